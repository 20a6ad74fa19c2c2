//! What on the plateau is not plateau: background, foreground, blobs.

use image::GrayImage;
use nalgebra::{Point2, SMatrix, SVector};

use super::ImageFault;
use super::blobs::Blobs;
use super::view::{RayTable, View, Window};
use feeder_model::camera::single;

/// Smoothed grey levels are kept in sixteenths, as the 3x3 binomial filter yields them.
pub(super) const LEVELS: f32 = 16.0;
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
/// Foreground differs from background by more than this many standard deviations of the background.
const SIGMAS: f32 = 5.0;
/// Relative misses beyond which a pixel tells nothing of the walls' shade, from fit to fit; every so many pixels both ways one
/// takes part, and so many bins on both sides of one are taken together.
const SHADE_LIMITS: [f32; 2] = [0.15, 0.08];
const SHADE_STRIDE: usize = 2;
const SHADE_POOL: usize = 2;
/// Share of the plateau that must look as expected of the taught light; otherwise the light is found from the frame alone.
const EXPECTED_RATIO_MIN: f64 = 0.5;
/// Bins across the plateau's width for what the walls do to the light.
pub(super) const RADIAL_BINS: usize = 200;

/// Brightness is kept relative to the bare plateau's in full light, as the difference in these units.
pub(super) const RELATIVE_UNITS: f32 = 2048.0;
/// Inertia of the fit, in shares of the plateau: where little of the plateau is free, and that in the shade of parts, the
/// taught light counts.
const FIT_INERTIA: f32 = 0.5;

/// The light when a part was taught.
#[derive(Clone, Copy, Debug)]
pub(super) struct TaughtLight {
    /// Coefficients of 1, u, v, u², uv, v² of the plateau's grey level, with u and v from −1 to 1 across the picture.
    pub light: [f32; 6],
    /// Grey level of the hub's top.
    pub hub_level: f32,
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
    /// Tray frame, m.
    pub place: Point2<f64>,
    /// Brightness above the plateau's, relative to it.
    pub level: f32,
    /// Pixels that it stands for.
    pub px: usize,
}

/// A frame taken apart.
#[derive(Clone, Debug, Default)]
pub(super) struct Segmentation {
    pub window: Window,
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
    pub(super) fn look(
        &mut self,
        view: &View,
        rays: &RayTable,
        image: &GrayImage,
        plateau: &Plateau,
        contrast_min_levels: f64,
        blob_px_min: usize,
    ) -> Result<(), ImageFault> {
        self.window = view.plateau_window().ok_or(ImageFault::PlateauOutOfView)?;
        let geometry = &view.tray.geometry;
        let bin_m = (geometry.outer_radius_m - geometry.inner_radius_m) / RADIAL_BINS as f64;
        let window = self.window;
        self.bins.resize(window.len(), 0);
        self.shade.resize(window.len(), 1.0);
        self.outward.resize(window.len(), [0.0; 2]);
        self.smooth.resize(window.len(), 0);
        self.relative.resize(window.len(), 0);
        self.foreground.resize(window.len(), 0);
        let rows = self.bins.chunks_mut(window.width).zip(self.shade.chunks_mut(window.width));
        let rows = rows.zip(self.outward.chunks_mut(window.width));
        for (row, ((bins, shade), outward)) in rows.enumerate() {
            rays.plateau_row(view, window, row, bin_m, &plateau.shade, bins, shade, outward);
        }
        smooth(image, window, &mut self.smooth);
        let across = Across { width: image.width() as usize, height: image.height() as usize, window };
        // Parts hide the plateau, and shade what they leave of it, but not the hub.
        self.hub_level = hub_level(view, image);
        let expected = plateau.taught.map(|taught| {
            let change = self.hub_level.map_or(1.0, |level| level / taught.hub_level);
            taught.light.map(|coefficient| coefficient * change)
        });
        let (light, sigma_levels, clipped_ratio) = self.fit_light(&across, expected)?;
        self.clipped_ratio = clipped_ratio;
        self.light = light;
        self.sigma = sigma_levels / light[0].max(1.0);
        if plateau.taught.is_some() {
            self.follow_shade(&across, &light);
        }
        let threshold = single(contrast_min_levels).max(SIGMAS * sigma_levels);
        self.threshold = threshold / light[0].max(1.0);
        for row in 0..window.height {
            let range = row * window.width..(row + 1) * window.width;
            let outputs = self.relative[range.clone()].iter_mut().zip(&mut self.foreground[range.clone()]);
            let inputs = self.smooth[range.clone()].iter().zip(&self.bins[range.clone()]).zip(&self.shade[range]);
            let levels = across.light_row(&light, row);
            for (((relative, foreground), ((value, bin), shade)), level) in outputs.zip(inputs).zip(levels) {
                let on_plateau = f32::from(u8::from(*bin > 0));
                let value = f32::from(*value) * (1.0 / LEVELS);
                *foreground = u8::from((value - level * shade).abs() * on_plateau > threshold);
                let light = level.max(1.0);
                let ratio = ((value - light) * on_plateau / light * RELATIVE_UNITS).clamp(-32_000.0, 32_000.0);
                #[expect(clippy::cast_possible_truncation, reason = "clamped to i16")]
                let ratio = ratio as i16;
                *relative = ratio;
            }
        }
        self.blobs.drop_specks(&mut self.foreground, window.width, blob_px_min);
        Ok(())
    }

    /// Follows what the walls make of this frame's light where that differs from what was taught: for each radial bin a
    /// constant and a share by direction, fitted to what looks like plateau.
    fn follow_shade(&mut self, across: &Across, light: &[f32; 6]) {
        let width = self.window.width;
        for limit in SHADE_LIMITS {
            let mut sums = vec![PlateauSums::default(); RADIAL_BINS + 1];
            for row in (0..self.window.height).step_by(SHADE_STRIDE) {
                let levels = across.light_row(light, row);
                for (column, level) in levels.enumerate().step_by(SHADE_STRIDE) {
                    let index = row * width + column;
                    let bin = usize::from(self.bins[index]);
                    let miss = f32::from(self.smooth[index]) / (LEVELS * level.max(1.0)) - self.shade[index];
                    if bin > 0 && miss.abs() < limit {
                        let weight = f64::from(1.0 - (miss / limit).powi(2));
                        let [x, y] = self.outward[index].map(f64::from);
                        let basis = nalgebra::Vector3::new(1.0, x, y);
                        sums[bin].normal += basis * basis.transpose() * weight;
                        sums[bin].target += basis * (weight * f64::from(miss));
                    }
                }
            }
            let ridge = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(10.0, 30.0, 30.0));
            let change = |bin: usize| {
                let near = &sums[bin.saturating_sub(SHADE_POOL).max(1)..(bin + SHADE_POOL + 1).min(sums.len())];
                let mut pooled = PlateauSums { normal: ridge, ..PlateauSums::default() };
                for sums in near {
                    pooled.normal += sums.normal;
                    pooled.target += sums.target;
                }
                pooled.normal.cholesky().map_or([0.0; 3], |factors| factors.solve(&pooled.target).map(single).into())
            };
            let changes: Vec<[f32; 3]> = (0..sums.len()).map(change).collect();
            for ((shade, bin), [x, y]) in self.shade.iter_mut().zip(&self.bins).zip(&self.outward) {
                let [constant, per_x, per_y] = changes[usize::from(*bin).min(RADIAL_BINS)];
                *shade += constant + per_x * x + per_y * y;
            }
        }
    }

    /// The light, the standard deviation about it in grey levels, and the share of the plateau that is clipped.
    fn fit_light(&self, across: &Across, expected: Option<[f32; 6]>) -> Result<([f32; 6], f32, f64), ImageFault> {
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
            let mut normal = SMatrix::<f32, 6, 6>::zeros();
            let mut target = SVector::<f32, 6>::zeros();
            inliers = 0;
            for (basis, level) in &samples {
                let residual = level - evaluate(&quadratic, basis);
                if residual.abs() < *limit {
                    // Tukey's weight: what lies near the limit counts little.
                    let weight = 1.0 - (residual / limit) * (residual / limit);
                    for i in 0..6 {
                        target[i] += weight * basis[i] * residual;
                        for j in 0..=i {
                            normal[(i, j)] += weight * basis[i] * basis[j];
                        }
                    }
                    inliers += 1;
                }
            }
            for i in 0..6 {
                normal[(i, i)] += inertia * count as f32;
            }
            let change = normal.cholesky().ok_or(ImageFault::NoBackground)?.solve(&target);
            for (coefficient, change) in quadratic.iter_mut().zip(change.iter()) {
                *coefficient += change;
            }
        }
        if expected.is_some() && share(inliers) < EXPECTED_RATIO_MIN {
            let alone = self.fit_light(across, None);
            if alone.is_ok() {
                return alone;
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

    /// What is learned of the bare plateau from a frame, all of it or only further than `margin_px` from what stands out: for
    /// each radial bin the sums of 1, cos θ, sin θ and of their squares and products with the relative brightness are added
    /// to `sums`.
    pub(super) fn learn_plateau(&self, view: &View, margin_px: Option<usize>, sums: &mut [PlateauSums]) {
        let window = self.window;
        let yaw = view.platen_from_tray.rotation;
        let near = margin_px.map(|margin_px| self.near_foreground(margin_px));
        for (index, bin) in self.bins.iter().enumerate() {
            if *bin == 0 || near.as_ref().is_some_and(|near| near[index]) {
                continue;
            }
            let pixel =
                Point2::new((window.left + index % window.width) as f64, (window.top + index / window.width) as f64);
            let Some(point) = view.tray_point(pixel, view.tray.plateau_height_m()) else {
                continue;
            };
            let outward = yaw * point.coords.normalize();
            let basis = nalgebra::Vector3::new(1.0, outward.x, outward.y);
            let ratio = 1.0 + f64::from(self.relative[index]) / f64::from(RELATIVE_UNITS);
            let sums = &mut sums[usize::from(*bin)];
            sums.normal += basis * basis.transpose();
            sums.target += basis * ratio;
        }
    }

    /// The pixels within a square of foreground.
    fn near_foreground(&self, margin_px: usize) -> Vec<bool> {
        let width = self.window.width;
        let mut near = vec![false; self.foreground.len()];
        for index in (0..self.foreground.len()).filter(|index| self.foreground[*index] != 0) {
            let (row, column) = (index / width, index % width);
            for row in row.saturating_sub(margin_px)..(row + margin_px + 1).min(self.window.height) {
                let start = row * width;
                near[start + column.saturating_sub(margin_px)..start + (column + margin_px + 1).min(width)].fill(true);
            }
        }
        near
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
                        // At its ends a thing is blurred: it is as bright as what follows.
                        let near = place.max(start + 1) - 1..(place + 2).min(column);
                        let levels = near.map(|column| {
                            let index = row * width + column;
                            f32::from(self.relative[index]) / RELATIVE_UNITS - self.wall_shade(index)
                        });
                        let level = levels.fold(0.0_f32, |a, b| if b.abs() > a.abs() { b } else { a });
                        points.push(Uncovered { place: point, level, px: (place + 1).saturating_sub(counted) });
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

    /// Column and row of the pixel before a place of the window; `None` if that pixel or the next is nearer to the border
    /// than `margin` pixels.
    fn pixel_before(&self, x: f32, y: f32, margin: u8) -> Option<(usize, usize)> {
        let least = f32::from(margin);
        if !(x >= least && y >= least) {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not negative, and a cast saturates"
        )]
        let (column, row) = (x as usize, y as usize);
        let beyond = 1 + usize::from(margin);
        let inside =
            column.saturating_add(beyond) < self.window.width && row.saturating_add(beyond) < self.window.height;
        inside.then_some((column, row))
    }

    /// As [`Self::relative_at`], by straight lines between pixels.
    pub(super) fn relative_near(&self, x: f32, y: f32) -> Option<(f32, usize)> {
        let (column, row) = self.pixel_before(x, y, 0)?;
        let width = self.window.width;
        let index = row * width + column;
        let (across, down) = (x - column as f32, y - row as f32);
        let along = |index: usize| {
            let (left, right) = (f32::from(self.relative[index]), f32::from(self.relative[index + 1]));
            left + across * (right - left)
        };
        let (above, below) = (along(index), along(index + width));
        Some((above + down * (below - above), index))
    }

    /// Relative brightness at a place of the window, in its units, and the index of a pixel there; `None` off the window.
    /// Cubic convolution (Keys 1981, a = −½): between pixels, linear interpolation would miss an edge by several levels.
    pub(super) fn relative_at(&self, x: f32, y: f32) -> Option<(f32, usize)> {
        let (column, row) = self.pixel_before(x, y, 1)?;
        let across = cubic_weights(x - column as f32);
        let down = cubic_weights(y - row as f32);
        let first = (row - 1) * self.window.width + column - 1;
        let mut level = 0.0;
        for (line, weight) in down.into_iter().enumerate() {
            let start = first + line * self.window.width;
            let values = self.relative.get(start..start + 4)?;
            let along: f32 = values.iter().zip(across).map(|(value, weight)| f32::from(*value) * weight).sum();
            level += weight * along;
        }
        Some((level, row * self.window.width + column))
    }
}

/// Weights of four neighbours at a share of the way from the second to the third.
fn cubic_weights(share: f32) -> [f32; 4] {
    let t = share;
    [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (1.5 * t - 2.5),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (0.5 * t - 0.5),
    ]
}

/// Sums over a radial bin of a plateau without parts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PlateauSums {
    pub normal: nalgebra::Matrix3<f64>,
    pub target: nalgebra::Vector3<f64>,
}

/// Where a window's pixels lie across the picture, from −1 to 1.
struct Across {
    width: usize,
    height: usize,
    window: Window,
}

impl Across {
    fn u(&self, column: usize) -> f32 {
        (self.window.left + column) as f32 * 2.0 / self.width as f32 - 1.0
    }

    fn v(&self, row: usize) -> f32 {
        (self.window.top + row) as f32 * 2.0 / self.height as f32 - 1.0
    }

    /// The light along a row of the window.
    fn light_row(&self, light: &[f32; 6], row: usize) -> impl Iterator<Item = f32> + use<> {
        let [c, cu, cv, cuu, cuv, cvv] = *light;
        let v = self.v(row);
        let (constant, linear) = (c + cv * v + cvv * v * v, cu + cuv * v);
        let (start, step) = (self.u(0), 2.0 / self.width as f32);
        (0..self.window.width).map(move |column| {
            let u = start + column as f32 * step;
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
pub(super) fn hub_level(view: &View, image: &GrayImage) -> Option<f32> {
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
