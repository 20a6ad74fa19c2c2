//! What lies on the plateau, before anything is known of the part: pictures of the same place are compared with each other.

use image::{GrayImage, Luma};
use imageproc::region_labelling::{Connectivity, connected_components};
use nalgebra::{Isometry2, Point2};

use crate::ImageFault;
use crate::view::View;
use feeder_model::camera::{CameraModel, MountedTray};

/// Pictures without which what lies there cannot be told from what is always there.
pub const PICTURES_MIN: usize = 3;
/// Grey levels, and standard deviations of the noise, by which a thing differs from the bare plateau at least.
const CONTRAST_MIN_LEVELS: f32 = 10.0;
const CONTRAST_SIGMAS: f32 = 5.0;
/// Smallest thing, px.
const THING_PX_MIN: u32 = 12;
/// A median absolute deviation of normal noise is this part of its standard deviation.
const MAD_PER_SIGMA: f32 = 0.674_5;

/// A thing that stands out from the bare plateau.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Its middle in the picture, px.
    pub pixel: Point2<f64>,
    /// Its middle in the tray frame, m, if it lies flat.
    pub place: Point2<f64>,
    /// How much of the picture it takes with what it shades, px.
    pub area_px: u32,
    /// How much brighter than the plateau it is in the mean, grey levels.
    pub contrast_levels: f32,
}

/// The plateau as it would look bare, from pictures of it with parts, which all show the tray at the same place under the
/// same light: at each pixel the median, for no part lies in the same place in half of them. Nothing if there are fewer than
/// three pictures, or of different sizes.
#[must_use]
pub fn bare_plateau(images: &[&GrayImage]) -> Option<GrayImage> {
    let first = images.first()?;
    if images.len() < PICTURES_MIN || images.iter().any(|image| image.dimensions() != first.dimensions()) {
        return None;
    }
    let mut levels = vec![0_u8; images.len()];
    let middle = images.len() / 2;
    let median = |x, y| {
        for (level, image) in levels.iter_mut().zip(images) {
            *level = image.get_pixel(x, y).0[0];
        }
        levels.sort_unstable();
        let (above, below) = (u16::from(levels[middle]), u16::from(levels[(images.len() - 1) / 2]));
        Luma([u8::try_from((above + below).div_ceil(2)).unwrap_or(u8::MAX)])
    };
    Some(GrayImage::from_fn(first.width(), first.height(), median))
}

/// The things that a picture shows on the plateau and the bare plateau does not, from left to right, with the tray at
/// `platen_from_tray`.
///
/// # Errors
///
/// [`ImageFault`] if a picture is not the camera's, or does not show the plateau.
pub fn things(
    image: &GrayImage,
    bare: &GrayImage,
    camera: &CameraModel,
    tray: &MountedTray,
    platen_from_tray: &Isometry2<f64>,
) -> Result<Vec<Thing>, ImageFault> {
    let expected = (camera.width_px(), camera.height_px());
    for image in [image, bare] {
        let found = image.dimensions();
        if found != expected {
            return Err(ImageFault::WrongSize { found, expected });
        }
    }
    let view = View { camera, tray, platen_from_tray: *platen_from_tray };
    let window = view.plateau_window().ok_or(ImageFault::PlateauOutOfView)?;
    let geometry = &tray.geometry;
    let on_plateau = |pixel: Point2<f64>| {
        let place = view.tray_point(pixel, tray.plateau_height_m())?;
        let radius_m = place.coords.norm();
        let inside = radius_m > geometry.inner_radius_m && radius_m < geometry.outer_radius_m;
        (inside && tray.inside_sector_m(place) > 0.0).then_some(place)
    };
    let mut differences = Vec::with_capacity(window.len());
    for row in window.top..window.top + window.height {
        for column in window.left..window.left + window.width {
            let pixel = Point2::new(column as f64, row as f64);
            #[expect(clippy::cast_possible_truncation, reason = "a picture's side")]
            let (x, y) = (column as u32, row as u32);
            let level = |image: &GrayImage| f32::from(image.get_pixel(x, y).0[0]);
            differences.push(on_plateau(pixel).map(|_| level(image) - level(bare)));
        }
    }
    let seen: Vec<f32> = differences.iter().flatten().copied().collect();
    // The light may have changed a little between the pictures.
    let change = median(seen.clone());
    let sigma = median(seen.iter().map(|level| (level - change).abs()).collect()) / MAD_PER_SIGMA;
    let least = CONTRAST_MIN_LEVELS.max(CONTRAST_SIGMAS * sigma);
    #[expect(clippy::cast_possible_truncation, reason = "a picture's side")]
    let (width, height) = (window.width as u32, window.height as u32);
    let difference = |x: u32, y: u32| differences[(y * width + x) as usize].map(|level| level - change);
    let mask = GrayImage::from_fn(width, height, |x, y| {
        Luma([u8::from(difference(x, y).is_some_and(|level| level.abs() > least))])
    });
    let labels = connected_components(&mask, Connectivity::Eight, Luma([0]));
    let count = labels.pixels().map(|label| label.0[0]).max().unwrap_or(0) as usize;
    let mut sums = vec![(0_u32, 0.0_f64, 0.0_f64, 0.0_f32); count + 1];
    for (x, y, label) in labels.enumerate_pixels() {
        let sum = &mut sums[label.0[0] as usize];
        *sum = (sum.0 + 1, sum.1 + f64::from(x), sum.2 + f64::from(y), sum.3 + difference(x, y).unwrap_or(0.0));
    }
    let thing = |(area_px, x, y, contrast): &(u32, f64, f64, f32)| {
        let count = f64::from(*area_px);
        let pixel = Point2::new(window.left as f64 + x / count, window.top as f64 + y / count);
        let place = view.tray_point(pixel, tray.plateau_height_m())?;
        Some(Thing { pixel, place, area_px: *area_px, contrast_levels: contrast / *area_px as f32 })
    };
    let mut things: Vec<Thing> =
        sums.iter().skip(1).filter(|(area_px, ..)| *area_px >= THING_PX_MIN).filter_map(thing).collect();
    things.sort_by(|a, b| a.pixel.x.total_cmp(&b.pixel.x));
    Ok(things)
}

fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
