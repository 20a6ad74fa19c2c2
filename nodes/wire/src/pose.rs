//! Poses in a horizontal plane.

use minifactory_msgs::geometry_msgs::msg::{Point, Pose, Quaternion};
use nalgebra::Isometry2;

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
    fn yaw_survives_the_quaternion() {
        for yaw_rad in [-3.0, -0.1, 0.0, 0.5, 3.1] {
            assert!((yaw_of_quaternion(&quaternion_of_yaw(yaw_rad)) - yaw_rad).abs() < 1e-12);
        }
    }
}
