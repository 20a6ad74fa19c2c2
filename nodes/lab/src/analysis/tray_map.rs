//! `feeder-lab tray-map`: how fast parts travel at each radius of an annular tray.

use anyhow::Result;
use clap::Args as ClapArgs;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::waveform::Axis;
use serde::Serialize;

use super::arguments::{FrictionArgs, OptimalTrack, TrayArgs, WaveformArgs};
use super::print_json;

/// How fast a yaw waveform feeds parts on ramp and plateau at each radius of an annular tray, as JSON.
///
/// Angular speeds are relative to the tray, in the steady state, null where parts slide down the ramp without end.
/// `radial_drift_m_s` is the mean outward speed on the ramp. `critical_radius_m` is the outermost radius at which the
/// feed on the ramp crosses zero, null where none lies on the tray.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    #[command(flatten)]
    tray: TrayArgs,
    #[command(flatten)]
    waveform: WaveformArgs,
    #[command(flatten)]
    friction: FrictionArgs,
    /// Radii to report, m, separated by commas.
    #[arg(long, value_name = "R[,R…]", value_delimiter = ',', allow_negative_numbers = true)]
    radius: Vec<f64>,
    /// Radius at which an optimal waveform is optimal on the ramp, m [default: the outer radius].
    #[arg(long, allow_negative_numbers = true)]
    design_radius: Option<f64>,
}

#[derive(Debug, Serialize)]
struct TrayMapReport {
    radii: Vec<RadiusReport>,
    critical_radius_m: Option<f64>,
}

#[derive(Debug, Serialize)]
struct RadiusReport {
    radius_m: f64,
    ramp_rad_s: Option<f64>,
    plateau_rad_s: Option<f64>,
    radial_drift_m_s: Option<f64>,
    plateau_radial_drift_m_s: Option<f64>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let tray = args.tray.geometry();
    let track = AnnularTrack::new(tray, args.friction.friction()?, args.friction.gravity)?;
    let design_radius_m = args.design_radius.unwrap_or(tray.outer_radius_m);
    track.check_radius(design_radius_m)?;
    let optimal = OptimalTrack {
        friction: args.friction.mu,
        slope_rad: tray.ramp_slope_rad(design_radius_m),
        gravity_m_s2: args.friction.gravity,
    };
    let waveform = args.waveform.asked()?.build(Axis::Yaw, &optimal, design_radius_m)?;
    let map = TrayMap::new(&track, &waveform)?;
    let radii = args.radius.iter().map(|&radius_m| {
        let feed = map.at(radius_m)?;
        Ok(RadiusReport {
            radius_m,
            ramp_rad_s: feed.ramp.map(|ramp| ramp.rate_rad_s),
            plateau_rad_s: feed.plateau.map(|plateau| plateau.rate_rad_s),
            radial_drift_m_s: feed.ramp.map(|ramp| ramp.radial_drift_m_s),
            plateau_radial_drift_m_s: feed.plateau.map(|plateau| plateau.radial_drift_m_s),
        })
    });
    print_json(&TrayMapReport { radii: radii.collect::<Result<_>>()?, critical_radius_m: map.critical_radius_m()? })
}
