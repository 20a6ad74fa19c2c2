//! `feeder-lab experiment fig6` and `fig8`: the paper's rig with the courier in the loop.

use std::path::{Path, PathBuf};

use crate::experiment::rig::{Recording, Rig};
use crate::identify::kinetic_friction;
use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use feeder_control::courier::control::ControlParameters;
use feeder_control::courier::{CourierConfig, LearningParameters};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::slope::LinearTrack;
use feeder_model::waveform::Waveform;
use feeder_scenario::{SimulatedCourier, assumed_motor};

use super::super::chart::{Chart, Series};
use super::super::identify;
use super::super::paper::{MU, fig6_waveform, fig8_waveform};

/// How long the mean feed is taken over, s.
const FEED_OVER_S: f64 = 1.0;
/// How long the last part of the run that is drawn, s.
const DRAWN_S: f64 = 0.5;
/// The controller whose recording is kept and whose speeds are drawn.
const SHOWN: &str = "PD 40 Hz";

/// Which of the paper's experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Figure {
    Six,
    Eight,
}

/// How the rig is run.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Folder for the charts (SVG, CSV) and two recordings (bags) for `feeder-lab identify-friction`; made if need be.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Friction between block and tray.
    #[arg(long, default_value_t = MU, allow_negative_numbers = true)]
    mu: f64,
    /// Noise of the interferometer's velocities, m/s rms (assumed).
    #[arg(long, default_value_t = 0.5e-3, allow_negative_numbers = true)]
    noise: f64,
    /// Simulated time of each run, s.
    #[arg(long, default_value_t = 8.0, allow_negative_numbers = true)]
    duration: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Figure {
    fn stem(self) -> &'static str {
        match self {
            Self::Six => "fig06",
            Self::Eight => "fig08",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Six => "Fig. 6: stick-slip, T 0.05 s, 1.6 and 10.1 m/s²",
            Self::Eight => "Fig. 8: Coulomb pump, T 0.05 s, 10.3 m/s², z 0.37",
        }
    }

    fn waveform(self) -> Result<Waveform> {
        match self {
            Self::Six => fig6_waveform(),
            Self::Eight => fig8_waveform(),
        }
    }

    /// What the paper measured, mm/s.
    fn measured_mm_s(self) -> f64 {
        match self {
            Self::Six => 12.4,
            Self::Eight => 22.5,
        }
    }
}

/// The controllers tried: the paper's PD over bandwidths, PD with feed-forward, and learning.
fn controllers() -> Vec<(String, SimulatedCourier)> {
    let base = CourierConfig::default();
    let with_motor = |config| SimulatedCourier { config, motor: assumed_motor() };
    // The paper's controller had neither integral nor feed-forward; its gains are not published.
    let pd = |bandwidth_hz: f64, feed_forward: bool| {
        let control = ControlParameters {
            bandwidth_hz,
            damping_ratio: 0.9,
            velocity_filter_hz: 500.0,
            integral_time_s: 0.0,
            feed_forward,
        };
        with_motor(CourierConfig { control, ..base })
    };
    // The rig's flat tray is one with its courier.
    let learning = LearningParameters { enabled: true, cutoff_hz: 930.0, ..base.learning };
    let bandwidths = (25..=60).step_by(5).map(f64::from);
    let mut controllers: Vec<_> = bandwidths.map(|hz| (format!("PD {hz} Hz"), pd(hz, false))).collect();
    controllers.push(("PD 40 Hz + feed-forward".to_owned(), pd(40.0, true)));
    controllers.push(("learning".to_owned(), with_motor(CourierConfig { learning, ..base })));
    controllers
}

pub(crate) fn run(figure: Figure, args: &Args) -> Result<()> {
    let waveform = figure.waveform()?;
    let friction = Friction::uniform(args.mu)?;
    let ideal = LinearTrack::new(friction, 0.0, STANDARD_GRAVITY_M_S2)?.drive(&waveform, 1.0)?;
    let ideal_mm_s = ideal.steady().map_or(f64::NAN, |steady| steady.feed_m_s * 1e3);
    println!("{}, μ {}", figure.title(), args.mu);
    println!(
        "{:<24} {:>12} {:>8} {:>18} {:>22}",
        "controller", "feed (mm/s)", "/ ideal", "v error (mm/s rms)", "identified μ"
    );
    let mut runs = Vec::new();
    for (name, courier) in controllers() {
        let rig = Rig { courier, waveform: waveform.clone(), friction, velocity_noise_m_s: args.noise };
        let recording = rig.run(args.duration, args.seed)?;
        let feed_mm_s = recording.feed_m_s(FEED_OVER_S) * 1e3;
        let found = kinetic_friction(&recording.samples, STANDARD_GRAVITY_M_S2);
        let found = found.map_or_else(
            |error| error.to_string(),
            |found| {
                format!(
                    "{:.4} ± {:.4} ({:+.2} %)",
                    found.kinetic,
                    found.standard_error,
                    100.0 * (found.kinetic / args.mu - 1.0)
                )
            },
        );
        let ratio = feed_mm_s / ideal_mm_s;
        println!("{name:<24} {feed_mm_s:>12.2} {ratio:>8.3} {:>18.2} {found:>22}", recording.velocity_error_m_s * 1e3);
        runs.push((name, feed_mm_s, recording));
    }
    println!("{:<24} {ideal_mm_s:>12.2} {:>8.3}", "ideal tray", 1.0);
    let pd = runs.iter().filter(|(name, ..)| name.starts_with("PD") && name.ends_with("Hz")).map(|(_, feed, _)| *feed);
    let (low, high) = pd.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), feed| (low.min(feed), high.max(feed)));
    let measured = figure.measured_mm_s();
    let place = if measured < low {
        "below"
    } else if measured > high {
        "above"
    } else {
        "within"
    };
    println!(
        "PD from 25 to 60 Hz feeds {low:.1} to {high:.1} mm/s; the {measured} mm/s measured in the paper lie {place} it."
    );
    match &args.out {
        Some(folder) => write(figure, folder, &runs, ideal_mm_s),
        None => Ok(()),
    }
}

fn write(figure: Figure, folder: &Path, runs: &[(String, f64, Recording)], ideal_mm_s: f64) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let stem = figure.stem();
    let measured = figure.measured_mm_s();
    let straight = |name: String, mm_s: f64| Series::line(name, vec![(0.0, 0.0), (DRAWN_S, mm_s * DRAWN_S)]);
    let mut travel: Vec<_> = runs.iter().map(|(name, _, recording)| Series::line(name, travel_mm(recording))).collect();
    travel.push(straight(format!("measured in the paper: {measured} mm/s"), measured));
    travel.push(straight(format!("ideal tray: {ideal_mm_s:.1} mm/s"), ideal_mm_s));
    let chart = Chart {
        title: format!("{}: travel of the block relative to the tray", figure.title()),
        x: "time, s".into(),
        y: "travel, mm".into(),
        series: travel,
    };
    chart.write(folder, &format!("{stem}_travel"))?;
    for (name, _, recording) in runs.iter().filter(|(name, ..)| name == SHOWN || name == "learning") {
        let drawn = last(&recording.samples, recording, 0.15);
        let start_s = drawn.first().map_or(0.0, |sample| sample.time_s);
        let chart = Chart {
            title: format!("{}: velocities, {name}", figure.title()),
            x: "time, s".into(),
            y: "velocity in the world, m/s".into(),
            series: vec![
                Series::line("tray", drawn.iter().map(|sample| (sample.time_s - start_s, sample.tray_m_s)).collect()),
                Series::line("block", drawn.iter().map(|sample| (sample.time_s - start_s, sample.part_m_s)).collect()),
            ],
        };
        let word = if name == SHOWN { "pd" } else { "learning" };
        chart.write(folder, &format!("{stem}_velocities_{word}"))?;
        identify::write_bag(&folder.join(format!("{stem}_recording_{word}")), &recording.samples)?;
    }
    println!("{}", folder.display());
    Ok(())
}

/// The end of what was recorded.
fn last<'a, T>(values: &'a [T], recording: &Recording, duration_s: f64) -> &'a [T] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred")]
    let ticks = (duration_s / recording.sample_period_s).round() as usize;
    &values[values.len().saturating_sub(ticks)..]
}

fn travel_mm(recording: &Recording) -> Vec<(f64, f64)> {
    let drawn = last(&recording.travel_m, recording, DRAWN_S);
    let start_m = drawn.first().copied().unwrap_or_default();
    let time_s = |index: usize| index as f64 * recording.sample_period_s;
    drawn.iter().enumerate().map(|(index, travel_m)| (time_s(index), (travel_m - start_m) * 1e3)).collect()
}
