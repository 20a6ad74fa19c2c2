//! Whether the fine detail of a part is seen: a blank of its outline has the same edges, and misses nothing else by much.

use image::{ImageBuffer, Luma};
use imageproc::filter::gaussian_blur_f32;
use nalgebra::{Matrix5, Vector5};

use super::super::modes::Light;
use super::super::segment::Segmentation;
use super::super::sought::Sought;
use super::super::template::Plane;
use super::super::view::View;
use super::{Fit, Owners, residuals};
use feeder_model::camera::single;

/// Detail is what a blur of this standard deviation takes away, and lies so far within the outline that no blank has it, px.
const BLUR_PX: f64 = 2.0;
const WITHIN_PX: f64 = 1.5;
/// By how much slant, in the template's units (standard deviation), a part may seem to be seen otherwise than it is: what is taught
/// of tall parts seen far aslant misses by as much, and what that looks like tells no part from a blank. Set by hand: 0.2 to 0.5 serve
/// clips alike, which far from below the camera passed for blanks without it; other parts' detail tells as it did.
const SLANT_SIGMA: f32 = 0.3;
/// Where that and noise make the answer uncertain by more than this variance, it is none. In the light taught it must be surer. Set
/// by hand: with 0.05 there, clips passed for blanks; with 0.015, a path-traced blank of a cap for a cap.
const VARIANCE_MAX: f32 = 0.05;
const VARIANCE_IN_LIGHT_TAUGHT_MAX: f32 = 0.025;

/// How much of the template's detail a fit shows: 1 of the part, 0 of a blank. `None` where the template has too little to tell.
pub(in super::super) fn detail_seen(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    fit: &Fit,
    owners: &Owners,
) -> Option<f32> {
    let noise = frame.sigma * frame.sigma;
    // Without what the frame adds: where most are blanks, that is what they lack.
    let picture = sought.fitted(&sought.aspect(view, fit), &fit.amounts);
    let m_per_texel = sought.template.texel_m;
    let blurred = blurred(&picture, sought.template.side(), single(BLUR_PX * sought.m_per_px / m_per_texel))?;
    let outside_max_m = single(-WITHIN_PX * sought.m_per_px);
    let residuals = residuals(frame, view, sought, (fit, &picture), owners)?;
    let [slant_x, slant_y, ..] = sought.template.slant_planes().map(Plane::values);
    // Least squares of what is seen more, on brightness as a whole, on what the blur leaves, on detail, and on what slant adds.
    let (mut normal, mut target) = (Matrix5::zeros(), Vector5::zeros());
    for (index, residual) in sought.texels.iter().zip(residuals) {
        let Some(residual) = residual.filter(|_| sought.outside_m[*index] <= outside_max_m) else { continue };
        let (coarse, fine) = (blurred[*index], picture[*index] - blurred[*index]);
        let parts = Vector5::new(1.0, coarse, fine, slant_x[*index], slant_y[*index]);
        let weight = sought.texel_weight / (sought.variance(*index, owners.beside_sigma) + noise);
        normal += weight * parts * parts.transpose();
        target += weight * residual * parts;
    }
    for slant in [3, 4] {
        normal[(slant, slant)] += 1.0 / (SLANT_SIGMA * SLANT_SIGMA);
    }
    let inverse = normal.cholesky()?.inverse();
    let variance_max = match sought.light {
        Light::Taught => VARIANCE_IN_LIGHT_TAUGHT_MAX,
        Light::Any => VARIANCE_MAX,
    };
    (inverse[(2, 2)] <= variance_max).then(|| 1.0 + (inverse * target)[2])
}

/// A square picture blurred by a Gaussian of this standard deviation, texels.
fn blurred(picture: &[f32], side: usize, sigma: f32) -> Option<Vec<f32>> {
    let side = u32::try_from(side).ok()?;
    let picture: ImageBuffer<Luma<f32>, Vec<f32>> = ImageBuffer::from_raw(side, side, picture.to_vec())?;
    Some(gaussian_blur_f32(&picture, sigma).into_raw())
}
