//! Pictures under light that falls alike from all sides.

use std::f64::consts::TAU;

use image::GrayImage;
use rand::Rng;

use super::render::Renderer;
use super::scene::{Scene, TrayShot};
use super::solid::PartView;
use feeder_model::camera::{grey_level, single};
use feeder_model::range::OutOfRange;

/// Lamps in a ring: shadows of so many look like one that falls to all sides.
const LAMPS: usize = 6;
/// Share of the scene's light that the ring gives: a slope that faces a low lamp is brighter than a level surface by far.
const LIGHT_RATIO: f64 = 0.5;

/// Renders a scene under a ring of lamps in place of its own light.
pub struct AllRound {
    lamps: Vec<Renderer>,
}

impl AllRound {
    /// A ring of lamps at this height over the platen, rad.
    ///
    /// # Errors
    ///
    /// As [`Scene::validate`].
    pub fn new(scene: &Scene, elevation_rad: f64) -> Result<Self, OutOfRange> {
        let lamp = |index: usize| {
            let mut scene = scene.clone();
            scene.light.white_level *= LIGHT_RATIO;
            scene.light.diffuse_ratio = 0.0;
            scene.light.elevation_rad = elevation_rad;
            scene.light.azimuth_rad = TAU * index as f64 / LAMPS as f64;
            Renderer::new(&scene)
        };
        Ok(Self { lamps: (0..LAMPS).map(lamp).collect::<Result<_, _>>()? })
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
        let share = 1.0 / single(LAMPS as f64);
        image.iter_mut().zip(sums).for_each(|(level, sum)| *level = grey_level(share * f32::from(sum)));
        Ok(())
    }
}
