//! What a camera says of its own optics, compared with what the scenario says of them.

use nalgebra::{Point2, Point3, Vector2};

use super::CalibrationLimits;
use crate::view::View;
use feeder_model::camera::{CameraModel, CameraSpec, Distortion, MountedTray};
use feeder_model::range::OutOfRange;

/// Focal lengths across and down that differ by more than this share are no camera of square pixels.
const SQUARE_RATIO: f64 = 1e-3;

/// A camera's own description of its optics, as in `sensor_msgs/CameraInfo`.
#[derive(Clone, Debug, PartialEq)]
pub struct ToldOptics<'a> {
    /// Width and height of its pictures, px.
    pub size_px: (u32, u32),
    /// Name of the model of distortion.
    pub distortion_model: &'a str,
    /// Coefficients of distortion.
    pub distortion: &'a [f64],
    /// The intrinsic matrix K, row by row, px; begins with 0 if the camera was never calibrated.
    pub intrinsics_px: [f64; 9],
}

/// How a camera's own description contradicts the scenario's.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ToldOtherwise {
    /// Pictures of a size that is no whole multiple of the scenario's.
    #[error("camera_info says {}x{} px; the scenario says {}x{} px, and a whole multiple of that is binned", told.0, told.1, stated.0, stated.1)]
    Size {
        /// By the camera.
        told: (u32, u32),
        /// By the scenario.
        stated: (u32, u32),
    },
    /// A distortion of another kind.
    #[error("camera_info has distortion model {0:?}; allowed: plumb_bob with k1, k2, p1, p2, k3, or none")]
    Distortion(String),
    /// Numbers that are no camera.
    #[error("camera_info is no camera with square pixels: {0}")]
    NoCamera(OutOfRange),
    /// Another lens: parts of the picture are seen elsewhere.
    #[error(
        "camera_info and the scenario differ by up to {:.2} mm on the plateau: focal length {told_px:.1} against {stated_px:.1} px, \
         k1 {told_k1:.4} against {stated_k1:.4}", 1e3 * error_m
    )]
    Lens {
        /// Greatest difference of place on the plateau, beside a shift that is alike everywhere, m.
        error_m: f64,
        /// Focal length by the camera, for pictures of the scenario's size.
        told_px: f64,
        /// Focal length by the scenario.
        stated_px: f64,
        /// Lens coefficient by the camera.
        told_k1: f64,
        /// Lens coefficient by the scenario.
        stated_k1: f64,
    },
}

impl ToldOptics<'_> {
    /// Compares with the scenario's `camera` over its `tray`. A camera that was never calibrated contradicts nothing. A
    /// principal point beside the scenario's shifts the whole picture, as a camera hung beside its place does, and is left to
    /// what the pictures show.
    ///
    /// # Errors
    ///
    /// [`ToldOtherwise`] from the difference on that `limits` state for a warning.
    pub fn compare(
        &self,
        camera: &CameraModel,
        tray: &MountedTray,
        limits: &CalibrationLimits,
    ) -> Result<(), ToldOtherwise> {
        let stated = (camera.width_px(), camera.height_px());
        let factor = self.size_px.0 / stated.0;
        if factor == 0 || self.size_px != (factor * stated.0, factor * stated.1) {
            return Err(ToldOtherwise::Size { told: self.size_px, stated });
        }
        let [fx, _, cx, _, fy, cy, ..] = self.intrinsics_px;
        if fx == 0.0 {
            return Ok(());
        }
        let coefficient = |index: usize| self.distortion.get(index).copied().unwrap_or(0.0);
        if !matches!(self.distortion_model, "plumb_bob" | "") || self.distortion.len() > 5 {
            return Err(ToldOtherwise::Distortion(self.distortion_model.to_owned()));
        }
        let square = (fy - fx).abs() <= SQUARE_RATIO * fx.abs();
        OutOfRange::unless(square, "K[4]", fy, "as K[0], to a thousandth").map_err(ToldOtherwise::NoCamera)?;
        let scale = f64::from(factor);
        // Between the middles of binned pixels lie whole pixels, between those of the first ones a part of one.
        let binned = |middle_px: f64| (middle_px - 0.5 * (scale - 1.0)) / scale;
        let spec = CameraSpec {
            focal_length_px: Some(fx / scale),
            platen_m_per_px: None,
            principal_point_px: Some([binned(cx), binned(cy)]),
            distortion: Distortion {
                k1: coefficient(0),
                k2: coefficient(1),
                p1: coefficient(2),
                p2: coefficient(3),
                k3: coefficient(4),
            },
            ..CameraSpec::from(camera.clone())
        };
        let told = CameraModel::new(spec).map_err(ToldOtherwise::NoCamera)?;
        let error_m = lens_error_m(camera, &told, tray);
        if error_m < limits.warning_m {
            return Ok(());
        }
        Err(ToldOtherwise::Lens {
            error_m,
            told_px: told.focal_length_px(),
            stated_px: camera.focal_length_px(),
            told_k1: told.distortion().k1,
            stated_k1: camera.distortion().k1,
        })
    }
}

/// Greatest difference of place between two cameras over a plateau that lies below them, beside the mean one, m.
fn lens_error_m(camera: &CameraModel, told: &CameraModel, tray: &MountedTray) -> f64 {
    let height_m = tray.plateau_height_m();
    let pose = camera.pose();
    let below = Vector2::new(pose.x_m, pose.y_m);
    let outline: Vec<Point2<f64>> = View::outline_of_plateau(tray);
    let middle = outline.iter().map(|place| place.coords).sum::<Vector2<f64>>() / outline.len() as f64;
    let shift = |place: &Point2<f64>| {
        let place = place - middle + below;
        let pixel = told.project(Point3::new(place.x, place.y, height_m))?;
        Some(camera.back_project(pixel, height_m)? - place)
    };
    let shifts: Vec<Vector2<f64>> = outline.iter().filter_map(shift).collect();
    let mean = shifts.iter().sum::<Vector2<f64>>() / shifts.len().max(1) as f64;
    shifts.iter().map(|shift| (shift - mean).norm()).fold(0.0, f64::max)
}
