//! Draws parts into the picture of the tray.

use std::ops::Range;

use nalgebra::{Isometry2, Matrix2, Point2, Point3, Rotation2, Vector2};

use super::appearance::{Face, PartView};
use super::light::{LightModel, Shading};
use super::render::Scene;
use super::{CameraModel, InvalidValue, MountedTray, grey_level, require, single};

/// Softness of the edge of a shadow, relative to the part's radius, and the diffuse light a part keeps from the floor
/// around its foot.
const SHADOW_SOFTNESS: f32 = 0.18;
const CONTACT_LOSS: f32 = 0.08;

/// Draws parts over the picture of the tray.
#[derive(Clone, Debug)]
pub(crate) struct PartPainter {
    camera: CameraModel,
    tray: MountedTray,
    light: LightModel,
    radius_m: f64,
    thickness_m: f64,
    side_reflectance: f32,
    faces: Vec<Face>,
}

/// A part as the picture sees it.
struct Seen<'a> {
    /// Turns pixels into multiples of the part's radius, in the part's own directions.
    part_from_px: Matrix2<f32>,
    /// Centres of the foot, the upper face and the shadow, px.
    foot: Vector2<f32>,
    top: Vector2<f32>,
    shadow: Vector2<f32>,
    radius_px: f32,
    /// Half-width and half-height of the box round a disc of the part's radius, px.
    reach_px: Vector2<f32>,
    shading: Shading,
    tilt: Vector2<f32>,
    white: f32,
    face: &'a Face,
    /// What stands in front of the part, if anything may.
    screen: Option<Screen>,
}

/// The walls and the drop-off as they hide a part: seen along the line of sight through a point at the part's top.
struct Screen {
    /// From the part's own directions and radii to the tray frame at the part's top.
    centre: Vector2<f64>,
    tray_from_part: Matrix2<f64>,
    eye: Vector2<f64>,
    /// How distances from the eye grow from the part's top to the walls' top and to the plateau.
    wall_scale: f64,
    plateau_scale: f64,
    px_per_m: f64,
    below_plateau: bool,
}

impl PartPainter {
    pub(crate) fn new(scene: &Scene) -> Self {
        let radius_m = scene.part.diameter_m / 2.0;
        let pixel_ratio = scene.camera.m_per_px(scene.tray.plateau_height_m()) / radius_m;
        Self {
            camera: scene.camera.clone(),
            tray: scene.tray,
            light: scene.light,
            radius_m,
            thickness_m: scene.part.thickness_m,
            side_reflectance: single(scene.part.side_reflectance),
            faces: scene.part.faces.iter().map(|face| Face::new(face, pixel_ratio)).collect(),
        }
    }

    pub(crate) fn check(&self, part: &PartView) -> Result<(), InvalidValue> {
        for (field, value) in
            [("part.x_m", part.x_m), ("part.y_m", part.y_m), ("part.z_m", part.z_m), ("part.yaw_rad", part.yaw_rad)]
        {
            require(value.is_finite(), field, value, "a finite number")?;
        }
        require(part.pose < self.faces.len(), "part.pose", part.pose as f64, "an index of part.faces")
    }

    pub(crate) fn paint(&self, platen_from_tray: &Isometry2<f64>, parts: &[PartView], pixels: &mut [u8]) {
        // A higher part hides a lower one; at equal height the order given decides.
        let mut order: Vec<&PartView> = parts.iter().collect();
        order.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
        let seen: Vec<Seen> = order.iter().filter_map(|part| self.see(platen_from_tray, part)).collect();
        for part in &seen {
            self.paint_shadow(part, pixels);
        }
        for part in &seen {
            self.paint_body(part, pixels);
        }
    }

    /// Where and how a part appears; `None` if it is not below the camera.
    fn see(&self, platen_from_tray: &Isometry2<f64>, part: &PartView) -> Option<Seen<'_>> {
        let in_tray = Point2::new(part.x_m, part.y_m);
        let centre = platen_from_tray * in_tray;
        let foot_m = self.tray.floor_height_m + part.z_m;
        let top_m = foot_m + self.thickness_m;
        let at =
            |x: f64, y: f64, z: f64| self.camera.project(Point3::new(x, y, z)).map(|pixel| pixel.coords.map(single));
        let top = at(centre.x, centre.y, top_m)?;
        let foot = at(centre.x, centre.y, foot_m)?;
        let shading = self.light.in_tray(0.0);
        let thrown = shading.toward_lamp.map(f64::from) * (0.5 * self.thickness_m);
        let shadow = at(centre.x - thrown.x, centre.y - thrown.y, foot_m)?;
        let yaw_rad = platen_from_tray.rotation.angle() + part.yaw_rad;
        let platen_from_part = *Rotation2::new(yaw_rad).matrix() * self.radius_m;
        let px_from_platen = self.camera.projection_jacobian(Point3::new(centre.x, centre.y, top_m))?;
        let px_from_part = px_from_platen * platen_from_part;
        let part_from_px = px_from_part.try_inverse()?;
        let reach_px = Vector2::new(px_from_part.row(0).norm(), px_from_part.row(1).norm());
        let slope = self.tilt(in_tray, part.z_m);
        let (sin, cos) = yaw_rad.sin_cos();
        let in_part = |v: Vector2<f64>| Vector2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x).map(single);
        Some(Seen {
            part_from_px: part_from_px.map(single),
            foot,
            top,
            shadow,
            radius_px: single(px_from_part.determinant().abs().sqrt()),
            reach_px: reach_px.map(single),
            shading: self.light.in_tray(yaw_rad),
            tilt: in_part(platen_from_tray.rotation * slope),
            white: self.light.white_at(
                f64::from(top.x),
                f64::from(top.y),
                self.camera.width_px(),
                self.camera.height_px(),
            ),
            face: self.faces.get(part.pose)?,
            screen: self.screen(platen_from_tray, in_tray, part, top_m),
        })
    }

    /// Gradient of the surface under a part, in the tray frame: the ramp's where it lies on the ramp.
    fn tilt(&self, in_tray: Point2<f64>, z_m: f64) -> Vector2<f64> {
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
        in_tray: Point2<f64>,
        part: &PartView,
        top_m: f64,
    ) -> Option<Screen> {
        let camera = self.camera.pose();
        let eye = platen_from_tray.inverse_transform_point(&Point2::new(camera.x_m, camera.y_m)).coords;
        let depth_m = camera.height_m - top_m;
        let scale = |height_m: f64| (camera.height_m - height_m) / depth_m;
        let (wall_scale, plateau_scale) = (scale(self.tray.wall_top_m()), scale(self.tray.plateau_height_m()));
        let below_plateau = top_m < self.tray.plateau_height_m();
        let at_wall = eye + (in_tray.coords - eye) * wall_scale;
        let at_plateau = eye + (in_tray.coords - eye) * plateau_scale;
        let reach_m = self.radius_m + 4.0 * self.camera.m_per_px(top_m);
        let hidden_by_wall = at_wall.norm() < self.tray.geometry.inner_radius_m + reach_m
            || at_wall.norm() > self.tray.geometry.outer_radius_m - reach_m;
        let hidden_by_drop_off = below_plateau && self.tray.inside_sector_m(at_plateau.into()) > -reach_m;
        (hidden_by_wall || hidden_by_drop_off).then(|| Screen {
            centre: in_tray.coords,
            tray_from_part: *Rotation2::new(part.yaw_rad).matrix() * self.radius_m,
            eye,
            wall_scale,
            plateau_scale,
            px_per_m: 1.0 / self.camera.m_per_px(top_m),
            below_plateau,
        })
    }

    /// Share of the pixel at `place` (part's directions, in radii) that walls and drop-off leave free.
    fn unscreened(&self, screen: &Screen, place: Vector2<f32>) -> f32 {
        let from_eye = screen.centre + screen.tray_from_part * place.map(f64::from) - screen.eye;
        let radius_m = (screen.eye + from_eye * screen.wall_scale).norm();
        let geometry = &self.tray.geometry;
        let mut behind_m = (geometry.inner_radius_m - radius_m).max(radius_m - geometry.outer_radius_m);
        if screen.below_plateau {
            let at_plateau = screen.eye + from_eye * screen.plateau_scale;
            behind_m = behind_m.max(self.tray.inside_sector_m(at_plateau.into()));
        }
        single((0.5 - behind_m * screen.px_per_m).clamp(0.0, 1.0))
    }

    /// Calls `paint` for the pixels of an ellipse, its half-axes along the image's: with the pixel's index and place.
    fn for_pixels(&self, centre: Vector2<f32>, reach: Vector2<f32>, mut paint: impl FnMut(usize, Vector2<f32>)) {
        let width = self.camera.width_px() as usize;
        for row in within(centre.y - reach.y, centre.y + reach.y, self.camera.height_px()) {
            let down = (row as f32 - centre.y) / reach.y;
            let half = reach.x * (1.0 - down * down).max(0.0).sqrt();
            for column in within(centre.x - half, centre.x + half, self.camera.width_px()) {
                paint(row * width + column, Vector2::new(column as f32, row as f32));
            }
        }
    }

    fn paint_shadow(&self, part: &Seen, pixels: &mut [u8]) {
        let loss = 1.0 - part.shading.diffuse() + CONTACT_LOSS;
        let reach = part.reach_px * (1.0 + SHADOW_SOFTNESS);
        self.for_pixels(part.shadow, reach, |index, pixel| {
            let place = part.part_from_px * (pixel - part.shadow);
            let depth = (1.0 + SHADOW_SOFTNESS - place.norm()) / (2.0 * SHADOW_SOFTNESS);
            let depth = depth.clamp(0.0, 1.0);
            let mut shadow = loss * depth * depth * (3.0 - 2.0 * depth);
            if let Some(screen) = &part.screen {
                shadow *= self.unscreened(screen, place);
            }
            pixels[index] = grey_level(f32::from(pixels[index]) * (1.0 - shadow));
        });
    }

    fn paint_body(&self, part: &Seen, pixels: &mut [u8]) {
        // The side shows beside the upper face by as much as the foot is displaced from it.
        let centre = (part.top + part.foot) * 0.5;
        let reach = part.reach_px + (part.top - part.foot).abs() * 0.5;
        let tilted = part.tilt.dot(&part.shading.toward_lamp);
        let tilt_flattening = 1.0 / (1.0 + part.tilt.norm_squared()).sqrt();
        self.for_pixels(centre, reach.add_scalar(1.5), |index, pixel| {
            let place = part.part_from_px * (pixel - part.top);
            let radius = place.norm();
            let top = ((1.0 - radius) * part.radius_px + 0.5).clamp(0.0, 1.0);
            let outward = place / radius.max(1e-3);
            let behind = f32::from(pixels[index]);
            let mut value = behind;
            if top < 1.0 {
                let radius = (part.part_from_px * (pixel - part.foot)).norm();
                let side = ((1.0 - radius) * part.radius_px + 0.5).clamp(0.0, 1.0);
                let brightness = self.side_reflectance * part.shading.on_wall(outward);
                value += side * (brightness * part.white - value);
            }
            let sample = part.face.at(radius);
            let mut reflectance = sample.reflectance;
            if let Some(mark) = &part.face.mark {
                let offset = place - Vector2::new(single(mark.offset_ratio), 0.0);
                let inside_px = (single(mark.radius_ratio) - offset.norm()) * part.radius_px;
                let cover = (inside_px + 0.5).clamp(0.0, 1.0);
                reflectance += cover * (single(mark.reflectance) - reflectance);
            }
            let away = tilted + sample.slope * outward.dot(&part.shading.toward_lamp);
            let lamp = (1.0 - away) * sample.flattening * tilt_flattening;
            value += top * (reflectance * part.shading.lit_by(lamp) * part.white - value);
            if let Some(screen) = &part.screen {
                value = behind + self.unscreened(screen, place) * (value - behind);
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
