//! `feeder-lab feed-rate`: one part on one straight track.

use anyhow::Result;
use clap::{Args as ClapArgs, ValueEnum};
use feeder_model::mechanics::equations::{coulomb_pump_feed_m_s, stick_slip_feed_m_s};
use feeder_model::mechanics::slope::LinearTrack;
use feeder_model::waveform::Axis;
use serde::Serialize;

use super::arguments::{Asked, FrictionArgs, OptimalTrack, WaveformArgs};
use super::print_json;

/// Periods listed with --from-rest.
const LISTED_CYCLES: usize = 20;

/// How fast a waveform feeds a part along a track, as JSON.
///
/// `feed_m_s` is the mean speed along the slope in the steady state, null where parts slide down without end;
/// `equation_m_s` the closed form, null outside its validity; `cycles` the periods it took to find the steady state.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    #[command(flatten)]
    waveform: WaveformArgs,
    #[command(flatten)]
    friction: FrictionArgs,
    /// Slope of the track in the feed direction, degrees, less than 90 either way.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    slope_deg: f64,
    /// Also list the mean speed of each of the first 20 cycles of a part that starts at rest.
    #[arg(long)]
    from_rest: Option<RestIn>,
}

/// What a part is at rest relative to.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum RestIn {
    /// The floor, while the tray already vibrates.
    World,
    /// The tray.
    Tray,
}

#[derive(Debug, Serialize)]
struct FeedRateReport {
    feed_m_s: Option<f64>,
    equation_m_s: Option<f64>,
    stick_fraction: Option<f64>,
    min_normal_over_weight: f64,
    cycles: Option<u32>,
    stroke_m: f64,
    peak_speed_m_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    cycle_mean_m_s: Option<Vec<f64>>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let friction = args.friction.friction()?;
    let slope_rad = args.slope_deg.to_radians();
    let track = LinearTrack::new(friction, slope_rad, args.friction.gravity)?;
    let asked = args.waveform.asked()?;
    let optimal = OptimalTrack { friction: args.friction.mu, slope_rad, gravity_m_s2: args.friction.gravity };
    let waveform = asked.clone().build(Axis::X, &optimal, 1.0)?;
    let drive = track.drive(&waveform, 1.0)?;
    let steady = drive.steady();
    let cycle_mean_m_s = args.from_rest.map(|rest| {
        let start_m_s = match rest {
            RestIn::World => drive.world_rest_m_s(),
            RestIn::Tray => 0.0,
        };
        drive.cycle_means_m_s(start_m_s, LISTED_CYCLES)
    });
    print_json(&FeedRateReport {
        feed_m_s: steady.map(|steady| steady.feed_m_s),
        equation_m_s: equation_m_s(&asked, args, &optimal)?,
        stick_fraction: steady.map(|steady| steady.stick_fraction),
        min_normal_over_weight: drive.min_normal_over_weight(),
        cycles: steady.map(|steady| steady.cycles),
        stroke_m: waveform.stroke(),
        peak_speed_m_s: waveform.peak_speed(),
        cycle_mean_m_s,
    })
}

/// The closed form of the case, where there is one.
fn equation_m_s(asked: &Asked, args: &Args, optimal: &OptimalTrack) -> Result<Option<f64>> {
    let (friction, gravity) = (args.friction.friction()?, args.friction.gravity);
    let flat = args.slope_deg == 0.0;
    Ok(match *asked {
        Asked::StickSlip { period_s, a_min, a_max } if flat => {
            stick_slip_feed_m_s(period_s, a_min, a_max, &friction, gravity)
        }
        Asked::CoulombPump { period_s, a, z } if flat => coulomb_pump_feed_m_s(period_s, a, z, &friction, gravity),
        Asked::Optimal { period_s, a } => {
            // Its −A must break the part loose from rest, which static friction resists.
            let loose = OptimalTrack { friction: friction.static_coefficient(), ..*optimal };
            let breaks_loose = a > gravity * (loose.friction.atan() + loose.slope_rad).tan();
            let feed = optimal.design(a).best_feed_m_s(period_s)?;
            breaks_loose.then_some(feed)
        }
        _ => None,
    })
}
