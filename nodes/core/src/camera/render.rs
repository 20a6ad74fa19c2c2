//! Takes the picture.

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Vector2};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::noise::NoiseTable;
use super::parts::PartPainter;
use super::tray::TrayPainter;
use super::{CameraModel, InvalidValue, LightModel, MountedTray, PartSolid, PartView, TrayAppearance, grey_level, require, single};

/// The exposure for which [`LightModel::white_level`] is stated, s.
const NOMINAL_EXPOSURE_S: f64 = 0.000_5;
/// Motion of the tray's picture during the exposure up to which the tray is drawn sharp, px, and the most pictures that are
/// averaged where it moves further.
const SHARP_PX: f64 = 0.5;
const SUB_SHOTS_MAX: f64 = 8.0;

/// The sensor behind the lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorModel {
    /// Standard deviation of the Gaussian noise, grey levels of 255.
    pub noise_sigma_levels: f64,
    /// How long the shutter is open, s. Brightness grows with it, and so does the blur of what moves.
    pub exposure_s: f64,
}

impl Default for SensorModel {
    fn default() -> Self {
        Self { noise_sigma_levels: 2.0, exposure_s: NOMINAL_EXPOSURE_S }
    }
}

impl SensorModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        let sigma = self.noise_sigma_levels;
        require((0.0..=40.0).contains(&sigma), "sensor.noise_sigma_levels", sigma, "0 to 40")?;
        let exposure_ok = (1e-6..=1.0).contains(&self.exposure_s);
        require(exposure_ok, "sensor.exposure_s", self.exposure_s, "1e-6 to 1 s")
    }
}

/// Everything a picture depends on that does not move.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The camera.
    pub camera: CameraModel,
    /// The tray and its mounting.
    pub tray: MountedTray,
    /// How the tray looks.
    pub tray_appearance: TrayAppearance,
    /// The parts.
    pub part: PartSolid,
    /// The light.
    pub light: LightModel,
    /// The sensor.
    pub sensor: SensorModel,
}

impl Scene {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field of the scene that is out of range, or the camera if it hangs lower than twice
    /// the height of the tray's walls.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        self.tray.validate()?;
        self.tray_appearance.validate()?;
        self.part.validate()?;
        self.light.validate()?;
        self.sensor.validate()?;
        let height_m = self.camera.pose().height_m;
        let clears = height_m >= 2.0 * (self.tray.wall_top_m() + self.part.height_m_max());
        require(clears, "camera.pose.height_m", height_m, "at least twice the height of the tray's walls")
    }
}

/// The tray while a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrayShot {
    /// Pose of the tray in the middle of the exposure.
    pub platen_from_tray: Isometry2<f64>,
    /// Velocity of its centre over the platen, m/s.
    pub velocity_m_s: Vector2<f64>,
    /// How fast it turns, rad/s.
    pub yaw_rate_rad_s: f64,
}

impl TrayShot {
    /// A tray at rest.
    #[must_use]
    pub fn still(platen_from_tray: Isometry2<f64>) -> Self {
        Self { platen_from_tray, velocity_m_s: Vector2::zeros(), yaw_rate_rad_s: 0.0 }
    }

    /// Velocity over the platen of a point of the tray, m/s.
    pub(super) fn velocity_at(&self, in_tray: Point2<f64>) -> Vector2<f64> {
        let arm = self.platen_from_tray.rotation * in_tray.coords;
        self.velocity_m_s + Vector2::new(-arm.y, arm.x) * self.yaw_rate_rad_s
    }

    fn after(&self, seconds: f64) -> Isometry2<f64> {
        let turn = self.platen_from_tray.rotation.angle() + self.yaw_rate_rad_s * seconds;
        Isometry2::new(self.platen_from_tray.translation.vector + self.velocity_m_s * seconds, turn)
    }
}

/// Renders mono pictures of the tray and its parts. The same inputs give the same bytes.
#[derive(Clone, Debug)]
pub struct Renderer {
    tray: TrayPainter,
    parts: PartPainter,
    noise: NoiseTable,
    camera: CameraModel,
    mounted: MountedTray,
    exposure_s: f64,
}

impl Renderer {
    /// Precomputes what does not change from picture to picture.
    ///
    /// # Errors
    ///
    /// As [`Scene::validate`].
    pub fn new(scene: &Scene) -> Result<Self, InvalidValue> {
        scene.validate()?;
        let mut scene = scene.clone();
        scene.light.white_level *= scene.sensor.exposure_s / NOMINAL_EXPOSURE_S;
        Ok(Self {
            tray: TrayPainter::new(&scene),
            parts: PartPainter::new(&scene),
            noise: NoiseTable::new(scene.sensor.noise_sigma_levels, scene.camera.width_px() as usize),
            camera: scene.camera,
            mounted: scene.tray,
            exposure_s: scene.sensor.exposure_s,
        })
    }

    /// Renders the tray with these parts into `image`, which takes the camera's size. `noise` deals out the sensor noise.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] if a part lies in a resting pose that the scene does not know, or at no finite place.
    pub fn render(
        &self,
        shot: &TrayShot,
        parts: &[PartView],
        noise: &mut impl Rng,
        image: &mut GrayImage,
    ) -> Result<(), InvalidValue> {
        for part in parts {
            self.parts.check(part)?;
        }
        let (width_px, height_px) = (self.camera.width_px(), self.camera.height_px());
        if image.dimensions() != (width_px, height_px) {
            *image = GrayImage::new(width_px, height_px);
        }
        self.paint_tray(shot, image);
        self.parts.paint(shot, self.exposure_s, parts, image);
        self.noise.add(noise, width_px as usize, image);
        Ok(())
    }

    /// Paints platen and tray, averaged over the exposure where they move.
    fn paint_tray(&self, shot: &TrayShot, image: &mut GrayImage) {
        let rim_m_s = shot.velocity_m_s.norm() + shot.yaw_rate_rad_s.abs() * self.mounted.geometry.outer_radius_m;
        let motion_px = rim_m_s * self.exposure_s / self.camera.m_per_px(self.mounted.plateau_height_m());
        let count = (motion_px / SHARP_PX).ceil().clamp(1.0, SUB_SHOTS_MAX);
        if count <= 1.0 {
            self.tray.paint(&shot.platen_from_tray, image);
            return;
        }
        let mut sums = vec![0_u16; image.len()];
        let mut index = 0.5;
        while index < count {
            self.tray.paint(&shot.after((index / count - 0.5) * self.exposure_s), image);
            for (sum, pixel) in sums.iter_mut().zip(image.iter()) {
                *sum += u16::from(*pixel);
            }
            index += 1.0;
        }
        let scale = 1.0 / single(count);
        for (pixel, sum) in image.iter_mut().zip(sums) {
            *pixel = grey_level(f32::from(sum) * scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;
    use nalgebra::{Point2, Point3, Vector2};
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::super::{CameraPose, CameraSpec, Distortion, FaceMark};
    use super::*;
    use crate::tray::TrayGeometry;

    fn scene(noise_sigma_levels: f64) -> Scene {
        Scene {
            camera: CameraModel::new(CameraSpec {
                width_px: 640,
                height_px: 480,
                focal_length_px: None,
                platen_m_per_px: Some(0.000_45),
                principal_point_px: None,
                distortion: Distortion { k1: -0.08, k2: 0.02, ..Distortion::default() },
                pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
            })
            .unwrap(),
            tray: MountedTray::new(TrayGeometry::PAPER),
            tray_appearance: TrayAppearance::default(),
            part: PartAppearance::grommet(0.010, 0.003),
            light: LightModel::default(),
            sensor: SensorModel { noise_sigma_levels },
        }
    }

    fn part(radius_m: f64, psi_rad: f64, pose: usize) -> PartView {
        let z_m = TrayGeometry::PAPER.height_m(psi_rad);
        PartView { x_m: radius_m * psi_rad.cos(), y_m: radius_m * psi_rad.sin(), z_m, yaw_rad: 0.0, pose }
    }

    fn picture(scene: &Scene, platen_from_tray: &Isometry2<f64>, parts: &[PartView]) -> GrayImage {
        let mut image = GrayImage::default();
        let renderer = Renderer::new(scene).unwrap();
        renderer.render(platen_from_tray, parts, &mut Pcg64Mcg::seed_from_u64(1), &mut image).unwrap();
        image
    }

    /// Mean grey level over the 3x3 pixels where a point of the tray frame is seen.
    fn level(scene: &Scene, image: &GrayImage, platen_from_tray: &Isometry2<f64>, point: Point3<f64>) -> f64 {
        let on_platen = platen_from_tray * point.xy();
        let above_platen_m = scene.tray.floor_height_m + point.z;
        let pixel = scene.camera.project(Point3::new(on_platen.x, on_platen.y, above_platen_m)).unwrap();
        let mut sum = 0.0;
        for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the image")]
            let (x, y) = ((pixel.x.round() as i32 + dx) as u32, (pixel.y.round() as i32 + dy) as u32);
            sum += f64::from(image.get_pixel(x, y).0[0]) / 9.0;
        }
        sum
    }

    #[test]
    fn the_same_inputs_give_the_same_bytes_and_another_seed_other_noise() {
        let renderer = Renderer::new(&scene(2.0)).unwrap();
        let pose = Isometry2::new(Vector2::new(0.3, 0.3), 0.01);
        let parts: Vec<PartView> = (0..30).map(|i| part(0.07, f64::from(i) * 0.2, 0)).collect();
        let shoot = |seed| {
            let mut image = GrayImage::default();
            renderer.render(&pose, &parts, &mut Pcg64Mcg::seed_from_u64(seed), &mut image).unwrap();
            image
        };
        assert_eq!(shoot(5), shoot(5));
        assert_ne!(shoot(5), shoot(6));
    }

    #[test]
    fn parts_appear_where_the_calibration_says_on_ramp_and_plateau() {
        let scene = scene(0.0);
        let pose = Isometry2::new(Vector2::new(0.308, 0.294), -0.02);
        for (radius_m, psi_rad) in [(0.05, 0.6), (0.08, 1.5), (0.07, 3.5), (0.045, 4.7), (0.084, 5.9)] {
            let holed = part(radius_m, psi_rad, 0);
            let image = picture(&scene, &pose, &[holed]);
            let empty = picture(&scene, &pose, &[]);
            let top_m = holed.z_m + 0.003;
            let centre = Point3::new(holed.x_m, holed.y_m, top_m);
            let rim = |dx: f64| centre + nalgebra::Vector3::new(dx, 0.0, 0.0);
            let hole = level(&scene, &image, &pose, centre);
            let face = level(&scene, &image, &pose, rim(0.003_2));
            let floor = level(&scene, &empty, &pose, centre);
            assert!(hole + 50.0 < face && face + 20.0 < floor, "{hole} {face} {floor} at ψ = {psi_rad}");
            let beside = rim(-0.009);
            let change = level(&scene, &image, &pose, beside) - level(&scene, &empty, &pose, beside);
            assert!(change.abs() < 2.0, "{change}");
        }
    }

    #[test]
    fn faces_differ_in_structure_but_hardly_in_brightness() {
        let scene = scene(0.0);
        let pose = Isometry2::new(Vector2::new(0.3, 0.3), 0.0);
        let mean = |face: usize| {
            let view = part(0.06, 4.5, face);
            let image = picture(&scene, &pose, &[view]);
            let (mut sum, mut count) = (0.0, 0.0);
            for (dx, dy) in (-9..=9).flat_map(|dx| (-9..=9).map(move |dy| (dx, dy))) {
                let offset = Vector2::new(f64::from(dx), f64::from(dy)) * 0.000_5;
                if offset.norm() < 0.004_7 {
                    let place = Point3::new(view.x_m + offset.x, view.y_m + offset.y, view.z_m + 0.003);
                    sum += level(&scene, &image, &pose, place);
                    count += 1.0;
                }
            }
            sum / count
        };
        let (upper, lower) = (mean(0), mean(1));
        assert!((upper - lower).abs() < 0.06 * upper, "{upper} {lower}");
    }

    #[test]
    fn the_hub_and_the_plateau_hide_what_lies_behind() {
        let scene = scene(0.0);
        // Far from under the camera, lines of sight are slanted enough.
        let pose = Isometry2::new(Vector2::new(0.36, 0.3), 0.0);
        let empty = picture(&scene, &pose, &[]);
        let inside_hub = Point3::new(0.027, 0.0, scene.tray.geometry.rise_m + scene.tray.lip_m);
        let behind = PartView { z_m: 0.0, ..part(0.033, 0.05, 0) };
        let image = picture(&scene, &pose, &[behind]);
        let change = level(&scene, &image, &pose, inside_hub) - level(&scene, &empty, &pose, inside_hub);
        assert!(change.abs() < 1e-9, "{change}");
        assert_ne!(image, empty);
    }

    #[test]
    fn the_drop_off_shows_as_an_edge_and_the_ramp_is_shaded() {
        let scene = scene(0.0);
        let pose = Isometry2::new(Vector2::new(0.3, 0.3), 0.0);
        let image = picture(&scene, &pose, &[]);
        let at = |psi_rad: f64| {
            let z_m = scene.tray.geometry.height_m(psi_rad);
            level(&scene, &image, &pose, Point3::new(0.06 * psi_rad.cos(), 0.06 * psi_rad.sin(), z_m))
        };
        let (plateau, foot) = (at(std::f64::consts::TAU - 0.05), at(0.08));
        assert!(plateau > 1.2 * foot, "plateau {plateau}, foot of the ramp {foot}");
        // At ψ = 90° the ramp leans towards x: a lamp standing there makes it brighter than one opposite, the plateau not.
        let lit_from = |azimuth_rad: f64, psi_rad: f64| {
            let mut scene = scene.clone();
            scene.light.azimuth_rad = azimuth_rad;
            let image = picture(&scene, &pose, &[]);
            let z_m = scene.tray.geometry.height_m(psi_rad);
            let place = Point3::new(0.06 * psi_rad.cos(), 0.06 * psi_rad.sin(), z_m);
            level(&scene, &image, &pose, place)
        };
        let change = |psi_rad: f64| lit_from(0.0, psi_rad) - lit_from(std::f64::consts::PI, psi_rad);
        assert!(change(std::f64::consts::FRAC_PI_2) > 3.0);
        assert!(change(-std::f64::consts::FRAC_PI_2).abs() < 1.0);
    }

    #[test]
    fn a_mark_turns_with_the_part() {
        let mut scene = scene(0.0);
        scene.part.faces[0].mark = Some(FaceMark { offset_ratio: 0.65, radius_ratio: 0.18, reflectance: 0.9 });
        let pose = Isometry2::new(Vector2::new(0.3, 0.3), 0.3);
        let view = PartView { yaw_rad: 1.1, ..part(0.06, 4.5, 0) };
        let image = picture(&scene, &pose, &[view]);
        let at = |yaw_rad: f64| {
            let offset = Point2::new(yaw_rad.cos(), yaw_rad.sin()) * (0.65 * 0.005);
            let place = Point3::new(view.x_m + offset.x, view.y_m + offset.y, view.z_m + 0.003);
            level(&scene, &image, &pose, place)
        };
        assert!(at(1.1) > at(1.1 + 1.5) + 50.0);
    }

    #[test]
    fn bad_scenes_and_parts_are_refused_by_name() {
        let mut low = scene(2.0);
        low.tray.floor_height_m = 0.4;
        assert_eq!(Renderer::new(&low).unwrap_err().field, "camera.pose.height_m");
        let mut noisy = scene(f64::NAN);
        assert_eq!(Renderer::new(&noisy).unwrap_err().field, "sensor.noise_sigma_levels");
        noisy.sensor.noise_sigma_levels = 2.0;
        noisy.part.faces.clear();
        assert_eq!(Renderer::new(&noisy).unwrap_err().field, "part.faces");
        let renderer = Renderer::new(&scene(2.0)).unwrap();
        let shoot = |view: PartView| {
            let mut image = GrayImage::default();
            let pose = Isometry2::new(Vector2::new(0.3, 0.3), 0.0);
            renderer.render(&pose, &[view], &mut Pcg64Mcg::seed_from_u64(1), &mut image)
        };
        assert_eq!(shoot(part(0.06, 4.0, 2)).unwrap_err().field, "part.pose");
        assert_eq!(shoot(PartView { x_m: f64::NAN, ..part(0.06, 4.0, 0) }).unwrap_err().field, "part.x_m");
        // Out of view is no error.
        assert_eq!(shoot(PartView { x_m: 3.0, ..part(0.06, 4.0, 0) }), Ok(()));
    }
}
