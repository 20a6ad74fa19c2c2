//! What tells a part from things that look much like it: from itself at another yaw, and from a blank of its shape.

use nalgebra::{Rotation2, Vector2};

use super::align::{Belief, Fit, MISS_SIGMAS_MAX, Owners};
use super::modes::added;
use super::segment::{RELATIVE_UNITS, Segmentation};
use super::sought::Sought;
use super::template::{Aspect, period_rad};
use super::view::View;
use feeder_model::camera::single;

/// A part whose picture changes by less than this mean square when it is turned, in standard deviations, looks round.
const TURNED_MIN: f32 = 0.1;
/// Neighbouring pixels miss alike, by what lens, JPEG and template do to them: so many count as one.
const ALIKE_PX: f32 = 4.0;
/// A share of the figure is told where its standard deviation is below this: half way between a part and a blank lies then two
/// of them from both.
const FIGURE_SIGMA_MAX: f32 = 0.25;

/// A texel that is compared, as it is seen after a fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenTexel {
    /// Brightness that template and modes tell, relative to the plateau's.
    expected: f32,
    /// By how much it is brighter than that.
    pub brighter: f32,
}

/// How much worse a part fits at another yaw, as a share of what the template says it must: about 1 for the part at its own
/// yaw, and 0 for something that looks the same at both, or lies between them. `None` where the template does not tell.
///
/// `other` is what was fitted there; nothing but the yaw of it counts if it is to be looked at as it is.
pub(super) fn yaw_lead_share(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    (fit, other): (&Fit, &Fit),
    owners: &Owners,
    belief: &Belief,
) -> Option<f32> {
    let period_rad = period_rad(sought.template.yaw_symmetry);
    if period_rad <= 0.0 {
        return None;
    }
    let noise = frame.sigma * frame.sigma;
    let slant = view.slant(fit.centre, sought.plane_m);
    let tray_yaw_rad = view.platen_from_tray.rotation.angle();
    let picture = |fit: &Fit| {
        let yaw_rad = (fit.yaw_rad + tray_yaw_rad).rem_euclid(period_rad);
        sought.template.picture(&Aspect { yaw_rad, slant })
    };
    let (here, there) = (picture(fit), picture(other));
    let level = |picture: &[f32], index: usize| {
        picture[index] + belief.added.get(index).copied().unwrap_or(0.0) + added(&sought.effects[index], &fit.amounts)
    };
    let turn = Rotation2::new(fit.yaw_rad - other.yaw_rad);
    let (mut expected, mut count) = (0.0, 0.0_f32);
    for index in &sought.texels {
        let Some(turned) = sought.texel(turn * sought.template.place_m(*index)) else { continue };
        let difference = level(&here, *index) - level(&there, turned);
        let square = difference * difference / (sought.variance(*index, owners.beside_sigma) + noise);
        expected += square.min(MISS_SIGMAS_MAX * MISS_SIGMAS_MAX);
        count += 1.0;
    }
    expected /= count.max(1.0);
    (expected >= TURNED_MIN).then(|| (other.cost - fit.cost) / expected)
}

/// What is seen of a part's figure: of how its brightness differs from place to place well within the outline. About 1 for the
/// part, and 0 for a blank of its shape that is equally bright all over; how bright does not matter. `None` where the part has
/// no figure, or noise hides it.
pub(super) fn figure_share(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    fit: &Fit,
    owners: &Owners,
    belief: &Belief,
) -> Option<f32> {
    let noise = frame.sigma * frame.sigma;
    let texels = seen_texels(frame, view, sought, fit, owners)?;
    let inner: Vec<(f32, f32, f32)> = sought
        .texels
        .iter()
        .zip(&texels)
        .filter(|(index, _)| sought.inside[**index] >= 1.0)
        .filter_map(|(index, seen)| {
            let SeenTexel { expected, brighter } = (*seen)?;
            let added = belief.added.get(*index).copied().unwrap_or(0.0);
            let weight = 1.0 / (sought.variance(*index, owners.beside_sigma) + noise);
            Some((weight, expected + added, brighter - added))
        })
        .collect();
    let (weights, sum) = inner
        .iter()
        .fold((0.0, 0.0), |(weights, sum), (weight, expected, _)| (weights + weight, sum + weight * expected));
    let blank = sum / weights;
    // Of the figure, and of what differs from it, along the figure.
    let (square, along) = inner.iter().fold((0.0, 0.0), |(square, along), (weight, expected, brighter)| {
        let figure = expected - blank;
        (square + weight * figure * figure, along + weight * figure * brighter)
    });
    let px_of_texel = sought.texel_weight * single(sought.template.texel_m / sought.m_per_px).powi(2);
    let told = square * px_of_texel >= ALIKE_PX / (FIGURE_SIGMA_MAX * FIGURE_SIGMA_MAX);
    told.then(|| 1.0 + along / square)
}

/// The texels that are compared, as they are seen after a fit; `None` where one is not seen.
pub(super) fn seen_texels(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    fit: &Fit,
    owners: &Owners,
) -> Option<Vec<Option<SeenTexel>>> {
    let tray_yaw_rad = view.platen_from_tray.rotation.angle();
    let period_rad = period_rad(sought.template.yaw_symmetry);
    let on_platen_rad = fit.yaw_rad + tray_yaw_rad;
    let folded_rad = if period_rad > 0.0 { on_platen_rad.rem_euclid(period_rad) } else { 0.0 };
    let aspect = Aspect { yaw_rad: folded_rad, slant: view.slant(fit.centre, sought.plane_m) };
    let picture = sought.template.picture(&aspect);
    let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
    let pixel = view.pixel(fit.centre, sought.plane_m)? - corner;
    let turn = Rotation2::new(folded_rad - tray_yaw_rad);
    let px_from_part = view.px_from_tray(fit.centre, sought.plane_m)? * turn.matrix();
    let seen = |index: &usize| {
        let place = (pixel + px_from_part * sought.template.place_m(*index)).map(single);
        let (level, pixel) = frame.relative_at(place.x, place.y)?;
        if owners.taken(pixel) {
            return None;
        }
        let shade = sought.template.wall_shade.values()[*index] * frame.wall_shade(pixel);
        let expected = picture[*index] + added(&sought.effects[*index], &fit.amounts);
        Some(SeenTexel { expected, brighter: level / RELATIVE_UNITS - expected - shade })
    };
    Some(sought.texels.iter().map(seen).collect())
}
