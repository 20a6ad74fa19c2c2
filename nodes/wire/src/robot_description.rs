//! What moves in the cell as URDF: links that are the frames of `/tf`, joints that are those of `joint_states`.
//!
//! Each node describes what it moves or owns, in its namespace, so that joints have the names they have there. Bodies are
//! boxes and cylinders: a mesh would have to be a file that every viewer's machine can open. The tray's true shape goes as
//! triangles (`markers`); here it is what a planner of motions needs, the cylinder that holds it.

use std::fmt::Write as _;

use feeder_model::camera::MountedTray;
use feeder_model::trajectory::AXES;
use minifactory_msgs::std_msgs::msg::String as Text;
use nalgebra::Isometry3;

use crate::frames::{self, PLATEN};

/// Depth of the tray's body below the foot of the ramp, m; below it is the courier. Only drawn so.
pub const TRAY_DEPTH_M: f64 = 0.009;
/// Side of the courier over the radius of the disc that covers it. Only drawn so.
const COURIER_SIDE_RATIO: f64 = 1.6;
/// Gap between courier and platen, m. Only drawn so.
const FLIGHT_M: f64 = 0.0015;

/// A courier with its tray.
#[derive(Clone, Copy, Debug)]
pub struct Courier<'a> {
    /// Name of its feeder.
    pub feeder: &'a str,
    /// Least place of its joints: x and y, m, and yaw, rad.
    pub lower: [f64; 3],
    /// Largest place of its joints.
    pub upper: [f64; 3],
    /// Largest speed, m/s and rad/s.
    pub speed_max: [f64; 3],
    /// Largest force, N, and torque, N m.
    pub effort_max: [f64; 3],
    /// Mass of courier and tray, kg, and moment of inertia about z, kg m².
    pub mass_kg: f64,
    /// See there.
    pub inertia_kg_m2: f64,
    /// Radius of the disc that covers it, m.
    pub footprint_radius_m: f64,
    /// The tray.
    pub tray: MountedTray,
}

/// The courier of a feeder.
#[must_use]
pub fn courier(courier: &Courier) -> Text {
    let Courier { feeder, lower, upper, speed_max, effort_max, mass_kg, inertia_kg_m2, tray, .. } = courier;
    let [slide_x, slide_y] = frames::courier_slides(feeder);
    let body = frames::courier(feeder);
    let mut urdf = Urdf::new(feeder);
    urdf.link(&slide_x, "").link(&slide_y, "");
    let side_m = COURIER_SIDE_RATIO * courier.footprint_radius_m;
    let height_m = (tray.floor_height_m - TRAY_DEPTH_M - FLIGHT_M).max(1e-3);
    let block = format!(r#"<box size="{side_m} {side_m} {height_m}"/>"#);
    // About the vertical it is known; across, that of a plate is taken.
    let across_kg_m2 = 0.5 * inertia_kg_m2;
    let inertial = format!(
        r#"<inertial><mass value="{mass_kg}"/><inertia ixx="{across_kg_m2}" ixy="0" ixz="0" iyy="{across_kg_m2}" iyz="0" izz="{inertia_kg_m2}"/></inertial>"#
    );
    urdf.link(&body, &(inertial + &solid(FLIGHT_M + 0.5 * height_m, &block, "courier", "0.28 0.32 0.36 1")));
    let radius_m = tray.geometry.outer_radius_m + tray.wall_thickness_m;
    let cylinder = |length_m: f64| format!(r#"<cylinder radius="{radius_m}" length="{length_m}"/>"#);
    // Seen is the body below the ramp's foot, or it would hide what is above; in the way is all of it.
    let whole_m = TRAY_DEPTH_M + tray.geometry.rise_m + tray.lip_m;
    let seen = visual([0.0, 0.0, -0.5 * TRAY_DEPTH_M], &cylinder(TRAY_DEPTH_M), "tray", "0.49 0.58 0.64 1");
    urdf.link(
        &frames::tray(feeder),
        &(seen + &collision([0.0, 0.0, 0.5 * whole_m - TRAY_DEPTH_M], &cylinder(whole_m))),
    );
    let kinds = [("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("revolute", "0 0 1")];
    let mut parent = PLATEN;
    for (axis, child) in [&slide_x, &slide_y, &body].into_iter().enumerate() {
        let limit = Limit { lower: lower[axis], upper: upper[axis], effort: effort_max[axis], speed: speed_max[axis] };
        urdf.joint(AXES[axis], kinds[axis], parent, child, &Isometry3::identity(), &limit);
        parent = child;
    }
    urdf.fixed(&body, &frames::tray(feeder), &frames::upright(0.0, 0.0, tray.floor_height_m, 0.0));
    urdf.end()
}

/// The camera of a feeder, which looks along z.
#[must_use]
pub fn camera(feeder: &str, platen_from_camera: &Isometry3<f64>) -> Text {
    let mut urdf = Urdf::new(&format!("{feeder}_camera"));
    let link = frames::camera(feeder);
    // The optical centre is in the lens, the housing behind it.
    let lens = solid(0.0, r#"<cylinder radius="0.012" length="0.02"/>"#, "lens", "0.1 0.1 0.1 1");
    let housing = solid(-0.03, r#"<box size="0.03 0.03 0.04"/>"#, "housing", "0.3 0.3 0.3 1");
    urdf.link(&link, &(lens + &housing)).fixed(PLATEN, &link, platen_from_camera);
    urdf.end()
}

/// A station with its tool.
#[derive(Clone, Copy, Debug)]
pub struct Tool<'a> {
    /// Name of its station.
    pub station: &'a str,
    /// Where its axis meets the height of the plateau, on the platen.
    pub platen_from_tool: Isometry3<f64>,
    /// Names of its joints, along and about z.
    pub joints: [&'a str; 2],
    /// Largest height of the gripper above the plateau, m.
    pub height_m_max: f64,
    /// Largest speed along z, m/s, and about it, rad/s.
    pub speed_max: [f64; 2],
    /// Width of the open gripper, m.
    pub opening_m: f64,
}

/// The tool of a station.
#[must_use]
pub fn tool(tool: &Tool) -> Text {
    let Tool { station, platen_from_tool, joints: [z, theta], height_m_max, speed_max, opening_m } = tool;
    let (fixed, slide, gripper) = (frames::tool(station), frames::tool_slide(station), frames::gripper(station));
    let mut urdf = Urdf::new(station);
    let shaft = solid(0.09, r#"<cylinder radius="0.004" length="0.14"/>"#, "tool", "0.7 0.72 0.74 1");
    let palm = format!(r#"<box size="{} 0.008 0.008"/>"#, opening_m + 0.0048);
    let mut hand = solid(0.017, &palm, "tool", "0.7 0.72 0.74 1");
    for side in [-0.5, 0.5] {
        let at_m = [side * (opening_m + 0.0016), 0.0, 0.0065];
        hand += &solid_at(at_m, r#"<box size="0.0016 0.0032 0.013"/>"#, "tool", "0.7 0.72 0.74 1");
    }
    urdf.link(&fixed, "").link(&slide, &shaft).link(&gripper, &hand);
    urdf.fixed(PLATEN, &fixed, platen_from_tool);
    let here = Isometry3::identity();
    // Forces of the tool are not modelled.
    let up = Limit { lower: 0.0, upper: *height_m_max, effort: 0.0, speed: speed_max[0] };
    urdf.joint(z, ("prismatic", "0 0 1"), &fixed, &slide, &here, &up);
    let pi = std::f64::consts::PI;
    let about = Limit { lower: -pi, upper: pi, effort: 0.0, speed: speed_max[1] };
    urdf.joint(theta, ("continuous", "0 0 1"), &slide, &gripper, &here, &about);
    urdf.end()
}

/// How far, how hard and how fast a joint goes: m, N and m/s, or rad, N m and rad/s.
struct Limit {
    lower: f64,
    upper: f64,
    effort: f64,
    speed: f64,
}

/// A robot that is being written. Names are those of nodes and frames: letters, digits, `_` and `/`.
struct Urdf(String);

impl Urdf {
    fn new(name: &str) -> Self {
        Self(format!("<?xml version=\"1.0\"?>\n<robot name=\"{name}\">\n  <link name=\"{PLATEN}\"/>\n"))
    }

    fn link(&mut self, name: &str, bodies: &str) -> &mut Self {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, r#"  <link name="{name}">{bodies}</link>"#);
        self
    }

    fn fixed(&mut self, parent: &str, child: &str, at: &Isometry3<f64>) {
        let name = child.replace('/', "_");
        let _ = writeln!(self.0, r#"  <joint name="{name}_mount" type="fixed">{}</joint>"#, ends(parent, child, at));
    }

    fn joint(
        &mut self,
        name: &str,
        (kind, axis): (&str, &str),
        parent: &str,
        child: &str,
        at: &Isometry3<f64>,
        limit: &Limit,
    ) {
        let Limit { lower, upper, effort, speed } = limit;
        let _ = writeln!(
            self.0,
            r#"  <joint name="{name}" type="{kind}">{}<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{speed}"/></joint>"#,
            ends(parent, child, at)
        );
    }

    fn end(mut self) -> Text {
        self.0.push_str("</robot>\n");
        Text { data: self.0 }
    }
}

fn ends(parent: &str, child: &str, at: &Isometry3<f64>) -> String {
    let place = at.translation;
    let (roll_rad, pitch_rad, yaw_rad) = at.rotation.euler_angles();
    format!(
        r#"<parent link="{parent}"/><child link="{child}"/><origin xyz="{} {} {}" rpy="{roll_rad} {pitch_rad} {yaw_rad}"/>"#,
        place.x, place.y, place.z
    )
}

/// A body, its middle at this height in its link's frame, that is seen and in the way.
fn solid(z_m: f64, geometry: &str, material: &str, rgba: &str) -> String {
    solid_at([0.0, 0.0, z_m], geometry, material, rgba)
}

fn solid_at(middle_m: [f64; 3], geometry: &str, material: &str, rgba: &str) -> String {
    visual(middle_m, geometry, material, rgba) + &collision(middle_m, geometry)
}

fn visual([x_m, y_m, z_m]: [f64; 3], geometry: &str, material: &str, rgba: &str) -> String {
    format!(
        r#"<visual><origin xyz="{x_m} {y_m} {z_m}"/><geometry>{geometry}</geometry><material name="{material}"><color rgba="{rgba}"/></material></visual>"#
    )
}

fn collision([x_m, y_m, z_m]: [f64; 3], geometry: &str) -> String {
    format!(r#"<collision><origin xyz="{x_m} {y_m} {z_m}"/><geometry>{geometry}</geometry></collision>"#)
}
