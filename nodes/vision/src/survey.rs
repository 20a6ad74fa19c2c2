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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{camera, over_camera};
    use feeder_model::tray::TrayGeometry;

    /// A camera over a tray whose plateau it sees whole, and the place of the plateau's middle in its picture.
    fn scene() -> (CameraModel, MountedTray, Isometry2<f64>, (u32, u32)) {
        let (camera, place) = (camera(), over_camera());
        // The least rectangle about a third of a ring holds more than that.
        let geometry = TrayGeometry { ramp_angle_rad: std::f64::consts::TAU * 2.0 / 3.0, ..TrayGeometry::PAPER };
        let tray = MountedTray::new(geometry);
        let view = View { camera: &camera, tray: &tray, platen_from_tray: place };
        let middle = view.pixel(Point2::new(0.0, -0.06), tray.plateau_height_m()).unwrap();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
        let middle = (middle.x as u32, middle.y as u32);
        (camera, tray, place, middle)
    }

    /// Makes a rectangle of a picture brighter by so many levels.
    fn brighten(image: &mut GrayImage, (left, top): (u32, u32), (width, height): (u32, u32), levels: i16) {
        for (x, y) in (left..left + width).flat_map(|x| (top..top + height).map(move |y| (x, y))) {
            let level = &mut image.get_pixel_mut(x, y).0[0];
            *level = u8::try_from(i16::from(*level) + levels).unwrap();
        }
    }

    fn seen(image: &GrayImage, bare: &GrayImage) -> Vec<Thing> {
        let (camera, tray, place, _) = scene();
        things(image, bare, &camera, &tray, &place).unwrap()
    }

    #[test]
    fn the_bare_plateau_is_the_median_of_pictures_of_one_size() {
        let picture = |levels: [u8; 2]| GrayImage::from_raw(2, 1, levels.to_vec()).unwrap();
        let pictures = [[9, 200], [100, 10], [101, 12], [250, 13]].map(picture);
        let bare = |of: &[usize]| bare_plateau(&of.iter().map(|index| &pictures[*index]).collect::<Vec<_>>());
        assert_eq!(bare(&[0, 1, 2]).unwrap().into_raw(), [100, 12]);
        // Of an even number, half way between the two in the middle.
        assert_eq!(bare(&[0, 1, 2, 3]).unwrap().into_raw(), [101, 13]);
        assert_eq!(bare(&[0, 1]), None);
        assert_eq!(bare(&[]), None);
        assert_eq!(bare_plateau(&[&pictures[0], &pictures[1], &GrayImage::new(1, 2)]), None);
    }

    #[test]
    fn things_are_told_with_place_size_and_brightness_from_left_to_right() {
        let (camera, tray, place, (x, y)) = scene();
        let bare = GrayImage::from_pixel(640, 480, Luma([100]));
        // Elsewhere the light has changed a little, too.
        let mut image = GrayImage::from_pixel(640, 480, Luma([104]));
        brighten(&mut image, (x + 20, y - 9), (5, 3), 30);
        brighten(&mut image, (x - 20, y), (3, 7), -40);
        // Two that touch at a corner are one.
        brighten(&mut image, (x, y), (3, 3), 20);
        brighten(&mut image, (x + 3, y + 3), (3, 3), 60);
        let things = seen(&image, &bare);
        let told = |thing: &Thing| (thing.pixel.x, thing.pixel.y, thing.area_px, thing.contrast_levels);
        let (x, y) = (f64::from(x), f64::from(y));
        let expected = [(x - 19.0, y + 3.0, 21, -40.0), (x + 2.5, y + 2.5, 18, 40.0), (x + 22.0, y - 8.0, 15, 30.0)];
        assert_eq!(things.iter().map(told).collect::<Vec<_>>(), expected);
        let view = View { camera: &camera, tray: &tray, platen_from_tray: place };
        for thing in things {
            let back = view.pixel(thing.place, tray.plateau_height_m()).unwrap();
            assert!((back - thing.pixel).norm() < 1e-6, "{thing:?}");
        }
    }

    #[test]
    fn what_is_small_or_faint_or_beside_the_plateau_is_no_thing() {
        let (camera, tray, place, (x, y)) = scene();
        let bare = GrayImage::from_pixel(640, 480, Luma([100]));
        let alone = |width: u32, levels: i16| {
            let mut image = bare.clone();
            brighten(&mut image, (x, y), (width, 1), levels);
            seen(&image, &bare).len()
        };
        assert_eq!((alone(12, 11), alone(12, -11), alone(11, 11), alone(12, 10)), (1, 1, 0, 0));
        // Where the picture is noisy, what noise does is no thing: two of three pixels are four levels off, so five sigmas are 29.7.
        let mut noisy = bare.clone();
        noisy.enumerate_pixels_mut().for_each(|(x, y, level)| level.0[0] = [96, 100, 104][((x + y) % 3) as usize]);
        let in_noise = |levels: i16| {
            let mut image = noisy.clone();
            brighten(&mut image, (x, y), (6, 6), levels);
            seen(&image, &bare).len()
        };
        assert_eq!((in_noise(25), in_noise(34)), (0, 1));
        // On the ramp, on the hub, and beyond the rim.
        let view = View { camera: &camera, tray: &tray, platen_from_tray: place };
        for beside in [Point2::new(-0.04, -0.02), Point2::new(0.0, -0.02), Point2::new(0.07, -0.07)] {
            let pixel = view.pixel(beside, tray.plateau_height_m()).unwrap();
            let mut image = bare.clone();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
            brighten(&mut image, (pixel.x as u32 - 2, pixel.y as u32 - 2), (5, 5), 50);
            assert_eq!(seen(&image, &bare), [], "{beside}");
        }
        assert_eq!(seen(&bare, &bare), []);
    }

    #[test]
    fn pictures_of_another_size_or_of_no_plateau_are_refused() {
        let (camera, tray, place, _) = scene();
        let (bare, small) = (GrayImage::new(640, 480), GrayImage::new(480, 640));
        let expected = (640, 480);
        for (image, bare) in [(&small, &bare), (&bare, &small)] {
            let told = things(image, bare, &camera, &tray, &place);
            assert_eq!(told, Err(ImageFault::WrongSize { found: (480, 640), expected }));
        }
        let away = Isometry2::translation(2.0, 0.3);
        assert_eq!(things(&bare, &bare, &camera, &tray, &away), Err(ImageFault::PlateauOutOfView));
    }
}
