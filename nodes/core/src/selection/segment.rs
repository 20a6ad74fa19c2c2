//! What on the plateau is not plateau: background, foreground, blobs.

use image::GrayImage;
use nalgebra::{Point2, SMatrix, SVector, Vector2};

use super::ImageFault;
use super::blobs::Blobs;
use super::view::{RayTable, View, Window};
use crate::camera::single;

/// Smoothed grey levels are kept in sixteenths, as the 3x3 binomial filter yields them.
pub(super) const LEVELS: f32 = 16.0;
/// Every so many pixels both ways one takes part in fitting the background.
const FIT_STRIDE: usize = 4;
/// Residuals, in grey levels, beyond which a pixel does not belong to the background, from fit to fit.
const FIT_LIMITS: [f32; 5] = [28.0, 20.0, 14.0, 10.0, 8.0];
/// Fewer pixels than this are no plateau.
const PLATEAU_PX_MIN: usize = 400;
/// Share of the plateau that must look like background, and of its pixels that may be quite black or quite white.
const BACKGROUND_RATIO_MIN: f64 = 0.15;
const CLIPPED_RATIO_MAX: f64 = 0.5;
/// Foreground differs from background by more than this many standard deviations of the background.
const SIGMAS: f32 = 5.0;
/// Gradient of an edge, in grey levels per pixel of the smoothed image: at least, and in standard deviations of the
/// background.
const EDGE_LEVELS_MIN: f32 = 5.0;
const EDGE_SIGMAS: f32 = 2.2;
/// Bins across the plateau's width for what the walls do to the light.
const RADIAL_BINS: usize = 200;

/// Brightness of the bare plateau: a quadratic over the window plus a correction by distance from the walls.
#[derive(Clone, Debug)]
pub(super) struct Background {
    /// Coefficients of 1, u, v, u², uv, v² in grey levels; u, v from −1 to 1 across the window.
    quadratic: [f32; 6],
    /// Correction by radial bin, grey levels.
    radial: Vec<f32>,
    /// Standard deviation of the smoothed plateau about this, grey levels.
    pub sigma: f32,
}

/// A frame taken apart.
#[derive(Clone, Debug, Default)]
pub(super) struct Segmentation {
    pub window: Window,
    /// Smoothed image, in sixteenths of a grey level.
    pub smooth: Vec<i16>,
    /// Radial bin of each pixel, 0 off the plateau.
    pub bins: Vec<u8>,
    /// Gradient from which an edge is more than noise, grey levels per pixel.
    pub edge_levels: f32,
    /// 1 where something lies on the plateau.
    pub foreground: Vec<u8>,
    blobs: Blobs,
}

impl Segmentation {
    /// Looks at a frame. Returns the background found.
    pub(super) fn look(
        &mut self,
        view: &View,
        rays: &RayTable,
        image: &GrayImage,
        contrast_min_levels: f64,
        blob_px_min: usize,
    ) -> Result<Background, ImageFault> {
        self.window = view.plateau_window().ok_or(ImageFault::PlateauOutOfView)?;
        let geometry = &view.tray.geometry;
        let bin_m = (geometry.outer_radius_m - geometry.inner_radius_m) / RADIAL_BINS as f64;
        let window = self.window;
        self.bins.resize(window.len(), 0);
        self.smooth.resize(window.len(), 0);
        self.foreground.resize(window.len(), 0);
        for (row, bins) in self.bins.chunks_mut(window.width).enumerate() {
            rays.plateau_row(view, window, row, bin_m, bins);
        }
        smooth(image, window, &mut self.smooth);
        let background = self.fit_background()?;
        self.edge_levels = EDGE_LEVELS_MIN.max(EDGE_SIGMAS * background.sigma);
        let threshold = single(contrast_min_levels).max(SIGMAS * background.sigma);
        for row in 0..window.height {
            let range = row * window.width..(row + 1) * window.width;
            let level = background.row(window, row);
            let pixels = self.smooth[range.clone()].iter().zip(&self.bins[range.clone()]);
            for ((foreground, (value, bin)), level) in self.foreground[range].iter_mut().zip(pixels).zip(level) {
                let expected = level + background.radial[usize::from(*bin)];
                let differs = (f32::from(*value) * (1.0 / LEVELS) - expected).abs() > threshold;
                *foreground = u8::from(differs & (*bin > 0));
            }
        }
        self.blobs.drop_specks(&mut self.foreground, window.width, blob_px_min);
        Ok(background)
    }

    fn fit_background(&self) -> Result<Background, ImageFault> {
        let window = self.window;
        let mut samples = Vec::with_capacity(window.len() / (FIT_STRIDE * FIT_STRIDE));
        let mut histogram = [0_usize; 256];
        for row in (0..window.height).step_by(FIT_STRIDE) {
            let v = unit(row, window.height);
            for column in (0..window.width).step_by(FIT_STRIDE) {
                let index = row * window.width + column;
                if self.bins[index] > 0 {
                    let level = f32::from(self.smooth[index]) * (1.0 / LEVELS);
                    histogram[usize::from(crate::camera::grey_level(level))] += 1;
                    samples.push((basis(unit(column, window.width), v), level));
                }
            }
        }
        let count = samples.len();
        if count * FIT_STRIDE * FIT_STRIDE < PLATEAU_PX_MIN {
            return Err(ImageFault::PlateauOutOfView);
        }
        let share = |count_of: usize| count_of as f64 / count as f64;
        if share(histogram[..4].iter().sum()) > CLIPPED_RATIO_MAX {
            return Err(ImageFault::UnderExposed);
        }
        if share(histogram[252..].iter().sum()) > CLIPPED_RATIO_MAX {
            return Err(ImageFault::OverExposed);
        }
        let mut quadratic = [0.0; 6];
        quadratic[0] = mode(&histogram);
        let mut inliers = 0;
        for limit in FIT_LIMITS {
            let mut normal = SMatrix::<f32, 6, 6>::zeros();
            let mut target = SVector::<f32, 6>::zeros();
            inliers = 0;
            for (basis, level) in &samples {
                let residual = level - evaluate(&quadratic, basis);
                if residual.abs() < limit {
                    // Tukey's weight: what lies near the limit counts little.
                    let weight = 1.0 - (residual / limit).powi(2);
                    for i in 0..6 {
                        target[i] += weight * basis[i] * residual;
                        for j in 0..=i {
                            normal[(i, j)] += weight * basis[i] * basis[j];
                        }
                    }
                    inliers += 1;
                }
            }
            // A touch of ridge keeps a fit to few pixels tame.
            for i in 0..6 {
                normal[(i, i)] += 1e-3 * count as f32;
            }
            let change = normal.cholesky().ok_or(ImageFault::NoBackground)?.solve(&target);
            for (coefficient, change) in quadratic.iter_mut().zip(change.iter()) {
                *coefficient += change;
            }
        }
        if share(inliers) < BACKGROUND_RATIO_MIN {
            return Err(ImageFault::NoBackground);
        }
        let mut background = Background { quadratic, radial: vec![0.0; 256], sigma: 0.0 };
        self.fit_walls(&mut background);
        Ok(background)
    }

    /// Median residual for each radial bin, and the scatter that remains.
    fn fit_walls(&self, background: &mut Background) {
        const SPAN: usize = 64;
        let window = self.window;
        let mut histograms = vec![[0_u32; SPAN]; 256];
        for row in (0..window.height).step_by(2) {
            let levels = background.row(window, row);
            let range = row * window.width..(row + 1) * window.width;
            let pixels = self.smooth[range.clone()].iter().zip(&self.bins[range]);
            for ((value, bin), level) in pixels.zip(levels) {
                if *bin > 0 {
                    let residual = f32::from(*value) * (1.0 / LEVELS) - level + SPAN as f32 / 2.0;
                    if (0.0..SPAN as f32).contains(&residual) {
                        histograms[usize::from(*bin)]
                            [usize::from(crate::camera::grey_level(residual)).min(SPAN - 1)] += 1;
                    }
                }
            }
        }
        let mut deviations = [0_u32; SPAN];
        for (radial, histogram) in background.radial.iter_mut().zip(&histograms) {
            let median = median_bin(histogram);
            if let Some(median) = median {
                *radial = median as f32 - SPAN as f32 / 2.0;
                for (bin, count) in histogram.iter().enumerate() {
                    deviations[bin.abs_diff(median)] += count;
                }
            }
        }
        // Median absolute deviation; half a level for the whole levels it is counted in.
        let deviation = median_bin(&deviations).unwrap_or(0) as f32;
        background.sigma = 1.4826 * (deviation + 0.5);
    }

    /// Takes a disc of the tray frame out of the foreground.
    pub(super) fn clear_disc(&mut self, view: &View, height_m: f64, centre: Point2<f64>, radius_m: f64) {
        let (Some(pixel), Some(px_from_tray)) = (view.pixel(centre, height_m), view.px_from_tray(centre, height_m))
        else {
            return;
        };
        let radius_px = radius_m * px_from_tray.determinant().abs().sqrt();
        let Window { left, top, width, height } = self.window;
        let middle = pixel - Vector2::new(left as f64, top as f64);
        for row in clip(middle.y - radius_px, middle.y + radius_px, height) {
            let half = (radius_px.powi(2) - (row as f64 - middle.y).powi(2)).max(0.0).sqrt();
            let columns = clip(middle.x - half, middle.x + half, width);
            self.foreground[row * width + columns.start..row * width + columns.end].fill(0);
        }
    }

    /// Where the tray frame shows foreground further than `strip_px` from the plateau's edges: both ends of every run of
    /// pixels, and points between them.
    pub(super) fn foreground_points(&self, view: &View, height_m: f64, strip_px: f64) -> Vec<Point2<f64>> {
        const SPACING: usize = 4;
        let width = self.window.width;
        let strip_m = strip_px * view.camera.m_per_px(height_m);
        let geometry = &view.tray.geometry;
        let mut points = Vec::new();
        for (row, pixels) in self.foreground.chunks(width).enumerate() {
            let mut column = 0;
            while let Some(skip) = pixels[column..].iter().position(|p| *p != 0) {
                let start = column + skip;
                let length = pixels[start..].iter().position(|p| *p == 0).unwrap_or(width - start);
                column = start + length;
                for place in (start..column - 1).step_by(SPACING).chain([column - 1]) {
                    let place = Point2::new((self.window.left + place) as f64, (self.window.top + row) as f64);
                    let Some(point) = view.tray_point(place, height_m) else {
                        continue;
                    };
                    let radius_m = point.coords.norm();
                    let from_walls_m = (geometry.outer_radius_m - radius_m).min(radius_m - geometry.inner_radius_m);
                    if from_walls_m.min(view.tray.inside_sector_m(point)) > strip_m {
                        points.push(point);
                    }
                }
            }
        }
        points
    }

    /// Smoothed grey level at a place of the image, bilinear; `None` off the window.
    pub(super) fn level(&self, x: f32, y: f32) -> Option<f32> {
        let (x, y) = (x - self.window.left as f32, y - self.window.top as f32);
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not negative, and a cast saturates"
        )]
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= self.window.width || row + 1 >= self.window.height {
            return None;
        }
        let (across, down) = (x - column as f32, y - row as f32);
        let index = row * self.window.width + column;
        let at = |index: usize| f32::from(self.smooth[index]);
        let upper = at(index) + across * (at(index + 1) - at(index));
        let index = index + self.window.width;
        let lower = at(index) + across * (at(index + 1) - at(index));
        Some((upper + down * (lower - upper)) * (1.0 / LEVELS))
    }
}

impl Background {
    /// Background of a row of the window without the walls' effect.
    fn row(&self, window: Window, row: usize) -> impl Iterator<Item = f32> + use<> {
        let [c, cu, cv, cuu, cuv, cvv] = self.quadratic;
        let v = unit(row, window.height);
        let (constant, linear) = (c + cv * v + cvv * v * v, cu + cuv * v);
        let step = 2.0 / window.width as f32;
        (0..window.width).map(move |column| {
            let u = column as f32 * step - 1.0;
            constant + u * (linear + u * cuu)
        })
    }

    /// Background at a place of the image, without the walls' effect.
    pub(super) fn level(&self, window: Window, x: f32, y: f32) -> f32 {
        let u = (x - window.left as f32) * 2.0 / window.width as f32 - 1.0;
        let v = (y - window.top as f32) * 2.0 / window.height as f32 - 1.0;
        evaluate(&self.quadratic, &basis(u, v))
    }
}

/// The whole numbers from `low` to `high` within 0..`size`.
fn clip(low: f64, high: f64, size: usize) -> std::ops::Range<usize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
    let (low, high) = (low.ceil() as usize, (high.floor() + 1.0) as usize);
    low.min(size)..high.min(size).max(low.min(size))
}

/// Place in −1 to 1 across a window.
fn unit(index: usize, size: usize) -> f32 {
    index as f32 * 2.0 / size as f32 - 1.0
}

fn basis(u: f32, v: f32) -> [f32; 6] {
    [1.0, u, v, u * u, u * v, v * v]
}

fn evaluate(coefficients: &[f32; 6], basis: &[f32; 6]) -> f32 {
    coefficients.iter().zip(basis).map(|(c, b)| c * b).sum()
}

/// The most frequent grey level, looked at through a window of some levels.
fn mode(histogram: &[usize; 256]) -> f32 {
    const HALF: usize = 8;
    let mass = |centre: usize| histogram[centre.saturating_sub(HALF)..=(centre + HALF).min(255)].iter().sum::<usize>();
    // The first of the highest, so that ties do not depend on the iterator.
    let best = (0..256).rev().max_by_key(|centre| mass(*centre)).unwrap_or(0);
    best as f32
}

fn median_bin(histogram: &[u32]) -> Option<usize> {
    let total: u32 = histogram.iter().sum();
    let mut below = 0;
    (total > 0).then_some(())?;
    histogram.iter().position(|count| {
        below += count;
        2 * below >= total
    })
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
