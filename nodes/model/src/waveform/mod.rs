//! Periodic vibration of the tray as piecewise-constant acceleration.
//!
//! A [`Waveform`] repeats without net motion: its velocity and its position both have zero mean over the period, so it
//! can run on top of any other motion of the courier. The files: `shapes` holds the shapes of the paper and the optimal
//! one, `kinematics` the motion that follows by integration, `reshape` what servo and amplifier make of it, and
//! `limits` the check against what the courier can do.

mod kinematics;
mod limits;
mod reshape;
mod shapes;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::OutOfRange;
use kinematics::Knot;

pub use kinematics::AxisState;
pub use limits::{AxisLimits, LimitExceeded};
pub use shapes::OptimalDesign;

/// The courier axis a waveform drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Translation along the platen's x; accelerations in m/s².
    X,
    /// Translation along the platen's y; accelerations in m/s².
    Y,
    /// Rotation about the tray's centre; accelerations in rad/s².
    Yaw,
}

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Acceleration: m/s² on X and Y, rad/s² on Yaw.
    pub acceleration: f64,
}

/// One period of a vibration: segments of constant acceleration on one axis, without net change of velocity.
///
/// Lengths, speeds and accelerations are in m, m/s and m/s² on X and Y, in rad, rad/s and rad/s² on Yaw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Description", into = "Description")]
pub struct Waveform {
    axis: Axis,
    segments: Vec<Segment>,
    /// Motion at the start of each segment, and at the end of the period.
    knots: Vec<Knot>,
}

/// A waveform as it stands in a file, before it is checked.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Description {
    /// The axis it drives.
    axis: Axis,
    /// Segments of constant acceleration, in order.
    segments: Vec<Segment>,
}

impl TryFrom<Description> for Waveform {
    type Error = WaveformError;

    fn try_from(description: Description) -> Result<Self, WaveformError> {
        Self::new(description.axis, description.segments)
    }
}

impl From<Waveform> for Description {
    fn from(waveform: Waveform) -> Self {
        Self { axis: waveform.axis, segments: waveform.segments }
    }
}

/// Why a waveform was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WaveformError {
    /// A parameter has no meaning at its value.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// There is nothing to repeat.
    #[error("a waveform needs at least one segment")]
    Empty,
    /// A segment has no meaning.
    #[error("segment {index}: {source}")]
    Segment {
        /// Position of the segment, from 0.
        index: usize,
        /// What is wrong with it.
        source: OutOfRange,
    },
    /// The velocity at the end of the period differs from that at its start.
    #[error(
        "the segments change the velocity by {change} in each period; \
         allowed: 0 within {allowed} (acceleration times duration must add up to 0)"
    )]
    NotClosed {
        /// Net change of velocity in a period.
        change: f64,
        /// Largest magnitude taken for rounding.
        allowed: f64,
    },
}

impl Waveform {
    /// Net change of velocity taken for rounding, as a share of the total variation of velocity in a period.
    pub const CLOSING_TOLERANCE: f64 = 1e-9;

    /// A waveform of arbitrary segments.
    ///
    /// # Errors
    ///
    /// [`WaveformError`] if there is no segment, if a duration is not positive and finite or an acceleration is not
    /// finite, or if the segments change the velocity by more than [`Self::CLOSING_TOLERANCE`] of its variation.
    pub fn new(axis: Axis, segments: Vec<Segment>) -> Result<Self, WaveformError> {
        if segments.is_empty() {
            return Err(WaveformError::Empty);
        }
        for (index, segment) in segments.iter().enumerate() {
            OutOfRange::unless_positive("duration_s", segment.duration_s)
                .and_then(|_| OutOfRange::unless(true, "acceleration", segment.acceleration, "finite"))
                .map_err(|source| WaveformError::Segment { index, source })?;
        }
        let change: f64 = segments.iter().map(|s| s.acceleration * s.duration_s).sum();
        let variation: f64 = segments.iter().map(|s| s.acceleration.abs() * s.duration_s).sum();
        let allowed = variation * Self::CLOSING_TOLERANCE;
        if change.abs() > allowed {
            return Err(WaveformError::NotClosed { change, allowed });
        }
        let knots = kinematics::knots(&segments);
        Ok(Self { axis, segments, knots })
    }

    /// The driven axis.
    #[must_use]
    pub fn axis(&self) -> Axis {
        self.axis
    }

    /// The segments in order; their durations add up to the period.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_does_not_close() {
        let error = Waveform::new(
            Axis::X,
            vec![Segment { duration_s: 0.01, acceleration: 1.0 }, Segment { duration_s: 0.01, acceleration: -0.9 }],
        )
        .unwrap_err();
        assert!(matches!(error, WaveformError::NotClosed { change, .. } if (change - 0.001).abs() < 1e-12), "{error}");
    }

    #[test]
    fn refuses_bad_segments_by_index_parameter_and_range() {
        for (duration_s, acceleration, word) in [
            (0.0, 1.0, "duration_s"),
            (-1.0, 1.0, "duration_s"),
            (f64::NAN, 1.0, "duration_s"),
            (0.1, f64::NAN, "acceleration"),
        ] {
            let segments = vec![Segment { duration_s: 0.1, acceleration: 0.0 }, Segment { duration_s, acceleration }];
            let text = Waveform::new(Axis::Yaw, segments).unwrap_err().to_string();
            assert!(text.starts_with("segment 1: ") && text.contains(word) && text.contains("range"), "{text}");
        }
        assert_eq!(Waveform::new(Axis::X, vec![]), Err(WaveformError::Empty));
    }
}
