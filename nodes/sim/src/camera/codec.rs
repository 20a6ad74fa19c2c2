//! JPEG for transport: small enough for one DDS sample, good enough for the selector.

use image::GrayImage;

use super::jpeg;

/// The quality tried first: what frames with usual noise take without a second attempt.
pub const DEFAULT_QUALITY: u8 = 75;
/// The most bytes a frame may take, so that with its header it stays below 64 kB.
pub const DEFAULT_BYTES_MAX: usize = 60_000;
/// Quality lost per attempt for a frame just too large, and as often again as it is times too large.
const QUALITY_STEP: usize = 10;
/// Why a picture could not be coded.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// No JPEG has this size.
    #[error("a picture of {width_px}x{height_px} px cannot be coded as JPEG; allowed: 1 to {} px each way", u16::MAX)]
    Size {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
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

/// Codes a mono picture at the best quality, from `quality` (1 to 100) downwards, that takes at most `bytes_max`.
///
/// # Errors
///
/// [`EncodeError::TooLarge`] if no quality does, [`EncodeError::Size`] for a picture without pixels, or with too many.
pub fn encode(image: &GrayImage, quality: u8, bytes_max: usize) -> Result<Vec<u8>, EncodeError> {
    let (width_px, height_px) = image.dimensions();
    let side = |px: u32| u16::try_from(px).ok().filter(|px| *px > 0);
    let Some(size_px) = side(width_px).zip(side(height_px)) else {
        return Err(EncodeError::Size { width_px, height_px });
    };
    let mut quality = quality.clamp(1, 100);
    loop {
        let mut bytes = Vec::with_capacity(bytes_max);
        jpeg::encode(image, size_px.into(), quality, &mut bytes);
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
    use jpeg_encoder::{ColorType, Encoder};
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
        // 40 dB of signal to noise, what is called visually lossless, is an rms error of 2.55 levels.
        assert!(lost(&picture, &encode(&picture, DEFAULT_QUALITY, DEFAULT_BYTES_MAX).unwrap()) < 2.55);
    }

    /// What is lost, rms in grey levels.
    fn lost(picture: &GrayImage, bytes: &[u8]) -> f64 {
        let decoded = decode(bytes).unwrap();
        assert_eq!(decoded.dimensions(), picture.dimensions());
        let square: f64 =
            picture.iter().zip(decoded.iter()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        (square / picture.len() as f64).sqrt()
    }

    /// The same picture coded by a library.
    fn by_a_library(picture: &GrayImage, quality: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        let side = |px: u32| u16::try_from(px).unwrap();
        let (width, height) = picture.dimensions();
        Encoder::new(&mut bytes, quality).encode(picture, side(width), side(height), ColorType::Luma).unwrap();
        bytes
    }

    #[test]
    fn val_a_general_encoder_loses_as_much_in_as_many_bytes() {
        // Noise has values at all frequencies, sides that are no multiple of eight have borders, 255 at quality 1 and 100 has
        // the largest means; and bytes of 255, which are escaped, are in all of them.
        let mut noise = GrayImage::new(203, 101);
        Pcg64Mcg::seed_from_u64(5).fill_bytes(&mut noise);
        let checks = GrayImage::from_fn(33, 40, |x, y| Luma([if (x / 8 + y / 8) % 2 == 0 { 0 } else { 255 }]));
        for (picture, name) in [(&picture(), "smooth"), (&noise, "noise"), (&checks, "checks")] {
            for quality in [1, 20, 50, 75, 90, 100] {
                let (ours, theirs) = (encode(picture, quality, 1_000_000).unwrap(), by_a_library(picture, quality));
                let (lost, allowed) = (lost(picture, &ours), lost(picture, &theirs));
                assert!(lost <= 1.01 * allowed + 0.05, "{name} at {quality}: {lost} and {allowed} levels");
                assert!(ours.len() <= theirs.len() + theirs.len() / 50, "{name} at {quality}");
            }
        }
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
        assert!(matches!(encode(&GrayImage::new(0, 4), 90, 1_000), Err(EncodeError::Size { .. })));
        assert!(matches!(encode(&GrayImage::new(70_000, 1), 90, 1_000), Err(EncodeError::Size { .. })));
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

    /// A picture of any size, from even to wild.
    fn any_picture() -> impl Strategy<Value = GrayImage> {
        let shape = (1_u32..50, 1_u32..50, any::<u8>(), any::<u8>(), any::<u64>());
        shape.prop_map(|(width, height, level, spread, seed)| {
            let mut noise = Pcg64Mcg::seed_from_u64(seed);
            GrayImage::from_fn(width, height, |_, _| {
                let swing = noise.next_u32() % (u32::from(spread) + 1);
                Luma([level.saturating_add(u8::try_from(swing).unwrap())])
            })
        })
    }

    proptest! {
        #[test]
        fn a_picture_of_any_size_and_quality_is_a_sound_jpeg(picture in any_picture(), quality in 1_u8..=100) {
            let bytes = encode(&picture, quality, 1_000_000).unwrap();
            // Behind the header of the only scan there is no marker but the end.
            let scan = bytes.windows(2).position(|marker| marker == [0xff, 0xda]).unwrap() + 2;
            let markers = bytes[scan..].windows(2).filter(|pair| pair[0] == 0xff && pair[1] != 0);
            prop_assert_eq!(markers.collect::<Vec<_>>(), [[0xff, 0xd9]]);
            prop_assert_eq!(&bytes[bytes.len() - 2..], [0xff, 0xd9]);
            let (lost, allowed) = (lost(&picture, &bytes), lost(&picture, &by_a_library(&picture, quality)));
            prop_assert!(lost <= 1.05 * allowed + 0.3, "{} and {} levels", lost, allowed);
        }

        #[test]
        fn steps_of_one_lose_next_to_nothing(picture in any_picture()) {
            let decoded = decode(&encode(&picture, 100, 1_000_000).unwrap()).unwrap();
            let largest = picture.iter().zip(decoded.iter()).map(|(a, b)| a.abs_diff(*b)).max();
            prop_assert!(largest <= Some(2), "{:?} levels", largest);
        }

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
