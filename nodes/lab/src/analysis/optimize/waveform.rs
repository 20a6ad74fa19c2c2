//! `feeder-lab optimize waveform`.

use crate::design::{DesignedWaveform, WaveformGoal};
use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::waveform::{Axis, AxisLimits, Waveform};
use serde::Serialize;

use super::super::arguments::TrayArgs;
use super::{FrictionRange, SearchArgs, create_folder, write_yaml};

/// The best waveform for a slope, or for the ramp of a tray at a radius: nominal, and robust against friction.
///
/// Prints YAML. With --out, each waveform is also written to a file of its own, which --waveform and the waveform generator
/// read. `share_of_bound` compares with the proven bound for |a| limited alone.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Slope of a straight track, degrees; not with --radius.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, conflicts_with = "radius")]
    slope_deg: f64,
    /// Radius on the ramp of an annular tray, m: a waveform for yaw, with limits in rad.
    #[arg(long, allow_negative_numbers = true)]
    radius: Option<f64>,
    #[command(flatten)]
    tray: TrayArgs,
    #[command(flatten)]
    friction: FrictionRange,
    /// Period, s.
    #[arg(long, allow_negative_numbers = true)]
    period: f64,
    /// Largest acceleration, m/s² or rad/s².
    #[arg(long, allow_negative_numbers = true)]
    a_max: f64,
    /// Largest speed, m/s or rad/s.
    #[arg(long, default_value_t = f64::INFINITY, allow_negative_numbers = true)]
    max_speed: f64,
    /// Largest peak-to-peak travel, m or rad.
    #[arg(long, default_value_t = f64::INFINITY, allow_negative_numbers = true)]
    max_stroke: f64,
    /// Time the amplifier takes to change the acceleration, s.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    slew: f64,
    #[command(flatten)]
    search: SearchArgs,
}

#[derive(Debug, Serialize)]
struct WaveformReport {
    nominal: Option<Rated>,
    robust: Option<Rated>,
}

#[derive(Debug, Serialize)]
struct Rated {
    /// Whether it is the closed form, proven best.
    proven: bool,
    worst_feed_m_s: f64,
    bound_m_s: Option<f64>,
    share_of_bound: Option<f64>,
    frictions: Vec<f64>,
    feeds_m_s: Vec<f64>,
    stroke: f64,
    peak_speed: f64,
    waveform: Waveform,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let (axis, lever, slope_rad) = match args.radius {
        None => (Axis::X, 1.0, args.slope_deg.to_radians()),
        Some(radius_m) => {
            let tray = args.tray.geometry();
            let friction = Friction::uniform(args.friction.mu)?;
            AnnularTrack::new(tray, friction, args.friction.gravity)?.check_radius(radius_m)?;
            (Axis::Yaw, radius_m, tray.ramp_slope_rad(radius_m))
        }
    };
    let limits = AxisLimits { max_acceleration: args.a_max, max_speed: args.max_speed, max_stroke: args.max_stroke };
    let best = |frictions: Vec<f64>| -> Result<Option<Rated>> {
        let goal = WaveformGoal {
            axis,
            lever,
            slope_rad,
            gravity_m_s2: args.friction.gravity,
            frictions,
            period_s: args.period,
            limits,
            slew_s: args.slew,
        };
        let designed = goal.best(args.search.segments, args.search.effort())?;
        Ok(designed.map(|designed| rated(designed, goal.frictions)))
    };
    let report = WaveformReport { nominal: best(vec![args.friction.mu])?, robust: best(args.friction.robust()?)? };
    if let Some(folder) = &args.search.out {
        create_folder(folder)?;
        for (name, rated) in [("nominal", &report.nominal), ("robust", &report.robust)] {
            if let Some(rated) = rated {
                write_yaml(&folder.join(format!("waveform_{name}.yaml")), &rated.waveform)?;
            }
        }
        write_yaml(&folder.join("report.yaml"), &report)?;
    }
    print!("{}", serde_saphyr::to_string(&report)?);
    report.nominal.map(|_| ()).context("no waveform within these limits feeds forward")
}

fn rated(designed: DesignedWaveform, frictions: Vec<f64>) -> Rated {
    let DesignedWaveform { waveform, feeds_m_s, worst_feed_m_s, bound_m_s, proven } = designed;
    Rated {
        proven,
        worst_feed_m_s,
        bound_m_s,
        share_of_bound: bound_m_s.map(|bound| worst_feed_m_s / bound),
        frictions,
        feeds_m_s,
        stroke: waveform.stroke(),
        peak_speed: waveform.peak_speed(),
        waveform,
    }
}
