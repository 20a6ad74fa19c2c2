//! From what a camera sends or a file holds to a grey picture of the calibrated camera's size.

use image::codecs::png::PngDecoder;
use image::imageops::colorops::grayscale;
use image::{DynamicImage, GrayImage, ImageBuffer, ImageDecoder as _, Limits, Luma, Rgb, Rgba};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Images wider or higher than this are refused before memory is taken for them.
const SIDE_MAX_PX: u32 = 4096;
/// How many pixels of a camera are averaged to one each way at most.
const BIN_MAX: u32 = 8;
/// What a PNG begins with.
const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// What a JPEG begins with.
const JPEG_SIGNATURE: &[u8] = b"\xff\xd8\xff";
/// The encodings of raw images that are understood, as `sensor_msgs/image_encodings` names them.
const ENCODINGS: &str = "mono8, mono16, rgb8, bgr8, rgba8, bgra8, 8UC1, 16UC1";

/// Why bytes are not a picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// Neither of the two file formats.
    #[error("{bytes} bytes are neither a JPEG nor a PNG")]
    NeitherFormat {
        /// Bytes given.
        bytes: usize,
    },
    /// A damaged JPEG, or one of a kind that cameras do not send.
    #[error("{bytes} bytes are not a sound JPEG of at most {SIDE_MAX_PX}x{SIDE_MAX_PX} px: {source}")]
    Jpeg {
        /// Bytes given.
        bytes: usize,
        /// What the decoder says.
        source: zune_jpeg::errors::DecodeErrors,
    },
    /// A JPEG that was cut short.
    #[error("the JPEG has {pixel_bytes} bytes of pixels; allowed: one each of {width_px}x{height_px} px")]
    CutShort {
        /// Width, px.
        width_px: usize,
        /// Height, px.
        height_px: usize,
        /// Bytes decoded.
        pixel_bytes: usize,
    },
    /// A damaged PNG.
    #[error("{bytes} bytes are not a sound PNG of at most {SIDE_MAX_PX}x{SIDE_MAX_PX} px: {source}")]
    Png {
        /// Bytes given.
        bytes: usize,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// A raw image of an encoding that is not understood.
    #[error("the image's encoding is {found:?}; allowed: {ENCODINGS}")]
    Encoding {
        /// What the message says.
        found: String,
    },
    /// A raw image whose numbers do not go together.
    #[error(
        "an image of {width_px}x{height_px} px, {encoding}, with rows of {step} bytes holds {bytes} bytes; allowed: rows \
         of at least {row_bytes} bytes, all of them there, and 1 to {SIDE_MAX_PX} px each way"
    )]
    Layout {
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// What the message says of the pixels.
        encoding: String,
        /// Bytes from row to row.
        step: u32,
        /// Bytes of a row's pixels.
        row_bytes: usize,
        /// Bytes given.
        bytes: usize,
    },
}

/// Decodes a JPEG or a PNG, grey or of colours, with 8 or 16 bits a channel, to grey levels of 8 bits.
///
/// # Errors
///
/// [`PictureError`] for anything that is not a sound JPEG or PNG of at most 4096x4096 px.
pub fn decode(bytes: &[u8]) -> Result<GrayImage, PictureError> {
    if bytes.starts_with(PNG_SIGNATURE) {
        return decode_png(bytes).map_err(|source| PictureError::Png { bytes: bytes.len(), source });
    }
    if bytes.starts_with(JPEG_SIGNATURE) {
        return decode_jpeg(bytes);
    }
    Err(PictureError::NeitherFormat { bytes: bytes.len() })
}

fn decode_png(bytes: &[u8]) -> Result<GrayImage, image::ImageError> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(SIDE_MAX_PX);
    limits.max_image_height = Some(SIDE_MAX_PX);
    let mut decoder = PngDecoder::with_limits(std::io::Cursor::new(bytes), limits.clone())?;
    decoder.set_limits(limits)?;
    Ok(DynamicImage::from_decoder(decoder)?.to_luma8())
}

fn decode_jpeg(bytes: &[u8]) -> Result<GrayImage, PictureError> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(SIDE_MAX_PX as usize)
        .set_max_height(SIDE_MAX_PX as usize)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let pixels = decoder.decode().map_err(|source| PictureError::Jpeg { bytes: bytes.len(), source })?;
    let (width_px, height_px) = decoder.dimensions().unwrap_or_default();
    let pixel_bytes = pixels.len();
    let side = |size: usize| u32::try_from(size).ok();
    side(width_px)
        .zip(side(height_px))
        .and_then(|(width, height)| GrayImage::from_raw(width, height, pixels))
        .filter(|image| pixel_bytes == image.len() && pixel_bytes > 0)
        .ok_or(PictureError::CutShort { width_px, height_px, pixel_bytes })
}

/// An image as `sensor_msgs/Image` has it.
#[derive(Clone, Copy, Debug)]
pub struct RawPicture<'a> {
    /// Width, px.
    pub width_px: u32,
    /// Height, px.
    pub height_px: u32,
    /// What a pixel is made of, as `sensor_msgs/image_encodings` names it.
    pub encoding: &'a str,
    /// Whether the higher byte of 16 bits comes first.
    pub is_bigendian: bool,
    /// Bytes from row to row.
    pub step: u32,
    /// The pixels.
    pub data: &'a [u8],
}

impl RawPicture<'_> {
    /// The picture in grey levels of 8 bits. Of 16 bits the full scale counts, whatever part of it the camera uses.
    ///
    /// # Errors
    ///
    /// [`PictureError`] naming the encoding, or the numbers that do not go together.
    pub fn grey(&self) -> Result<GrayImage, PictureError> {
        let (channels, channel_bytes) = match self.encoding {
            "mono8" | "8UC1" => (1, 1),
            "mono16" | "16UC1" => (1, 2),
            "rgb8" | "bgr8" => (3, 1),
            "rgba8" | "bgra8" => (4, 1),
            other => return Err(PictureError::Encoding { found: other.to_owned() }),
        };
        let row_bytes = self.width_px as usize * channels * channel_bytes;
        let step = self.step as usize;
        let layout = || PictureError::Layout {
            width_px: self.width_px,
            height_px: self.height_px,
            encoding: self.encoding.to_owned(),
            step: self.step,
            row_bytes,
            bytes: self.data.len(),
        };
        let side_ok = |side: u32| (1..=SIDE_MAX_PX).contains(&side);
        let height = self.height_px as usize;
        // The padding of the last row may be missing.
        let whole = side_ok(self.width_px)
            && side_ok(self.height_px)
            && step >= row_bytes
            && self.data.len() >= step * (height - 1) + row_bytes;
        if !whole {
            return Err(layout());
        }
        let mut bytes = Vec::with_capacity(row_bytes * height);
        self.data.chunks(step).take(height).for_each(|row| bytes.extend_from_slice(&row[..row_bytes]));
        let (width, height) = (self.width_px, self.height_px);
        let grey = match self.encoding {
            "rgb8" | "bgr8" => {
                if self.encoding == "bgr8" {
                    bytes.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
                }
                ImageBuffer::<Rgb<u8>, _>::from_raw(width, height, bytes).map(|image| grayscale(&image))
            }
            "rgba8" | "bgra8" => {
                if self.encoding == "bgra8" {
                    bytes.chunks_exact_mut(4).for_each(|pixel| pixel.swap(0, 2));
                }
                ImageBuffer::<Rgba<u8>, _>::from_raw(width, height, bytes)
                    .map(|image| DynamicImage::ImageRgba8(image).to_luma8())
            }
            "mono16" | "16UC1" => {
                let value = |pair: &[u8]| match self.is_bigendian {
                    true => u16::from_be_bytes([pair[0], pair[1]]),
                    false => u16::from_le_bytes([pair[0], pair[1]]),
                };
                let values: Vec<u16> = bytes.chunks_exact(2).map(value).collect();
                ImageBuffer::<Luma<u16>, _>::from_raw(width, height, values)
                    .map(|image| DynamicImage::ImageLuma16(image).to_luma8())
            }
            _ => GrayImage::from_raw(width, height, bytes),
        };
        grey.ok_or_else(layout)
    }
}

/// Brings a picture to the size of the calibrated camera's (width and height, px): one of a whole multiple of that is binned,
/// each pixel the mean of those that lie in it; any other is left as it is, for the selector to refuse by both sizes.
#[must_use]
pub fn binned(image: GrayImage, camera_px: (u32, u32)) -> GrayImage {
    let (width, height) = image.dimensions();
    let factor = width / camera_px.0.max(1);
    let fits = (2..=BIN_MAX).contains(&factor) && (width, height) == (factor * camera_px.0, factor * camera_px.1);
    if !fits {
        return image;
    }
    GrayImage::from_fn(camera_px.0, camera_px.1, |x, y| {
        let rows = (factor * y..factor * (y + 1)).map(|row| (row * width + factor * x) as usize);
        let sum: u32 =
            rows.flat_map(|start| &image.as_raw()[start..start + factor as usize]).map(|level| u32::from(*level)).sum();
        let count = factor * factor;
        Luma([u8::try_from((sum + count / 2) / count).unwrap_or(u8::MAX)])
    })
}

#[cfg(test)]
mod tests {
    use image::ImageEncoder as _;
    use image::codecs::png::PngEncoder;
    use proptest::prelude::*;

    use super::*;

    fn raw<'a>(encoding: &'a str, step: u32, data: &'a [u8]) -> RawPicture<'a> {
        RawPicture { width_px: 2, height_px: 2, encoding, is_bigendian: false, step, data }
    }

    fn png(color: image::ExtendedColorType, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        PngEncoder::new(&mut out).write_image(bytes, 2, 2, color).unwrap();
        out
    }

    #[test]
    fn every_encoding_of_the_same_picture_gives_the_same_grey_levels() {
        let grey = [0, 100, 200, 255];
        let rows = |pixel: fn(u8) -> Vec<u8>| grey.iter().flat_map(|level| pixel(*level)).collect::<Vec<u8>>();
        for (encoding, channels, data) in [
            ("mono8", 1, rows(|level| vec![level])),
            ("8UC1", 1, rows(|level| vec![level])),
            ("rgb8", 3, rows(|level| vec![level; 3])),
            ("bgr8", 3, rows(|level| vec![level; 3])),
            ("rgba8", 4, rows(|level| vec![level, level, level, 255])),
            ("bgra8", 4, rows(|level| vec![level, level, level, 255])),
            ("mono16", 2, rows(|level| (u16::from(level) * 257).to_le_bytes().to_vec())),
        ] {
            assert_eq!(raw(encoding, 2 * channels, &data).grey().unwrap().as_raw(), &grey, "{encoding}");
        }
        let big = rows(|level| (u16::from(level) * 257).to_be_bytes().to_vec());
        let big = RawPicture { is_bigendian: true, ..raw("16UC1", 4, &big) };
        assert_eq!(big.grey().unwrap().as_raw(), &grey);
    }

    #[test]
    fn red_and_blue_are_not_mixed_up() {
        let red: Vec<u8> = [255, 0, 0].repeat(4);
        let (as_red, as_blue) = (raw("rgb8", 6, &red).grey().unwrap(), raw("bgr8", 6, &red).grey().unwrap());
        // Red is brighter to the eye than blue.
        assert!(as_red.as_raw()[0] > 2 * as_blue.as_raw()[0], "{as_red:?} {as_blue:?}");
    }

    #[test]
    fn padding_is_left_out_and_a_layout_that_cannot_be_is_refused_by_its_numbers() {
        let padded = [1, 2, 99, 3, 4];
        assert_eq!(raw("mono8", 3, &padded).grey().unwrap().as_raw(), &[1, 2, 3, 4]);
        let short = raw("mono8", 3, &padded[..4]).grey().unwrap_err().to_string();
        assert!(short.contains("2x2 px, mono8, with rows of 3 bytes holds 4 bytes"), "{short}");
        assert!(matches!(raw("mono8", 1, &padded).grey(), Err(PictureError::Layout { .. })));
        let none = RawPicture { width_px: 0, height_px: 0, ..raw("mono8", 0, &[]) };
        assert!(matches!(none.grey(), Err(PictureError::Layout { .. })));
        let unknown = raw("yuv422", 4, &padded).grey().unwrap_err().to_string();
        assert!(unknown.contains("yuv422") && unknown.contains("bgr8"), "{unknown}");
    }

    #[test]
    fn pngs_of_grey_and_of_colours_with_8_and_16_bits_are_read() {
        let grey = [0, 100, 200, 255];
        let colours: Vec<u8> = grey.iter().flat_map(|level| [*level; 3]).collect();
        let deep: Vec<u8> = grey.iter().flat_map(|level| (u16::from(*level) * 257).to_ne_bytes()).collect();
        for (color, bytes) in [
            (image::ExtendedColorType::L8, &grey[..]),
            (image::ExtendedColorType::Rgb8, &colours),
            (image::ExtendedColorType::L16, &deep),
        ] {
            assert_eq!(decode(&png(color, bytes)).unwrap().as_raw(), &grey, "{color:?}");
        }
    }

    #[test]
    fn what_is_no_picture_is_refused_and_says_what_came() {
        let whole = png(image::ExtendedColorType::L8, &[1, 2, 3, 4]);
        assert!(matches!(decode(&whole[..40]), Err(PictureError::Png { bytes: 40, .. })));
        assert!(matches!(decode(b"\xff\xd8\xff\xe0"), Err(PictureError::Jpeg { bytes: 4, .. })));
        assert_eq!(decode(b"GIF89a").unwrap_err().to_string(), "6 bytes are neither a JPEG nor a PNG");
    }

    #[test]
    fn a_whole_multiple_is_binned_and_another_size_is_left_alone() {
        let fine = GrayImage::from_raw(4, 2, vec![0, 2, 10, 10, 4, 6, 10, 11]).unwrap();
        let coarse = binned(fine.clone(), (2, 1));
        assert_eq!((coarse.dimensions(), coarse.as_raw().as_slice()), ((2, 1), &[3, 10][..]));
        for size in [(4, 2), (4, 1), (3, 2), (8, 4)] {
            assert_eq!(binned(fine.clone(), size), fine, "{size:?}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(
            mut bytes in prop::collection::vec(any::<u8>(), 0..200), kind in 0_usize..3, width_px: u32, height_px: u32, step: u32,
        ) {
            let signature = [PNG_SIGNATURE, JPEG_SIGNATURE, b""][kind];
            bytes.splice(0..0, signature.iter().copied());
            let _ = decode(&bytes);
            for encoding in ["mono8", "mono16", "bgr8", "bgra8"] {
                let picture = RawPicture { width_px, height_px, step, ..raw(encoding, step, &bytes) };
                prop_assert!(picture.grey().is_err() || bytes.len() >= width_px as usize * height_px as usize);
            }
        }
    }
}
