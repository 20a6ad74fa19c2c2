//! The experiments and simulations of the paper, in numbers.

use anyhow::Result;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, Waveform};

/// Friction of the paper's simulations.
pub(super) const MU: f64 = 0.2;
/// Period of Figs 11 to 15, s.
pub(super) const SHORT_PERIOD_S: f64 = 1.0 / 30.0;
/// Period of the experiments in Figs 6 and 8, s.
pub(super) const LONG_PERIOD_S: f64 = 0.05;

/// μ g for the paper's friction, m/s².
pub(super) fn mu_g() -> f64 {
    MU * STANDARD_GRAVITY_M_S2
}

/// The waveform of the stick-slip experiment, Fig. 6.
pub(super) fn fig6_waveform() -> Result<Waveform> {
    Ok(Waveform::stick_slip(Axis::X, LONG_PERIOD_S, 1.6, 10.1)?)
}

/// The waveform of the Coulomb pump experiment, Fig. 8.
pub(super) fn fig8_waveform() -> Result<Waveform> {
    Ok(Waveform::coulomb_pump(Axis::X, LONG_PERIOD_S, 10.3, 0.37)?)
}

/// The waveform of the simulated tray, Fig. 15: 9.0 m and 66.7 m rad/s² with m = μ g as a number.
pub(super) fn fig15_waveform() -> Result<Waveform> {
    Ok(Waveform::stick_slip(Axis::Yaw, SHORT_PERIOD_S, 9.0 * mu_g(), 66.7 * mu_g())?)
}

/// The tray of Fig. 15 for parts of some friction.
pub(super) fn tray(mu: f64) -> Result<AnnularTrack> {
    Ok(AnnularTrack::new(TrayGeometry::PAPER, Friction::uniform(mu)?, STANDARD_GRAVITY_M_S2)?)
}
