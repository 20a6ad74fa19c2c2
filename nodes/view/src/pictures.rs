//! Pictures of the camera, with what the selector said of them.

use axum::body::Bytes;
use feeder_wire::{odometry, part_candidates};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::msg::PartCandidates;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::ns_of_stamp;
use minifactory_msgs::sensor_msgs::msg::CompressedImage;
use nalgebra::{Isometry2, Point3, Vector2};
use serde_json::{Value, json};

use crate::description::Feeder;
use crate::frame::{refusal_names, time_s};
use crate::numbers::{coarse, seconds};

/// Pictures wait so long for what the selector says of them, s of the run's clock.
const WAIT_S: f64 = 0.5;

/// Shows the pictures of one camera, each once.
#[derive(Default)]
pub(crate) struct PictureShow {
    shown_ns: u64,
}

impl PictureShow {
    /// The next picture to show: the one that the selector spoke of last, or the newest if it has been silent for long.
    pub(crate) fn next(
        &mut self,
        feeder: &Feeder,
        pictures: &[CompressedImage],
        candidates: Option<&PartCandidates>,
        odometry: &[Odometry],
    ) -> Option<Bytes> {
        let newest = pictures.last()?;
        let said = candidates.and_then(|candidates| {
            let picture = pictures.iter().find(|picture| picture.header.stamp == candidates.header.stamp)?;
            Some((picture, marks(feeder, candidates, odometry)))
        });
        let waited = |said_s: f64| time_s(&newest.header.stamp) - said_s > WAIT_S;
        let (picture, marks) = match said {
            Some((picture, marks)) if !waited(time_s(&picture.header.stamp)) => (picture, marks),
            _ if candidates.is_none_or(|candidates| waited(time_s(&candidates.header.stamp))) => (newest, Value::Null),
            _ => return None,
        };
        let stamp_ns = ns_of_stamp(&picture.header.stamp);
        if stamp_ns == std::mem::replace(&mut self.shown_ns, stamp_ns) {
            return None;
        }
        Some(message(feeder, picture, &marks))
    }
}

fn message(feeder: &Feeder, picture: &CompressedImage, marks: &Value) -> Bytes {
    let header = json!({
        "type": "picture",
        "feeder": feeder.name,
        "stamp_s": seconds(time_s(&picture.header.stamp)),
        "format": if picture.format.contains("png") { "png" } else { "jpeg" },
        "marks": marks,
    });
    let header = header.to_string().into_bytes();
    let length = u32::try_from(header.len()).unwrap_or_default();
    Bytes::from([length.to_le_bytes().as_slice(), &header, &picture.data].concat())
}

/// Where the courier was at a time: x, y and yaw, from the nearest odometry.
fn courier_at(stamp: &Time, odometry: &[Odometry]) -> Option<Isometry2<f64>> {
    let at_ns = ns_of_stamp(stamp);
    let nearest = odometry.iter().min_by_key(|message| ns_of_stamp(&message.header.stamp).abs_diff(at_ns))?;
    let place = odometry::from_message(nearest).position;
    Some(Isometry2::new(Vector2::new(place.x, place.y), place.z))
}

/// What the selector said, in pixels; nothing where it cannot be told where the tray was.
fn marks(feeder: &Feeder, candidates: &PartCandidates, odometry: &[Odometry]) -> Value {
    let (Some(platen_from_tray), Ok(seen)) =
        (courier_at(&candidates.header.stamp, odometry), part_candidates::from_message(candidates))
    else {
        return Value::Null;
    };
    let height_m = feeder.tray.plateau_height_m();
    let px_per_m = 1.0 / feeder.camera.m_per_px(height_m);
    let mark = |part: &part_candidates::SeenPart| {
        let place = platen_from_tray * nalgebra::Point2::from(part.position_in_tray_m);
        let pixel = feeder.camera.project(Point3::new(place.x, place.y, height_m))?;
        let yaw_rad = platen_from_tray.rotation.angle() + part.yaw_in_tray_rad;
        let heading = feeder.camera.image_from_platen() * Vector2::new(yaw_rad.cos(), yaw_rad.sin());
        Some(json!({
            "id": part.id,
            "u_px": coarse(pixel.x),
            "v_px": coarse(pixel.y),
            "radius_px": coarse(part.radius_m * px_per_m),
            "yaw_px_rad": coarse(heading.y.atan2(heading.x)),
            "may_be_picked": part.refusals.may_be_picked(),
            "pose_class": part.pose_class,
            "refusals": refusal_names(&part.refusals),
        }))
    };
    seen.iter().filter_map(mark).collect()
}
