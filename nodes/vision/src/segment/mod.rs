//! What on the plateau is not plateau: background (`light` and `walls`), foreground, blobs; `between` tells brightness between
//! pixels.

mod between;
mod light;
mod walls;

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Vector2};

use super::ImageFault;
use super::blobs::Blobs;
use super::modes::Light;
use super::view::{RayTable, View, Window};
use feeder_model::camera::{nearest_i16, single};
use light::Across;
pub(super) use light::hub_level;
pub(super) use walls::PlateauSums;

/// Smoothed grey levels are kept in sixteenths, as the 3x3 binomial filter yields them.
pub(super) const LEVELS: f32 = 16.0;
/// Foreground differs from background by more than this many standard deviations of the background.
const SIGMAS: f32 = 5.0;
/// Bins across the plateau's width for what the walls do to the light.
pub(super) const RADIAL_BINS: usize = 200;

/// Brightness is kept relative to the bare plateau's in full light, as the difference in these units.
pub(super) const RELATIVE_UNITS: f32 = 2048.0;

/// The light when a part was taught.
#[derive(Clone, Copy, Debug)]
pub(super) struct TaughtLight {
    /// Coefficients of 1, u, v, u², uv, v² of the plateau's grey level, with u and v from −1 to 1 across the picture.
    pub light: [f32; 6],
    /// Grey level of the hub's top.
    pub hub_level: f32,
    /// Where the tray stood, see [`View::beside_camera_m`].
    pub at_m: Vector2<f64>,
}

/// What is known of the bare plateau before a frame is looked at.
#[derive(Clone, Debug)]
pub(super) struct Plateau {
    /// The light, if taught.
    pub taught: Option<TaughtLight>,
    /// Brightness relative to the middle's for each radial bin: constant, and per cosine and sine of the direction from
    /// the tray's centre, platen frame. The first entry is not used.
    pub shade: Vec<[f32; 3]>,
}

impl Plateau {
    /// A plateau that nothing is known of.
    pub(super) fn unknown() -> Self {
        Self { taught: None, shade: vec![[1.0, 0.0, 0.0]; RADIAL_BINS + 1] }
    }
}

/// A point of what lies on the plateau and belongs to no part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Uncovered {
    /// The pixel of the window.
    pub pixel: usize,
    /// Tray frame, m.
    pub place: Point2<f64>,
    /// Brightness above the plateau's, relative to it.
    pub level: f32,
    /// Pixels that it stands for.
    pub px: usize,
}

/// Where the plateau's pixels lie on it is worked out for the tray to this share of a pixel.
const STEP_PX: f64 = 1.0 / 32.0;

/// A frame taken apart.
#[derive(Clone, Debug, Default)]
pub(super) struct Segmentation {
    pub window: Window,
    /// The tray's pose and the shade of the walls by bin for which `bins`, `shade` and `outward` were worked out; `None` when they
    /// have been changed since.
    mapped: Option<(Isometry2<f64>, Vec<[f32; 3]>)>,
    /// Smoothed image, in sixteenths of a grey level.
    smooth: Vec<i16>,
    /// Radial bin of each pixel, 0 off the plateau.
    pub bins: Vec<u8>,
    /// What the walls make of the light at each pixel.
    shade: Vec<f32>,
    /// Direction of each pixel from the tray's centre, in the platen's axes.
    outward: Vec<[f32; 2]>,
    /// Brightness above that of a bare plateau out of the walls' shade, relative to it, in units of [`RELATIVE_UNITS`]; 0 off
    /// the plateau.
    pub relative: Vec<i16>,
    /// Standard deviation of that on the bare plateau, 1.
    pub sigma: f32,
    /// By how much something differs from the plateau's brightness, relative to it, to stand out.
    pub threshold: f32,
    /// The light as in [`TaughtLight::light`].
    pub light: [f32; 6],
    /// Grey level of the hub's top, if that is seen.
    pub hub_level: Option<f32>,
    /// Share of the plateau's pixels that are quite black or quite white.
    pub clipped_ratio: f64,
    /// 1 where something lies on the plateau.
    pub foreground: Vec<u8>,
    blobs: Blobs,
}

impl Segmentation {
    /// Looks at a frame.
    #[expect(clippy::too_many_arguments, reason = "what is seen, by what, and what is known of it beforehand")]
    pub(super) fn look(
        &mut self,
        view: &View,
        rays: &RayTable,
        image: &GrayImage,
        plateau: &Plateau,
        light: Light,
        contrast_min_levels: f64,
        blob_px_min: usize,
    ) -> Result<(), ImageFault> {
        self.map(view, rays, plateau)?;
        let window = self.window;
        self.smooth.resize(window.len(), 0);
        self.relative.resize(window.len(), 0);
        self.foreground.resize(window.len(), 0);
        smooth(image, window, &mut self.smooth);
        let across = Across { width: image.width() as usize, height: image.height() as usize, window };
        // Parts hide the plateau, and shade what they leave of it, but not the hub.
        self.hub_level = hub_level(view, image);
        let expected = plateau.taught.map(|taught| {
            let change = self.hub_level.map_or(1.0, |level| level / taught.hub_level);
            taught.light.map(|coefficient| coefficient * change)
        });
        let follows = light == Light::Any;
        let (light, sigma_levels, clipped_ratio) = self.fit_light(&across, expected, follows)?;
        self.clipped_ratio = clipped_ratio;
        self.light = light;
        self.sigma = sigma_levels / light[0].max(1.0);
        if follows && plateau.taught.is_some() {
            self.follow_shade(&across, &light);
            self.mapped = None;
        }
        let threshold = single(contrast_min_levels).max(SIGMAS * sigma_levels);
        self.threshold = threshold / light[0].max(1.0);
        let mut levels = vec![0.0; window.width];
        for row in 0..window.height {
            let range = row * window.width..(row + 1) * window.width;
            levels.iter_mut().zip(across.light_row(&light, row)).for_each(|(level, light)| *level = light);
            let outputs = self.relative[range.clone()].iter_mut().zip(&mut self.foreground[range.clone()]);
            let inputs = self.smooth[range.clone()].iter().zip(&self.bins[range.clone()]).zip(&self.shade[range]);
            for (((relative, foreground), ((value, bin), shade)), level) in outputs.zip(inputs).zip(&levels) {
                let on_plateau = f32::from(u8::from(*bin > 0));
                let value = f32::from(*value) * (1.0 / LEVELS);
                *foreground = u8::from((value - level * shade).abs() * on_plateau > threshold);
                let light = level.max(1.0);
                *relative = nearest_i16((value - light) * on_plateau / light * RELATIVE_UNITS);
            }
        }
        self.blobs.drop_specks(&mut self.foreground, window.width, blob_px_min);
        Ok(())
    }

    /// Works out where each pixel of the window lies on the plateau, unless the tray still stands where it did.
    fn map(&mut self, view: &View, rays: &RayTable, plateau: &Plateau) -> Result<(), ImageFault> {
        let place = view.tray.on_grid(view.camera, &view.platen_from_tray, STEP_PX);
        if self.mapped.as_ref().is_some_and(|(at, shade)| *at == place && *shade == plateau.shade) {
            return Ok(());
        }
        self.mapped = None;
        let view = View { platen_from_tray: place, ..*view };
        self.window = view.plateau_window().ok_or(ImageFault::PlateauOutOfView)?;
        let geometry = &view.tray.geometry;
        let bin_m = (geometry.outer_radius_m - geometry.inner_radius_m) / RADIAL_BINS as f64;
        let window = self.window;
        self.bins.resize(window.len(), 0);
        self.shade.resize(window.len(), 1.0);
        self.outward.resize(window.len(), [0.0; 2]);
        let rows = self.bins.chunks_mut(window.width).zip(self.shade.chunks_mut(window.width));
        let rows = rows.zip(self.outward.chunks_mut(window.width));
        for (row, ((bins, shade), outward)) in rows.enumerate() {
            rays.plateau_row(&view, window, row, bin_m, &plateau.shade, bins, shade, outward);
        }
        self.mapped = Some((place, plateau.shade.clone()));
        Ok(())
    }

    /// Where the tray frame shows foreground that has no owner, further than `strip_px` from the plateau's edges, and how
    /// bright it is there, relative to the plateau: every pixel of it.
    pub(super) fn foreground_points(
        &self,
        view: &View,
        height_m: f64,
        strip_px: f64,
        owners: &[u16],
    ) -> Vec<Uncovered> {
        let width = self.window.width;
        let strip_m = strip_px * view.camera.m_per_px(height_m);
        let geometry = &view.tray.geometry;
        let mut points = Vec::new();
        let rows = self.foreground.chunks(width).zip(owners.chunks(width));
        for (row, (pixels, owners)) in rows.enumerate() {
            let open = |column: usize| pixels[column] != 0 && owners[column] == 0;
            let mut column = 0;
            while let Some(start) = (column..width).find(|column| open(*column)) {
                column = (start..width).find(|column| !open(*column)).unwrap_or(width);
                let mut counted = start;
                for place in start..column {
                    let pixel = Point2::new((self.window.left + place) as f64, (self.window.top + row) as f64);
                    let Some(point) = view.tray_point(pixel, height_m) else {
                        continue;
                    };
                    let radius_m = point.coords.norm();
                    let from_walls_m = (geometry.outer_radius_m - radius_m).min(radius_m - geometry.inner_radius_m);
                    if from_walls_m.min(view.tray.inside_sector_m(point)) > strip_m {
                        let index = row * width + place;
                        let level = f32::from(self.relative[index]) / RELATIVE_UNITS - self.wall_shade(index);
                        let px = (place + 1).saturating_sub(counted);
                        points.push(Uncovered { pixel: index, place: point, level, px });
                        counted = place + 1;
                    }
                }
            }
        }
        points
    }

    /// What the walls' shade adds to the bare plateau's relative brightness at a pixel.
    pub(super) fn wall_shade(&self, index: usize) -> f32 {
        self.shade[index] - 1.0
    }
}

/// 3x3 binomial filter, in sixteenths of a grey level.
fn smooth(image: &GrayImage, window: Window, smooth: &mut [i16]) {
    let stride = image.width() as usize;
    let pixels: &[u8] = image;
    let mut columns = vec![0_i16; window.width + 2];
    for (row, smooth) in smooth.chunks_mut(window.width).enumerate() {
        let start = (window.top + row - 1) * stride + window.left - 1;
        let line = |offset: usize| &pixels[start + offset * stride..start + offset * stride + window.width + 2];
        for (column, ((above, middle), below)) in columns.iter_mut().zip(line(0).iter().zip(line(1)).zip(line(2))) {
            *column = i16::from(*above) + 2 * i16::from(*middle) + i16::from(*below);
        }
        for (smooth, columns) in smooth.iter_mut().zip(columns.windows(3)) {
            *smooth = columns[0] + 2 * columns[1] + columns[2];
        }
    }
}

#[cfg(test)]
mod tests {
    use feeder_model::camera::MountedTray;
    use feeder_model::tray::TrayGeometry;
    use nalgebra::Vector2;

    use super::*;
    use crate::tests::camera;

    /// A part's shade is compared with what is seen: it must not be told of one pixel what is seen at another.
    #[test]
    fn what_stands_out_is_as_bright_as_it_is_seen_at_that_pixel() {
        let camera = camera();
        let (tray, rays) = (MountedTray::new(TrayGeometry::PAPER), RayTable::new(&camera));
        let view = View { camera: &camera, tray: &tray, platen_from_tray: Isometry2::new(Vector2::new(0.3, 0.3), 0.0) };
        let height_m = tray.plateau_height_m();
        let middle = view.pixel(Point2::new(0.0, -0.06), height_m).unwrap();
        // A slope that grows darker by two grey levels a pixel.
        let left = (0..640).find(|x| f64::from(*x) > middle.x - 20.0).unwrap();
        let image = GrayImage::from_fn(640, 480, |x, y| {
            let is_slope = (left..left + 40).contains(&x) && (f64::from(y) - middle.y).abs() < 10.0;
            image::Luma([if is_slope { 150 - 2 * u8::try_from(x.abs_diff(left)).unwrap() } else { 200 }])
        });
        let mut frame = Segmentation::default();
        frame.look(&view, &rays, &image, &Plateau::unknown(), Light::Taught, 10.0, 9).unwrap();
        let points = frame.foreground_points(&view, height_m, 0.0, &vec![0; frame.window.len()]);
        let seen =
            |point: &Uncovered| f32::from(frame.relative[point.pixel]) / RELATIVE_UNITS - frame.wall_shade(point.pixel);
        assert!(points.len() > 500, "{}", points.len());
        for point in &points {
            assert!((point.level - seen(point)).abs() < 1e-6, "{point:?} {}", seen(point));
        }
    }

    /// The light found on a tray that was taught at a level of 160, and of 180 on the hub; now a sixteenth of the plateau is at another
    /// level than the rest of it.
    fn crowded(hub: u8, most: u8, bare: u8) -> Result<[f32; 6], ImageFault> {
        let camera = camera();
        let (tray, rays) = (MountedTray::new(TrayGeometry::PAPER), RayTable::new(&camera));
        let view = View { camera: &camera, tray: &tray, platen_from_tray: Isometry2::new(Vector2::new(0.3, 0.3), 0.0) };
        let image = GrayImage::from_fn(640, 480, |x, y| {
            let place = view.tray_point(Point2::new(f64::from(x), f64::from(y)), tray.wall_top_m());
            let on_hub = place.is_some_and(|place| place.coords.norm() < tray.geometry.inner_radius_m);
            let is_bare = x / 8 % 4 == 0 && y / 8 % 4 == 0;
            image::Luma([if on_hub {
                hub
            } else if is_bare {
                bare
            } else {
                most
            }])
        });
        let taught = TaughtLight { light: [160.0, 0.0, 0.0, 0.0, 0.0, 0.0], hub_level: 180.0, at_m: Vector2::zeros() };
        let plateau = Plateau { taught: Some(taught), ..Plateau::unknown() };
        let mut frame = Segmentation::default();
        frame.look(&view, &rays, &image, &plateau, Light::Any, 10.0, 9)?;
        Ok(frame.light)
    }

    #[test]
    fn the_shade_of_a_crowd_is_not_taken_for_the_plateau_which_is_about_as_bright_as_the_hub_tells() {
        assert_eq!(crowded(180, 80, 80), Err(ImageFault::NoBackground));
        for (hub, most, bare, level) in
            [(180, 80, 160, 160.0), (180, 135, 160, 135.0), (180, 200, 160, 200.0), (90, 80, 160, 80.0)]
        {
            let light = crowded(hub, most, bare).unwrap();
            assert!((light[0] - level).abs() < 3.0, "{hub} {most} {bare}: {light:?}");
        }
    }

    #[test]
    fn the_plateau_is_mapped_anew_for_another_place_and_for_other_walls() {
        let camera = camera();
        let (tray, rays) = (MountedTray::new(TrayGeometry::PAPER), RayTable::new(&camera));
        let image = GrayImage::from_pixel(640, 480, image::Luma([100]));
        let bright = Plateau::unknown();
        let dim = Plateau { shade: vec![[0.5, 0.0, 0.0]; RADIAL_BINS + 1], ..Plateau::unknown() };
        let look = |frame: &mut Segmentation, x_m: f64, plateau: &Plateau| {
            let platen_from_tray = Isometry2::new(Vector2::new(x_m, 0.3), 0.0);
            let view = View { camera: &camera, tray: &tray, platen_from_tray };
            frame.look(&view, &rays, &image, plateau, Light::Taught, 10.0, 9).unwrap();
        };
        let mut kept = Segmentation::default();
        // A micrometre is nothing, a millimetre something; and walls may be learned from the picture just looked at.
        for (x_m, plateau) in [(0.3, &bright), (0.300_001, &bright), (0.301, &bright), (0.301, &dim), (0.301, &bright)]
        {
            look(&mut kept, x_m, plateau);
            let mut fresh = Segmentation::default();
            look(&mut fresh, x_m, plateau);
            assert!(kept.bins == fresh.bins && kept.shade == fresh.shade && kept.outward == fresh.outward, "{x_m}");
        }
    }
}
