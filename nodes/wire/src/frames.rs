//! Frames as the messages of `/tf` and `/tf_static` hold them.

use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::geometry_msgs::msg::{Quaternion, Transform, TransformStamped, Vector3};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

/// The platen's frame, z up.
pub const PLATEN: &str = "platen";

/// The frames of the slides that the courier's joints along x and along y move: it has none, but a tree of joints has.
#[must_use]
pub fn courier_slides(feeder: &str) -> [String; 2] {
    [format!("{feeder}/courier_x"), format!("{feeder}/courier_y")]
}

/// The frame that moves with a feeder's courier.
#[must_use]
pub fn courier(feeder: &str) -> String {
    format!("{feeder}/courier")
}

/// The frame that moves with a feeder's tray: ψ = 0 at the foot of the ramp.
#[must_use]
pub fn tray(feeder: &str) -> String {
    format!("{feeder}/tray")
}

/// The frame of a feeder's camera: z along the view, x to the right of the image.
#[must_use]
pub fn camera(feeder: &str) -> String {
    format!("{feeder}/camera_optical")
}

/// The frame of a station's tool: where its axis meets the height of the plateau.
#[must_use]
pub fn tool(station: &str) -> String {
    format!("{station}/tool")
}

/// The frame that goes up and down with a station's tool.
#[must_use]
pub fn tool_slide(station: &str) -> String {
    format!("{station}/tool_slide")
}

/// The frame that moves with the tip of a station's gripper.
#[must_use]
pub fn gripper(station: &str) -> String {
    format!("{station}/gripper")
}

/// A turn about z by `yaw_rad` and a place (x, y, z), m, in the parent's frame.
#[must_use]
pub fn upright(x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
    Isometry3::from_parts(Translation3::new(x_m, y_m, z_m), turn)
}

/// A message that says where a frame is in another.
#[must_use]
pub fn to_message(stamp: Time, parent: &str, child: &str, parent_from_child: &Isometry3<f64>) -> TFMessage {
    chain(stamp, parent, [(child, *parent_from_child)])
}

/// A message that says where each of some frames is in the one before it; the first is in `root`.
#[must_use]
pub fn chain<'a>(stamp: Time, root: &'a str, frames: impl IntoIterator<Item = (&'a str, Isometry3<f64>)>) -> TFMessage {
    let mut parent = root;
    let transform = |(child, parent_from_child): (&'a str, Isometry3<f64>)| {
        let (t, q) = (parent_from_child.translation.vector, parent_from_child.rotation.coords);
        let transform = Transform {
            translation: Vector3 { x: t.x, y: t.y, z: t.z },
            rotation: Quaternion { x: q.x, y: q.y, z: q.z, w: q.w },
        };
        let header = Header { stamp, frame_id: std::mem::replace(&mut parent, child).to_owned() };
        TransformStamped { header, child_frame_id: child.to_owned(), transform }
    };
    TFMessage { transforms: frames.into_iter().map(transform).collect() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Where a child's frame is in its parent's.
    fn from_transform(transform: &Transform) -> Isometry3<f64> {
        let (t, q) = (&transform.translation, &transform.rotation);
        let turn = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
        Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), turn)
    }

    proptest! {
        #[test]
        fn a_frame_survives_the_round_trip(
            place in prop::array::uniform3(-5.0..5.0_f64),
            turn in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let sent = Isometry3::new(place.into(), turn.into());
            let message = to_message(Time::default(), PLATEN, "tool", &sent);
            let stamped = &message.transforms[0];
            prop_assert_eq!((stamped.header.frame_id.as_str(), stamped.child_frame_id.as_str()), ("platen", "tool"));
            let came = from_transform(&stamped.transform);
            prop_assert!((came.translation.vector - sent.translation.vector).norm() < 1e-12);
            prop_assert!(came.rotation.angle_to(&sent.rotation) < 1e-6);
        }
    }

    #[test]
    fn an_upright_frame_turns_about_z() {
        let frame = upright(1.0, 2.0, 3.0, std::f64::consts::FRAC_PI_2);
        let point = frame * nalgebra::Point3::new(1.0, 0.0, 0.0);
        assert!((point.coords - nalgebra::Vector3::new(1.0, 3.0, 3.0)).norm() < 1e-12);
    }
}
