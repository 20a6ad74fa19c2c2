//! Paints platen and tray: everything in the picture that is not a part.
//!
//! The lattice of `tile` is filled here: for every lattice point, where it lies on each surface of the tray and how much
//! light that surface sends back.

use std::collections::VecDeque;

use nalgebra::{Isometry2, Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::scene::Scene;
use super::surfaces::{MOTTLE_CELLS, TrayPose};
use super::tile::{TILE, paint_tile};
use feeder_model::camera::{grey_level, single};

/// A tray at rest is painted where it stands to this share of a pixel: far less than a grey level.
const STEP_PX: f64 = 1.0 / 64.0;
/// Pictures of the tray at rest that are kept. A tray that vibrates comes back to a place as soon as a whole number of periods
/// has passed between pictures.
const KEPT: usize = 8;

/// Precomputed view of a camera on the platen, ready to paint the tray at any pose.
#[derive(Clone, Debug)]
pub(crate) struct TrayPainter {
    scene: Scene,
    width: usize,
    node_columns: usize,
    /// Direction of sight of every lattice point, in the platen frame, per metre of descent.
    rays: Vec<Vector2<f32>>,
    /// Grey level of level white at every lattice point.
    white: Vec<f32>,
    /// The picture of the bare platen.
    platen: Vec<u8>,
    mottle: Vec<f32>,
    /// The latest poses in which the tray was painted at rest, with their pictures, the latest first.
    kept: VecDeque<(Isometry2<f64>, Vec<u8>)>,
}

impl TrayPainter {
    pub(crate) fn new(scene: &Scene) -> Self {
        let camera = &scene.camera;
        let (width, height) = (camera.width_px() as usize, camera.height_px() as usize);
        let (node_columns, node_rows) = (width.div_ceil(TILE) + 1, height.div_ceil(TILE) + 1);
        let mut rays = Vec::with_capacity(node_columns * node_rows);
        let mut white = Vec::with_capacity(node_columns * node_rows);
        for node in 0..node_columns * node_rows {
            let place = |index: usize| (index * TILE) as f64;
            let pixel = Point2::new(place(node % node_columns), place(node / node_columns));
            // Lattice points beyond the border may lie where the lens cannot be undone; the border's ray serves them.
            let border = Point2::new(pixel.x.min((width - 1) as f64), pixel.y.min((height - 1) as f64));
            let ray = camera.ray(pixel).or_else(|| camera.ray(border)).unwrap_or_default();
            rays.push(ray.map(single));
            white.push(scene.light.white_at(pixel.x, pixel.y, camera.width_px(), camera.height_px()));
        }
        let mut generator = Pcg64Mcg::seed_from_u64(0x7472_6179);
        let amplitude = single(scene.tray_appearance.mottling_ratio);
        let mottle =
            (0..MOTTLE_CELLS * MOTTLE_CELLS).map(|_| 1.0 + amplitude * generator.random_range(-1.0..1.0)).collect();
        Self {
            scene: scene.clone(),
            width,
            node_columns,
            rays,
            white,
            platen: bare_platen(scene),
            mottle,
            kept: VecDeque::new(),
        }
    }

    /// Paints platen and tray at rest over the whole picture; where the tray stood a short time ago, what was painted then.
    pub(crate) fn paint_at_rest(&mut self, platen_from_tray: &Isometry2<f64>, pixels: &mut [u8]) {
        let Scene { tray, camera, .. } = &self.scene;
        let place = tray.on_grid(camera, platen_from_tray, STEP_PX);
        if let Some(index) = self.kept.iter().position(|(kept, _)| *kept == place) {
            self.kept.make_contiguous()[..=index].rotate_right(1);
            pixels.copy_from_slice(&self.kept[0].1);
            return;
        }
        self.paint(&place, pixels);
        self.kept.truncate(KEPT - 1);
        self.kept.push_front((place, pixels.to_vec()));
    }

    /// Paints platen and tray over the whole picture.
    pub(crate) fn paint(&self, platen_from_tray: &Isometry2<f64>, pixels: &mut [u8]) {
        let pose = TrayPose::new(&self.scene, platen_from_tray);
        let node_row = |row: usize| {
            let range = row * self.node_columns..(row + 1) * self.node_columns;
            self.rays[range.clone()]
                .iter()
                .zip(&self.white[range])
                .map(|(ray, white)| pose.node(*ray, *white, &self.mottle))
                .collect::<Vec<_>>()
        };
        let mut upper = node_row(0);
        let bands = pixels.chunks_mut(self.width * TILE).zip(self.platen.chunks(self.width * TILE));
        for (band, (pixels, platen)) in bands.enumerate() {
            let lower = node_row(band + 1);
            for tile in 0..self.node_columns - 1 {
                let corners = [&upper[tile], &upper[tile + 1], &lower[tile], &lower[tile + 1]];
                paint_tile(corners, tile * TILE, self.width, platen, pixels);
            }
            upper = lower;
        }
    }
}

/// The bare platen: teeth, light and shade, averaged over a square of a pixel's size.
fn bare_platen(scene: &Scene) -> Vec<u8> {
    let look = &scene.tray_appearance;
    let camera = &scene.camera;
    let half_px = camera.m_per_px(0.0) / look.tooth_pitch_m / 2.0;
    // Teeth are half of the pitch wide: their total width, in pitches, up to `x`.
    let teeth_to = |x: f64| x.floor() / 2.0 + (x - x.floor()).min(0.5);
    let teeth_at = |x_m: f64| {
        let x = x_m / look.tooth_pitch_m;
        (teeth_to(x + half_px) - teeth_to(x - half_px)) / (2.0 * half_px)
    };
    let (width, height) = (camera.width_px(), camera.height_px());
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
        let (row, column) = (f64::from(row), f64::from(column));
        let seen = camera.back_project(Point2::new(column, row), 0.0);
        let teeth = seen.map_or(0.0, |point| teeth_at(point.x) * teeth_at(point.y));
        let reflectance = look.platen_reflectance + teeth * (look.tooth_reflectance - look.platen_reflectance);
        pixels.push(grey_level(single(reflectance) * scene.light.white_at(column, row, width, height)));
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{LightModel, PartSolid, SensorModel, TrayAppearance};
    use feeder_model::camera::{CameraModel, CameraPose, CameraSpec, Distortion, MountedTray};
    use feeder_model::tray::TrayGeometry;

    fn scene() -> Scene {
        let pose = CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.2 };
        Scene {
            camera: CameraModel::new(CameraSpec {
                width_px: 640,
                height_px: 480,
                focal_length_px: None,
                platen_m_per_px: Some(0.000_45),
                principal_point_px: None,
                distortion: Distortion { k1: -0.1, ..Default::default() },
                pose,
            })
            .unwrap(),
            tray: MountedTray::new(TrayGeometry::PAPER),
            tray_appearance: TrayAppearance::default(),
            part: PartSolid::of_catalogue("grommet"),
            light: LightModel::default(),
            sensor: SensorModel::default(),
        }
    }

    #[test]
    fn a_picture_that_was_kept_is_the_one_that_would_be_painted() {
        let mut painter = TrayPainter::new(&scene());
        let at = |x_m: f64, yaw_rad: f64| Isometry2::new(nalgebra::Vector2::new(x_m, 0.28), yaw_rad);
        let shot = |painter: &mut TrayPainter, pose: Isometry2<f64>| {
            let mut pixels = vec![0; 640 * 480];
            painter.paint_at_rest(&pose, &mut pixels);
            pixels
        };
        // Twelve places are four more than are kept; on the way back the later ones are at hand, the others are not.
        let places = (0..12).map(|index| at(0.3 + 0.001 * f64::from(index), -0.002 * f64::from(index)));
        for pose in places.clone().chain(places.rev()) {
            let mut fresh = TrayPainter::new(&painter.scene);
            assert!(shot(&mut painter, pose) == shot(&mut fresh, pose), "{pose}");
            assert!(painter.kept.len() <= KEPT);
        }
        assert!(shot(&mut painter, at(0.3, 0.0)) != shot(&mut painter, at(0.300_05, 0.0)), "50 µm are seen");
    }

    #[test]
    fn verif_a_picture_at_rest_is_within_a_grey_level_of_the_one_at_the_very_place() {
        let mut painter = TrayPainter::new(&scene());
        let (mut rounded, mut exact) = (vec![0_u8; 640 * 480], vec![0; 640 * 480]);
        for index in 0..10 {
            let odd = f64::from(index) * 1.618e-6;
            let pose = Isometry2::new(nalgebra::Vector2::new(0.31 + odd, 0.28 - odd), -0.02 + 7.0 * odd);
            painter.paint_at_rest(&pose, &mut rounded);
            painter.paint(&pose, &mut exact);
            let off = |limit: u8| rounded.iter().zip(&exact).filter(|(a, b)| a.abs_diff(**b) > limit).count();
            assert_eq!(off(2), 0);
            // Outlines of 100 levels and more move by a hundredth of a pixel.
            assert!(off(1) < 300, "{} pixels", off(1));
        }
    }

    #[test]
    fn verif_interpolated_picture_against_the_exact_one() {
        let scene = scene();
        let painter = TrayPainter::new(&scene);
        let platen_from_tray = Isometry2::new(nalgebra::Vector2::new(0.31, 0.28), -0.02);
        let mut pixels = vec![0; 640 * 480];
        painter.paint(&platen_from_tray, &mut pixels);
        let tray_pose = TrayPose::new(&scene, &platen_from_tray);
        let (mut count, mut off) = (0, 0);
        for index in (0..pixels.len()).step_by(13) {
            let (column, row) = ((index % 640) as f64, (index / 640) as f64);
            let ray = scene.camera.ray(Point2::new(column, row)).unwrap().map(single);
            let node = tray_pose.node(ray, scene.light.white_at(column, row, 640, 480), &painter.mottle);
            let bare = f32::from(painter.platen[index]) * node.platen_light;
            let exact = node
                .inside_px
                .iter()
                .zip(node.grey)
                .fold(bare, |value, (inside, grey)| value + (inside + 0.5).clamp(0.0, 1.0) * (grey - value));
            count += 1;
            off += u32::from((exact - f32::from(pixels[index])).abs() > 3.0);
        }
        // Outlines fill some 3 % of the picture and are up to 0.1 px off there, which is 10 levels where they are hard.
        assert!(f64::from(off) < 0.02 * f64::from(count), "{off} of {count} pixels off by more than 3 levels");
    }
}
