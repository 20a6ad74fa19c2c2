//! The waveform as a message.

use feeder_model::waveform::{Axis, Segment, Waveform, WaveformError};
use minifactory_msgs::msg;

/// Why a message holds no waveform.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WaveformMessageError {
    /// A constant that the definition does not list.
    #[error("axis = {axis} is none of AXIS_X (0), AXIS_Y (1), AXIS_YAW (2)")]
    UnknownAxis {
        /// The value found.
        axis: u8,
    },
    /// A waveform that means nothing.
    #[error(transparent)]
    Waveform(#[from] WaveformError),
}

/// The message; header, sequence, name and `enabled` are left to the publisher.
#[must_use]
pub fn to_message(waveform: &Waveform) -> msg::Waveform {
    let segments = waveform.segments().iter();
    msg::Waveform {
        axis: match waveform.axis() {
            Axis::X => msg::Waveform::AXIS_X,
            Axis::Y => msg::Waveform::AXIS_Y,
            Axis::Yaw => msg::Waveform::AXIS_YAW,
        },
        period_s: waveform.period_s(),
        start_velocity: waveform.start_velocity(),
        segments: segments
            .map(|segment| msg::WaveformSegment { duration_s: segment.duration_s, acceleration: segment.acceleration })
            .collect(),
        ..msg::Waveform::default()
    }
}

/// The waveform of a message. Period and start velocity follow from the segments; what the message says of them is not
/// used.
///
/// # Errors
/// An unknown axis, or segments that make no waveform.
pub fn from_message(message: &msg::Waveform) -> Result<Waveform, WaveformMessageError> {
    let axis = match message.axis {
        msg::Waveform::AXIS_X => Axis::X,
        msg::Waveform::AXIS_Y => Axis::Y,
        msg::Waveform::AXIS_YAW => Axis::Yaw,
        axis => return Err(WaveformMessageError::UnknownAxis { axis }),
    };
    let segments = message
        .segments
        .iter()
        .map(|segment| Segment { duration_s: segment.duration_s, acceleration: segment.acceleration });
    Ok(Waveform::new(axis, segments.collect())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_waveform_survives_the_round_trip() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 0.1, 9.0, 66.7).unwrap();
        let message = to_message(&waveform);
        assert!((message.period_s - 0.1).abs() < 1e-15);
        assert_eq!(from_message(&message), Ok(waveform));
    }

    #[test]
    fn an_unknown_axis_is_named() {
        let message = msg::Waveform { axis: 9, ..msg::Waveform::default() };
        assert!(from_message(&message).unwrap_err().to_string().contains("axis = 9"));
    }
}
