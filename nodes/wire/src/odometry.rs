//! What a driver knows of its courier's motion, as odometry.

use minifactory_msgs::nav_msgs::msg::Odometry;
use nalgebra::{Rotation2, Vector3};

use crate::pose::{self, UprightPose};

/// Variance of what is not estimated: z, roll and pitch, which the platen holds. A large number is how the drivers of ROS
/// say so.
const NOT_ESTIMATED: f64 = 1e6;

/// Places of z, roll and pitch on the diagonal of a message's covariance, whose rows are x, y, z, roll, pitch, yaw.
const NOT_ESTIMATED_AT: [usize; 3] = [14, 21, 28];

/// Motion of a courier in the platen frame as estimated: (x, y, yaw) in m and rad, m/s and rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EstimatedMotion {
    /// Position.
    pub position: Vector3<f64>,
    /// Velocity.
    pub velocity: Vector3<f64>,
    /// Variance of the position, m² and rad².
    pub position_variance: Vector3<f64>,
    /// Variance of the velocity, (m/s)² and (rad/s)².
    pub velocity_variance: Vector3<f64>,
}

/// The message; header and child frame are left to the publisher. The twist is in the courier's own frame, as the message
/// defines it.
#[must_use]
pub fn to_message(motion: &EstimatedMotion) -> Odometry {
    let EstimatedMotion { position, velocity, position_variance, velocity_variance } = *motion;
    let mut message = Odometry::default();
    let (x_m, y_m, yaw_rad) = (position.x, position.y, position.z);
    message.pose.pose = pose::to_message(&UprightPose { x_m, y_m, z_m: 0.0, yaw_rad });
    let twist = Rotation2::new(-position.z) * velocity.xy();
    (message.twist.twist.linear.x, message.twist.twist.linear.y) = (twist.x, twist.y);
    message.twist.twist.angular.z = velocity.z;
    for index in NOT_ESTIMATED_AT {
        message.pose.covariance[index] = NOT_ESTIMATED;
        message.twist.covariance[index] = NOT_ESTIMATED;
    }
    for (index, variance) in [0, 7, 35].into_iter().zip(&position_variance) {
        message.pose.covariance[index] = *variance;
    }
    let (sin, cos) = position.z.sin_cos();
    let (along_x, along_y) = (velocity_variance.x, velocity_variance.y);
    message.twist.covariance[0] = cos * cos * along_x + sin * sin * along_y;
    message.twist.covariance[7] = sin * sin * along_x + cos * cos * along_y;
    message.twist.covariance[1] = sin * cos * (along_y - along_x);
    message.twist.covariance[6] = message.twist.covariance[1];
    message.twist.covariance[35] = velocity_variance.z;
    message
}

/// The motion of a message.
#[must_use]
pub fn from_message(message: &Odometry) -> EstimatedMotion {
    let twist = &message.twist.twist;
    let UprightPose { x_m, y_m, yaw_rad, .. } = pose::from_message(&message.pose.pose);
    let velocity = Rotation2::new(yaw_rad) * Vector3::new(twist.linear.x, twist.linear.y, 0.0).xy();
    let (sin, cos) = yaw_rad.sin_cos();
    let (pose, twist_variance) = (&message.pose.covariance, &message.twist.covariance);
    let (ahead, aside, both) = (twist_variance[0], twist_variance[7], 2.0 * sin * cos * twist_variance[1]);
    EstimatedMotion {
        position: Vector3::new(x_m, y_m, yaw_rad),
        velocity: Vector3::new(velocity.x, velocity.y, twist.angular.z),
        position_variance: Vector3::new(pose[0], pose[7], pose[35]),
        velocity_variance: Vector3::new(
            cos * cos * ahead + sin * sin * aside - both,
            sin * sin * ahead + cos * cos * aside + both,
            twist_variance[35],
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOTION: EstimatedMotion = EstimatedMotion {
        position: Vector3::new(0.1, -0.2, 0.5),
        velocity: Vector3::new(1.0, 2.0, -3.0),
        position_variance: Vector3::new(1.0, 2.0, 3.0),
        velocity_variance: Vector3::new(4.0, 5.0, 6.0),
    };

    #[test]
    fn estimated_motion_survives_the_round_trip() {
        let back = from_message(&to_message(&MOTION));
        assert!((back.position - MOTION.position).norm() < 1e-12, "{back:?}");
        assert!((back.velocity - MOTION.velocity).norm() < 1e-12, "{back:?}");
        assert_eq!(back.position_variance, MOTION.position_variance);
        assert!((back.velocity_variance - MOTION.velocity_variance).norm() < 1e-12, "{back:?}");
    }

    #[test]
    fn a_courier_turned_by_a_quarter_goes_sideways_in_its_own_frame() {
        let turned = Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let message = to_message(&EstimatedMotion { position: turned, ..MOTION });
        let linear = &message.twist.twist.linear;
        assert!((linear.x - 2.0).abs() < 1e-12 && (linear.y + 1.0).abs() < 1e-12, "{linear:?}");
        assert!((message.twist.covariance[0] - 5.0).abs() < 1e-12);
        for (index, variance) in [0, 7, 14, 21, 28, 35].into_iter().zip([1.0, 2.0, 1e6, 1e6, 1e6, 3.0]) {
            assert!((message.pose.covariance[index] - variance).abs() < 1e-12, "{index}");
        }
    }
}
