//! Pictures under light that falls alike from all sides.

use std::f64::consts::TAU;

use image::GrayImage;
use nalgebra::Point3;
use rand::Rng;

use super::parts::PartPainter;
use super::render::Renderer;
use super::scene::{Scene, TrayShot};
use super::solid::PartView;
use feeder_model::camera::{grey_level, single};
use feeder_model::range::OutOfRange;

/// Lamps in a ring: shadows of so many look like one that falls to all sides.
const LAMPS: usize = 6;
/// Share of the scene's light that the ring gives: a slope that faces a low lamp is brighter than a level surface by far.
const LIGHT_RATIO: f64 = 0.5;
/// How high over the platen lamps stand in the lights from all sides for which a part's pictures are taught, rad: those of a ring
/// round the lens as seen from the plateau's height below it, and those of a ring afar.
const ROUND_LENS_RAD: f64 = 1.36;
const LOW_RAD: f64 = 0.42;

/// Renders a scene under a ring of lamps in place of its own light.
pub struct AllRound {
    lamps: Vec<Renderer>,
}

impl AllRound {
    /// The lights in which a lesson shows parts: a ring round the lens, a dome, and a low ring afar.
    ///
    /// # Errors
    ///
    /// As [`Scene::validate`].
    pub fn of_lessons(scene: &Scene) -> Result<[Self; 3], OutOfRange> {
        Ok([Self::round_lens(scene)?, Self::dome(scene)?, Self::afar(scene, LOW_RAD)?])
    }

    /// A ring of lamps so far away that all parts see them in the same directions, at this height over the platen, rad.
    ///
    /// # Errors
    ///
    /// As [`Scene::validate`].
    pub fn afar(scene: &Scene, elevation_rad: f64) -> Result<Self, OutOfRange> {
        let lamp = |index: usize| Renderer::new(&lit_by(scene, azimuth_rad(index), elevation_rad));
        Ok(Self { lamps: (0..LAMPS).map(lamp).collect::<Result<_, _>>()? })
    }

    /// Light from the whole sky alike.
    fn dome(scene: &Scene) -> Result<Self, OutOfRange> {
        let mut scene = lit_by(scene, 0.0, ROUND_LENS_RAD);
        scene.light.diffuse_ratio = 1.0;
        Ok(Self { lamps: vec![Renderer::new(&scene)?] })
    }

    /// A ring light round the camera's lens: what lies aside is lit along the line of sight.
    pub(super) fn round_lens(scene: &Scene) -> Result<Self, OutOfRange> {
        let pose = scene.camera.pose();
        let height_m = pose.height_m - scene.tray.plateau_height_m();
        let ring_m = height_m / ROUND_LENS_RAD.tan();
        let steepness_max = (ring_m + scene.tray.geometry.outer_radius_m) / height_m;
        scene.validate()?;
        let parts = PartPainter::lit_from_near_the_lens(&lit_by(scene, 0.0, ROUND_LENS_RAD), steepness_max);
        let lamp = |index: usize| {
            let (sin, cos) = azimuth_rad(index).sin_cos();
            let at = Point3::new(pose.x_m + ring_m * cos, pose.y_m + ring_m * sin, pose.height_m);
            Renderer::with_parts(&lit_by(scene, azimuth_rad(index), ROUND_LENS_RAD), |scene| {
                parts.lit_from(scene.light, at)
            })
        };
        Ok(Self { lamps: (0..LAMPS).map(lamp).collect::<Result<_, _>>()? })
    }

    /// Each lamp of the ring alone: where it stands, counter-clockwise from the platen's x, rad, and what it lights.
    pub fn lamps(&mut self) -> impl Iterator<Item = (f64, &mut Renderer)> {
        self.lamps.iter_mut().enumerate().map(|(index, lamp)| (azimuth_rad(index), lamp))
    }

    /// As [`Renderer::render`]: the mean of what each lamp shows.
    ///
    /// # Errors
    ///
    /// As [`Renderer::render`].
    pub fn render(
        &mut self,
        shot: &TrayShot,
        parts: &[PartView],
        noise: &mut impl Rng,
        image: &mut GrayImage,
    ) -> Result<(), OutOfRange> {
        let mut sums: Vec<u16> = Vec::new();
        for lamp in &mut self.lamps {
            lamp.render(shot, parts, noise, image)?;
            sums.resize(image.len(), 0);
            sums.iter_mut().zip(image.iter()).for_each(|(sum, level)| *sum += u16::from(*level));
        }
        let share = 1.0 / single(self.lamps.len() as f64);
        image.iter_mut().zip(sums).for_each(|(level, sum)| *level = grey_level(share * f32::from(sum)));
        Ok(())
    }
}

fn azimuth_rad(lamp: usize) -> f64 {
    TAU * lamp as f64 / LAMPS as f64
}

/// The scene with a single lamp and nothing else for its light.
fn lit_by(scene: &Scene, azimuth_rad: f64, elevation_rad: f64) -> Scene {
    let mut scene = scene.clone();
    scene.light.white_level *= LIGHT_RATIO;
    scene.light.diffuse_ratio = 0.0;
    scene.light.elevation_rad = elevation_rad;
    scene.light.azimuth_rad = azimuth_rad;
    scene
}
