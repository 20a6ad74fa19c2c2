//! The overhead camera: its calibration, the pictures it takes of the tray, and how they are coded for transport.
//!
//! [`CameraModel`] maps platen points to pixels and back; it is all of this module that the selector knows.
//! [`Renderer`] takes the picture: platen, tray and parts under a light, through the lens, with sensor noise.
//! [`codec`] turns pictures into JPEG and back.

pub mod codec;
mod light;
mod model;
mod noise;
mod parts;
mod relief;
mod render;
mod scene;
mod solid;
mod spec;
mod surfaces;
mod tile;
mod tray;

pub use light::LightModel;
pub use model::CameraModel;
pub use render::{Renderer, Scene, SensorModel, TrayShot};
pub use scene::{MountedTray, TrayAppearance};
pub use solid::{PartSolid, PartView};
pub use spec::{CameraPose, CameraSpec, Distortion};

/// A number outside what it may be, in a camera, scene or selector description.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}; allowed: {allowed}")]
pub struct InvalidValue {
    /// Which number, as in the description, e.g. `pose.height_m`.
    pub field: &'static str,
    /// The value found.
    pub value: f64,
    /// The values allowed.
    pub allowed: &'static str,
}

/// Passes if `accepted`; otherwise says which `field` holds a `value` that is not `allowed`.
pub(crate) fn require(
    accepted: bool,
    field: &'static str,
    value: f64,
    allowed: &'static str,
) -> Result<(), InvalidValue> {
    if accepted { Ok(()) } else { Err(InvalidValue { field, value, allowed }) }
}

/// Pixels and grey levels need no more than single precision.
pub(crate) fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
    let value = value as f32;
    value
}

/// The nearest grey level; what is brighter than white is white.
pub(crate) fn grey_level(value: f32) -> u8 {
    // At 2²³ single precision counts whole numbers: the sum's last byte is the rounded level. Unlike a saturating cast,
    // this compiles to vector instructions.
    const WHOLE: f32 = 8_388_608.0;
    (value.clamp(0.0, 255.0) + WHOLE).to_bits().to_le_bytes()[0]
}
