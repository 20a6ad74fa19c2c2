//! What the driver says, in standard messages.

use feeder_core::courier::{AXES, DriverStatus};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::convert::{planar_pose, quaternion_of_yaw};
use minifactory_msgs::geometry_msgs::msg::{Transform, TransformStamped, Vector3};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::tf2_msgs::msg::TFMessage;

/// Names of the feeder's frames.
pub(crate) struct Names {
    courier: String,
    tray: String,
}

impl Names {
    pub(crate) fn new(feeder: &str) -> Self {
        Self { courier: format!("{feeder}/courier"), tray: format!("{feeder}/tray") }
    }

    /// Pose of the courier on the platen, and its velocity in the courier's own frame, as the message defines it.
    pub(crate) fn odometry(&self, stamp: Time, status: &DriverStatus) -> Odometry {
        let (position, velocity) = (status.position, status.velocity);
        let (sin, cos) = position.z.sin_cos();
        let mut message = Odometry {
            header: Header { stamp, frame_id: "platen".to_owned() },
            child_frame_id: self.courier.clone(),
            ..Odometry::default()
        };
        message.pose.pose = planar_pose(position.x, position.y, 0.0, position.z);
        message.twist.twist.linear.x = cos * velocity.x + sin * velocity.y;
        message.twist.twist.linear.y = cos * velocity.y - sin * velocity.x;
        message.twist.twist.angular.z = velocity.z;
        message
    }

    /// Where the courier is on the platen.
    pub(crate) fn transforms(&self, stamp: Time, status: &DriverStatus) -> TFMessage {
        let translation = Vector3 { x: status.position.x, y: status.position.y, z: 0.0 };
        let transform = Transform { translation, rotation: quaternion_of_yaw(status.position.z) };
        let header = Header { stamp, frame_id: "platen".to_owned() };
        TFMessage { transforms: vec![TransformStamped { header, child_frame_id: self.courier.clone(), transform }] }
    }

    /// How the tray sits on the courier.
    pub(crate) fn static_transforms(&self, stamp: Time, tray_height_m: f64) -> TFMessage {
        let translation = Vector3 { x: 0.0, y: 0.0, z: tray_height_m };
        let transform = Transform { translation, rotation: quaternion_of_yaw(0.0) };
        let header = Header { stamp, frame_id: self.courier.clone() };
        TFMessage { transforms: vec![TransformStamped { header, child_frame_id: self.tray.clone(), transform }] }
    }
}

/// Position and velocity of the courier's three axes.
pub(crate) fn joint_states(stamp: Time, status: &DriverStatus) -> JointState {
    JointState {
        header: Header { stamp, frame_id: String::new() },
        name: AXES.map(str::to_owned).to_vec(),
        position: status.position.iter().copied().collect(),
        velocity: status.velocity.iter().copied().collect(),
        effort: Vec::new(),
    }
}
