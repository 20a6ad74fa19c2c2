//! What the walls make of the light on the plateau.

use nalgebra::Point2;

use super::super::view::View;
use super::light::Across;
use super::{LEVELS, RADIAL_BINS, RELATIVE_UNITS, Segmentation};
use feeder_model::camera::single;

/// Relative misses beyond which a pixel tells nothing of the walls' shade, from fit to fit; every so many pixels both ways one
/// takes part, and so many bins on both sides of one are taken together.
const SHADE_LIMITS: [f32; 2] = [0.15, 0.08];
const SHADE_STRIDE: usize = 2;
const SHADE_POOL: usize = 2;

/// Sums over a radial bin of a plateau without parts.
#[derive(Clone, Copy, Debug, Default)]
pub(in super::super) struct PlateauSums {
    pub(in super::super) normal: nalgebra::Matrix3<f64>,
    pub(in super::super) target: nalgebra::Vector3<f64>,
}

impl Segmentation {
    /// Follows what the walls make of this frame's light where that differs from what was taught: for each radial bin a
    /// constant and a share by direction, fitted to what looks like plateau.
    pub(super) fn follow_shade(&mut self, across: &Across, light: &[f32; 6]) {
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

    /// What is learned of the bare plateau from a frame, all of it or only further than `margin_px` from what stands out: for
    /// each radial bin the sums of 1, cos θ, sin θ and of their squares and products with the relative brightness are added
    /// to `sums`.
    pub(in super::super) fn learn_plateau(&self, view: &View, margin_px: Option<usize>, sums: &mut [PlateauSums]) {
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
}
