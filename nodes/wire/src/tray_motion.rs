//! Blocks of the tray's motion as messages.

use feeder_model::motion::{MotionBlock, MotionSample};
use minifactory_msgs::msg::TrayMotion;
use nalgebra::Vector3;

/// Arrays of one message that should be of one length.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} has {found} entries, but x_m has {expected}; one for each sample is needed")]
pub struct LengthsDiffer {
    /// The array.
    pub field: &'static str,
    /// Its length.
    pub found: usize,
    /// The length of `x_m`.
    pub expected: usize,
}

/// The message; header and sequence are left to the publisher.
#[must_use]
pub fn to_message(block: &MotionBlock) -> TrayMotion {
    let column = |value: fn(&MotionSample) -> f64| block.samples.iter().map(value).collect();
    TrayMotion {
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
        ..TrayMotion::default()
    }
}

/// The block of a message.
///
/// # Errors
/// Arrays of different lengths.
pub fn from_message(message: &TrayMotion) -> Result<MotionBlock, LengthsDiffer> {
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
            return Err(LengthsDiffer { field, found: column.len(), expected });
        }
    }
    let samples = (0..expected).map(|i| MotionSample {
        position: Vector3::new(message.x_m[i], message.y_m[i], message.yaw_rad[i]),
        velocity: Vector3::new(message.vx_m_s[i], message.vy_m_s[i], message.yaw_rate_rad_s[i]),
        acceleration: Vector3::new(message.ax_m_s2[i], message.ay_m_s2[i], message.yaw_acceleration_rad_s2[i]),
    });
    Ok(MotionBlock { sample_period_s: message.sample_period_s, samples: samples.collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_survives_the_round_trip() {
        let sample = MotionSample {
            position: Vector3::new(1.0, 2.0, 3.0),
            velocity: Vector3::new(4.0, 5.0, 6.0),
            acceleration: Vector3::new(7.0, 8.0, 9.0),
        };
        let block = MotionBlock { sample_period_s: 5e-4, samples: vec![sample; 3] };
        assert_eq!(from_message(&to_message(&block)), Ok(block));
    }

    #[test]
    fn ragged_motion_is_named() {
        let message = TrayMotion { x_m: vec![0.0; 3], ..TrayMotion::default() };
        assert!(from_message(&message).unwrap_err().to_string().contains("y_m has 0 entries"));
    }
}
