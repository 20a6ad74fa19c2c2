//! What the learner says of what it does and of what it measured.

use std::fmt;

use nalgebra::Complex;
use thiserror::Error;

/// What the learner does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LearningPhase {
    /// Nothing: no waveform runs, or learning is not enabled.
    #[default]
    Off,
    /// It measures the plant by a weak excitation.
    Measuring,
    /// It learns, or keeps what it has learned up to date.
    Learning,
    /// It has given up: feedback alone follows the waveform.
    GivenUp,
}

impl fmt::Display for LearningPhase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Measuring => "measuring",
            Self::Learning => "learning",
            Self::GivenUp => "given up",
        })
    }
}

/// What the driver says of a waveform that it runs, but not as it should.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum LearningWarning {
    /// Learning did worse than feedback alone, or asked for more force than there is.
    #[error(
        "learning the waveform made it worse and was given up; with feedback alone the velocity is off by {:.0} %: \
         parts are not fed as computed",
        100.0 * velocity_error
    )]
    GivenUp {
        /// Velocity off over velocity wanted, rms.
        velocity_error: f64,
    },
    /// The courier does not follow closely enough.
    #[error("the waveform is not followed, its velocity is off by {:.0} %: parts are not fed as computed", 100.0 * velocity_error)]
    NotFollowed {
        /// Velocity off over velocity wanted, rms.
        velocity_error: f64,
    },
    /// The plant answers otherwise than a rigid courier.
    #[error("the tray swings on its mounting near {frequency_hz:.0} Hz: parts may not be fed as computed")]
    Resonance {
        /// The frequency of the mode, Hz.
        frequency_hz: f64,
    },
    /// Forces disturb the courier, or seem to, that no courier has to overcome.
    #[error(
        "to follow the waveform the courier seems to have to overcome {:.0} % of its own acceleration: the sensor may be out of \
         calibration, and parts may not be fed as computed",
        100.0 * share
    )]
    Implausible {
        /// Acceleration that disturbances need, as a share of the waveform's own, rms.
        share: f64,
    },
}

/// What the learner reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearningReport {
    /// What it does.
    pub phase: LearningPhase,
    /// Velocity off over velocity wanted on the vibrating axis, rms over the last window; nothing before there is one.
    pub velocity_error: Option<f64>,
    /// What is wrong, if something is.
    pub warning: Option<LearningWarning>,
    /// Acceleration given over that commanded, as fitted.
    pub gain: f64,
    /// Time from a command to its first effect, as fitted, s.
    pub delay_s: f64,
    /// Time constant of the force, as fitted, s.
    pub lag_s: f64,
}

/// How the plant answers at one frequency, as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredResponse {
    /// The frequency, Hz.
    pub frequency_hz: f64,
    /// Position per acceleration commanded, m per m/s² or rad per rad/s².
    pub position: Complex<f64>,
    /// Standard deviation of that, relative.
    pub uncertainty: f64,
    /// The answer of the rigid plant that was fitted.
    pub rigid: Complex<f64>,
}
