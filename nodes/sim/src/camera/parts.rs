//! Draws parts into the picture of the tray.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Isometry2, Matrix2, Point2, Point3, Rotation2, Vector2};

use super::light::{LightModel, Shading};
use super::relief::{Lamp, PathPoint, Relief, Sight, path};
use super::scene::{Scene, TrayShot};
use super::solid::PartView;
use feeder_model::camera::{CameraModel, MountedTray, grey_level, single};
use feeder_model::range::OutOfRange;

/// Texels of a part's map per pixel.
const TEXELS_PER_PX: f64 = 4.0;
/// Lines of sight per pixel: spread over its area, and over the time the shutter is open.
const SIGHTS: usize = 9;
/// Where in a pixel, px, and when in the exposure, from −½ to ½, each line of sight is: on a grid turned so that no two share
/// a row or a column, which gives an edge along either nine steps across a pixel.
const SIGHT_PLACES: [(f32, f32, f32); SIGHTS] = {
    let ninth = 1.0 / 9.0;
    [
        (-2.0 * ninth, -4.0 * ninth, 0.0),
        (1.0 * ninth, -3.0 * ninth, 3.0 * ninth),
        (4.0 * ninth, -2.0 * ninth, -2.0 * ninth),
        (-3.0 * ninth, -ninth, -4.0 * ninth),
        (0.0, 0.0, 1.0 * ninth),
        (3.0 * ninth, 1.0 * ninth, 4.0 * ninth),
        (-4.0 * ninth, 2.0 * ninth, 2.0 * ninth),
        (-ninth, 3.0 * ninth, -3.0 * ninth),
        (2.0 * ninth, 4.0 * ninth, -ninth),
    ]
};

/// Share of the light on the floor close to a part that the part leaves: that much falls back on it. Assumed; more of it under
/// lamps round the lens, as those light the floor before whatever face the lens sees.
const THROWN_BACK_RATIO: f32 = 0.5;
const THROWN_BACK_ROUND_LENS_RATIO: f32 = 0.9;
/// How many steepnesses of light from near by are told apart.
const NEAR_STEEPNESSES: usize = 6;

/// Draws parts over the picture of the tray.
#[derive(Clone, Debug)]
pub(crate) struct PartPainter {
    camera: CameraModel,
    tray: MountedTray,
    light: LightModel,
    /// Where the lamp is on the platen, m, if it is not afar.
    lamp_at: Option<Point3<f64>>,
    reliefs: Arc<[Relief]>,
}

/// A part as the picture sees it.
struct PartInView<'a> {
    relief: &'a Relief,
    lamp: Lamp<'a>,
    /// The light in the part's frame.
    shading: Shading,
    /// Turns pixels into texels.
    texels_from_px: Matrix2<f32>,
    /// Where the part's origin is seen at the height of its underside and of its top, px.
    foot: Vector2<f32>,
    top: Vector2<f32>,
    px_per_m: f32,
    /// A line of sight through the part.
    path: Vec<PathPoint>,
    /// Each line of sight of a pixel beside the pixel's middle, texels.
    sights: [Vector2<f32>; SIGHTS],
    /// How far the picture of the part moves while the shutter is open, px.
    motion_px: f32,
    /// What the slope of the ramp makes of the brightness.
    tilt: f32,
    white: f32,
    /// What stands in front of the part, if anything may.
    screen: Option<Screen>,
}

/// The walls and the drop-off as they hide a part: seen along the line of sight through a point at the part's top.
struct Screen {
    /// From the part's own directions, in texels, to the tray frame at the part's top.
    centre: Vector2<f64>,
    tray_from_texels: Matrix2<f64>,
    eye: Vector2<f64>,
    /// How distances from the eye grow from the part's top to the walls' top and to the plateau.
    wall_scale: f64,
    plateau_scale: f64,
    px_per_m: f64,
    below_plateau: bool,
}

impl PartPainter {
    pub(crate) fn new(scene: &Scene) -> Self {
        Self::lit_as_steeply_as(scene, &[scene.light.in_tray(0.0).toward_lamp.norm()], THROWN_BACK_RATIO)
    }

    /// The same whose light falls from a lamp near the lens, up to so steeply.
    pub(crate) fn lit_from_near_the_lens(scene: &Scene, steepness_max: f64) -> Self {
        let middle = |step: usize| single(steepness_max * (step as f64 + 0.5) / NEAR_STEEPNESSES as f64);
        let steepnesses: [f32; NEAR_STEEPNESSES] = std::array::from_fn(middle);
        Self::lit_as_steeply_as(scene, &steepnesses, THROWN_BACK_ROUND_LENS_RATIO)
    }

    /// The same parts in this light, with its lamp at a place over the platen, m.
    pub(crate) fn lit_from(&self, light: LightModel, lamp_at: Point3<f64>) -> Self {
        Self { light, lamp_at: Some(lamp_at), ..self.clone() }
    }

    /// The floor throws back the share `floor_left` of what it would send without the part.
    fn lit_as_steeply_as(scene: &Scene, steepnesses: &[f32], floor_left: f32) -> Self {
        let thrown_back = floor_left * single(scene.tray_appearance.surface_reflectance);
        let texel_m = scene.camera.m_per_px(scene.tray.plateau_height_m()) / TEXELS_PER_PX;
        let diffuse = scene.light.in_tray(0.0).diffuse();
        let part = &scene.part;
        Self {
            camera: scene.camera.clone(),
            tray: scene.tray,
            light: scene.light,
            lamp_at: None,
            reliefs: part
                .poses
                .iter()
                .map(|pose| Relief::new(part, pose, texel_m, diffuse, steepnesses, thrown_back))
                .collect(),
        }
    }

    pub(crate) fn check(&self, part: &PartView) -> Result<(), OutOfRange> {
        for (field, value) in [
            ("part.x_m", part.x_m),
            ("part.y_m", part.y_m),
            ("part.z_m", part.z_m),
            ("part.yaw_rad", part.yaw_rad),
            ("part.vx_m_s", part.vx_m_s),
            ("part.vy_m_s", part.vy_m_s),
        ] {
            OutOfRange::unless(value.is_finite(), field, value, "a finite number")?;
        }
        OutOfRange::unless(part.pose < self.reliefs.len(), "part.pose", part.pose as f64, "an index of part.poses")
    }

    pub(crate) fn paint(&self, shot: &TrayShot, exposure_s: f64, parts: &[PartView], pixels: &mut [u8]) {
        // A higher part hides a lower one; at equal height the order given decides.
        let mut order: Vec<&PartView> = parts.iter().collect();
        order.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
        let seen: Vec<PartInView> = order.iter().filter_map(|part| self.see(shot, exposure_s, part)).collect();
        for part in &seen {
            self.paint_floor(part, pixels);
        }
        for part in &seen {
            self.paint_body(part, pixels);
        }
    }

    /// Where and how a part appears; `None` if it is not below the camera or far from the picture.
    fn see(&self, shot: &TrayShot, exposure_s: f64, part: &PartView) -> Option<PartInView<'_>> {
        let relief = self.reliefs.get(part.pose)?;
        let in_tray = Point2::new(part.x_m, part.y_m);
        let platen_from_tray = &shot.platen_from_tray;
        let centre = platen_from_tray * in_tray;
        let foot_m = self.tray.floor_height_m + part.z_m;
        let top_m = foot_m + f64::from(relief.top_m);
        let at = |height_m: f64| self.camera.project(Point3::new(centre.x, centre.y, height_m));
        let (top, foot) = (at(top_m)?, at(foot_m)?);
        let yaw_rad = platen_from_tray.rotation.angle() + part.yaw_rad;
        let part_at = Point3::new(centre.x, centre.y, foot_m);
        let light = self.lamp_at.map_or(self.light, |lamp| self.light.with_lamp_towards(lamp - part_at));
        let shading = light.in_tray(yaw_rad);
        let px_from_platen = self.camera.projection_jacobian(Point3::new(centre.x, centre.y, top_m))?;
        let texel_m = f64::from(relief.texel_m);
        let px_from_texels = px_from_platen * *Rotation2::new(yaw_rad).matrix() * texel_m;
        let texels_from_px = px_from_texels.try_inverse()?.map(single);
        let velocity = shot.velocity_at(in_tray) + platen_from_tray.rotation * Vector2::new(part.vx_m_s, part.vy_m_s);
        let motion_px = (px_from_platen * velocity * exposure_s).map(single);
        let (foot, top) = (foot.coords.map(single), top.coords.map(single));
        let slope = self.slope(in_tray, part.z_m);
        Some(PartInView {
            relief,
            lamp: relief.lamp(light.azimuth_rad - yaw_rad, shading.toward_lamp.norm()),
            shading,
            texels_from_px,
            foot,
            top,
            px_per_m: single(px_from_texels.determinant().abs().sqrt() / texel_m),
            path: path(texels_from_px * (foot - top), relief),
            // PartInView at a later time the part has moved on: the line of sight meets it further back.
            sights: SIGHT_PLACES.map(|(x, y, time)| texels_from_px * (Vector2::new(x, y) - motion_px * time)),
            motion_px: motion_px.norm(),
            tilt: self.light.in_tray(platen_from_tray.rotation.angle()).on_slope(slope.map(single), 1.0),
            white: self.light.white_at(
                f64::from(top.x),
                f64::from(top.y),
                self.camera.width_px(),
                self.camera.height_px(),
            ),
            screen: self.screen(platen_from_tray, part, relief, top_m),
        })
    }

    /// Gradient of the surface under a part, in the tray frame: the ramp's where it lies on the ramp.
    fn slope(&self, in_tray: Point2<f64>, z_m: f64) -> Vector2<f64> {
        let radius_m = in_tray.coords.norm();
        if z_m >= self.tray.geometry.rise_m || radius_m <= 0.0 {
            return Vector2::zeros();
        }
        let along = Vector2::new(-in_tray.y, in_tray.x) / radius_m;
        along * (self.tray.geometry.pitch_m_per_rad() / radius_m)
    }

    fn screen(
        &self,
        platen_from_tray: &Isometry2<f64>,
        part: &PartView,
        relief: &Relief,
        top_m: f64,
    ) -> Option<Screen> {
        let camera = self.camera.pose();
        let in_tray = Vector2::new(part.x_m, part.y_m);
        let eye = platen_from_tray.inverse_transform_point(&Point2::new(camera.x_m, camera.y_m)).coords;
        let depth_m = camera.height_m - top_m;
        let scale = |height_m: f64| (camera.height_m - height_m) / depth_m;
        let (wall_scale, plateau_scale) = (scale(self.tray.wall_top_m()), scale(self.tray.plateau_height_m()));
        let below_plateau = top_m < self.tray.plateau_height_m();
        let at_wall = eye + (in_tray - eye) * wall_scale;
        let at_plateau = eye + (in_tray - eye) * plateau_scale;
        let reach_m = f64::from(relief.reach_m) + 4.0 * self.camera.m_per_px(top_m);
        let hidden_by_wall = at_wall.norm() < self.tray.geometry.inner_radius_m + reach_m
            || at_wall.norm() > self.tray.geometry.outer_radius_m - reach_m;
        let hidden_by_drop_off = below_plateau && self.tray.inside_sector_m(at_plateau.into()) > -reach_m;
        (hidden_by_wall || hidden_by_drop_off).then(|| Screen {
            centre: in_tray,
            tray_from_texels: *Rotation2::new(part.yaw_rad).matrix() * f64::from(relief.texel_m),
            eye,
            wall_scale,
            plateau_scale,
            px_per_m: 1.0 / self.camera.m_per_px(top_m),
            below_plateau,
        })
    }

    /// Share of the pixel at `place` (texels from the part's origin, at its top) that walls and drop-off leave free.
    fn unscreened(&self, screen: &Screen, place: Vector2<f32>) -> f32 {
        let from_eye = screen.centre + screen.tray_from_texels * place.map(f64::from) - screen.eye;
        let radius_m = (screen.eye + from_eye * screen.wall_scale).norm();
        let geometry = &self.tray.geometry;
        let mut behind_m = (geometry.inner_radius_m - radius_m).max(radius_m - geometry.outer_radius_m);
        if screen.below_plateau {
            let at_plateau = screen.eye + from_eye * screen.plateau_scale;
            behind_m = behind_m.max(self.tray.inside_sector_m(at_plateau.into()));
        }
        single((0.5 - behind_m * screen.px_per_m).clamp(0.0, 1.0))
    }

    /// Calls `paint` for the pixels within `reach_px` of a point: with the pixel's index and place.
    fn for_pixels(&self, centre: Vector2<f32>, reach_px: f32, mut paint: impl FnMut(usize, Vector2<f32>)) {
        let width = self.camera.width_px() as usize;
        for row in within(centre.y - reach_px, centre.y + reach_px, self.camera.height_px()) {
            let half = (reach_px.powi(2) - (row as f32 - centre.y).powi(2)).max(0.0).sqrt();
            for column in within(centre.x - half, centre.x + half, self.camera.width_px()) {
                paint(row * width + column, Vector2::new(column as f32, row as f32));
            }
        }
    }

    /// Takes from the floor round a part the light that the part keeps from it.
    fn paint_floor(&self, part: &PartInView, pixels: &mut [u8]) {
        let reach_px = part.relief.reach_m * part.px_per_m;
        let middle = Vector2::repeat(part.relief.middle());
        self.for_pixels(part.foot, reach_px, |index, pixel| {
            let place = part.texels_from_px * (pixel - part.foot);
            let (mut light, mut bare) = (0.0, 0_u8);
            for sight in part.sights.iter().step_by(2) {
                if let Some(share) = part.lamp.floor(place + middle + sight) {
                    (light, bare) = (light + share, bare + 1);
                }
            }
            if bare == 0 {
                return;
            }
            let mut loss = 1.0 - light / f32::from(bare);
            if let Some(screen) = &part.screen {
                loss *= self.unscreened(screen, place);
            }
            pixels[index] = grey_level(f32::from(pixels[index]) * (1.0 - loss));
        });
    }

    fn paint_body(&self, part: &PartInView, pixels: &mut [u8]) {
        let middle = Vector2::repeat(part.relief.middle());
        let reach_px = part.relief.radius_m * part.px_per_m + 0.5 * (part.motion_px + (part.top - part.foot).norm());
        self.for_pixels((part.top + part.foot) * 0.5, reach_px + 1.0, |index, pixel| {
            let at_foot = part.texels_from_px * (pixel - part.foot);
            let (mut light, mut met) = (0.0, 0_u8);
            for sight in &part.sights {
                if let Sight::Surface(brightness) = part.lamp.look(at_foot + middle + sight, &part.path, &part.shading)
                {
                    (light, met) = (light + brightness, met + 1);
                }
            }
            if met == 0 {
                return;
            }
            let behind = f32::from(pixels[index]);
            let cover = f32::from(met) / SIGHTS as f32;
            let mut value = behind * (1.0 - cover) + light / SIGHTS as f32 * part.tilt * part.white;
            if let Some(screen) = &part.screen {
                let at_top = part.texels_from_px * (pixel - part.top);
                value = behind + self.unscreened(screen, at_top) * (value - behind);
            }
            pixels[index] = grey_level(value);
        });
    }
}

/// The whole numbers from `low` to `high` within 0..`size`.
fn within(low: f32, high: f32, size: u32) -> Range<usize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
    let (low, high) = (low.ceil() as usize, (high.floor() + 1.0) as usize);
    low..high.min(size as usize)
}
