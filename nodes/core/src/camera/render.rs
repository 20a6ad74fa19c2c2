//! Takes the picture.

use image::GrayImage;
use nalgebra::Isometry2;
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::noise::NoiseTable;
use super::parts::PartPainter;
use super::tray::TrayPainter;
use super::{
    CameraModel, InvalidValue, LightModel, MountedTray, PartAppearance, PartView, TrayAppearance,
    require,
};

/// The sensor behind the lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorModel {
    /// Standard deviation of the Gaussian noise, grey levels of 255.
    pub noise_sigma_levels: f64,
}

impl Default for SensorModel {
    fn default() -> Self {
        Self {
            noise_sigma_levels: 2.0,
        }
    }
}

/// Everything a picture depends on that does not move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The camera.
    pub camera: CameraModel,
    /// The tray and its mounting.
    pub tray: MountedTray,
    /// How tray and platen look.
    #[serde(default)]
    pub tray_appearance: TrayAppearance,
    /// How the parts look.
    pub part: PartAppearance,
    /// The light.
    #[serde(default)]
    pub light: LightModel,
    /// The sensor.
    #[serde(default)]
    pub sensor: SensorModel,
}

/// Renders mono pictures of the tray and its parts. The same inputs give the same bytes.
#[derive(Clone, Debug)]
pub struct Renderer {
    tray: TrayPainter,
    parts: PartPainter,
    noise: NoiseTable,
    width_px: u32,
    height_px: u32,
}

impl Renderer {
    /// Precomputes what does not change from picture to picture.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field of the scene that is out of range, or the camera if it hangs lower than twice
    /// the height of the tray's walls.
    pub fn new(scene: &Scene) -> Result<Self, InvalidValue> {
        scene.tray.validate()?;
        scene.tray_appearance.validate()?;
        scene.part.validate()?;
        scene.light.validate()?;
        let sigma = scene.sensor.noise_sigma_levels;
        require(
            (0.0..=40.0).contains(&sigma),
            "sensor.noise_sigma_levels",
            sigma,
            "0 to 40",
        )?;
        let height_m = scene.camera.pose().height_m;
        let clears = height_m >= 2.0 * (scene.tray.wall_top_m() + scene.part.thickness_m);
        require(
            clears,
            "camera.pose.height_m",
            height_m,
            "at least twice the height of the tray's walls",
        )?;
        Ok(Self {
            tray: TrayPainter::new(scene),
            parts: PartPainter::new(scene),
            noise: NoiseTable::new(sigma, scene.camera.width_px() as usize),
            width_px: scene.camera.width_px(),
            height_px: scene.camera.height_px(),
        })
    }

    /// Renders the tray at `platen_from_tray` with these parts into `image`, which takes the camera's size. `noise` deals
    /// out the sensor noise.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] if a part lies in a resting pose whose look is not described, or at no finite place.
    pub fn render(
        &self,
        platen_from_tray: &Isometry2<f64>,
        parts: &[PartView],
        noise: &mut impl Rng,
        image: &mut GrayImage,
    ) -> Result<(), InvalidValue> {
        for part in parts {
            self.parts.check(part)?;
        }
        if image.dimensions() != (self.width_px, self.height_px) {
            *image = GrayImage::new(self.width_px, self.height_px);
        }
        self.tray.paint(platen_from_tray, image);
        self.parts.paint(platen_from_tray, parts, image);
        self.noise.add(noise, self.width_px as usize, image);
        Ok(())
    }
}
