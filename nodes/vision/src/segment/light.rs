//! The light on the bare plateau, from what of it is seen.

use image::GrayImage;
use nalgebra::{Point2, SMatrix, SVector};

use super::super::ImageFault;
use super::super::view::{View, Window};
use super::{LEVELS, Segmentation};

/// Every so many pixels both ways one takes part in fitting the background.
const FIT_STRIDE: usize = 4;
/// Residuals, in grey levels, beyond which a pixel does not belong to the background, from fit to fit.
const FIT_LIMITS: [f32; 5] = [28.0, 20.0, 14.0, 10.0, 8.0];
/// Fewer pixels than this are no plateau.
const PLATEAU_PX_MIN: usize = 400;
/// Share of the plateau that must look like background where the light was not taught, and of its pixels that may be
/// quite black or quite white.
const BACKGROUND_RATIO_MIN: f64 = 0.15;
const CLIPPED_RATIO_MAX: f64 = 0.5;
/// Share of the plateau that must look as expected of the taught light; otherwise the light is found from the frame alone.
const EXPECTED_RATIO_MIN: f64 = 0.5;
/// What the hub tells of the plateau's brightness is right within this factor: lights that differ much differ by 1.1. What is alike
/// in many places and further from that is the shade of a crowd.
const BESIDE_HUB_FACTOR: f32 = 1.4;
/// Where less of the plateau than this looks as the hub tells, nothing tells of the light on it: where nuts cover half of it
/// 0.06 does, where brackets or clips do less than 0.01.
const BARE_RATIO_MIN: f64 = 0.02;
/// Inertia of the fit, in shares of the plateau: where little of the plateau is free, and that in the shade of parts, the
/// taught light counts.
const FIT_INERTIA: f32 = 0.5;

impl Segmentation {
    /// The light, the standard deviation about it in grey levels, and the share of the plateau that is clipped.
    pub(super) fn fit_light(
        &self,
        across: &Across,
        expected: Option<[f32; 6]>,
        follows: bool,
    ) -> Result<([f32; 6], f32, f64), ImageFault> {
        let window = self.window;
        let mut samples = Vec::with_capacity(window.len() / (FIT_STRIDE * FIT_STRIDE));
        let mut histogram = [0_usize; 256];
        for row in (0..window.height).step_by(FIT_STRIDE) {
            let v = across.v(row);
            for column in (0..window.width).step_by(FIT_STRIDE) {
                let index = row * window.width + column;
                if self.bins[index] > 0 {
                    let level = f32::from(self.smooth[index]) * (1.0 / LEVELS) / self.shade[index];
                    let basis = basis(across.u(column), v);
                    histogram[usize::from(feeder_model::camera::grey_level(level))] += 1;
                    samples.push((basis, level));
                }
            }
        }
        let count = samples.len();
        if count * FIT_STRIDE * FIT_STRIDE < PLATEAU_PX_MIN {
            return Err(ImageFault::PlateauOutOfView);
        }
        let share = |count_of: usize| count_of as f64 / count as f64;
        let black_ratio = share(histogram[..4].iter().sum());
        let white_ratio = share(histogram[252..].iter().sum());
        if black_ratio > CLIPPED_RATIO_MAX {
            return Err(ImageFault::UnderExposed);
        }
        if white_ratio > CLIPPED_RATIO_MAX {
            return Err(ImageFault::OverExposed);
        }
        let clipped_ratio = black_ratio + white_ratio;
        let (mut quadratic, limits, inertia) = match expected {
            None => ([mode(&histogram), 0.0, 0.0, 0.0, 0.0, 0.0], &FIT_LIMITS[..], 1e-3),
            Some(expected) => (expected, &FIT_LIMITS[FIT_LIMITS.len() - 2..], FIT_INERTIA),
        };
        let mut inliers = 0;
        for limit in limits {
            // A row for each coefficient: what goes with all six, and with the residual; eight make up vectors.
            let mut sums = [[0.0_f32; 8]; 6];
            inliers = 0;
            for (basis, level) in &samples {
                let residual = level - evaluate(&quadratic, basis);
                if residual.abs() < *limit {
                    // Tukey's weight: what lies near the limit counts little.
                    let weight = 1.0 - (residual / limit) * (residual / limit);
                    let [c, u, v, uu, uv, vv] = *basis;
                    let values = [c, u, v, uu, uv, vv, residual, 0.0];
                    for (sums, value) in sums.iter_mut().zip(basis) {
                        let scale = weight * value;
                        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += scale * value);
                    }
                    inliers += 1;
                }
            }
            let mut normal = SMatrix::<f32, 6, 6>::from_fn(|row, column| sums[row][column]);
            let target = SVector::<f32, 6>::from_fn(|row, _| sums[row][6]);
            for i in 0..6 {
                normal[(i, i)] += inertia * count as f32;
            }
            let change = normal.cholesky().ok_or(ImageFault::NoBackground)?.solve(&target);
            for (coefficient, change) in quadratic.iter_mut().zip(change.iter()) {
                *coefficient += change;
            }
        }
        if follows && expected.is_some() && share(inliers) < EXPECTED_RATIO_MIN {
            let alone = self.fit_light(across, None, follows);
            let expected = expected.map_or(0.0, |light| light[0]);
            let as_hub_tells = |level: f32| level.max(expected) <= BESIDE_HUB_FACTOR * level.min(expected);
            if alone.as_ref().is_ok_and(|(light, ..)| self.hub_level.is_none() || as_hub_tells(light[0])) {
                return alone;
            }
            if share(inliers) < BARE_RATIO_MIN {
                return Err(ImageFault::NoBackground);
            }
        }
        if expected.is_none() && share(inliers) < BACKGROUND_RATIO_MIN {
            return Err(ImageFault::NoBackground);
        }
        let mut deviations = [0_u32; 256];
        let limit = FIT_LIMITS[FIT_LIMITS.len() - 1];
        for (basis, level) in &samples {
            let deviation = (level - evaluate(&quadratic, basis)).abs();
            if deviation < limit {
                // In sixteenths of a grey level.
                deviations[usize::from(feeder_model::camera::grey_level(deviation * LEVELS))] += 1;
            }
        }
        // The lower quartile of a normal distribution's absolute deviations: what is in the shade of parts deviates more.
        let sigma_levels = 3.1384 * (lower_quartile_bin(&deviations).unwrap_or(0) as f32 + 0.5) / LEVELS;
        Ok((quadratic, sigma_levels, clipped_ratio))
    }
}

/// Where a window's pixels lie across the picture, from −1 to 1.
pub(super) struct Across {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) window: Window,
}

impl Across {
    fn u(&self, column: usize) -> f32 {
        (self.window.left + column) as f32 * 2.0 / self.width as f32 - 1.0
    }

    fn v(&self, row: usize) -> f32 {
        (self.window.top + row) as f32 * 2.0 / self.height as f32 - 1.0
    }

    /// The light along a row of the window.
    pub(super) fn light_row(&self, light: &[f32; 6], row: usize) -> impl Iterator<Item = f32> + use<> {
        let [c, cu, cv, cuu, cuv, cvv] = *light;
        let v = self.v(row);
        let (constant, linear) = (c + cv * v + cvv * v * v, cu + cuv * v);
        let (start, step) = (self.u(0), 2.0 / self.width as f32);
        // Sides are at most 4096 px, and what has 16 bits becomes a float in vector instructions.
        (0..u16::try_from(self.window.width).unwrap_or(u16::MAX)).map(move |column| {
            let u = start + f32::from(column) * step;
            constant + u * (linear + u * cuu)
        })
    }
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

/// Mean grey level of the hub's top; `None` if it is out of view.
pub(in super::super) fn hub_level(view: &View, image: &GrayImage) -> Option<f32> {
    /// Rings and spokes of points looked at, clear of the bore and of the rim.
    const RINGS: [f64; 4] = [0.45, 0.55, 0.65, 0.75];
    const SPOKES: u32 = 32;
    let (mut sum, mut count) = (0.0, 0.0_f32);
    for ring in RINGS {
        for spoke in 0..SPOKES {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(spoke) / f64::from(SPOKES)).sin_cos();
            let point = Point2::new(cos, sin) * (ring * view.tray.geometry.inner_radius_m);
            let pixel = view.pixel(point, view.tray.wall_top_m())?;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
            let (x, y) = (pixel.x.round() as u32, pixel.y.round() as u32);
            if let Some(pixel) = image.get_pixel_checked(x, y).filter(|_| pixel.x >= 0.0 && pixel.y >= 0.0) {
                sum += f32::from(pixel.0[0]);
                count += 1.0;
            }
        }
    }
    (count >= 0.5 * RINGS.len() as f32 * SPOKES as f32).then(|| sum / count)
}

fn lower_quartile_bin(histogram: &[u32]) -> Option<usize> {
    let total: u32 = histogram.iter().sum();
    let mut below = 0;
    (total > 0).then_some(())?;
    histogram.iter().position(|count| {
        below += count;
        4 * below >= total
    })
}
