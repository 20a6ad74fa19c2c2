//! Pictures of the tray in files, and where the tray stood.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use feeder_model::camera::CameraModel;
use feeder_scenario::Scenario;
use feeder_vision::{ImageFault, binned, decode};
use image::GrayImage;
use nalgebra::{Isometry2, Vector2};

/// A picture of the tray.
pub(crate) struct Photo {
    pub(crate) file: PathBuf,
    /// At the camera's size.
    pub(crate) image: GrayImage,
}

impl Photo {
    /// Reads a JPEG or a PNG, and brings it to the camera's size if it is a whole multiple of that.
    pub(crate) fn open(file: &Path, camera: &CameraModel) -> anyhow::Result<Self> {
        let name = || file.display().to_string();
        let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
        let image = decode(&bytes).with_context(name)?;
        let (found, expected) = (image.dimensions(), (camera.width_px(), camera.height_px()));
        let image = binned(image, expected);
        if image.dimensions() != expected {
            return Err(ImageFault::WrongSize { found, expected }).with_context(name);
        }
        Ok(Self { file: file.to_owned(), image })
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
