//! From the bytes of a compressed image to a picture.

use image::GrayImage;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Images wider or higher than this are refused before memory is taken for them.
const SIDE_MAX_PX: usize = 4096;

/// Why bytes are not a picture.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Not a JPEG, or a damaged one.
    #[error("{bytes} bytes are not a sound JPEG")]
    Decoder {
        /// Bytes given.
        bytes: usize,
        /// What the decoder says.
        source: zune_jpeg::errors::DecodeErrors,
    },
    /// A JPEG of colours, or cut short.
    #[error("the JPEG has {pixel_bytes} bytes of pixels; allowed: one each of {width_px}x{height_px} px")]
    NotMono {
        /// Width, px.
        width_px: usize,
        /// Height, px.
        height_px: usize,
        /// Bytes decoded.
        pixel_bytes: usize,
    },
}

/// Decodes a mono JPEG.
///
/// # Errors
///
/// [`DecodeError`] for anything that is not a sound JPEG of at most 4096x4096 px.
pub fn decode(bytes: &[u8]) -> Result<GrayImage, DecodeError> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(SIDE_MAX_PX)
        .set_max_height(SIDE_MAX_PX)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let pixels = decoder.decode().map_err(|source| DecodeError::Decoder { bytes: bytes.len(), source })?;
    let (width_px, height_px) = decoder.dimensions().unwrap_or_default();
    let pixel_bytes = pixels.len();
    let side = |size: usize| u32::try_from(size).ok();
    side(width_px)
        .zip(side(height_px))
        .and_then(|(width, height)| GrayImage::from_raw(width, height, pixels))
        .filter(|image| pixel_bytes == image.len() && pixel_bytes > 0)
        .ok_or(DecodeError::NotMono { width_px, height_px, pixel_bytes })
}
