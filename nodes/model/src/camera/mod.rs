//! The camera as it is calibrated, and the tray as it stands under it.

mod calibration;
mod mounted_tray;
mod spec;
mod tray_triangles;

pub use calibration::CameraModel;
pub use mounted_tray::MountedTray;
pub use spec::{CameraPose, CameraSpec, Distortion};

/// Pixels and grey levels need no more than single precision.
#[inline]
pub fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is the purpose")]
    let value = value as f32;
    value
}

/// The nearest grey level; what is brighter than white is white.
#[inline]
pub fn grey_level(value: f32) -> u8 {
    whole(value.clamp(0.0, 255.0))[0]
}

/// The nearest whole number of 16 bits.
#[inline]
pub fn nearest_i16(value: f32) -> i16 {
    let [low, high, ..] = whole(value.clamp(-32_768.0, 32_767.0));
    i16::from_le_bytes([low, high])
}

/// The bytes of the nearest whole number, lowest first; of 22 bits at most.
#[inline]
fn whole(value: f32) -> [u8; 4] {
    // From 2²³ to 2²⁴ single precision counts whole numbers: the sum's last bytes are the rounded value. Unlike a saturating
    // cast, this compiles to vector instructions.
    const WHOLE: f32 = 12_582_912.0;
    (value + WHOLE).to_bits().to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_to_the_nearest_and_end_at_the_limits() {
        for (value, level, word) in [
            (-1e9, 0, -32_768),
            (-300.4, 0, -300),
            (-0.6, 0, -1),
            (0.4, 0, 0),
            (0.6, 1, 1),
            (254.6, 255, 255),
            (255.6, 255, 256),
            (32_766.6, 255, 32_767),
            (1e9, 255, 32_767),
        ] {
            assert_eq!((grey_level(value), nearest_i16(value)), (level, word), "{value}");
        }
    }
}
