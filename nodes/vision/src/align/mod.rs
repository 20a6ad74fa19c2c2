//! Lays a template over a frame, to a fraction of a pixel.

mod detail;
mod lead;

use nalgebra::{Point2, Rotation2, SMatrix, SVector, Vector2};

use super::modes::{self, Amounts, Belief, Light, LightAmounts, MODES, added};
use super::segment::{RELATIVE_UNITS, Segmentation};
use super::sought::{BARE_BRIGHT_SIGMA, BARE_DARK_SIGMA, BARE_PLAIN_SIGMA, CoarsePoint, Sought, Turn, gradient};
use super::template::Aspect;
use super::view::View;
pub(super) use detail::detail_seen;
use feeder_model::camera::single;
pub(super) use lead::{AtYaw, Laid, lead_due};

/// A texel that misses by more standard deviations counts no more than this many, and one beside the part that is darker
/// than expected no more than that many: a shadow may lie there.
const MISS_SIGMAS_MAX: f32 = 4.0;
const SHADOW_SIGMAS_MAX: f32 = 1.5;
/// Points compared at a glance.
const GLANCE_POINTS: usize = 32;
/// Steps of the fit at most.
const STEPS_MAX: usize = 8;
/// A step of a rough fit that leaves more of the miss than this is the last.
const STALLED_RATIO: f32 = 0.97;
/// How far the fit may lead from where it began, px, and by what share of a turn.
const DRIFT_PX_MAX: f64 = 3.0;
const DRIFT_RAD_MAX: f64 = 0.4;
/// Share of the template that must be seen.
const SEEN_MIN: f32 = 0.6;
/// Share of the normal matrix's diagonal added to it, so that what nothing tells about stays as it is.
const DAMPING: f32 = 1e-3;

/// Where and how a part may lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Place in the tray frame.
    pub centre: Point2<f64>,
    /// Yaw in the tray frame, rad.
    pub yaw_rad: f64,
    /// Mean square miss in standard deviations, capped per texel: at most about 1 where the template holds.
    pub cost: f32,
    /// Logarithm of how much likelier the part makes what is seen than bare floor in some shade does, summed over texels.
    pub evidence: f32,
    /// What light and lens have made of it.
    pub amounts: Amounts,
}

/// How likely a level is on bare floor: for bright and for dark ones one over the standard deviation, and the logarithm of
/// that.
#[derive(Clone, Copy)]
struct Bare {
    bright: (f32, f32),
    dark: (f32, f32),
    /// As it is where nothing shades it.
    plain: (f32, f32),
}

impl Bare {
    fn new(noise: f32) -> Self {
        let inverse = |sigma: f32| 1.0 / (sigma * sigma + noise).sqrt();
        let with_log = |sigma: f32| (inverse(sigma), inverse(sigma).ln());
        let plain = with_log(BARE_PLAIN_SIGMA);
        Self { bright: with_log(BARE_BRIGHT_SIGMA), dark: with_log(BARE_DARK_SIGMA), plain }
    }

    /// Logarithm of how much likelier a level is where a part misses it by `miss` of its standard deviations, capped, than on
    /// bare floor.
    fn outdone(self, level: f32, miss: f32, log_inverse_sigma: f32) -> f32 {
        let (bare_inverse_sigma, bare_log) = if level < 0.0 { self.dark } else { self.bright };
        let bare = (level * bare_inverse_sigma).clamp(-MISS_SIGMAS_MAX, MISS_SIGMAS_MAX);
        let (plain_inverse_sigma, plain_log) = self.plain;
        let plain = level * plain_inverse_sigma;
        let bare = (bare_log - 0.5 * bare * bare).max(plain_log - 0.5 * plain * plain);
        log_inverse_sigma - 0.5 * miss * miss - bare
    }
}

/// About the mean square miss of a turned part at a pixel of the window, by its first points; infinitely much where it is more
/// than `cost_max` or little is seen.
pub(super) fn glance(
    frame: &Segmentation,
    turn: &Turn,
    (column, row): (usize, usize),
    light: Option<&LightAmounts>,
    cost_max: f32,
) -> f32 {
    let points = &turn.points[..turn.points.len().min(GLANCE_POINTS)];
    coarse(frame, points, (column, row), light, CostMax { first: f32::INFINITY, all: cost_max })
}

/// Mean square misses beyond which it does not matter by how much.
#[derive(Clone, Copy)]
pub(super) struct CostMax {
    /// Of the first points.
    pub first: f32,
    /// Of all.
    pub all: f32,
}

/// Mean square miss of these points of a turned part at a pixel of the window; infinitely much where it is too much or too little
/// is seen.
#[inline]
pub(super) fn coarse(
    frame: &Segmentation,
    points: &[CoarsePoint],
    (column, row): (usize, usize),
    light: Option<&LightAmounts>,
    cost_max: CostMax,
) -> f32 {
    const FIRST: u16 = 24;
    let enough = cost_max.all * points.len() as f32;
    let (mut sum, mut seen) = (0.0, 0_u16);
    for point in points {
        let Some((level, index)) = at_pixel(frame, point, column, row) else {
            continue;
        };
        sum += miss(frame, point, light, level, index).powi(2);
        seen += 1;
        if sum > enough || (seen == FIRST && sum > cost_max.first * f32::from(FIRST)) {
            return f32::INFINITY;
        }
    }
    let seen = f32::from(seen);
    if seen < SEEN_MIN * points.len() as f32 { f32::INFINITY } else { sum / seen }
}

/// Evidence, as in [`Fit`], of a turned part at a pixel of the window.
pub(super) fn coarse_evidence(
    frame: &Segmentation,
    turn: &Turn,
    (column, row): (usize, usize),
    light: Option<&LightAmounts>,
) -> f32 {
    let bare = Bare::new(frame.sigma * frame.sigma);
    let seen = turn.points.iter().filter_map(|point| Some((point, at_pixel(frame, point, column, row)?)));
    let outdone = seen.map(|(point, (level, index))| {
        let miss = miss(frame, point, light, level, index);
        bare.outdone(level - frame.wall_shade(index), miss, point.log_inverse_sigma)
    });
    outdone.sum::<f32>() * turn.point_weight
}

/// Relative brightness at a point of a part whose centre is at a pixel of the window, and the index of the pixel
/// there; `None` off the plateau.
#[inline]
fn at_pixel(frame: &Segmentation, point: &CoarsePoint, column: usize, row: usize) -> Option<(f32, usize)> {
    let place =
        column.checked_add_signed(isize::from(point.column)).zip(row.checked_add_signed(isize::from(point.row)));
    let (column, row) = place.filter(|(column, row)| *column < frame.window.width && *row < frame.window.height)?;
    let index = row * frame.window.width + column;
    (frame.bins[index] != 0).then(|| (f32::from(frame.relative[index]) * (1.0 / RELATIVE_UNITS), index))
}

/// By how many standard deviations a level misses a point, capped.
#[inline]
fn miss(frame: &Segmentation, point: &CoarsePoint, light: Option<&LightAmounts>, level: f32, index: usize) -> f32 {
    let lit = light.map_or(0.0, |light| added(&point.effect, light));
    let value = point.value + lit + point.wall_shade * frame.wall_shade(index);
    ((level - value) * point.inverse_sigma).clamp(-MISS_SIGMAS_MAX, MISS_SIGMAS_MAX)
}

/// The owner of what lies off the plateau.
pub(super) const NO_PART: u16 = u16::MAX;

/// What of the frame belongs to other parts already.
pub(super) struct Owners<'a> {
    /// The owner of each pixel of the window: a part counted from 1, [`NO_PART`] off the plateau, 0 for none.
    pub of: &'a [u16],
    /// Who asks.
    pub own: u16,
    /// Scatter of what lies beside the part, relative to the plateau's brightness.
    pub beside_sigma: f32,
}

impl Owners<'_> {
    pub(super) fn taken(&self, index: usize) -> bool {
        let owner = self.of[index];
        owner != 0 && owner != self.own
    }
}

/// How finely a template is laid over a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fineness {
    /// To tell whether it is worth a closer look: by a share of the texels, between pixels by straight lines.
    Rough,
    /// As well as can be.
    Full,
    /// As well as can be, and where it is.
    Fixed,
}

impl Fineness {
    /// Every so many texels count.
    fn stride(self) -> usize {
        match self {
            Self::Rough => 4,
            Self::Full | Self::Fixed => 1,
        }
    }

    /// The step below which the fit is done, px.
    fn step_px_min(self) -> f64 {
        match self {
            Self::Rough => 0.2,
            Self::Full | Self::Fixed => 0.03,
        }
    }
}

/// A texel of the template as the fit uses it.
struct Probe<const UNKNOWNS: usize> {
    /// Place in the part's directions, m.
    place: Vector2<f64>,
    value: f32,
    /// How that changes with the yaw, 1/rad.
    turned: f32,
    /// Share of the walls' shade that lies on it.
    wall_shade: f32,
    inverse_sigma: f32,
    log_inverse_sigma: f32,
    /// Misses by being too dark, in standard deviations, count no more than this many.
    dark_max: f32,
    /// What light and lens may add.
    effect: Amounts,
    /// How the miss grows with a shift along x and y (1/px) and with a turn (1/rad), and falls with the amounts, over sigma.
    slope: SVector<f32, UNKNOWNS>,
}

/// What is fitted in the light taught: place and yaw; and in any: what light and lens have made of the picture too.
const PLACE_UNKNOWNS: usize = 3;
const ALL_UNKNOWNS: usize = PLACE_UNKNOWNS + MODES;

/// Fits a pose to a frame from a first guess: Gauss–Newton on place, yaw and modes, the picture's gradient taken at the guess
/// (the inverse compositional form of Lucas and Kanade: Baker and Matthews 2004, "Lucas-Kanade 20 years on"). Shading turns
/// against the part as the part turns, so that the template is a function of the yaw. `None` if it leads astray or too little
/// is seen.
pub(super) fn refine(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    start: Fit,
    owners: &Owners,
    belief: &Belief,
    fineness: Fineness,
) -> Option<Fit> {
    match sought.light {
        Light::Taught => laid::<PLACE_UNKNOWNS>(frame, view, sought, start, owners, belief, fineness),
        Light::Any => laid::<ALL_UNKNOWNS>(frame, view, sought, start, owners, belief, fineness),
    }
}

/// As [`refine`], with the first of all unknowns.
fn laid<const UNKNOWNS: usize>(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    start: Fit,
    owners: &Owners,
    belief: &Belief,
    fineness: Fineness,
) -> Option<Fit> {
    let modes = UNKNOWNS - PLACE_UNKNOWNS;
    // Yaws that look the same count as one.
    let aspect = sought.aspect(view, &start);
    let start = Fit { yaw_rad: aspect.yaw_rad - view.platen_from_tray.rotation.angle(), ..start };
    let noise = frame.sigma * frame.sigma;
    let probes: Vec<Probe<UNKNOWNS>> =
        probes(sought, &aspect, &start.amounts, noise, owners.beside_sigma, &belief.added, fineness);
    let bare = Bare::new(noise);
    let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
    let px_from_tray = view.px_from_tray(start.centre, sought.plane_m)?;
    let mut fit = start;
    let mut normal = None;
    let mut cost_before = f32::INFINITY;
    for step in 0..=STEPS_MAX {
        let pixel = view.pixel(fit.centre, sought.plane_m)? - corner;
        let px_from_part = (px_from_tray * Rotation2::new(fit.yaw_rad).matrix()).map(single);
        let pixel = pixel.map(single);
        let turned_rad = single(fit.yaw_rad - start.yaw_rad);
        let mut target = SVector::<f32, UNKNOWNS>::zeros();
        let (mut sum, mut evidence, mut seen) = (0.0_f32, 0.0_f32, 0_u16);
        let mut matrix = SMatrix::<f32, UNKNOWNS, UNKNOWNS>::zeros();
        for probe in &probes {
            let place = pixel + px_from_part * probe.place.map(single);
            let level_at = match fineness {
                Fineness::Rough => frame.relative_near(place.x, place.y),
                Fineness::Full | Fineness::Fixed => frame.relative_at(place.x, place.y),
            };
            let Some((level, index)) = level_at else {
                continue;
            };
            if owners.taken(index) {
                continue;
            }
            let level = level * (1.0 / RELATIVE_UNITS);
            let shade = frame.wall_shade(index);
            let lit = if modes > 0 { added(&probe.effect, &fit.amounts) } else { 0.0 };
            let value = probe.value + probe.turned * turned_rad + probe.wall_shade * shade + lit;
            let miss = (level - value) * probe.inverse_sigma;
            let miss = miss.clamp(-probe.dark_max, MISS_SIGMAS_MAX);
            evidence += bare.outdone(level - shade, miss, probe.log_inverse_sigma);
            sum += miss * miss;
            seen += 1;
            target += probe.slope * miss;
            if normal.is_none() {
                matrix += probe.slope * probe.slope.transpose();
            }
        }
        let seen = f32::from(seen);
        if seen < SEEN_MIN * probes.len() as f32 {
            return None;
        }
        fit.cost = sum / seen;
        let doubt: f32 = (0..modes)
            .map(|mode| 0.5 * ((fit.amounts[mode] - belief.middle[mode]) / belief.spread[mode]).powi(2))
            .sum();
        fit.evidence = evidence * sought.texel_weight * fineness.stride() as f32 - doubt;
        if step == STEPS_MAX
            || fineness == Fineness::Fixed
            || (fineness == Fineness::Rough && fit.cost > STALLED_RATIO * cost_before)
        {
            break;
        }
        cost_before = fit.cost;
        let factors = match normal {
            Some(factors) => factors,
            None => {
                for pose in 0..PLACE_UNKNOWNS {
                    matrix[(pose, pose)] += matrix[(pose, pose)].max(if pose == 2 { 1.0 } else { 0.0 }) * DAMPING;
                }
                // The spread of each mode is a belief about it.
                for (mode, spread) in belief.spread.iter().enumerate().take(modes) {
                    matrix[(PLACE_UNKNOWNS + mode, PLACE_UNKNOWNS + mode)] += 1.0 / (spread * spread);
                }
                *normal.insert(matrix.cholesky()?)
            }
        };
        for (mode, amount) in fit.amounts.iter().enumerate().take(modes) {
            target[PLACE_UNKNOWNS + mode] -= (amount - belief.middle[mode]) / belief.spread[mode].powi(2);
        }
        let change = factors.solve(&target);
        // The template moves by the inverse of what would bring it to the picture it shows.
        let moved = Vector2::new(change[0], change[1]).map(f64::from) * sought.m_per_px;
        fit.centre -= Rotation2::new(fit.yaw_rad) * moved;
        fit.yaw_rad -= f64::from(change[2]);
        for (mode, amount) in fit.amounts.iter_mut().enumerate().take(modes) {
            *amount = if mode == modes::SCALE {
                (*amount + change[PLACE_UNKNOWNS + mode]).clamp(-5.0, 5.0)
            } else {
                modes::clamped(*amount + change[PLACE_UNKNOWNS + mode])
            };
        }
        let drift_px = (fit.centre - start.centre).norm() / sought.m_per_px;
        if !(drift_px <= DRIFT_PX_MAX && (fit.yaw_rad - start.yaw_rad).abs() <= DRIFT_RAD_MAX) {
            return None;
        }
        let rim_px = (moved.norm() + f64::from(change[2]).abs() * sought.radius_m) / sought.m_per_px;
        if rim_px < fineness.step_px_min() {
            break;
        }
    }
    Some(fit)
}

/// By how much each texel that is compared is brighter than the picture as fitted; `None` where it is not seen.
pub(super) fn residuals(
    frame: &Segmentation,
    view: &View,
    sought: &Sought,
    (fit, picture): (&Fit, &[f32]),
    owners: &Owners,
) -> Option<Vec<Option<f32>>> {
    let aspect = sought.aspect(view, fit);
    let corner = Vector2::new(frame.window.left as f64, frame.window.top as f64);
    let pixel = view.pixel(fit.centre, sought.plane_m)? - corner;
    let turn = Rotation2::new(aspect.yaw_rad - view.platen_from_tray.rotation.angle());
    let px_from_part = view.px_from_tray(fit.centre, sought.plane_m)? * turn.matrix();
    let residual = |index: &usize| {
        let place = (pixel + px_from_part * sought.template.place_m(*index)).map(single);
        let (level, pixel) = frame.relative_at(place.x, place.y)?;
        if owners.taken(pixel) {
            return None;
        }
        let shade = sought.template.wall_shade.values()[*index] * frame.wall_shade(pixel);
        Some(level / RELATIVE_UNITS - picture[*index] - shade)
    };
    Some(sought.texels.iter().map(residual).collect())
}

/// By how many standard deviations a texel may miss by being too dark, as far as that counts.
fn dark_max(sought: &Sought, index: usize) -> f32 {
    if sought.inside[index] < 0.5 { SHADOW_SIGMAS_MAX } else { MISS_SIGMAS_MAX }
}

/// The template's texels under an aspect, as the fit uses them.
fn probes<const UNKNOWNS: usize>(
    sought: &Sought,
    aspect: &Aspect,
    amounts: &Amounts,
    noise: f32,
    beside_sigma: f32,
    added: &[f32],
    fineness: Fineness,
) -> Vec<Probe<UNKNOWNS>> {
    let turns = sought.template.yaw_symmetry != 0;
    let picture = sought.template.picture(aspect);
    let effects = sought.effects(&picture, aspect);
    // Edges are where the light begun with has them, and shades turn against the part. What blur and size do to edges is left out: it
    // is told by few texels, and led astray.
    let light = modes::of_other_lights(amounts);
    let lit = sought.lit(&picture, &effects, &light);
    let picture_change = turns.then(|| sought.lit_change(aspect, &lit, &light));
    let texels_per_px = single(sought.m_per_px / sought.template.texel_m);
    let probe = |index: usize| {
        let place = sought.template.place_m(index);
        let (along_x, along_y) = gradient(&lit, sought.template.side(), index);
        let inverse_sigma = 1.0 / (sought.variance(index, beside_sigma) + noise).sqrt();
        let (x, y) = (along_x * inverse_sigma * texels_per_px, along_y * inverse_sigma * texels_per_px);
        let turned = picture_change.as_ref().map_or(0.0, |change| change[index]);
        let place_px = (place / sought.m_per_px).map(single);
        let turning = if turns { y * place_px.x - x * place_px.y - turned * inverse_sigma } else { 0.0 };
        let effect = effects.at(index);
        let mut slope = SVector::<f32, UNKNOWNS>::zeros();
        slope.fixed_rows_mut::<3>(0).copy_from_slice(&[x, y, turning]);
        slope.iter_mut().skip(PLACE_UNKNOWNS).zip(effect).for_each(|(slope, effect)| *slope = effect * inverse_sigma);
        Probe {
            place,
            value: picture[index] + added.get(index).copied().unwrap_or(0.0),
            turned,
            wall_shade: sought.template.wall_shade.values()[index],
            inverse_sigma,
            log_inverse_sigma: inverse_sigma.ln(),
            dark_max: dark_max(sought, index),
            effect,
            slope,
        }
    };
    sought.texels.iter().step_by(fineness.stride()).map(|index| probe(*index)).collect()
}
