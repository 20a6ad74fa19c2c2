//! Poses of what stands upright: a place, and a turn about z.

use minifactory_msgs::geometry_msgs::msg::{Point, Pose, Quaternion};

/// A pose that is turned about z alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UprightPose {
    /// Place along x, m.
    pub x_m: f64,
    /// Place along y, m.
    pub y_m: f64,
    /// Height, m.
    pub z_m: f64,
    /// Turn about z, rad; −π to π in one that was read from a message.
    pub yaw_rad: f64,
}

/// The pose as a message.
#[must_use]
pub fn to_message(pose: &UprightPose) -> Pose {
    let (z, w) = (0.5 * pose.yaw_rad).sin_cos();
    Pose { position: Point { x: pose.x_m, y: pose.y_m, z: pose.z_m }, orientation: Quaternion { x: 0.0, y: 0.0, z, w } }
}

/// The pose of a message; what its quaternion tips it over is left out.
#[must_use]
pub fn from_message(message: &Pose) -> UprightPose {
    let (place, q) = (&message.position, &message.orientation);
    let yaw_rad = (2.0 * (q.w * q.z + q.x * q.y)).atan2(1.0 - 2.0 * (q.y * q.y + q.z * q.z));
    UprightPose { x_m: place.x, y_m: place.y, z_m: place.z, yaw_rad }
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        /// Any pose.
        pub(crate) fn poses()(
            (x_m, y_m, z_m) in (-5.0..5.0_f64, -5.0..5.0_f64, -5.0..5.0_f64),
            yaw_rad in -3.1..3.1_f64,
        ) -> UprightPose {
            UprightPose { x_m, y_m, z_m, yaw_rad }
        }
    }

    /// Whether two poses are the same but for the rounding of the yaw.
    pub(crate) fn same(a: &UprightPose, b: &UprightPose) -> bool {
        (a.x_m, a.y_m, a.z_m) == (b.x_m, b.y_m, b.z_m) && (a.yaw_rad - b.yaw_rad).abs() < 1e-12
    }

    proptest! {
        #[test]
        fn a_pose_survives_the_round_trip(sent in poses()) {
            let came = from_message(&to_message(&sent));
            prop_assert!(same(&came, &sent), "{:?}", came);
        }
    }

    #[test]
    fn a_quarter_turn_to_the_left_is_positive() {
        let message = to_message(&UprightPose { yaw_rad: std::f64::consts::FRAC_PI_2, ..UprightPose::default() });
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((message.orientation.z - half).abs() < 1e-12 && (message.orientation.w - half).abs() < 1e-12);
    }
}
