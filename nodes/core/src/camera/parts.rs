//! Parts in the picture: discs with faces that tell which way up they lie.

use std::ops::Range;

use nalgebra::{Isometry2, Matrix2, Point2, Point3, Vector2};
use serde::{Deserialize, Serialize};

use super::light::{LightModel, Shading};
use super::render::Scene;
use super::{CameraModel, InvalidValue, MountedTray, grey_level, require, single};

/// Entries of a face's look from its centre to its rim.
const FACE_SAMPLES: usize = 256;
/// Softness of the edge of a shadow, relative to the part's radius, and the diffuse light a part keeps from the floor
/// around its foot.
const SHADOW_SOFTNESS: f32 = 0.18;
const CONTACT_LOSS: f32 = 0.08;

/// A ring of a face: from the radius of the ring inside it to its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceRing {
    /// Outer radius relative to the part's.
    pub radius_ratio: f64,
    /// Share of light that comes back.
    pub reflectance: f64,
    /// Rise of the surface per distance outwards: negative on a chamfer at the rim, positive in a countersink.
    #[serde(default)]
    pub slope: f64,
}

/// A round spot beside the centre that makes the part's yaw visible.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceMark {
    /// Distance of the spot from the centre along the part's x, relative to the part's radius.
    pub offset_ratio: f64,
    /// Radius of the spot, relative to the part's radius.
    pub radius_ratio: f64,
    /// Share of light that comes back.
    pub reflectance: f64,
}

/// How a face looks from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceAppearance {
    /// Concentric rings from the centre outwards; the last reaches the rim.
    pub rings: Vec<FaceRing>,
    /// A spot beside the centre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<FaceMark>,
}

/// A disc-like part: its size and, for each resting pose, the face then on top.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartAppearance {
    /// Diameter, m.
    pub diameter_m: f64,
    /// Height of the upper face above the surface the part lies on, m.
    pub thickness_m: f64,
    /// Share of light that comes back from the side.
    pub side_reflectance: f64,
    /// The upper face in each resting pose.
    pub faces: Vec<FaceAppearance>,
}

impl PartAppearance {
    /// A rubber grommet of this size: in pose 0 a face with a dark hole, in pose 1 a darker flange with a bright boss.
    /// Both faces are about equally bright on the whole, so that only their structure tells them apart.
    #[must_use]
    pub fn grommet(diameter_m: f64, thickness_m: f64) -> Self {
        let ring = |radius_ratio, reflectance, slope| FaceRing {
            radius_ratio,
            reflectance,
            slope,
        };
        let face = |rings| FaceAppearance { rings, mark: None };
        Self {
            diameter_m,
            thickness_m,
            side_reflectance: 0.26,
            faces: vec![
                face(vec![
                    ring(0.30, 0.06, 0.0),
                    ring(0.40, 0.40, 0.8),
                    ring(0.90, 0.44, 0.0),
                    ring(1.00, 0.38, -0.9),
                ]),
                face(vec![
                    ring(0.42, 0.60, 0.0),
                    ring(0.50, 0.45, -1.2),
                    ring(0.60, 0.20, 0.0),
                    ring(0.92, 0.36, 0.0),
                    ring(1.00, 0.32, -0.9),
                ]),
            ],
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        let diameter_ok = (5e-4..=0.2).contains(&self.diameter_m);
        require(
            diameter_ok,
            "part.diameter_m",
            self.diameter_m,
            "5e-4 to 0.2 m",
        )?;
        let thickness_ok = (0.0..=0.1).contains(&self.thickness_m);
        require(
            thickness_ok,
            "part.thickness_m",
            self.thickness_m,
            "0 to 0.1 m",
        )?;
        let share = |field, value| require((0.0..=1.0).contains(&value), field, value, "0 to 1");
        share("part.side_reflectance", self.side_reflectance)?;
        require(
            !self.faces.is_empty(),
            "part.faces",
            0.0,
            "at least one face",
        )?;
        for face in &self.faces {
            let mut inner = 0.0;
            for ring in &face.rings {
                let radius = ring.radius_ratio;
                require(
                    radius > inner && radius <= 1.0,
                    "part.faces.rings.radius_ratio",
                    radius,
                    "rising, up to 1",
                )?;
                inner = radius;
                share("part.faces.rings.reflectance", ring.reflectance)?;
                let slope_ok = ring.slope.abs() <= 10.0;
                require(slope_ok, "part.faces.rings.slope", ring.slope, "-10 to 10")?;
            }
            require(
                inner >= 1.0,
                "part.faces.rings.radius_ratio",
                inner,
                "1 for the last ring",
            )?;
            if let Some(mark) = face.mark {
                share("part.faces.mark.offset_ratio", mark.offset_ratio)?;
                share("part.faces.mark.radius_ratio", mark.radius_ratio)?;
                share("part.faces.mark.reflectance", mark.reflectance)?;
            }
        }
        Ok(())
    }
}

/// A part where it is, in the tray frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartView {
    /// Centre, x, m.
    pub x_m: f64,
    /// Centre, y, m.
    pub y_m: f64,
    /// Underside above the foot of the ramp, m.
    pub z_m: f64,
    /// Turn about the vertical, rad.
    pub yaw_rad: f64,
    /// Resting pose: which face is on top, an index into [`PartAppearance::faces`].
    pub pose: usize,
}

/// A face sampled along its radius, blurred as far as a pixel does.
#[derive(Clone, Debug)]
struct Face {
    /// Reflectance and slope from the centre to the rim.
    samples: Vec<(f32, f32)>,
    mark: Option<FaceMark>,
}

impl Face {
    fn new(appearance: &FaceAppearance, pixel_ratio: f64) -> Self {
        const TAPS: usize = 9;
        let samples = (0..FACE_SAMPLES)
            .map(|sample| {
                let place = sample as f64 / (FACE_SAMPLES - 1) as f64;
                let (mut reflectance, mut slope) = (0.0, 0.0);
                for tap in 0..TAPS {
                    let offset = (tap as f64 / (TAPS - 1) as f64 - 0.5) * pixel_ratio;
                    let radius = (place + offset).abs().min(1.0);
                    // The last ring reaches 1, so one is always found.
                    if let Some(ring) = appearance
                        .rings
                        .iter()
                        .find(|ring| radius <= ring.radius_ratio)
                    {
                        reflectance += ring.reflectance / TAPS as f64;
                        slope += ring.slope / TAPS as f64;
                    }
                }
                (single(reflectance), single(slope))
            })
            .collect();
        Self {
            samples,
            mark: appearance.mark,
        }
    }

    fn at(&self, radius: f32) -> (f32, f32) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a float cast saturates"
        )]
        let index = (radius * (FACE_SAMPLES - 1) as f32 + 0.5) as usize;
        self.samples[index.min(FACE_SAMPLES - 1)]
    }
}

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
            faces: scene
                .part
                .faces
                .iter()
                .map(|face| Face::new(face, pixel_ratio))
                .collect(),
        }
    }

    pub(crate) fn check(&self, part: &PartView) -> Result<(), InvalidValue> {
        for (field, value) in [
            ("part.x_m", part.x_m),
            ("part.y_m", part.y_m),
            ("part.z_m", part.z_m),
            ("part.yaw_rad", part.yaw_rad),
        ] {
            require(value.is_finite(), field, value, "a finite number")?;
        }
        require(
            part.pose < self.faces.len(),
            "part.pose",
            part.pose as f64,
            "an index of part.faces",
        )
    }

    pub(crate) fn paint(
        &self,
        platen_from_tray: &Isometry2<f64>,
        parts: &[PartView],
        pixels: &mut [u8],
    ) {
        // A higher part hides a lower one; at equal height the order given decides.
        let mut order: Vec<&PartView> = parts.iter().collect();
        order.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
        let seen: Vec<Seen> = order
            .iter()
            .filter_map(|part| self.see(platen_from_tray, part))
            .collect();
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
        let at = |x: f64, y: f64, z: f64| {
            self.camera
                .project(Point3::new(x, y, z))
                .map(|pixel| pixel.coords.map(single))
        };
        let top = at(centre.x, centre.y, top_m)?;
        let foot = at(centre.x, centre.y, foot_m)?;
        let shading = self.light.in_tray(0.0);
        let thrown = shading.toward_lamp.map(f64::from) * (0.5 * self.thickness_m);
        let shadow = at(centre.x - thrown.x, centre.y - thrown.y, foot_m)?;
        let yaw_rad = platen_from_tray.rotation.angle() + part.yaw_rad;
        let platen_from_part = *nalgebra::Rotation2::new(yaw_rad).matrix() * self.radius_m;
        let px_from_platen = self
            .camera
            .projection_jacobian(Point3::new(centre.x, centre.y, top_m))?;
        let px_from_part = px_from_platen * platen_from_part;
        let part_from_px = px_from_part.try_inverse()?;
        let reach_px = Vector2::new(px_from_part.row(0).norm(), px_from_part.row(1).norm());
        let slope = self.tilt(in_tray, part.z_m);
        let (sin, cos) = yaw_rad.sin_cos();
        let in_part = |v: Vector2<f64>| {
            Vector2::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x).map(single)
        };
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
        let eye = platen_from_tray
            .inverse_transform_point(&Point2::new(camera.x_m, camera.y_m))
            .coords;
        let depth_m = camera.height_m - top_m;
        let scale = |height_m: f64| (camera.height_m - height_m) / depth_m;
        let (wall_scale, plateau_scale) = (
            scale(self.tray.wall_top_m()),
            scale(self.tray.plateau_height_m()),
        );
        let below_plateau = top_m < self.tray.plateau_height_m();
        let at_wall = eye + (in_tray.coords - eye) * wall_scale;
        let at_plateau = eye + (in_tray.coords - eye) * plateau_scale;
        let reach_m = self.radius_m + 4.0 * self.camera.m_per_px(top_m);
        let hidden_by_wall = at_wall.norm() < self.tray.geometry.inner_radius_m + reach_m
            || at_wall.norm() > self.tray.geometry.outer_radius_m - reach_m;
        let hidden_by_drop_off =
            below_plateau && self.tray.inside_sector_m(at_plateau.into()) > -reach_m;
        (hidden_by_wall || hidden_by_drop_off).then(|| Screen {
            centre: in_tray.coords,
            tray_from_part: *nalgebra::Rotation2::new(part.yaw_rad).matrix() * self.radius_m,
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
        let mut behind_m =
            (geometry.inner_radius_m - radius_m).max(radius_m - geometry.outer_radius_m);
        if screen.below_plateau {
            let at_plateau = screen.eye + from_eye * screen.plateau_scale;
            behind_m = behind_m.max(self.tray.inside_sector_m(at_plateau.into()));
        }
        single((0.5 - behind_m * screen.px_per_m).clamp(0.0, 1.0))
    }

    /// The rows and columns of pixels within `reach_px` of two centres.
    fn pixels_around(
        &self,
        a: Vector2<f32>,
        b: Vector2<f32>,
        reach_px: Vector2<f32>,
    ) -> (Range<usize>, Range<usize>) {
        let range = |low: f32, high: f32, size: u32| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a float cast saturates"
            )]
            let (low, high) = (
                low.floor().max(0.0) as usize,
                (high.ceil() + 1.0).max(0.0) as usize,
            );
            low..high.min(size as usize)
        };
        (
            range(
                a.y.min(b.y) - reach_px.y,
                a.y.max(b.y) + reach_px.y,
                self.camera.height_px(),
            ),
            range(
                a.x.min(b.x) - reach_px.x,
                a.x.max(b.x) + reach_px.x,
                self.camera.width_px(),
            ),
        )
    }

    fn paint_shadow(&self, part: &Seen, pixels: &mut [u8]) {
        let width = self.camera.width_px() as usize;
        let reach = part.reach_px * (1.0 + SHADOW_SOFTNESS);
        let (rows, columns) = self.pixels_around(part.shadow, part.shadow, reach);
        let loss = 1.0 - part.shading.diffuse() + CONTACT_LOSS;
        let limit = (1.0 + SHADOW_SOFTNESS) * (1.0 + SHADOW_SOFTNESS);
        for row in rows {
            let line = &mut pixels[row * width..(row + 1) * width];
            for column in columns.clone() {
                let offset = Vector2::new(column as f32, row as f32) - part.shadow;
                let place = part.part_from_px * offset;
                let square = place.norm_squared();
                if square < limit {
                    let depth = ((1.0 + SHADOW_SOFTNESS - square.sqrt()) / (2.0 * SHADOW_SOFTNESS))
                        .min(1.0);
                    let mut shadow = loss * depth * depth * (3.0 - 2.0 * depth);
                    if let Some(screen) = &part.screen {
                        shadow *= self.unscreened(screen, place);
                    }
                    line[column] = grey_level(f32::from(line[column]) * (1.0 - shadow));
                }
            }
        }
    }

    fn paint_body(&self, part: &Seen, pixels: &mut [u8]) {
        let width = self.camera.width_px() as usize;
        let (rows, columns) =
            self.pixels_around(part.top, part.foot, part.reach_px.add_scalar(1.0));
        for row in rows {
            let line = &mut pixels[row * width..(row + 1) * width];
            for column in columns.clone() {
                let pixel = Vector2::new(column as f32, row as f32);
                let place = part.part_from_px * (pixel - part.top);
                let radius = place.norm();
                let top = ((1.0 - radius) * part.radius_px + 0.5).clamp(0.0, 1.0);
                let side = if top < 1.0 {
                    let radius = (part.part_from_px * (pixel - part.foot)).norm();
                    ((1.0 - radius) * part.radius_px + 0.5).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                if top + side <= 0.0 {
                    continue;
                }
                let outward = place / radius.max(1e-3);
                let mut value = f32::from(line[column]);
                if side > 0.0 {
                    let brightness = self.side_reflectance * part.shading.on_wall(outward);
                    value += side * (brightness * part.white - value);
                }
                let (mut reflectance, slope) = part.face.at(radius);
                if let Some(mark) = &part.face.mark {
                    let offset = place - Vector2::new(single(mark.offset_ratio), 0.0);
                    let inside_px = (single(mark.radius_ratio) - offset.norm()) * part.radius_px;
                    let cover = (inside_px + 0.5).clamp(0.0, 1.0);
                    reflectance += cover * (single(mark.reflectance) - reflectance);
                }
                let brightness =
                    reflectance * part.shading.on_slope(part.tilt + outward * slope, 1.0);
                value += top * (brightness * part.white - value);
                if let Some(screen) = &part.screen {
                    let behind = f32::from(line[column]);
                    value = behind + self.unscreened(screen, place) * (value - behind);
                }
                line[column] = grey_level(value);
            }
        }
    }
}
