//! The camera's calibration, watched and made: rim, hub and drop-off of the tray are in every picture, and say where the
//! camera hangs.

mod edges;
mod fit;
mod told;
mod watch;

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::view::View;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::range::{OutOfRange, check_ranges};

pub use fit::{Calibrated, CalibrationError, Shot, calibrate};
pub use told::{ToldOptics, ToldOtherwise};
pub use watch::{CalibrationFault, CalibrationWatch};

/// How far the calibration may be off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationLimits {
    /// Error of place, anywhere on the plateau, from which a warning is given, m.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub warning_m: f64,
    /// Error of place, anywhere on the plateau, from which nothing is selected, m.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub refusal_m: f64,
}

impl Default for CalibrationLimits {
    fn default() -> Self {
        Self { warning_m: 0.3e-3, refusal_m: 1e-3 }
    }
}

impl CalibrationLimits {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("selector.calibration.", self)
    }
}

/// How far a picture shows the tray from where camera and odometry put it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Misalignment {
    /// How far the middle of the plateau, as far as it is in the picture, is seen from where it is, platen frame, m.
    pub shift_m: Vector2<f64>,
    /// How many times as large as it is the tray is seen.
    pub scale: f64,
    /// How far it is seen turned, rad.
    pub turn_rad: f64,
    /// Greatest error of place anywhere on the plateau that is in the picture, m.
    pub error_m: f64,
    /// Share of the rim that lies in the picture, 0 to 1: of less than half a circle the middle is guessed.
    pub rim_ratio: f64,
}

impl std::fmt::Display for Misalignment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "places are up to {:.2} mm off: the tray is seen {:+.2} mm in x and {:+.2} mm in y from where camera and \
             odometry put it, {:.2} % its size, turned by {:+.2}°",
            1e3 * self.error_m,
            1e3 * self.shift_m.x,
            1e3 * self.shift_m.y,
            1e2 * self.scale,
            self.turn_rad.to_degrees()
        )
    }
}

/// The rim is not seen near where it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the tray's rim is not seen where camera and odometry put it: {seen} of {in_view} places looked at show an edge"
)]
pub struct RimNotSeen {
    /// Places on the rim where an edge is seen.
    pub seen: usize,
    /// Places on the rim that lie in the picture.
    pub in_view: usize,
}

/// How far off the calibration is, by one picture with the tray at `platen_from_tray`; nothing if too little of the rim lies
/// in the picture to tell.
///
/// # Errors
///
/// [`RimNotSeen`] if the rim should be there and is not.
pub fn misalignment(
    image: &GrayImage,
    camera: &CameraModel,
    tray: &MountedTray,
    platen_from_tray: &Isometry2<f64>,
) -> Result<Option<Misalignment>, RimNotSeen> {
    if image.dimensions() != (camera.width_px(), camera.height_px()) {
        return Ok(None);
    }
    let shot = Shot { image, platen_from_tray: *platen_from_tray };
    let seen_by = fit::pose_seen(&shot, camera, tray)?;
    let compared =
        |(seen_by, rim_ratio)| Misalignment { rim_ratio, ..compare(camera, &seen_by, tray, platen_from_tray) };
    Ok(seen_by.map(compared))
}

/// What the places on the plateau that are in the picture come to if one of the camera `truly` is read as one of `believed`.
/// Nothing is selected elsewhere, and a short piece of rim says nothing of the far side.
fn compare(
    believed: &CameraModel,
    truly: &CameraModel,
    tray: &MountedTray,
    platen_from_tray: &Isometry2<f64>,
) -> Misalignment {
    let height_m = tray.plateau_height_m();
    let seen_by = |camera, place| View { camera, tray, platen_from_tray: *platen_from_tray }.pixel(place, height_m);
    let read =
        |place: Point2<f64>| Some(believed.back_project(seen_by(truly, place)?, height_m)? - platen_from_tray * place);
    let in_picture = |place: &Point2<f64>| {
        let inside = |at: f64, size_px: u32| (0.0..f64::from(size_px)).contains(&at);
        seen_by(believed, *place)
            .is_some_and(|pixel| inside(pixel.x, believed.width_px()) && inside(pixel.y, believed.height_px()))
    };
    let mut outline = View::outline_of_plateau(tray);
    outline.retain(in_picture);
    let error_m = outline.iter().filter_map(|place| read(*place)).map(|error| error.norm()).fold(0.0, f64::max);
    let middle =
        Point2::from(outline.iter().map(|place| place.coords).sum::<Vector2<f64>>() / outline.len().max(1) as f64);
    let depth = |camera: &CameraModel| (camera.pose().height_m - height_m) / camera.focal_length_px();
    Misalignment {
        shift_m: read(middle).unwrap_or_default(),
        scale: depth(believed) / depth(truly),
        turn_rad: believed.pose().yaw_rad - truly.pose().yaw_rad,
        error_m,
        rim_ratio: 0.0,
    }
}

#[cfg(test)]
mod tests;
