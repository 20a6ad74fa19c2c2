//! The camera as it is calibrated, and the tray as it stands under it.

mod calibration;
mod mounted_tray;
mod spec;
mod tray_triangles;

pub use calibration::CameraModel;
pub use mounted_tray::MountedTray;
pub use spec::{CameraPose, CameraSpec, Distortion};

/// Pixels and grey levels need no more than single precision.
pub fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
    let value = value as f32;
    value
}

/// The nearest grey level; what is brighter than white is white.
pub fn grey_level(value: f32) -> u8 {
    // At 2²³ single precision counts whole numbers: the sum's last byte is the rounded level. Unlike a saturating cast,
    // this compiles to vector instructions.
    const WHOLE: f32 = 8_388_608.0;
    (value.clamp(0.0, 255.0) + WHOLE).to_bits().to_le_bytes()[0]
}
