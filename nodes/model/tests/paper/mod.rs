//! The paper's tray and the waveforms of the tables on it.

use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, OptimalDesign, Waveform};

pub(crate) const T30: f64 = 1.0 / 30.0;
pub(crate) const M: f64 = 0.2 * G;

pub(crate) fn paper_track() -> AnnularTrack {
    AnnularTrack::new(TrayGeometry::PAPER, Friction::uniform(0.2).unwrap(), G).unwrap()
}

/// The waveform of Fig. 15: 9.0 m and 66.7 m rad/s² with m as a number.
pub(crate) fn fig15(period_s: f64) -> Waveform {
    Waveform::stick_slip(Axis::Yaw, period_s, 9.0 * M, 66.7 * M).unwrap()
}

/// The optimal waveform for the ramp of the paper's tray at a radius, limited as Fig. 15's.
pub(crate) fn optimal_at(radius_m: f64, period_s: f64) -> Waveform {
    optimal_on(TrayGeometry::PAPER.ramp_slope_rad(radius_m), radius_m, period_s)
}

pub(crate) fn optimal_on(slope_rad: f64, radius_m: f64, period_s: f64) -> Waveform {
    let design = OptimalDesign { friction: 0.2, slope_rad, gravity_m_s2: G, limit_m_s2: 66.7 * M * radius_m };
    Waveform::optimal(Axis::Yaw, period_s, &design).unwrap().scaled(1.0 / radius_m).unwrap()
}

pub(crate) fn pump(a: f64, z: f64) -> Waveform {
    Waveform::coulomb_pump(Axis::Yaw, T30, a, z).unwrap()
}
