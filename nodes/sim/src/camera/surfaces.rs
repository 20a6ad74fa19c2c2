//! The tray's surfaces as the camera sees them at one pose: where they lie and how much light they send back.

use nalgebra::{Isometry2, Point2, Vector2};

use super::light::Shading;
use super::scene::Scene;
use super::tile::{BODY_SIDE, BORE, HUB_CHAMFER, HUB_SIDE, HUB_TOP, LAYERS, Node, PLATEAU, RAMP, RIM, TILE, WALL_FACE};
use crate::camera::TrayAppearance;
use feeder_model::camera::{MountedTray, single};

/// Radius of the hub's flat top and of its bore relative to the inner wall's radius.
const HUB_TOP_RATIO: f32 = 0.94;
const BORE_RATIO: f32 = 0.28;
/// Depth of corners over which they darken, m.
const CORNER_DEPTH_M: f32 = 0.002_5;
/// Share of light missing in a corner between floor and wall, and at the foot of the drop-off.
const CORNER_LOSS: f32 = 0.12;
const DROP_OFF_LOSS: f32 = 0.45;
/// Width of the shadow the tray's body throws on the platen around itself, m, and the light missing there.
const BODY_SHADOW_M: f32 = 0.018;
const BODY_SHADOW_LOSS: f32 = 0.45;
/// Cells of the cloudiness pattern and their size, m.
pub(super) const MOTTLE_CELLS: usize = 64;
const MOTTLE_CELL_M: f32 = 0.006;

/// The tray at one pose, seen by the camera; lengths in the tray frame, m.
pub(super) struct TrayPose<'a> {
    tray: &'a MountedTray,
    appearance: &'a TrayAppearance,
    shading: Shading,
    focal_length_px: f32,
    /// Turns platen directions into the tray frame: cosine and sine of the tray's yaw.
    cos: f32,
    sin: f32,
    /// The camera over the tray: x, y in the tray frame and height above the platen.
    eye: Vector2<f32>,
    eye_height_m: f32,
    outer_m: f32,
    inner_m: f32,
    body_m: f32,
    floor_m: f32,
    plateau_m: f32,
    top_m: f32,
    pitch_m_per_rad: f32,
    ramp_angle_rad: f32,
}

impl<'a> TrayPose<'a> {
    /// The tray at `platen_from_tray` in this scene.
    pub(super) fn new(scene: &'a Scene, platen_from_tray: &Isometry2<f64>) -> Self {
        let tray = &scene.tray;
        let camera_pose = scene.camera.pose();
        let eye = platen_from_tray.inverse_transform_point(&Point2::new(camera_pose.x_m, camera_pose.y_m));
        let yaw_rad = platen_from_tray.rotation.angle();
        Self {
            tray,
            appearance: &scene.tray_appearance,
            shading: scene.light.in_tray(yaw_rad),
            focal_length_px: single(scene.camera.focal_length_px()),
            cos: single(yaw_rad.cos()),
            sin: single(yaw_rad.sin()),
            eye: eye.coords.map(single),
            eye_height_m: single(camera_pose.height_m),
            outer_m: single(tray.geometry.outer_radius_m),
            inner_m: single(tray.geometry.inner_radius_m),
            body_m: single(tray.geometry.outer_radius_m + tray.wall_thickness_m),
            floor_m: single(tray.floor_height_m),
            plateau_m: single(tray.plateau_height_m()),
            top_m: single(tray.wall_top_m()),
            pitch_m_per_rad: single(tray.geometry.pitch_m_per_rad()),
            ramp_angle_rad: single(tray.geometry.ramp_angle_rad),
        }
    }

    /// What is seen along `ray` (platen frame) where level white has the grey level `white`.
    pub(super) fn node(&self, ray: Vector2<f32>, white: f32, mottle: &[f32]) -> Node {
        let ray = Vector2::new(self.cos * ray.x + self.sin * ray.y, self.cos * ray.y - self.sin * ray.x);
        let at = |height_m: f32| self.eye + ray * (self.eye_height_m - height_m);
        let px_per_m = |height_m: f32| self.focal_length_px / (self.eye_height_m - height_m);

        let on_platen = at(0.0);
        let beside_m = on_platen.norm() - self.body_m;
        let thrown = self.shading.toward_lamp * (0.5 * self.top_m);
        let shade_m = (on_platen + thrown).norm() - self.body_m;
        let top = at(self.top_m);
        let top_px_per_m = px_per_m(self.top_m);
        let mut node = Node {
            top_px: top * top_px_per_m,
            platen_light: 1.0
                - BODY_SHADOW_LOSS * fading(beside_m, BODY_SHADOW_M)
                - (1.0 - self.shading.diffuse()) * (0.5 - shade_m / BODY_SHADOW_M).clamp(0.0, 1.0),
            inside_px: [f32::NEG_INFINITY; LAYERS],
            grey: [0.0; LAYERS],
        };
        let top_radius_m = top.norm();
        let margin_m = 2.0 * TILE as f32 / px_per_m(0.0);
        if beside_m.min(top_radius_m - self.body_m) > margin_m {
            node.inside_px = [-2.0 * TILE as f32; LAYERS];
            return node;
        }
        let mut set = |layer: usize, inside_px: f32, reflectance: f64, brightness: f32| {
            node.inside_px[layer] = inside_px;
            node.grey[layer] = single(reflectance) * brightness * white;
        };
        let look = self.appearance;
        let outward = top / top_radius_m.max(1e-6);
        let cloud = cloudiness(mottle, top);

        set(BODY_SIDE, -beside_m * px_per_m(0.0), look.wall_reflectance, self.shading.on_wall(outward));
        set(RIM, (self.body_m - top_radius_m) * top_px_per_m, look.rim_reflectance, cloud);
        let wall_light = self.shading.on_wall(-outward) + 0.15;
        set(WALL_FACE, (self.outer_m - top_radius_m) * top_px_per_m, look.wall_reflectance, wall_light);

        let on_plateau = at(self.plateau_m);
        let ramp_height_m = self.ramp_height_m(at(self.ramp_height_m(on_plateau)));
        let on_ramp = at(ramp_height_m);
        let ramp_inside_m = self.outer_m - on_ramp.norm();
        let ramp_light = self.ramp_light(on_ramp, ramp_height_m) * cloud;
        set(RAMP, ramp_inside_m * px_per_m(ramp_height_m), look.surface_reflectance, ramp_light);

        let sector_m = single(self.tray.inside_sector_m(on_plateau.map(f64::from).into()));
        let plateau_inside_m = sector_m.min(self.outer_m - on_plateau.norm());
        let plateau_light = self.floor_light(on_plateau, self.plateau_m, Vector2::zeros()) * cloud;
        set(PLATEAU, plateau_inside_m * px_per_m(self.plateau_m), look.surface_reflectance, plateau_light);

        let (beside, beside_height_m) =
            if sector_m > 0.0 { (on_plateau, self.plateau_m) } else { (on_ramp, ramp_height_m) };
        let hub_side_px = (self.inner_m - beside.norm()) * px_per_m(beside_height_m);
        set(HUB_SIDE, hub_side_px, look.wall_reflectance, self.shading.on_wall(outward));
        let chamfer_light = self.shading.on_slope(-outward, 1.0);
        set(HUB_CHAMFER, (self.inner_m - top_radius_m) * top_px_per_m, look.rim_reflectance, chamfer_light);
        let hub_top_px = (self.inner_m * HUB_TOP_RATIO - top_radius_m) * top_px_per_m;
        set(HUB_TOP, hub_top_px, look.rim_reflectance, cloud);
        let bore_light = 0.15 + 0.2 * self.shading.on_wall(-outward);
        set(BORE, (self.inner_m * BORE_RATIO - top_radius_m) * top_px_per_m, look.wall_reflectance, bore_light);
        node
    }

    /// Height of the ramp above the platen at `point`, continued below its foot and above its end to half of the plateau.
    fn ramp_height_m(&self, point: Vector2<f32>) -> f32 {
        let seam_rad = 0.5 * (self.ramp_angle_rad + std::f32::consts::TAU);
        let psi_rad = point.y.atan2(point.x);
        let psi_rad =
            if psi_rad + std::f32::consts::TAU < seam_rad { psi_rad + std::f32::consts::TAU } else { psi_rad };
        let psi_rad = if psi_rad > seam_rad { psi_rad - std::f32::consts::TAU } else { psi_rad };
        self.floor_m + (psi_rad.min(self.ramp_angle_rad)) * self.pitch_m_per_rad
    }

    /// Brightness of the ramp: its slope, its corners and the shadow of the drop-off.
    fn ramp_light(&self, point: Vector2<f32>, height_m: f32) -> f32 {
        let radius_m = point.norm().max(0.1 * self.inner_m);
        let along = Vector2::new(-point.y, point.x) / radius_m;
        let light = self.floor_light(point, height_m, along * (self.pitch_m_per_rad / radius_m));
        if point.x < 0.0 {
            return light;
        }
        let drop_m = self.plateau_m - height_m;
        let shadow_m = drop_m * (-self.shading.toward_lamp.y).max(0.0);
        let lit = ((point.y - shadow_m) / (0.3 * shadow_m + 0.001) + 0.5).clamp(0.0, 1.0);
        let lamp = 1.0 - self.shading.diffuse();
        light * (1.0 - DROP_OFF_LOSS * fading(point.y, 0.4 * drop_m + 0.001)) * (1.0 - lamp * (1.0 - lit))
    }

    /// Brightness of a running surface with slope `gradient`: corners at both walls, and the outer wall's soft shadow.
    fn floor_light(&self, point: Vector2<f32>, height_m: f32, gradient: Vector2<f32>) -> f32 {
        let radius_m = point.norm();
        let outward = point / radius_m.max(1e-6);
        let wall_m = self.top_m - height_m;
        let to_outer_m = self.outer_m - radius_m;
        let to_inner_m = radius_m - self.inner_m;
        let reach_m = wall_m * outward.dot(&self.shading.toward_lamp);
        let shade_m = if reach_m > 0.0 { reach_m - to_outer_m } else { -reach_m - to_inner_m };
        let lit = (0.5 - shade_m / (0.6 * reach_m.abs() + 0.003)).clamp(0.0, 1.0);
        let depth_m = CORNER_DEPTH_M + 0.3 * wall_m;
        let corners = fading(to_outer_m, depth_m) + fading(to_inner_m, depth_m);
        self.shading.on_slope(gradient, lit) * (1.0 - CORNER_LOSS * corners)
    }
}

/// 1 at `distance_m` ≤ 0, falling to a quarter at `depth_m` and on towards 0.
fn fading(distance_m: f32, depth_m: f32) -> f32 {
    let far = 1.0 + distance_m.max(0.0) / depth_m;
    1.0 / (far * far)
}

/// The cloudiness pattern at a point of the tray frame, interpolated.
fn cloudiness(mottle: &[f32], point: Vector2<f32>) -> f32 {
    let cell = |x: f32| {
        let place = x / MOTTLE_CELL_M + (MOTTLE_CELLS / 2) as f32;
        let place = place.clamp(0.0, MOTTLE_CELLS as f32 - 1.001);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the table")]
        let index = place as usize;
        (index, place - index as f32)
    };
    let ((column, across), (row, down)) = (cell(point.x), cell(point.y));
    let at = |row: usize, column: usize| mottle[row * MOTTLE_CELLS + column];
    let upper = at(row, column) + across * (at(row, column + 1) - at(row, column));
    let lower = at(row + 1, column) + across * (at(row + 1, column + 1) - at(row + 1, column));
    upper + down * (lower - upper)
}
