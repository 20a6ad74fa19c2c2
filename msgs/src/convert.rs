//! Conversions between messages and the types of `feeder_core`.

use feeder_core::motion::{MotionBlock, MotionSample};
use feeder_core::waveform::{Axis, Segment, Waveform as CoreWaveform, WaveformError};
use nalgebra::{Isometry2, Vector3};

use crate::geometry_msgs::msg::{Point, Pose, Quaternion};
use crate::msg::{TrayMotion, Waveform, WaveformSegment};

/// Why a message has no counterpart in core.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConvertError {
    /// A constant that the definition does not list.
    #[error("axis = {axis} is none of AXIS_X (0), AXIS_Y (1), AXIS_YAW (2)")]
    UnknownAxis {
        /// The value found.
        axis: u8,
    },
    /// A waveform that means nothing.
    #[error(transparent)]
    Waveform(#[from] WaveformError),
    /// Arrays that should be of one length.
    #[error("{field} has {found} entries, but x_m has {expected}; one for each sample is needed")]
    Lengths {
        /// The array.
        field: &'static str,
        /// Its length.
        found: usize,
        /// The length of `x_m`.
        expected: usize,
    },
}

impl From<&CoreWaveform> for Waveform {
    /// Leaves header, sequence, name and `enabled` to the publisher.
    fn from(waveform: &CoreWaveform) -> Self {
        Self {
            axis: match waveform.axis() {
                Axis::X => Self::AXIS_X,
                Axis::Y => Self::AXIS_Y,
                Axis::Yaw => Self::AXIS_YAW,
            },
            period_s: waveform.period_s(),
            start_velocity: waveform.start_velocity(),
            segments: waveform
                .segments()
                .iter()
                .map(|segment| WaveformSegment { duration_s: segment.duration_s, acceleration: segment.acceleration })
                .collect(),
            ..Self::default()
        }
    }
}

impl TryFrom<&Waveform> for CoreWaveform {
    type Error = ConvertError;

    /// Period and start velocity follow from the segments; what the message says of them is not used.
    fn try_from(message: &Waveform) -> Result<Self, ConvertError> {
        let axis = match message.axis {
            Waveform::AXIS_X => Axis::X,
            Waveform::AXIS_Y => Axis::Y,
            Waveform::AXIS_YAW => Axis::Yaw,
            axis => return Err(ConvertError::UnknownAxis { axis }),
        };
        let segments = message
            .segments
            .iter()
            .map(|segment| Segment { duration_s: segment.duration_s, acceleration: segment.acceleration });
        Ok(Self::new(axis, segments.collect())?)
    }
}

impl From<&MotionBlock> for TrayMotion {
    /// Leaves header and sequence to the publisher.
    fn from(block: &MotionBlock) -> Self {
        let column = |value: fn(&MotionSample) -> f64| block.samples.iter().map(value).collect();
        Self {
            sample_period_s: block.sample_period_s,
            x_m: column(|sample| sample.position.x),
            y_m: column(|sample| sample.position.y),
            yaw_rad: column(|sample| sample.position.z),
            vx_m_s: column(|sample| sample.velocity.x),
            vy_m_s: column(|sample| sample.velocity.y),
            yaw_rate_rad_s: column(|sample| sample.velocity.z),
            ax_m_s2: column(|sample| sample.acceleration.x),
            ay_m_s2: column(|sample| sample.acceleration.y),
            yaw_acceleration_rad_s2: column(|sample| sample.acceleration.z),
            ..Self::default()
        }
    }
}

impl TryFrom<&TrayMotion> for MotionBlock {
    type Error = ConvertError;

    fn try_from(message: &TrayMotion) -> Result<Self, ConvertError> {
        let expected = message.x_m.len();
        for (field, column) in [
            ("y_m", &message.y_m),
            ("yaw_rad", &message.yaw_rad),
            ("vx_m_s", &message.vx_m_s),
            ("vy_m_s", &message.vy_m_s),
            ("yaw_rate_rad_s", &message.yaw_rate_rad_s),
            ("ax_m_s2", &message.ax_m_s2),
            ("ay_m_s2", &message.ay_m_s2),
            ("yaw_acceleration_rad_s2", &message.yaw_acceleration_rad_s2),
        ] {
            if column.len() != expected {
                return Err(ConvertError::Lengths { field, found: column.len(), expected });
            }
        }
        let samples = (0..expected).map(|i| MotionSample {
            position: Vector3::new(message.x_m[i], message.y_m[i], message.yaw_rad[i]),
            velocity: Vector3::new(message.vx_m_s[i], message.vy_m_s[i], message.yaw_rate_rad_s[i]),
            acceleration: Vector3::new(message.ax_m_s2[i], message.ay_m_s2[i], message.yaw_acceleration_rad_s2[i]),
        });
        Ok(Self { sample_period_s: message.sample_period_s, samples: samples.collect() })
    }
}

/// A turn about z by `yaw_rad`.
#[must_use]
pub fn quaternion_of_yaw(yaw_rad: f64) -> Quaternion {
    let (z, w) = (0.5 * yaw_rad).sin_cos();
    Quaternion { x: 0.0, y: 0.0, z, w }
}

/// The turn about z that a quaternion makes, rad, −π to π.
#[must_use]
pub fn yaw_of_quaternion(q: &Quaternion) -> f64 {
    (2.0 * (q.w * q.z + q.x * q.y)).atan2(1.0 - 2.0 * (q.y * q.y + q.z * q.z))
}

/// A pose in a horizontal plane at height `z_m`.
#[must_use]
pub fn planar_pose(x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64) -> Pose {
    Pose { position: Point { x: x_m, y: y_m, z: z_m }, orientation: quaternion_of_yaw(yaw_rad) }
}

/// What a pose is in the horizontal plane.
#[must_use]
pub fn planar_isometry(pose: &Pose) -> Isometry2<f64> {
    Isometry2::new([pose.position.x, pose.position.y].into(), yaw_of_quaternion(&pose.orientation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_waveform_survives_the_round_trip() {
        let waveform = CoreWaveform::stick_slip(Axis::Yaw, 0.1, 9.0, 66.7).unwrap();
        let message = Waveform::from(&waveform);
        assert!((message.period_s - 0.1).abs() < 1e-15);
        assert_eq!(CoreWaveform::try_from(&message), Ok(waveform));
    }

    #[test]
    fn an_unknown_axis_and_ragged_motion_are_named() {
        let message = Waveform { axis: 9, ..Waveform::default() };
        assert!(CoreWaveform::try_from(&message).unwrap_err().to_string().contains("axis = 9"));
        let message = TrayMotion { x_m: vec![0.0; 3], ..TrayMotion::default() };
        assert!(MotionBlock::try_from(&message).unwrap_err().to_string().contains("y_m has 0 entries"));
    }

    #[test]
    fn motion_survives_the_round_trip() {
        let sample = MotionSample {
            position: Vector3::new(1.0, 2.0, 3.0),
            velocity: Vector3::new(4.0, 5.0, 6.0),
            acceleration: Vector3::new(7.0, 8.0, 9.0),
        };
        let block = MotionBlock { sample_period_s: 5e-4, samples: vec![sample; 3] };
        assert_eq!(MotionBlock::try_from(&TrayMotion::from(&block)), Ok(block));
    }

    #[test]
    fn yaw_survives_the_quaternion() {
        for yaw_rad in [-3.0, -0.1, 0.0, 0.5, 3.1] {
            assert!((yaw_of_quaternion(&quaternion_of_yaw(yaw_rad)) - yaw_rad).abs() < 1e-12);
        }
    }
}
