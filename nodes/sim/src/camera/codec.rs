//! JPEG for transport: small enough for one DDS sample, good enough for the selector.

use image::GrayImage;
use jpeg_encoder::{Encoder, ImageBuffer, JpegColorType};

/// The quality tried first: what frames with usual noise take without a second attempt.
pub const DEFAULT_QUALITY: u8 = 75;
/// The most bytes a frame may take, so that with its header it stays below 64 kB.
pub const DEFAULT_BYTES_MAX: usize = 60_000;
/// Quality lost per attempt for a frame just too large, and as often again as it is times too large.
const QUALITY_STEP: usize = 10;
/// Why a picture could not be coded.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// The encoder refused the picture.
    #[error("a picture of {width_px}x{height_px} px cannot be encoded as JPEG")]
    Encoder {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// What the encoder says.
        source: jpeg_encoder::EncodingError,
    },
    /// Even the lowest quality takes too many bytes.
    #[error(
        "a picture of {width_px}x{height_px} px takes {bytes} bytes as JPEG at the lowest quality; allowed: {bytes_max}"
    )]
    TooLarge {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// Bytes at the lowest quality.
        bytes: usize,
        /// Bytes allowed.
        bytes_max: usize,
    },
}

/// A mono picture, for the encoder to take row by row: its own way takes pixel by pixel.
struct Rows<'a>(&'a GrayImage);

impl ImageBuffer for Rows<'_> {
    fn get_jpeg_color_type(&self) -> JpegColorType {
        JpegColorType::Luma
    }

    // Sides beyond u16 become 0, which the encoder refuses.
    fn width(&self) -> u16 {
        u16::try_from(self.0.width()).unwrap_or(0)
    }

    fn height(&self) -> u16 {
        u16::try_from(self.0.height()).unwrap_or(0)
    }

    fn fill_buffers(&self, row: u16, buffers: &mut [Vec<u8>; 4]) {
        let width = usize::from(self.width());
        buffers[0].extend_from_slice(&self.0.as_raw()[usize::from(row) * width..][..width]);
    }
}

/// Codes a mono picture at the best quality, from `quality` (1 to 100) downwards, that takes at most `bytes_max`.
///
/// # Errors
///
/// [`EncodeError::TooLarge`] if no quality does, [`EncodeError::Encoder`] for a picture without pixels.
pub fn encode(image: &GrayImage, quality: u8, bytes_max: usize) -> Result<Vec<u8>, EncodeError> {
    let (width_px, height_px) = image.dimensions();
    let mut quality = quality.clamp(1, 100);
    loop {
        let mut bytes = Vec::with_capacity(bytes_max);
        Encoder::new(&mut bytes, quality).encode_image(Rows(image)).map_err(|source| EncodeError::Encoder {
            width_px,
            height_px,
            source,
        })?;
        if bytes.len() <= bytes_max {
            return Ok(bytes);
        }
        if quality == 1 {
            return Err(EncodeError::TooLarge { width_px, height_px, bytes: bytes.len(), bytes_max });
        }
        let step = QUALITY_STEP * (bytes.len() / bytes_max.max(1)).max(1);
        quality = quality.saturating_sub(u8::try_from(step).unwrap_or(u8::MAX)).max(1);
    }
}

#[cfg(test)]
mod tests {
    use image::Luma;
    use jpeg_encoder::ColorType;
    use proptest::prelude::*;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use feeder_vision::{PictureError, decode};

    use super::*;

    /// Smooth with some edges, as a feeder is.
    fn picture() -> GrayImage {
        GrayImage::from_fn(160, 120, |x, y| Luma([if (x / 20 + y / 20) % 2 == 0 { 60 } else { 180 }]))
    }

    #[test]
    fn a_picture_survives_transport_nearly_unchanged() {
        let picture = picture();
        let decoded = decode(&encode(&picture, DEFAULT_QUALITY, DEFAULT_BYTES_MAX).unwrap()).unwrap();
        assert_eq!(decoded.dimensions(), picture.dimensions());
        let square: f64 =
            picture.iter().zip(decoded.iter()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        // 40 dB of signal to noise, what is called visually lossless, is an rms error of 2.55 levels.
        assert!((square / f64::from(160 * 120)).sqrt() < 2.55);
    }

    #[test]
    fn quality_falls_until_a_frame_is_small_enough() {
        let mut picture = GrayImage::new(640, 480);
        Pcg64Mcg::seed_from_u64(3).fill_bytes(&mut picture);
        let bytes = encode(&picture, DEFAULT_QUALITY, DEFAULT_BYTES_MAX).unwrap();
        assert!(bytes.len() <= DEFAULT_BYTES_MAX);
        assert_eq!(decode(&bytes).unwrap().dimensions(), (640, 480));
        let refused = encode(&picture, DEFAULT_QUALITY, 2_000).unwrap_err();
        assert!(matches!(refused, EncodeError::TooLarge { bytes_max: 2_000, .. }));
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        assert!(matches!(encode(&GrayImage::new(0, 4), 90, 1_000), Err(EncodeError::Encoder { .. })));
        assert!(matches!(decode(&[]), Err(PictureError::NeitherFormat { bytes: 0 })));
        let bytes = encode(&picture(), 90, DEFAULT_BYTES_MAX).unwrap();
        assert!(decode(&bytes[..bytes.len() / 2]).is_err());
    }

    #[test]
    fn a_coloured_jpeg_becomes_mono() {
        let mut bytes = Vec::new();
        Encoder::new(&mut bytes, 90).encode(&[90; 3 * 16 * 16], 16, 16, ColorType::Rgb).unwrap();
        let image = decode(&bytes).unwrap();
        assert_eq!(image.dimensions(), (16, 16));
        assert!(image.iter().all(|level| level.abs_diff(90) <= 2), "{image:?}");
    }

    proptest! {
        #[test]
        fn damaged_bytes_never_panic(
            changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..24),
            keep in any::<proptest::sample::Index>(),
        ) {
            let mut bytes = encode(&picture(), 80, DEFAULT_BYTES_MAX).unwrap();
            for (place, value) in changes {
                let place = place.index(bytes.len());
                bytes[place] = value;
            }
            // Half of the cases lose their end too.
            let keep = keep.index(2 * bytes.len()).min(bytes.len());
            if let Ok(image) = decode(&bytes[..keep]) {
                prop_assert!(!image.is_empty());
            }
        }
    }
}
