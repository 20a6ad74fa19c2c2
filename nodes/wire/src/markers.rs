//! What viewers draw without knowing the feeder: tray, parts and what the selector says of them, as markers.
//!
//! Shapes go as lists of triangles: a viewer has them from the topic alone, while a mesh that a marker or a URDF names must
//! be a file that the viewer's machine can open, and the tray's shape is the scenario's. Each message holds everything that
//! there is and begins with the removal of all before it, so that a message that is lost leaves nothing behind.

use feeder_model::camera::{MountedTray, single};
use minifactory_msgs::geometry_msgs::msg::{Point, Pose, Quaternion, Vector3};
use minifactory_msgs::std_msgs::msg::{ColorRGBA, Header};
use minifactory_msgs::visualization_msgs::msg::{Marker, MarkerArray};
use nalgebra::{Isometry3, Point3, Vector2};

use crate::part_candidates::SeenPart;

/// Corners of a ring.
const RING_CORNERS: u32 = 24;
/// Width of a ring's line, m.
const LINE_M: f64 = 0.0004;
/// A ring's radius over that of its part.
const RING_RATIO: f64 = 1.25;
/// A ring lies this far above the plateau, m.
const RING_HEIGHT_M: f64 = 0.0003;

/// A colour as the page's style sheet states it, red, green and blue.
pub type Rgb = u32;

/// The tray's running surface and walls.
pub const TRAY: Rgb = 0x00a9_b6be;
/// A part that may be picked.
pub const PICK: Rgb = 0x0000_9e73;
/// A part that is seen and may not be picked.
pub const SEEN: Rgb = 0x00e6_9f00;
/// A part whose pose is not known.
pub const UNSURE: Rgb = 0x00cc_79a7;
/// Resting poses that are wanted, and those that are not, in the order of the part's poses; the last stands for all that
/// follow. They are of Okabe and Ito's palette too, and none is one of those above.
pub const WANTED_POSE: Rgb = 0x0000_72b2;
/// See [`WANTED_POSE`].
pub const OTHER_POSES: [Rgb; 3] = [0x00d5_5e00, 0x0056_b4e9, 0x00f0_e442];

/// The tray.
#[must_use]
pub fn tray(header: &Header, tray: &MountedTray) -> MarkerArray {
    array(header, [triangles(header, "tray", 0, &Isometry3::identity(), &tray.triangles(), TRAY)])
}

/// A part as it lies.
#[derive(Clone, Debug)]
pub struct LyingPart<'a> {
    /// Its number.
    pub id: u32,
    /// From the part as it would lie on a level floor, its centre of mass at the origin, to the tray's frame.
    pub tray_from_lying: Isometry3<f64>,
    /// The part as it would lie so, m.
    pub triangles_m: &'a [[Point3<f64>; 3]],
    /// The colour of its pose.
    pub colour: Rgb,
}

/// The parts that are there.
#[must_use]
pub fn parts<'a>(header: &Header, parts: impl IntoIterator<Item = LyingPart<'a>>) -> MarkerArray {
    let marker =
        |part: LyingPart| triangles(header, "parts", part.id, &part.tray_from_lying, part.triangles_m, part.colour);
    array(header, parts.into_iter().map(marker))
}

/// The colour of each of a part's resting poses.
#[must_use]
pub fn pose_colours(poses: usize, wanted: &[usize]) -> Vec<Rgb> {
    let mut others = OTHER_POSES.into_iter();
    let mut other = || others.next().unwrap_or(OTHER_POSES[OTHER_POSES.len() - 1]);
    (0..poses).map(|pose| if wanted.contains(&pose) { WANTED_POSE } else { other() }).collect()
}

/// What the selector says of a part, as a colour.
fn verdict(part: &SeenPart) -> Rgb {
    match &part.pose_class {
        _ if part.refusals.may_be_picked() => PICK,
        Some(_) => SEEN,
        None => UNSURE,
    }
}

/// The parts that the selector sees, on a plateau this high above the tray's origin, m.
#[must_use]
pub fn candidates(header: &Header, plateau_m: f64, parts: &[SeenPart]) -> MarkerArray {
    let marker = |(index, part): (u32, &SeenPart)| {
        let radius_m = RING_RATIO * part.radius_m;
        let around = |corner: u32, ratio: f64| {
            let angle_rad = part.yaw_in_tray_rad + std::f64::consts::TAU * f64::from(corner) / f64::from(RING_CORNERS);
            let (sin, cos) = angle_rad.sin_cos();
            let at = part.position_in_tray_m + ratio * radius_m * Vector2::new(cos, sin);
            Point { x: at.x, y: at.y, z: plateau_m + RING_HEIGHT_M }
        };
        // The line begins outside the ring, where the part's yaw points.
        let points = std::iter::once(around(0, 1.3)).chain((0..=RING_CORNERS).map(|corner| around(corner, 1.0)));
        Marker {
            scale: Vector3 { x: LINE_M, y: 0.0, z: 0.0 },
            points: points.collect(),
            ..marker(header, "candidates", index, Marker::LINE_STRIP, verdict(part))
        }
    };
    array(header, (0..).zip(parts).map(marker))
}

/// All that there is, in place of all that was.
fn array(header: &Header, markers: impl IntoIterator<Item = Marker>) -> MarkerArray {
    let none = Marker { header: header.clone(), action: Marker::DELETEALL, ..Marker::default() };
    MarkerArray { markers: std::iter::once(none).chain(markers).collect() }
}

fn triangles(
    header: &Header,
    group: &str,
    id: u32,
    pose: &Isometry3<f64>,
    triangles_m: &[[Point3<f64>; 3]],
    colour: Rgb,
) -> Marker {
    let (at, turn) = (pose.translation.vector, pose.rotation.coords);
    let point = |corner: &Point3<f64>| Point { x: corner.x, y: corner.y, z: corner.z };
    Marker {
        pose: Pose {
            position: Point { x: at.x, y: at.y, z: at.z },
            orientation: Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
        },
        scale: Vector3 { x: 1.0, y: 1.0, z: 1.0 },
        points: triangles_m.iter().flatten().map(point).collect(),
        ..marker(header, group, id, Marker::TRIANGLE_LIST, colour)
    }
}

/// A marker that moves with its frame between messages.
fn marker(header: &Header, group: &str, id: u32, kind: i32, colour: Rgb) -> Marker {
    Marker {
        header: header.clone(),
        ns: group.to_owned(),
        // Numbers only tell markers apart.
        id: id.cast_signed(),
        r#type: kind,
        action: Marker::ADD,
        color: to_color(colour),
        frame_locked: true,
        ..Marker::default()
    }
}

fn to_color(colour: Rgb) -> ColorRGBA {
    let [_, r, g, b] = colour.to_be_bytes().map(|byte| single(f64::from(byte) / 255.0));
    ColorRGBA { r, g, b, a: 1.0 }
}

#[cfg(test)]
mod tests {
    use feeder_model::part::Refusals;

    use super::*;

    fn header() -> Header {
        Header { frame_id: "feeder/tray".to_owned(), ..Header::default() }
    }

    fn seen(pose_class: Option<&str>, refusals: Refusals) -> SeenPart {
        SeenPart {
            id: 7,
            position_in_tray_m: Vector2::new(-0.02, -0.05),
            yaw_in_tray_rad: 0.3,
            pose_class: pose_class.map(str::to_owned),
            confidence: 0.9,
            radius_m: 0.0025,
            part_gap_m: 0.01,
            wall_gap_m: 0.02,
            refusals,
        }
    }

    #[test]
    fn every_message_begins_with_the_removal_of_the_last() {
        for sent in [candidates(&header(), 0.02, &[]), parts(&header(), [])] {
            let [first] = &sent.markers[..] else { panic!("{sent:?}") };
            assert_eq!((first.action, first.header.frame_id.as_str()), (Marker::DELETEALL, "feeder/tray"));
        }
    }

    #[test]
    fn a_ring_lies_about_its_part_in_the_colour_of_what_is_said() {
        let near = Refusals { part_too_near: true, ..Refusals::default() };
        let unsure = Refusals { pose_unsure: true, ..Refusals::default() };
        let all = [seen(Some("hole_up"), Refusals::default()), seen(Some("hole_up"), near), seen(None, unsure)];
        let sent = candidates(&header(), 0.02, &all);
        let colours: Vec<ColorRGBA> = sent.markers[1..].iter().map(|marker| marker.color).collect();
        assert_eq!(colours, [PICK, SEEN, UNSURE].map(to_color));
        for point in &sent.markers[1].points[1..] {
            let from_m = (point.x + 0.02).hypot(point.y + 0.05);
            assert!((from_m - RING_RATIO * 0.0025).abs() < 1e-12 && point.z > 0.02, "{point:?}");
        }
    }

    #[test]
    fn poses_are_told_apart_by_colour() {
        assert_eq!(pose_colours(3, &[1]), [OTHER_POSES[0], WANTED_POSE, OTHER_POSES[1]]);
        assert_eq!(pose_colours(6, &[0])[4..], [OTHER_POSES[2]; 2]);
        let Marker { color, .. } = marker(&header(), "parts", 0, Marker::CUBE, 0x00ff_8000);
        assert!((color.r - 1.0).abs() < 1e-6 && (color.g - 128.0 / 255.0).abs() < 1e-6 && color.b == 0.0, "{color:?}");
    }
}
