//! Pictures of the tray in files, and where the tray stood.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use feeder_model::camera::CameraModel;
use feeder_scenario::Scenario;
use feeder_vision::{ImageFault, binned, decode};
use image::GrayImage;
use nalgebra::{Isometry2, Point2, Vector2};

/// A picture of the tray.
#[derive(Clone)]
pub(crate) struct Photo {
    pub(crate) file: PathBuf,
    /// At the camera's size.
    pub(crate) image: GrayImage,
    /// Width and height as it came, px: each pixel of the image is the mean of a whole number of those, each way.
    pub(crate) own_size_px: (u32, u32),
    pub(crate) platen_from_tray: Isometry2<f64>,
}

impl Photo {
    /// Reads a JPEG or a PNG taken with the tray at `platen_from_tray`, and brings it to the camera's size if it is a whole
    /// multiple of that.
    pub(crate) fn open(file: &Path, camera: &CameraModel, platen_from_tray: Isometry2<f64>) -> anyhow::Result<Self> {
        let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
        Self::decoded(file, &bytes, camera, platen_from_tray)
    }

    /// The same of the bytes of a picture that is to be called `file`.
    pub(crate) fn decoded(
        file: &Path,
        bytes: &[u8],
        camera: &CameraModel,
        platen_from_tray: Isometry2<f64>,
    ) -> anyhow::Result<Self> {
        let name = || file.display().to_string();
        let image = decode(bytes).with_context(name)?;
        let (found, expected) = (image.dimensions(), (camera.width_px(), camera.height_px()));
        let image = binned(image, expected);
        if image.dimensions() != expected {
            return Err(ImageFault::WrongSize { found, expected }).with_context(name);
        }
        Ok(Self { file: file.to_owned(), image, own_size_px: found, platen_from_tray })
    }

    /// Name of the file, without its folder.
    pub(crate) fn name(&self) -> String {
        self.file.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Its own pixels for one of the image, each way.
    fn factor(&self) -> f64 {
        f64::from(self.own_size_px.0) / f64::from(self.image.width())
    }

    /// A place in the image, from one in its own pixels, px.
    pub(crate) fn camera_px(&self, own: Point2<f64>) -> Point2<f64> {
        let factor = self.factor();
        own.map(|at| (at - 0.5 * (factor - 1.0)) / factor)
    }

    /// The other way round.
    pub(crate) fn own_px(&self, camera: Point2<f64>) -> Point2<f64> {
        let factor = self.factor();
        camera.map(|at| at * factor + 0.5 * (factor - 1.0))
    }
}

/// Where a tray stands on the platen: x and y, m, and yaw, rad.
pub(crate) fn parse_tray(text: &str) -> anyhow::Result<Isometry2<f64>> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let numbers = numbers.unwrap_or_default();
    let [x_m, y_m, yaw_rad] = numbers[..] else { anyhow::bail!("allowed: three numbers X,Y,YAW in m, m and rad") };
    let finite = [x_m, y_m, yaw_rad].iter().all(|number| number.is_finite());
    ensure!(finite, "allowed: finite numbers");
    Ok(Isometry2::new(Vector2::new(x_m, y_m), yaw_rad))
}

/// The tray as told, or else at the feeding place.
pub(crate) fn tray_or_feeding_place(tray: Option<Isometry2<f64>>, scenario: &Scenario) -> Isometry2<f64> {
    let place = scenario.delivery.feeding_place;
    tray.unwrap_or_else(|| Isometry2::new(place.xy(), place.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_of_the_tray_is_three_numbers() {
        let tray = parse_tray("-0.1, 0.02,0.5").unwrap();
        assert_eq!((tray.translation.x, tray.translation.y, tray.rotation.angle()), (-0.1, 0.02, 0.5));
        for wrong in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,inf"] {
            assert!(parse_tray(wrong).unwrap_err().to_string().starts_with("allowed"), "{wrong}");
        }
    }
}
