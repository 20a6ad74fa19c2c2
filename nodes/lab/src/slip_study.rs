//! `feeder-lab slip-study`: how far parts slide in many random moves, with the whole simulator.

use feeder_control::courier::{CourierConfig, LearningParameters};
use feeder_control::delivery::{GentleParameters, MovePlanner, Policy, ramp_parts};
use feeder_model::seed::generator;
use feeder_scenario::{Scenario, SimulatedCourier, SimulatedDriver, assumed_motor};
use feeder_sim::parts::{Part, PartBulk};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::Serialize;
use std::f64::consts::{PI, TAU};
use std::time::Instant;

/// Carry parts through random moves on a motor with delay, lag, ripple and noise, and print how far they slid as JSON.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// How many moves
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    moves: u32,
    /// Seed of the moves and of the motor's noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Share of the acceleration that friction holds which is used
    #[arg(long, allow_negative_numbers = true, default_value_t = GentleParameters::default().friction_share)]
    friction_share: f64,
}

/// What came of it.
#[derive(Debug, Serialize)]
struct Study {
    moves: u32,
    friction_share: f64,
    /// Parts followed, over all moves.
    parts: u64,
    /// Largest displacement of any protected part within its move, µm.
    slip_um_max: f64,
    /// The displacement that 99 % of the parts stay below, µm.
    slip_um_p99: f64,
    /// Parts displaced by more than 10 µm.
    over_10_um: u64,
    /// Mean time to plan a move, µs of wall time.
    planning_us_mean: f64,
    /// Mean duration of a move over its jerk-limited bound.
    duration_over_bound_mean: f64,
    /// The same for one move at 1.2 times what friction holds: largest displacement, µm.
    slip_um_at_1_2: f64,
}

/// Moves after which the motor is set up afresh and learns its waveform again.
const MOVES_PER_MOTOR: u32 = 50;
/// Vibration before the moves, s: the time it takes to learn the waveform.
const LEARNING_S: f64 = 3.0;
/// Radius from which on parts on the ramp are protected, m, as in the built-in scenario.
const RAMP_RADIUS_M: f64 = 0.06;

/// Runs the study and prints it.
///
/// # Errors
/// An argument out of its range, or a move that cannot be made.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string_pretty(&study(args)?)?);
    Ok(())
}

fn study(args: &Args) -> anyhow::Result<Study> {
    let scenario = Scenario::default();
    let mut random = generator(args.seed, "slip-study");
    let mut bench = Bench::new(&scenario, args.friction_share, args.seed)?;
    let (mut slips_um, mut planning_s, mut over_bound) = (Vec::new(), 0.0, 0.0);
    for index in 0..args.moves {
        if index > 0 && index % MOVES_PER_MOTOR == 0 {
            bench = Bench::new(&scenario, args.friction_share, args.seed + u64::from(index))?;
        }
        let policy = if index % 2 == 0 { Policy::Selected } else { Policy::All };
        let moved = bench.carry(&scenario, policy, &mut random)?;
        slips_um.extend(moved.slips_um);
        planning_s += moved.planning_s;
        over_bound += moved.over_bound;
    }
    slips_um.sort_by(f64::total_cmp);
    let too_fast = Bench::new(&scenario, 1.2, args.seed)?.carry(&scenario, Policy::Selected, &mut random)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let p99 = ((slips_um.len() as f64 * 0.99) as usize).min(slips_um.len() - 1);
    Ok(Study {
        moves: args.moves,
        friction_share: args.friction_share,
        parts: slips_um.len() as u64,
        slip_um_max: slips_um[slips_um.len() - 1],
        slip_um_p99: slips_um[p99],
        over_10_um: slips_um.iter().filter(|slip_um| **slip_um > 10.0).count() as u64,
        planning_us_mean: planning_s / f64::from(args.moves) * 1e6,
        duration_over_bound_mean: over_bound / f64::from(args.moves),
        slip_um_at_1_2: too_fast.slips_um.into_iter().fold(0.0, f64::max),
    })
}

/// A motor that has learned its waveform, and a planner for it.
struct Bench {
    driver: SimulatedDriver,
    planner: MovePlanner,
    at: Vector3<f64>,
}

/// What came of a move.
struct Moved {
    slips_um: Vec<f64>,
    planning_s: f64,
    over_bound: f64,
}

impl Bench {
    fn new(scenario: &Scenario, friction_share: f64, seed: u64) -> anyhow::Result<Self> {
        let config = CourierConfig {
            learning: LearningParameters { enabled: true, ..LearningParameters::default() },
            start: Vector3::zeros(),
            ..scenario.courier
        };
        let mut driver = SimulatedCourier { config, motor: assumed_motor() }.driver(seed)?;
        let waveform = scenario.waveform()?;
        driver.set_waveform(&waveform, true)?;
        run_for(&mut driver, LEARNING_S);
        driver.set_waveform(&waveform, false)?;
        while !driver.step(20).status.at_rest() {}
        driver.motor_mut().take_block();
        let friction = scenario.part_type()?.friction.static_coefficient();
        let gentle = GentleParameters { friction, friction_share, ..GentleParameters::default() };
        let planner = MovePlanner::new(gentle, scenario.tray.geometry, config.limits, config.load)?;
        Ok(Self { driver, planner, at: Vector3::zeros() })
    }

    /// Puts parts onto the tray and carries them to a random place, with a random turn.
    fn carry(&mut self, scenario: &Scenario, policy: Policy, random: &mut Pcg64Mcg) -> anyhow::Result<Moved> {
        let part = scenario.part_type()?;
        let settings = scenario.bulk_settings(&part)?;
        let mut bulk = PartBulk::new(scenario.tray.geometry, part, settings, random.random())?;
        put(&mut bulk, 3, (0.065, 0.086), (PI + 0.2, TAU - 0.2), random);
        let mut protected: Vec<Vector2<f64>> = bulk.parts().iter().map(Part::position_m).collect();
        if policy == Policy::All {
            put(&mut bulk, 6, (RAMP_RADIUS_M + 0.002, 0.086), (0.2, PI - 0.2), random);
            protected.extend(ramp_parts(bulk.tray(), RAMP_RADIUS_M));
        }
        let before: Vec<Part> = bulk.parts().to_vec();
        let to = loop {
            let to = Vector3::new(
                random.random_range(-0.45..0.45),
                random.random_range(-0.45..0.45),
                // The waveform that is kept ready needs some of the 2° for itself.
                random.random_range(-0.02..0.02),
            );
            if (to - self.at).xy().norm() > 0.02 {
                break to;
            }
        };
        let started = Instant::now();
        let plan = self.planner.plan(self.at, to, &protected)?;
        let planning_s = started.elapsed().as_secs_f64();
        self.driver.execute(1, &plan.trajectory())?;
        let mut slips_um = vec![0.0_f64; before.len()];
        loop {
            let step = self.driver.step(20);
            bulk.step(&self.driver.motor_mut().take_block())?;
            for (slip_um, (part, start)) in slips_um.iter_mut().zip(bulk.parts().iter().zip(&before)) {
                *slip_um = slip_um.max((part.position_m() - start.position_m()).norm() * 1e6);
            }
            if step.status.at_rest() {
                self.at = step.status.nominal_position;
                return Ok(Moved { slips_um, planning_s, over_bound: plan.duration_s / plan.jerk_bound_s });
            }
        }
    }
}

/// Puts parts at random places of a sector, clear of each other.
fn put(bulk: &mut PartBulk, count: usize, radii_m: (f64, f64), angles_rad: (f64, f64), random: &mut Pcg64Mcg) {
    let mut placed = 0;
    while placed < count {
        let radius_m = random.random_range(radii_m.0..radii_m.1);
        let angle_rad = random.random_range(angles_rad.0..angles_rad.1);
        placed += usize::from(bulk.put(radius_m, angle_rad, 0.0, 0).is_ok());
    }
}

fn run_for(driver: &mut SimulatedDriver, time_s: f64) {
    let mut ran_s = 0.0;
    while ran_s < time_s {
        ran_s = driver.step(20).status.time_s;
    }
}
