//! Takes the picture.

use image::GrayImage;
use rand::Rng;

use super::noise::NoiseTable;
use super::parts::PartPainter;
use super::scene::{NOMINAL_EXPOSURE_S, Scene, TrayShot};
use super::tray::TrayPainter;
use crate::camera::PartView;
use feeder_model::camera::{CameraModel, MountedTray, grey_level, single};
use feeder_model::range::OutOfRange;

/// Motion of the tray's picture during the exposure up to which the tray is drawn sharp, px, and the most pictures that are
/// averaged where it moves further.
const SHARP_PX: f64 = 1.0;
const SUB_SHOTS_MAX: f64 = 8.0;

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
    pub fn new(scene: &Scene) -> Result<Self, OutOfRange> {
        Self::with_parts(scene, PartPainter::new)
    }

    /// As [`Renderer::new`], with parts painted by what `parts` makes.
    pub(super) fn with_parts(scene: &Scene, parts: impl FnOnce(&Scene) -> PartPainter) -> Result<Self, OutOfRange> {
        scene.validate()?;
        let mut scene = scene.clone();
        scene.light.white_level *= scene.sensor.exposure_s / NOMINAL_EXPOSURE_S;
        Ok(Self {
            tray: TrayPainter::new(&scene),
            parts: parts(&scene),
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
    /// [`OutOfRange`] if a part lies in a resting pose that the scene does not know, or at no finite place.
    pub fn render(
        &mut self,
        shot: &TrayShot,
        parts: &[PartView],
        noise: &mut impl Rng,
        image: &mut GrayImage,
    ) -> Result<(), OutOfRange> {
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
    fn paint_tray(&mut self, shot: &TrayShot, image: &mut GrayImage) {
        let rim_m_s = shot.velocity_m_s.norm() + shot.yaw_rate_rad_s.abs() * self.mounted.geometry.outer_radius_m;
        let motion_px = rim_m_s * self.exposure_s / self.camera.m_per_px(self.mounted.plateau_height_m());
        let count = (motion_px / SHARP_PX).ceil().clamp(1.0, SUB_SHOTS_MAX);
        if count <= 1.0 {
            self.tray.paint_at_rest(&shot.platen_from_tray, image);
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
    use nalgebra::{Isometry2, Point2, Point3, Vector2};
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::camera::{AllRound, LightModel, PartSolid, SensorModel, TrayAppearance};
    use feeder_model::camera::{CameraPose, CameraSpec, Distortion};
    use feeder_model::tray::TrayGeometry;

    /// Index of the poses of the catalogue's grommet.
    const HOLE_UP: usize = 0;
    const BOSS_UP: usize = 1;

    fn camera_spec() -> CameraSpec {
        CameraSpec {
            width_px: 640,
            height_px: 480,
            focal_length_px: None,
            platen_m_per_px: Some(0.000_3),
            principal_point_px: None,
            distortion: Distortion { k1: -0.08, k2: 0.02, ..Distortion::default() },
            pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
        }
    }

    fn scene(part: &str, noise_sigma_levels: f64) -> Scene {
        Scene {
            camera: CameraModel::new(camera_spec()).unwrap(),
            tray: MountedTray::new(TrayGeometry::PAPER),
            tray_appearance: TrayAppearance::default(),
            part: PartSolid::of_catalogue(part),
            light: LightModel::default(),
            sensor: SensorModel { noise_sigma_levels, ..SensorModel::default() },
        }
    }

    fn part(radius_m: f64, psi_rad: f64, pose: usize) -> PartView {
        let z_m = TrayGeometry::PAPER.height_m(psi_rad);
        PartView { x_m: radius_m * psi_rad.cos(), y_m: radius_m * psi_rad.sin(), z_m, pose, ..PartView::default() }
    }

    fn under_camera() -> TrayShot {
        TrayShot::still(Isometry2::new(Vector2::new(0.3, 0.3), 0.0))
    }

    fn picture(scene: &Scene, shot: &TrayShot, parts: &[PartView]) -> GrayImage {
        let mut image = GrayImage::default();
        let mut renderer = Renderer::new(scene).unwrap();
        renderer.render(shot, parts, &mut Pcg64Mcg::seed_from_u64(1), &mut image).unwrap();
        image
    }

    /// Mean grey level over the 3x3 pixels where a point of the tray frame is seen.
    fn level(scene: &Scene, image: &GrayImage, shot: &TrayShot, point: Point3<f64>) -> f64 {
        let on_platen = shot.platen_from_tray * point.xy();
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
        let mut renderer = Renderer::new(&scene("grommet", 2.0)).unwrap();
        let parts: Vec<PartView> = (0..30).map(|i| part(0.07, f64::from(i) * 0.2, HOLE_UP)).collect();
        let mut shoot = |seed| {
            let mut image = GrayImage::default();
            renderer.render(&under_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(seed), &mut image).unwrap();
            image
        };
        assert_eq!(shoot(5), shoot(5));
        assert_ne!(shoot(5), shoot(6));
    }

    #[test]
    fn parts_appear_where_the_calibration_says_on_ramp_and_plateau() {
        let scene = scene("grommet", 0.0);
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.308, 0.294), -0.02));
        let empty = picture(&scene, &shot, &[]);
        for (radius_m, psi_rad) in [(0.05, 0.6), (0.05, 3.5), (0.045, 4.7), (0.05, 5.9)] {
            let holed = part(radius_m, psi_rad, HOLE_UP);
            let image = picture(&scene, &shot, &[holed]);
            let top = Point3::new(holed.x_m, holed.y_m, holed.z_m + 0.002);
            let beside = |dx: f64| top + nalgebra::Vector3::new(dx, 0.0, 0.0);
            let seen = |point| level(&scene, &image, &shot, point);
            let (hole, face, floor) = (seen(top), seen(beside(0.001_6)), level(&scene, &empty, &shot, top));
            assert!(hole + 10.0 < face && face + 20.0 < floor, "{hole} {face} {floor} at ψ = {psi_rad}");
            let change = seen(beside(-0.009)) - level(&scene, &empty, &shot, beside(-0.009));
            assert!(change.abs() < 2.0, "{change}");
        }
    }

    #[test]
    fn upper_and_lower_faces_differ_and_shadows_fall_away_from_the_lamp() {
        let scene = scene("grommet", 0.0);
        let shot = under_camera();
        let seen = |pose: usize, dx: f64, dy: f64, z_m: f64| {
            let view = part(0.05, 4.5, pose);
            let image = picture(&scene, &shot, &[view]);
            level(&scene, &image, &shot, Point3::new(view.x_m + dx, view.y_m + dy, view.z_m + z_m))
        };
        // Half way to the rim lies the bright flange, or the dark boss on it.
        assert!(seen(HOLE_UP, 0.001_1, 0.0, 0.002) > seen(BOSS_UP, 0.001_1, 0.0, 0.002) + 20.0);
        let (sin, cos) = scene.light.azimuth_rad.sin_cos();
        let (toward, away) =
            (seen(BOSS_UP, 0.003 * cos, 0.003 * sin, 0.0), seen(BOSS_UP, -0.003 * cos, -0.003 * sin, 0.0));
        assert!(toward > away + 5.0, "toward the lamp {toward}, away {away}");
    }

    #[test]
    fn under_a_ring_of_lamps_shadows_fall_to_all_sides_alike() {
        let scene = scene("grommet", 0.0);
        let view = part(0.05, 4.5, BOSS_UP);
        // Right under the camera no line of sight is slanted.
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.3 - view.x_m, 0.3 - view.y_m), 0.0));
        let by_ring = |parts: &[PartView]| {
            let mut image = GrayImage::default();
            let mut ring = AllRound::afar(&scene, 0.6).unwrap();
            ring.render(&shot, parts, &mut Pcg64Mcg::seed_from_u64(1), &mut image).unwrap();
            image
        };
        // By how much more it is darker beside the part on one side than on another.
        let uneven = |bare: &GrayImage, laid: &GrayImage| {
            let beside = |turns: f64| {
                let (sin, cos) = (std::f64::consts::TAU * turns / 8.0).sin_cos();
                let point = Point3::new(view.x_m + 0.003 * cos, view.y_m + 0.003 * sin, view.z_m);
                level(&scene, bare, &shot, point) - level(&scene, laid, &shot, point)
            };
            let all: Vec<f64> = (0..8).map(|index| beside(f64::from(index))).collect();
            all.iter().copied().fold(f64::NEG_INFINITY, f64::max) - all.iter().copied().fold(f64::INFINITY, f64::min)
        };
        let by_lamp = uneven(&picture(&scene, &shot, &[]), &picture(&scene, &shot, &[view]));
        let by_ring = uneven(&by_ring(&[]), &by_ring(&[view]));
        assert!(by_lamp > 10.0 && by_ring < 0.5 * by_lamp, "one lamp {by_lamp}, a ring {by_ring}");
    }

    #[test]
    fn a_ring_round_the_lens_throws_shadows_behind_parts_that_lie_aside() {
        let scene = scene("grommet", 0.0);
        let view = part(0.05, 4.5, HOLE_UP);
        let aside = Vector2::new(0.08, 0.06);
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.3 - view.x_m, 0.3 - view.y_m) + aside, 0.0));
        // How dark it is close to the part on its side towards the camera.
        let shade = |ring: &mut AllRound| {
            let mut picture = |parts: &[PartView]| {
                let mut image = GrayImage::default();
                ring.render(&shot, parts, &mut Pcg64Mcg::seed_from_u64(1), &mut image).unwrap();
                image
            };
            let towards = -0.002_9 * aside.normalize();
            let point = Point3::new(view.x_m + towards.x, view.y_m + towards.y, view.z_m);
            level(&scene, &picture(&[]), &shot, point) - level(&scene, &picture(&[view]), &shot, point)
        };
        let mut round_lens = AllRound::round_lens(&scene).unwrap();
        let (round_lens, afar) = (shade(&mut round_lens), shade(&mut AllRound::afar(&scene, 1.36).unwrap()));
        assert!(afar > 10.0 && round_lens < 0.5 * afar, "round the lens {round_lens}, afar {afar}");
    }

    #[test]
    fn a_ring_round_the_lens_lights_the_floor_before_the_faces_that_the_lens_sees() {
        let scene = scene("block", 0.0);
        let view = part(0.05, 4.5, 0);
        let aside = Vector2::new(0.08, 0.0);
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.3 - view.x_m, 0.3 - view.y_m) + aside, 0.0));
        let mut image = GrayImage::default();
        let mut round_lens = AllRound::round_lens(&scene).unwrap();
        round_lens.render(&shot, &[view], &mut Pcg64Mcg::seed_from_u64(1), &mut image).unwrap();
        let at = |x_m: f64| level(&scene, &image, &shot, Point3::new(view.x_m + x_m, view.y_m, view.z_m));
        // The face towards the lens is seen from 2.6 to 3.3 mm beside the block's middle.
        let face = (26..34).map(|step| at(-1e-4 * f64::from(step))).fold(f64::INFINITY, f64::min) / at(0.0);
        assert!((0.6..0.75).contains(&face), "the face is {face} times as bright as the top");
    }

    #[test]
    fn a_bright_floor_lights_the_sides_of_parts_and_nothing_else() {
        let view = part(0.05, 4.5, 0);
        let mut scene = scene("block", 0.0);
        let pose = CameraPose { height_m: 0.16, ..camera_spec().pose };
        scene.camera = CameraModel::new(CameraSpec { pose, ..camera_spec() }).unwrap();
        // 40 mm beside the axis of a lens so near, the side that faces it is seen.
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.34 - view.x_m, 0.3 - view.y_m), 0.0));
        let mut over_floor_of = |surface_reflectance: f64| {
            scene.tray_appearance.surface_reflectance = surface_reflectance;
            let image = picture(&scene, &shot, &[view]);
            let at = |x_m: f64, z_m: f64| {
                level(&scene, &image, &shot, Point3::new(view.x_m + x_m, view.y_m, view.z_m + z_m))
            };
            (at(-0.003, 0.0015), at(0.0, 0.003))
        };
        let ((bright_side, bright_top), (dark_side, dark_top)) = (over_floor_of(0.7), over_floor_of(0.0));
        assert!((1.2..1.5).contains(&(bright_side / dark_side)), "sides {bright_side} and {dark_side}");
        assert!((bright_top - dark_top).abs() < 1e-9, "tops {bright_top} and {dark_top}");
    }

    #[test]
    fn the_hub_and_the_plateau_hide_what_lies_behind() {
        let scene = scene("grommet", 0.0);
        // Far from under the camera, lines of sight are slanted enough.
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.345, 0.3), 0.0));
        let empty = picture(&scene, &shot, &[]);
        let inside_hub = Point3::new(0.027, 0.0, scene.tray.geometry.rise_m + scene.tray.lip_m);
        let image = picture(&scene, &shot, &[PartView { z_m: 0.0, ..part(0.033, 0.05, BOSS_UP) }]);
        let change = level(&scene, &image, &shot, inside_hub) - level(&scene, &empty, &shot, inside_hub);
        assert!(change.abs() < 1e-9, "{change}");
        assert_ne!(image, empty);
    }

    #[test]
    fn the_drop_off_shows_as_an_edge_and_the_ramp_is_shaded() {
        let scene = scene("grommet", 0.0);
        let shot = under_camera();
        let image = picture(&scene, &shot, &[]);
        let at = |psi_rad: f64| {
            let z_m = scene.tray.geometry.height_m(psi_rad);
            level(&scene, &image, &shot, Point3::new(0.06 * psi_rad.cos(), 0.06 * psi_rad.sin(), z_m))
        };
        let (plateau, foot) = (at(std::f64::consts::TAU - 0.05), at(0.08));
        assert!(plateau > 1.2 * foot, "plateau {plateau}, foot of the ramp {foot}");
        // At ψ = 90° the ramp leans towards x: a lamp standing there makes it brighter than one opposite, the plateau not.
        let lit_from = |azimuth_rad: f64, psi_rad: f64| {
            let mut scene = scene.clone();
            scene.light.azimuth_rad = azimuth_rad;
            let image = picture(&scene, &shot, &[]);
            let z_m = scene.tray.geometry.height_m(psi_rad);
            level(&scene, &image, &shot, Point3::new(0.06 * psi_rad.cos(), 0.06 * psi_rad.sin(), z_m))
        };
        let change = |psi_rad: f64| lit_from(0.0, psi_rad) - lit_from(std::f64::consts::PI, psi_rad);
        assert!(change(std::f64::consts::FRAC_PI_2) > 3.0);
        assert!(change(-std::f64::consts::FRAC_PI_2).abs() < 1.0);
    }

    #[test]
    fn the_picture_turns_with_part_and_lamp() {
        let view = part(0.05, 4.5, 0);
        // The part lies right under the camera, so that no line of sight is slanted.
        let shot = TrayShot::still(Isometry2::new(Vector2::new(0.3 - view.x_m, 0.3 - view.y_m), 0.0));
        let levels = |turn_rad: f64| {
            let mut scene = scene("block", 0.0);
            scene.light = LightModel {
                azimuth_rad: scene.light.azimuth_rad + turn_rad,
                gradient_right_ratio: 0.0,
                gradient_down_ratio: 0.0,
                ..scene.light
            };
            let yaw_rad = 0.3 + turn_rad;
            let image = picture(&scene, &shot, &[PartView { yaw_rad, ..view }]);
            [-0.010, -0.004, -0.002, 0.0, 0.002, 0.004, 0.006].map(|along_m: f64| {
                let place = Point2::new(view.x_m + along_m * yaw_rad.cos(), view.y_m + along_m * yaw_rad.sin());
                level(&scene, &image, &shot, Point3::new(place.x, place.y, view.z_m))
            })
        };
        let (here, turned) = (levels(0.3), levels(0.3 + std::f64::consts::FRAC_PI_2));
        // What is left is the cloudiness of the tray, 1.2 %, and the pixel grid.
        assert!(here.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 8.0), "{here:?} {turned:?}");
        assert!((here[0] - here[3]).abs() > 20.0, "part and floor differ: {here:?}");
    }

    #[test]
    fn motion_during_the_exposure_blurs_along_it_and_longer_exposures_are_brighter() {
        let mut scene = scene("grommet", 0.0);
        scene.light.white_level = 100.0;
        scene.sensor.exposure_s = 0.001;
        let view = part(0.05, 4.5, HOLE_UP);
        let still = under_camera();
        let moving = TrayShot { velocity_m_s: Vector2::new(1.5, 0.0), ..still };
        let top = Point3::new(view.x_m, view.y_m, view.z_m + 0.002);
        let (sharp, blurred) = (picture(&scene, &still, &[view]), picture(&scene, &moving, &[view]));
        // 1.5 mm of motion fill in the hole of 1.4 mm.
        let hole = |image| level(&scene, image, &still, top);
        assert!(hole(&blurred) > hole(&sharp) + 5.0, "{} {}", hole(&sharp), hole(&blurred));
        let darker = |dx: f64| {
            let at = |image| level(&scene, image, &still, top + nalgebra::Vector3::new(dx, 0.0, 0.0));
            at(&sharp) - at(&blurred)
        };
        assert!(darker(0.002_2) > 2.0, "the rim is mixed with its shadow: {}", darker(0.002_2));
        assert!(darker(-0.002_8) > 2.0, "towards the lamp the floor is mixed with the rim: {}", darker(-0.002_8));
        let floor = level(&scene, &sharp, &still, Point3::new(0.03, -0.05, 0.02));
        scene.sensor.exposure_s = 0.000_5;
        let darker = level(&scene, &picture(&scene, &still, &[view]), &still, Point3::new(0.03, -0.05, 0.02));
        assert!((floor / darker - 2.0).abs() < 0.05, "{floor} {darker}");
    }

    #[test]
    fn bad_scenes_and_parts_are_refused_by_name() {
        let mut low = scene("grommet", 2.0);
        low.tray.floor_height_m = 0.4;
        assert_eq!(Renderer::new(&low).unwrap_err().parameter, "camera.pose.height_m");
        let mut noisy = scene("grommet", f64::NAN);
        assert_eq!(Renderer::new(&noisy).unwrap_err().parameter, "sensor.noise_sigma_levels");
        noisy.sensor = SensorModel { exposure_s: 0.0, ..SensorModel::default() };
        assert_eq!(Renderer::new(&noisy).unwrap_err().parameter, "sensor.exposure_s");
        noisy.sensor = SensorModel::default();
        noisy.part.poses.clear();
        assert_eq!(Renderer::new(&noisy).unwrap_err().parameter, "part.poses");
        let mut renderer = Renderer::new(&scene("grommet", 2.0)).unwrap();
        let mut shoot = |view: PartView| {
            let mut image = GrayImage::default();
            renderer.render(&under_camera(), &[view], &mut Pcg64Mcg::seed_from_u64(1), &mut image)
        };
        assert_eq!(shoot(part(0.06, 4.0, 9)).unwrap_err().parameter, "part.pose");
        assert_eq!(shoot(PartView { x_m: f64::NAN, ..part(0.06, 4.0, 0) }).unwrap_err().parameter, "part.x_m");
        // Out of view is no error.
        assert_eq!(shoot(PartView { x_m: 3.0, ..part(0.06, 4.0, 0) }), Ok(()));
    }
}
