//! `feeder-lab good-parts`: how many good parts a minute a feeder delivers, beside an oracle with the same feed and moves.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use clap::ValueEnum;
use feeder::up::{self, UpArgs};
use feeder_scenario::{Scenario, Station, WaveformSpec};
use run_monitor::{FeederProgress, Oracle};

use crate::whole_run::whole_run;

/// Deliver parts in several set-ups, a run for each seed, and print good parts a minute beside what an oracle would have made
/// of the same feed and moves
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Set-ups to run; all without
    #[arg(value_enum)]
    setups: Vec<Setup>,
    /// Scenario (YAML) from which the set-ups start: its part, tray, waveform, load; without it the built-in one
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Runs of each set-up, with the seeds from --first-seed on
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// The first seed
    #[arg(long, default_value_t = 1)]
    first_seed: u64,
    /// Simulated seconds of each run
    #[arg(long, default_value_t = 600.0, allow_negative_numbers = true, value_name = "SECONDS")]
    duration: f64,
    /// Parts in the feeder, kept there by a hopper, instead of those of the set-up
    #[arg(long, value_name = "COUNT")]
    parts: Option<u32>,
    /// Period of the waveform, instead of that of the set-up, s; only for a waveform that has one
    #[arg(long, allow_negative_numbers = true, value_name = "SECONDS")]
    period: Option<f64>,
    /// Requests that each manipulator keeps open, instead of those of the set-up
    #[arg(long, value_name = "COUNT")]
    goals: Option<u32>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// Who takes parts where, out of how many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Setup {
    /// The scenario as it is, its load kept up by a hopper
    AsGiven,
    /// A manipulator 0.2 m away with one request open; 20 parts
    OneGoal,
    /// A manipulator 0.2 m away with four requests open; 40 parts
    FourGoals,
    /// The same; 80 parts
    Crowd,
    /// A manipulator above the plateau of the feeding place, four requests open; 80 parts
    Near,
    /// Four manipulators round the feeding place, a picture each 50 ms, decisions after 30 ms; 80 parts
    FourArms,
}

impl Setup {
    /// A word on it, with the load.
    fn words(self, scenario: &Scenario) -> String {
        let place = match self {
            Self::AsGiven => "as given".to_owned(),
            Self::OneGoal | Self::FourGoals | Self::Crowd => "0.2 m away".to_owned(),
            Self::Near => "at the feeding place".to_owned(),
            Self::FourArms => "4 arms, 50 ms, 30 ms".to_owned(),
        };
        let goals: u32 = scenario.stations.iter().map(|station| station.manipulator.goals_open).sum();
        format!("{place} | {goals} | {} {}", scenario.parts_loaded, scenario.waveform.name())
    }

    /// The scenario so set up.
    fn of(self, args: &Args, mut scenario: Scenario) -> anyhow::Result<Scenario> {
        let (parts, goals, places_m): (u32, u32, &[[f64; 2]]) = match self {
            Self::AsGiven => (scenario.parts_loaded, 0, &[]),
            Self::OneGoal => (20, 1, &[[0.2, 0.0]]),
            Self::FourGoals => (40, 4, &[[0.2, 0.0]]),
            Self::Crowd => (80, 4, &[[0.2, 0.0]]),
            Self::Near => (80, 4, &[[0.0, -0.06]]),
            Self::FourArms => (80, 1, &[[0.06, 0.03], [-0.06, 0.03], [-0.06, -0.09], [0.06, -0.09]]),
        };
        if let ([_, ..], Some(first)) = (places_m, scenario.stations.first().cloned()) {
            let home_m = scenario.delivery.feeding_place;
            let station = |(index, place_m): (usize, &[f64; 2])| Station {
                name: format!("station_{}", index + 1),
                x_m: home_m.x + place_m[0],
                y_m: home_m.y + place_m[1],
                ..first.clone()
            };
            scenario.stations = places_m.iter().enumerate().map(station).collect();
        }
        for station in &mut scenario.stations {
            let set_up = if goals > 0 { goals } else { station.manipulator.goals_open };
            station.manipulator.goals_open = args.goals.unwrap_or(set_up);
        }
        if self == Self::FourArms {
            scenario.camera.period_ms = 50;
            scenario.time.feedback_delay_ticks = 30 / scenario.time.tick_ms.max(1);
        }
        scenario.parts_loaded = args.parts.unwrap_or(parts);
        scenario.refill_below = scenario.parts_loaded;
        if let Some(wanted_s) = args.period {
            match &mut scenario.waveform {
                WaveformSpec::StickSlip { period_s, .. } => *period_s = Some(wanted_s),
                WaveformSpec::CoulombPump { period_s, .. } | WaveformSpec::Optimal { period_s, .. } => {
                    *period_s = wanted_s;
                }
                WaveformSpec::Segments { .. } => anyhow::bail!("--period: a waveform of segments has its own"),
            }
        }
        scenario.with_duration_s(args.duration).context("--duration")
    }
}

/// One run.
struct Outcome {
    per_min: f64,
    oracle: Option<Oracle>,
    wrong_pose: u32,
    slip_m: f64,
    failed: u32,
}

impl Outcome {
    /// Of the first feeder of a run.
    fn of(feeder: &FeederProgress, duration_s: f64) -> Self {
        Self {
            per_min: 60.0 * f64::from(feeder.delivered) / duration_s,
            oracle: feeder.oracle(),
            wrong_pose: feeder.wrong_pose_delivered,
            slip_m: feeder.max_slip_m.unwrap_or(0.0),
            failed: feeder.failed_by_outcome.iter().sum(),
        }
    }

    fn share(&self) -> Option<f64> {
        self.oracle.map(|oracle| self.per_min / oracle.per_minute())
    }
}

/// Runs every set-up and prints a table.
///
/// # Errors
/// A scenario that cannot run, or a run that does not come to its end.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let stop = up::stop_on_signals()?;
    let setups = if args.setups.is_empty() { Setup::value_variants() } else { &args.setups };
    println!(
        "| Station | Goals | Parts, waveform | Parts a minute (least, most) | An oracle's | Share (least) | q 1/s | M s | c s \
         | Wrong | Slip µm | Failed |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for setup in setups {
        let given = up::load_scenario(&UpArgs { scenario: args.scenario.clone(), ..UpArgs::default() })?;
        let scenario = setup.of(args, given)?;
        let outcomes = outcomes(args, &scenario, &stop)?;
        println!("{}", row(&setup.words(&scenario), &outcomes));
    }
    Ok(())
}

/// A run for each seed.
fn outcomes(args: &Args, scenario: &Scenario, stop: &Arc<AtomicBool>) -> anyhow::Result<Vec<Outcome>> {
    let options = UpArgs { domain: args.domain, composed: true, plain: true, ..UpArgs::default() };
    let mut outcomes = Vec::new();
    for seed in args.first_seed..args.first_seed + args.seeds {
        let (_, progress) = whole_run(&Scenario { seed, ..scenario.clone() }.plan()?, &options, stop)?;
        let feeder = progress.feeders.first().context("the run has no feeder")?;
        outcomes.push(Outcome::of(feeder, args.duration));
    }
    Ok(outcomes)
}

fn row(words: &str, outcomes: &[Outcome]) -> String {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let rates: Vec<f64> = outcomes.iter().map(|outcome| outcome.per_min).collect();
    let oracles: Vec<Oracle> = outcomes.iter().filter_map(|outcome| outcome.oracle).collect();
    let of_oracles = |value: fn(&Oracle) -> f64| mean(&oracles.iter().map(value).collect::<Vec<_>>());
    let shares: Vec<f64> = outcomes.iter().filter_map(Outcome::share).collect();
    let further: Vec<f64> = oracles.iter().filter_map(|oracle| oracle.further_stop_s).collect();
    let count = |value: fn(&Outcome) -> u32| outcomes.iter().map(value).sum::<u32>();
    let cells = [
        format!("{:.1} ({:.1}, {:.1})", mean(&rates), least(&rates), most(&rates)),
        format!("{:.1}", of_oracles(Oracle::per_minute)),
        format!("{:.2} ({:.2})", mean(&shares), least(&shares)),
        format!("{:.2}", of_oracles(|oracle| oracle.right_per_s)),
        format!("{:.2}", of_oracles(|oracle| oracle.moves_s)),
        if further.is_empty() { "–".to_owned() } else { format!("{:.2}", mean(&further)) },
        count(|outcome| outcome.wrong_pose).to_string(),
        format!("{:.1}", 1e6 * most(&outcomes.iter().map(|outcome| outcome.slip_m).collect::<Vec<_>>())),
        count(|outcome| outcome.failed).to_string(),
    ];
    format!("| {words} | {} |", cells.join(" | "))
}
