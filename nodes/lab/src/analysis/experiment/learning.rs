//! `feeder-lab experiment learning`: feed of the learning courier over a grid of plants.

use std::f64::consts::PI;

use crate::experiment::feed::{FeedRun, FeedTrial};
use anyhow::Result;
use clap::Args as ClapArgs;
use feeder_control::courier::control::ControlParameters;
use feeder_control::courier::{CourierConfig, LearningParameters};
use feeder_scenario::{SimulatedCourier, assumed_motor};
use feeder_sim::motor::MotorParameters;
use indicatif::{ProgressBar, ProgressStyle};

/// How well the courier feeds that learns, from cold, on plants that differ from the one it reckons with.
///
/// The paper's waveform at 30 Hz, μ 0.2, 85 mm; feed on ramp and plateau over that of the waveform averaged over servo
/// ticks: mean of the seeds and largest deviation of a single run, in percent; error of velocity, mrad/s rms, and how
/// many times larger it is with PD alone and with PD and feed-forward.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Runs of each cell, with different noise.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Only the corners and the middle of the grid.
    #[arg(long)]
    coarse: bool,
    /// Highest frequency of the waveform that is run and learned, Hz; the driver's default if not given.
    #[arg(long)]
    cutoff_hz: Option<f64>,
}

/// A plant of the grid: factors on mass and delay, ripple, and offset of the centre of mass.
#[derive(Clone, Copy, Debug)]
struct Cell {
    mass: f64,
    delay: f64,
    ripple: f64,
    offset_m: f64,
}

impl Cell {
    fn motor(&self) -> MotorParameters {
        let assumed = assumed_motor();
        MotorParameters {
            mass_kg: assumed.mass_kg * self.mass,
            inertia_kg_m2: assumed.inertia_kg_m2 * self.mass,
            delay_s: assumed.delay_s * self.delay,
            ripple: self.ripple,
            // The whole ripple falls on the torque.
            ripple_phase_rad: [0.0, PI, 0.0, PI],
            center_of_mass_offset_m: [self.offset_m, 0.0],
            ..assumed
        }
    }
}

fn grid(coarse: bool) -> Vec<Cell> {
    let pick = |values: &[f64]| if coarse { vec![values[0], values[values.len() - 1]] } else { values.to_vec() };
    let mut cells = Vec::new();
    for mass in pick(&[0.8, 1.0, 1.2]) {
        for delay in pick(&[0.7, 1.0, 1.3]) {
            for offset_m in [0.0, 0.003] {
                for ripple in pick(&[0.0, 0.05, 0.1]) {
                    cells.push(Cell { mass, delay, ripple, offset_m });
                }
            }
        }
    }
    if coarse {
        cells.push(Cell { mass: 1.0, delay: 1.0, ripple: 0.05, offset_m: 0.0 });
    }
    cells
}

/// Mean of the runs, and the run that is farthest from 1.
fn spread(runs: &[FeedRun], pick: impl Fn(&FeedRun) -> f64) -> (f64, f64) {
    let mean = runs.iter().map(&pick).sum::<f64>() / runs.len() as f64;
    let worst = runs.iter().map(|run| (pick(run) - 1.0).abs()).fold(0.0, f64::max);
    (mean, worst)
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let base = SimulatedCourier { motor: assumed_motor(), ..SimulatedCourier::default() };
    let trial = FeedTrial::paper(base.config.servo_period_s);
    let [ramp, plateau] = trial.reference_m_s().map(|m_s| m_s * 1e3);
    println!("reference: ramp {ramp:.3} mm/s, plateau {plateau:.3} mm/s");
    println!("                          |         after 5 s           |         after 10 s          | velocity error");
    println!("                          |     ramp          plateau   |     ramp          plateau   |");
    println!(
        "mass delay ripple COM, mm | mean    worst   mean  worst | mean    worst   mean  worst | mrad/s  /PD /PD+FF"
    );
    let cells = grid(args.coarse);
    let bar = ProgressBar::new(cells.len() as u64);
    bar.set_style(ProgressStyle::with_template("[{bar:40}] {pos}/{len}")?.progress_chars("=> "));
    // What is off by most, over all cells: means after 5 s, single runs after 5 s, the same after 10 s.
    let mut extremes = [0.0_f64; 8];
    let (mut least_pd, mut least_feed_forward) = (f64::INFINITY, f64::INFINITY);
    for cell in cells {
        let motor = cell.motor();
        let cutoff_hz = args.cutoff_hz.unwrap_or(base.config.learning.cutoff_hz);
        let learning = LearningParameters { enabled: true, cutoff_hz, ..base.config.learning };
        let config = SimulatedCourier { motor, config: CourierConfig { learning, ..base.config } };
        let runs = (0..args.seeds).map(|seed| trial.run(config, seed)).collect::<Result<Vec<_>, _>>()?;
        let velocity_mrad_s = 1e3 * runs.iter().map(|run| run.velocity_error_rad_s).sum::<f64>() / runs.len() as f64;
        let plain = |feed_forward| {
            let control = ControlParameters { feed_forward, ..base.config.control };
            let run = trial.run(SimulatedCourier { motor, config: CourierConfig { control, ..base.config } }, 0)?;
            anyhow::Ok(1e3 * run.velocity_error_rad_s / velocity_mrad_s)
        };
        let (pd, feed_forward) = (plain(false)?, plain(true)?);
        (least_pd, least_feed_forward) = (least_pd.min(pd), least_feed_forward.min(feed_forward));
        let columns = [
            spread(&runs, |run| run.after_5_s[0]),
            spread(&runs, |run| run.after_5_s[1]),
            spread(&runs, |run| run.after_10_s[0]),
            spread(&runs, |run| run.after_10_s[1]),
        ];
        for (extreme, off) in
            extremes.iter_mut().zip(columns.iter().flat_map(|(mean, worst)| [(mean - 1.0).abs(), *worst]))
        {
            *extreme = extreme.max(off);
        }
        let [(r5, rw5), (p5, pw5), (r10, rw10), (p10, pw10)] = columns.map(|(mean, worst)| (mean, 100.0 * worst));
        let Cell { mass, delay, ripple, offset_m } = cell;
        bar.suspend(|| {
            println!(
                " {mass:.1}   {delay:.1}   {ripple:.2}     {:.0}   | {r5:.4} {rw5:5.2} %  {p5:.4} {pw5:4.2} % | \
                 {r10:.4} {rw10:5.2} %  {p10:.4} {pw10:4.2} % | {velocity_mrad_s:5.2} {pd:5.0} {feed_forward:5.0}",
                offset_m * 1e3
            );
        });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let [rm5, r5, pm5, p5, rm10, r10, pm10, p10] = extremes.map(|share| 100.0 * share);
    println!(
        "largest deviation of a mean:       after 5 s ramp {rm5:.2} %, plateau {pm5:.2} %; after 10 s {rm10:.2} %, {pm10:.2} %"
    );
    println!(
        "largest deviation of a single run: after 5 s ramp {r5:.2} %, plateau {p5:.2} %; after 10 s {r10:.2} %, {p10:.2} %"
    );
    println!(
        "velocity error: PD's is at least {least_pd:.0} times larger, PD and feed-forward's {least_feed_forward:.0} times"
    );
    Ok(())
}
