//! What a scenario says about a camera.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Plumb-bob (Brown–Conrady) lens distortion as in `sensor_msgs/CameraInfo`; all zero is a perfect pinhole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Distortion {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// Tangential coefficient.
    pub p1: f64,
    /// Tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

/// Where the camera hangs. It looks straight down; at zero yaw the image's x is the platen's x and the image's y (down)
/// is the platen's −y.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraPose {
    /// Optical centre, x in the platen frame, m.
    pub x_m: f64,
    /// Optical centre, y in the platen frame, m.
    pub y_m: f64,
    /// Optical centre above the platen, m.
    pub height_m: f64,
    /// Turn of the camera about the platen's z, rad.
    #[serde(default)]
    pub yaw_rad: f64,
}

/// What a scenario says about a camera; [`CameraModel`](super::CameraModel) is the checked form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Image width, px.
    #[serde(default = "CameraSpec::default_width_px")]
    pub width_px: u32,
    /// Image height, px.
    #[serde(default = "CameraSpec::default_height_px")]
    pub height_px: u32,
    /// Focal length, px. Give this or `platen_m_per_px`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_length_px: Option<f64>,
    /// Size of a pixel on the platen under the camera, m/px: `pose.height_m` over the focal length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub platen_m_per_px: Option<f64>,
    /// Principal point (x, y), px; without it the middle of the image. The centre of the first pixel is (0, 0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub principal_point_px: Option<[f64; 2]>,
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
    /// Where the camera hangs.
    pub pose: CameraPose,
}

impl CameraSpec {
    const fn default_width_px() -> u32 {
        640
    }

    const fn default_height_px() -> u32 {
        480
    }
}
