//! What viewers draw from topics alone: links and joints of the URDF are those of `/tf` and `joint_states`, markers are
//! where parts and candidates are, and both together give a picture of the feeder.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use feeder_runtime::dds::{NodeName, Participant, Reader};
use feeder_runtime::node::ns_of_stamp;
use feeder_wire::topics;
use feeder_wire::{markers, part_candidates, parts};
use image::{Rgb, RgbImage};
use minifactory_msgs::Message;
use minifactory_msgs::geometry_msgs::msg::TransformStamped;
use minifactory_msgs::interface::TopicSpec;
use minifactory_msgs::msg::{PartCandidates, PartStates};
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use minifactory_msgs::visualization_msgs::msg::{Marker, MarkerArray};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType, Robot};

use crate::common::{FEEDER, Run, Up, wait_for};

const STATION: &str = "/station_1";

/// Messages that are kept of a topic.
const KEPT: usize = 300;

/// The newest that has come on a topic.
struct Heard<M> {
    messages: Arc<Mutex<Vec<M>>>,
    _reader: Reader,
}

impl<M: Message> Heard<M> {
    fn on(participant: &Participant, topic: &TopicSpec<M>, namespace: &str) -> Self {
        let messages = Arc::new(Mutex::new(Vec::new()));
        let heard = Arc::clone(&messages);
        let take = move |sample: feeder_runtime::dds::Sample| {
            let mut heard = heard.lock().unwrap();
            heard.push(sample.decode().unwrap());
            let old = heard.len().saturating_sub(KEPT);
            heard.drain(..old);
        };
        Self { messages, _reader: participant.topic_reader(topic, namespace, take).unwrap() }
    }

    fn all(&self) -> Vec<M> {
        self.messages.lock().unwrap().clone()
    }
}

fn onlooker(run: &Run) -> Participant {
    Participant::open(run.domain(), &NodeName::new("/test", "onlooker").unwrap()).unwrap()
}

/// Where a frame is in its parent.
fn isometry(stamped: &TransformStamped) -> Isometry3<f64> {
    let (t, q) = (&stamped.transform.translation, &stamped.transform.rotation);
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
    Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), turn)
}

fn origin(pose: &urdf_rs::Pose) -> Isometry3<f64> {
    let ([x, y, z], [roll, pitch, yaw]) = (*pose.xyz, *pose.rpy);
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

/// The cell as viewers hear it.
struct Cell {
    tf: Heard<TFMessage>,
    tf_static: Heard<TFMessage>,
    descriptions: [Heard<Text>; 3],
}

impl Cell {
    fn of(participant: &Participant) -> Self {
        Self {
            tf: Heard::on(participant, &topics::TF, ""),
            tf_static: Heard::on(participant, &topics::TF_STATIC, ""),
            descriptions: [
                Heard::on(participant, &topics::ROBOT_DESCRIPTION, FEEDER),
                Heard::on(participant, &topics::CAMERA_DESCRIPTION, FEEDER),
                Heard::on(participant, &topics::TOOL_DESCRIPTION, STATION),
            ],
        }
    }

    /// The robots, when all have come.
    fn robots(&self) -> Option<Vec<Robot>> {
        let parsed = |heard: &Heard<Text>| Some(urdf_rs::read_from_string(&heard.all().last()?.data).unwrap());
        self.descriptions.iter().map(parsed).collect()
    }

    /// The newest word on each frame.
    fn frames(&self) -> BTreeMap<String, TransformStamped> {
        let all = self.tf_static.all().into_iter().chain(self.tf.all()).flat_map(|message| message.transforms);
        all.map(|stamped| (stamped.child_frame_id.clone(), stamped)).collect()
    }
}

#[test]
fn a_urdf_has_the_links_of_tf_and_the_joints_of_joint_states() {
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let participant = onlooker(&run);
    let cell = Cell::of(&participant);
    let joint_states = [
        Heard::on(&participant, &topics::JOINT_STATES, FEEDER),
        Heard::on(&participant, &topics::TOOL_JOINT_STATES, STATION),
    ];
    let robots = wait_for("all descriptions", || cell.robots());
    let joints: Vec<_> = robots.iter().flat_map(|robot| &robot.joints).collect();
    let frames = wait_for("all frames", || {
        let frames = cell.frames();
        joints.iter().all(|joint| frames.contains_key(&joint.child.link)).then_some(frames)
    });
    assert_eq!(frames.len(), joints.len(), "a frame is no link: {:?}", frames.keys());
    for joint in &joints {
        let stamped = &frames[&joint.child.link];
        assert_eq!(stamped.header.frame_id, joint.parent.link, "{}", joint.name);
        if joint.joint_type == JointType::Fixed {
            let off = isometry(stamped).inverse() * origin(&joint.origin);
            assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-6, "{}: {off}", joint.name);
        }
    }
    let states = wait_for("states with frames of the same stamp", || {
        let tf = cell.tf.all();
        let mut all = Vec::new();
        for heard in &joint_states {
            let state: JointState = heard.all().pop()?;
            let moved = |stamped: &TransformStamped| stamped.header.stamp == state.header.stamp;
            let now: Vec<_> =
                tf.iter().flat_map(|message| &message.transforms).filter(|at| moved(at)).cloned().collect();
            let known = |joint: &&urdf_rs::Joint| now.iter().any(|stamped| stamped.child_frame_id == joint.child.link);
            let mine = joints.iter().filter(|joint| state.name.contains(&joint.name));
            mine.copied().all(|joint| known(&joint)).then_some(())?;
            all.push((state, now));
        }
        Some(all)
    });
    let mut named: Vec<&String> = states.iter().flat_map(|(state, _)| &state.name).collect();
    let moving = joints.iter().filter(|joint| joint.joint_type != JointType::Fixed);
    let mut described: Vec<&String> = moving.map(|joint| &joint.name).collect();
    named.sort();
    described.sort();
    assert_eq!(named, described);
    for (state, now) in &states {
        for (name, position) in state.name.iter().zip(&state.position) {
            let joint = joints.iter().find(|joint| joint.name == *name).unwrap();
            let stamped = now.iter().find(|stamped| stamped.child_frame_id == joint.child.link).unwrap();
            let axis = Vector3::from(*joint.axis.xyz);
            let wanted = match joint.joint_type {
                JointType::Prismatic => Isometry3::translation(position * axis.x, position * axis.y, position * axis.z),
                _ => Isometry3::rotation(*position * axis),
            };
            let off = isometry(stamped).inverse() * origin(&joint.origin) * wanted;
            assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-6, "{name}: {off}");
            let limits = &joint.limit;
            let turns = joint.joint_type == JointType::Continuous;
            assert!(turns || (limits.lower..=limits.upper).contains(position), "{name}: {position}, {limits:?}");
        }
    }
}

fn to_rgb(marker: &Marker) -> [u8; 3] {
    let color = &marker.color;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of 255")]
    [color.r, color.g, color.b].map(|share| (255.0 * share).round() as u8)
}

fn bytes(colour: markers::Rgb) -> [u8; 3] {
    let [_, r, g, b] = colour.to_be_bytes();
    [r, g, b]
}

#[test]
fn markers_are_where_parts_and_candidates_are() {
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let participant = onlooker(&run);
    let truth: Heard<PartStates> = Heard::on(&participant, &topics::PARTS, FEEDER);
    let drawn: Heard<MarkerArray> = Heard::on(&participant, &topics::PART_MARKERS, FEEDER);
    let seen: Heard<PartCandidates> = Heard::on(&participant, &topics::PART_CANDIDATES, FEEDER);
    let ringed: Heard<MarkerArray> = Heard::on(&participant, &topics::CANDIDATE_MARKERS, FEEDER);
    let stamp = |array: &MarkerArray| array.markers[0].header.stamp;
    let (states, array) = wait_for("parts and their markers of one stamp", || {
        let all = truth.all();
        drawn.all().into_iter().find_map(|array| {
            let states = all.iter().find(|states| states.header.stamp == stamp(&array))?;
            Some((states.clone(), array))
        })
    });
    let true_parts = parts::from_message(states.clone()).unwrap().parts;
    assert!(!true_parts.is_empty());
    assert_eq!(array.markers.len(), true_parts.len() + 1);
    assert_eq!(array.markers[0].action, Marker::DELETEALL);
    for (part, marker) in true_parts.iter().zip(&array.markers[1..]) {
        assert_eq!((marker.id.cast_unsigned(), marker.header.frame_id.as_str()), (part.id, "feeder/tray"));
        let (sin, cos) = part.angle_rad.sin_cos();
        let at = &marker.pose.position;
        let off_m = (at.x - part.radius_m * cos).hypot(at.y - part.radius_m * sin);
        // On the ramp the part leans: its centre of mass is not above its foot.
        assert!(off_m < 0.0005 && (0.0..0.03).contains(&at.z), "{part:?} at {at:?}");
        let wanted = if part.resting_pose == 0 { markers::WANTED_POSE } else { markers::OTHER_POSES[0] };
        assert_eq!(to_rgb(marker), bytes(wanted), "{part:?}");
        assert!(marker.points.len() > 30 && marker.points.len().is_multiple_of(3));
    }
    let (found, rings) = wait_for("candidates and their markers of one stamp", || {
        let all = seen.all();
        let some = all.iter().filter(|found| found.parts.len() > 2);
        some.rev().find_map(|found| {
            let array = ringed.all().into_iter().find(|array| stamp(array) == found.header.stamp)?;
            Some((found.clone(), array))
        })
    });
    let candidates = part_candidates::from_message(&found).unwrap();
    assert_eq!(rings.markers.len(), candidates.len() + 1);
    for (candidate, ring) in candidates.iter().zip(&rings.markers[1..]) {
        let colour = match &candidate.pose_class {
            _ if candidate.refusals.may_be_picked() => markers::PICK,
            Some(_) => markers::SEEN,
            None => markers::UNSURE,
        };
        assert_eq!(to_rgb(ring), bytes(colour), "{candidate:?}");
        for point in &ring.points {
            let from = candidate.position_in_tray_m;
            let ratio = (point.x - from.x).hypot(point.y - from.y) / candidate.radius_m;
            assert!((1.0..2.0).contains(&ratio), "{candidate:?}: {point:?}");
        }
    }
    // Rate: what is drawn is for the eye. A tick of 10 ms knows what the one before it ended with, the first its own begin.
    let stamps: Vec<u64> = drawn.all().iter().map(|array| ns_of_stamp(&stamp(array))).collect();
    assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] >= 90_000_000), "{stamps:?}");
}

#[test]
fn markers_have_the_colours_of_the_page() {
    let css = Path::new(env!("CARGO_MANIFEST_DIR")).join("../nodes/view/page/theme.css");
    let css = std::fs::read_to_string(css).unwrap();
    for (name, colour) in
        [("pick", markers::PICK), ("seen", markers::SEEN), ("unsure", markers::UNSURE), ("plateau", markers::TRAY)]
    {
        assert!(css.contains(&format!("--{name}: #{colour:06x};")), "{name}");
    }
}

/// A picture that is being drawn: orthographic, from above and the side, the nearest wins.
struct Canvas {
    image: RgbImage,
    depth: Vec<f64>,
    centre: Point3<f64>,
}

impl Canvas {
    const WIDTH_PX: u32 = 900;
    const HEIGHT_PX: u32 = 640;
    const PX_PER_M: f64 = 3_100.0;

    fn new(centre: Point3<f64>) -> Self {
        let image = RgbImage::from_pixel(Self::WIDTH_PX, Self::HEIGHT_PX, Rgb([244, 245, 245]));
        let depth = vec![f64::NEG_INFINITY; (Self::WIDTH_PX * Self::HEIGHT_PX) as usize];
        Self { image, depth, centre }
    }

    /// Right, down (px) and towards the eye (m).
    fn project(&self, point: &Point3<f64>) -> Vector3<f64> {
        let turned = UnitQuaternion::from_euler_angles(-0.9, 0.0, 0.0)
            * UnitQuaternion::from_euler_angles(0.0, 0.0, 0.6)
            * (point - self.centre);
        let (width, height) = (f64::from(Self::WIDTH_PX), f64::from(Self::HEIGHT_PX));
        Vector3::new(0.5 * width + Self::PX_PER_M * turned.x, 0.5 * height - Self::PX_PER_M * turned.y, turned.z)
    }

    fn triangle(&mut self, corners: [Point3<f64>; 3], colour: [u8; 3]) {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let Some(normal) = normal.try_normalize(1e-15) else { return };
        let light = 0.55 + 0.45 * normal.dot(&Vector3::new(0.3, -0.4, 0.87).normalize()).max(0.0);
        let [a, b, c] = corners.map(|corner| self.project(&corner));
        let area = (b - a).xy().perp(&(c - a).xy());
        let clamp = |value: f64, most: u32| value.clamp(0.0, f64::from(most - 1));
        let range = |of: fn(&Vector3<f64>) -> f64, most: u32| {
            let all = [of(&a), of(&b), of(&c)];
            let low = clamp(all.into_iter().fold(f64::INFINITY, f64::min).floor(), most);
            let high = clamp(all.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil(), most);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
            (low as u32..=high as u32)
        };
        for v in range(|p| p.y, Self::HEIGHT_PX) {
            for u in range(|p| p.x, Self::WIDTH_PX) {
                let at = Vector3::new(f64::from(u) + 0.5, f64::from(v) + 0.5, 0.0);
                let share = |p: &Vector3<f64>, q: &Vector3<f64>| (q - p).xy().perp(&(at - p).xy()) / area;
                let (to_c, to_a, to_b) = (share(&a, &b), share(&b, &c), share(&c, &a));
                let depth = to_a * a.z + to_b * b.z + to_c * c.z;
                let index = (v * Self::WIDTH_PX + u) as usize;
                if to_a >= 0.0 && to_b >= 0.0 && to_c >= 0.0 && depth > self.depth[index] {
                    self.depth[index] = depth;
                    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a byte")]
                    let shaded = colour.map(|level| (light * f64::from(level)) as u8);
                    self.image.put_pixel(u, v, Rgb(shaded));
                }
            }
        }
    }

    /// A line, m across, as a band that lies level.
    fn line(&mut self, from: Point3<f64>, to: Point3<f64>, width_m: f64, colour: [u8; 3]) {
        let along = to - from;
        let Some(across) = Vector3::new(-along.y, along.x, 0.0).try_normalize(1e-12) else { return };
        let half = 0.5 * width_m * across;
        let [a, b, c, d] = [from - half, to - half, to + half, from + half];
        self.triangle([a, b, c], colour);
        self.triangle([a, c, d], colour);
    }

    fn marker(&mut self, marker: &Marker, platen_from_frame: &Isometry3<f64>) {
        let (at, q) = (&marker.pose.position, &marker.pose.orientation);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
        let placed = platen_from_frame * Isometry3::from_parts(Translation3::new(at.x, at.y, at.z), turn);
        let points: Vec<_> =
            marker.points.iter().map(|point| placed * Point3::new(point.x, point.y, point.z)).collect();
        let colour = to_rgb(marker);
        match marker.r#type {
            _ if marker.action != Marker::ADD => {}
            Marker::TRIANGLE_LIST => {
                points.as_chunks().0.iter().for_each(|corners| self.triangle(*corners, colour));
            }
            Marker::LINE_STRIP => {
                points.windows(2).for_each(|pair| self.line(pair[0], pair[1], marker.scale.x, colour));
            }
            other => panic!("a marker of type {other} is not drawn"),
        }
    }

    fn link(&mut self, link: &urdf_rs::Link, platen_from_link: &Isometry3<f64>) {
        for visual in &link.visual {
            let placed = platen_from_link * origin(&visual.origin);
            let rgba = *visual.material.as_ref().and_then(|material| material.color.as_ref()).unwrap().rgba;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of 255")]
            let colour = [0, 1, 2].map(|channel| (255.0 * rgba[channel]) as u8);
            let outline: Vec<[f64; 2]>;
            let half_m;
            match &visual.geometry {
                Geometry::Box { size } => {
                    let [x, y, z] = size.map(|side| 0.5 * side);
                    outline = vec![[x, y], [-x, y], [-x, -y], [x, -y]];
                    half_m = z;
                }
                Geometry::Cylinder { radius, length } => {
                    let angles = (0..48).map(|step| std::f64::consts::TAU * f64::from(step) / 48.0);
                    outline = angles.map(|angle| [radius * angle.cos(), radius * angle.sin()]).collect();
                    half_m = 0.5 * length;
                }
                other => panic!("{other:?} is not drawn"),
            }
            let at = |[x, y]: [f64; 2], z: f64| placed * Point3::new(x, y, z);
            let ends = outline.iter().zip(outline.iter().cycle().skip(1));
            for (&from, &to) in ends {
                self.triangle([at(from, -half_m), at(to, -half_m), at(to, half_m)], colour);
                self.triangle([at(from, -half_m), at(to, half_m), at(from, half_m)], colour);
                self.triangle([at([0.0, 0.0], half_m), at(from, half_m), at(to, half_m)], colour);
            }
        }
    }
}

/// Where a frame is on the platen.
fn platen_from(frames: &BTreeMap<String, TransformStamped>, frame: &str) -> Isometry3<f64> {
    match frames.get(frame) {
        Some(stamped) => platen_from(frames, &stamped.header.frame_id) * isometry(stamped),
        None => Isometry3::identity(),
    }
}

/// Draws what RViz would draw of URDF and markers, and looks whether parts are to be seen where they are. With `UPDATE` set
/// the picture goes into the documentation.
#[test]
fn urdf_and_markers_make_a_picture_of_the_feeder() {
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let participant = onlooker(&run);
    let cell = Cell::of(&participant);
    let arrays = [&topics::TRAY_MARKERS, &topics::PART_MARKERS, &topics::CANDIDATE_MARKERS]
        .map(|topic| Heard::on(&participant, topic, FEEDER));
    let robots = wait_for("all descriptions", || cell.robots());
    let [tray, parts, candidates] = wait_for("tray, parts and some candidates", || {
        let [tray, parts, candidates] = arrays.each_ref().map(|heard| heard.all().pop());
        Some([tray?, parts?, candidates.filter(|array| array.markers.len() > 4)?])
    });
    let frames = wait_for("all frames", || {
        let frames = cell.frames();
        let links = robots.iter().flat_map(|robot| &robot.joints).map(|joint| &joint.child.link);
        links.into_iter().all(|link| frames.contains_key(link)).then_some(frames)
    });
    let platen_from_tray = platen_from(&frames, "feeder/tray");
    let mut canvas = Canvas::new(platen_from_tray * Point3::new(0.0, 0.0, 0.005));
    for link in robots.iter().flat_map(|robot| &robot.links) {
        canvas.link(link, &platen_from(&frames, &link.name));
    }
    for marker in tray.markers.iter().chain(&parts.markers).chain(&candidates.markers) {
        canvas.marker(marker, &platen_from_tray);
    }
    // From this side the hub hides the tray behind it; where a part is not hidden it is seen in its hue.
    let mut shown = 0;
    for marker in &parts.markers[1..] {
        let at = &marker.pose.position;
        let top_m = marker.points.iter().map(|point| point.z).fold(f64::NEG_INFINITY, f64::max);
        let place = canvas.project(&(platen_from_tray * Point3::new(at.x, at.y, at.z + top_m - 1e-4)));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
        let pixel = canvas.image.get_pixel(place.x as u32, place.y as u32).0;
        let wanted = to_rgb(marker).map(f64::from);
        let least = pixel.map(f64::from).into_iter().zip(wanted).map(|(is, most)| is - most * 0.5);
        let ratio = |rgb: [f64; 3]| rgb[0] / rgb.iter().sum::<f64>();
        shown += usize::from(
            least.clone().all(|over| over > -3.0) && (ratio(pixel.map(f64::from)) - ratio(wanted)).abs() < 0.03,
        );
    }
    let picture = Path::new(env!("CARGO_TARGET_TMPDIR")).join("urdf-and-markers.png");
    canvas.image.save(&picture).unwrap();
    assert!(
        shown > parts.markers.len() / 2,
        "{shown} of {} parts are seen in {}",
        parts.markers.len(),
        picture.display()
    );
    if std::env::var_os("UPDATE").is_some() {
        canvas.image.save(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/pictures/markers.png")).unwrap();
    }
}
