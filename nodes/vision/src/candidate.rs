//! Parts as a frame shows them.

use nalgebra::Point2;

use super::SelectorConfig;
use super::detector::{Detector, Found};
use super::health::FrameHealth;
use super::modes::{BLUR, BLUR_SPREAD_PX2, Light, SCALE, SCALE_SPREAD, size_off};
use super::room::measure_gaps;
use super::view::View;
use feeder_model::camera::single;

/// How far into a wall a part that touches it may be measured, px.
const WALL_MISS_PX: f64 = 1.5;
/// How far beyond the edge of the plateau a part's outline may be measured for the part to lie on it, px.
const SECTOR_MISS_PX: f64 = 0.5;
/// A part seen larger or smaller than taught by more than this is another one, relative: sizes of a series differ by a tenth,
/// and no calibration that is of use errs by as much as half of that. Under other light a shaded rim looks as if it belonged
/// to the part: what all parts of a frame share of that may be more.
const SIZE_OFF_MAX: f32 = 0.045;
const SIZE_OFF_IN_COMPANY_MAX: f32 = 0.08;
/// A part that differs from others of its pose in the frame by more than this, in spreads from part to part, is none of them.
const UNLIKE_MAX: f32 = 1.9;
/// Share of the others' lead over other explanations that a part must have to be one of them, and by how much more it is sure.
const LEAD_RATIO_MIN: f32 = 0.4;
const LEAD_RATIO_SURE: f32 = 0.25;
/// Mean square miss of the template alone from which it does not hold, whatever the parts of the frame have in common: it
/// is about 1 at most where it does.
const ALONE_COST_MAX: f32 = 1.25;
/// A part must fit worse at another yaw by this share of what its template says: half way between 0 for what looks the same at
/// both and what blunt edges leave of 1.
const YAW_LEAD_SHARE_MIN: f32 = 0.3;
/// So much of a part's figure must be seen: half way between the part and a blank.
const FIGURE_SHARE_MIN: f32 = 0.5;

/// A part as one frame shows it, in the tray frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Place, x, m.
    pub x_m: f64,
    /// Place, y, m.
    pub y_m: f64,
    /// Yaw, rad, of the taught pose that it looks most like; `None` if that looks the same from all sides.
    pub yaw_rad: Option<f64>,
    /// The taught pose that it looks most like.
    pub likeness: usize,
    /// Resting pose; `None` if that is not sure.
    pub pose: Option<usize>,
    /// How sure the pose is, 0 to 1.
    pub confidence: f64,
    /// Free gap to the nearest other thing seen on the plateau, m.
    pub part_gap_m: f64,
    /// Free gap to the nearer wall, m; about 0 for a part that touches.
    pub wall_gap_m: f64,
    /// Whether its whole outline lies within the plateau sector.
    pub on_plateau: bool,
}

impl Candidate {
    /// Free gap to the nearest other thing or wall, m.
    #[must_use]
    pub fn isolation_m(&self) -> f64 {
        self.part_gap_m.min(self.wall_gap_m)
    }

    /// Place in the tray frame, m.
    #[must_use]
    pub fn centre(&self) -> Point2<f64> {
        Point2::new(self.x_m, self.y_m)
    }
}

/// Judges what was found: what pose it is in, whether it lies on the plateau, and what room it has.
pub(super) fn judge(
    detector: &Detector,
    view: &View,
    config: &SelectorConfig,
    found: &[Found],
) -> (Vec<Candidate>, FrameHealth) {
    let m_per_px = detector.camera.m_per_px(detector.tray.plateau_height_m());
    let geometry = &detector.tray.geometry;
    let mut candidates = Vec::with_capacity(found.len());
    let mut outlines = Vec::with_capacity(found.len());
    for part in found {
        let outline = detector.outline(part.pose, part.fit.centre, part.fit.yaw_rad);
        let wall_gap_m = outline
            .iter()
            .map(|corner| {
                (geometry.outer_radius_m - corner.coords.norm()).min(corner.coords.norm() - geometry.inner_radius_m)
            })
            .fold(f64::INFINITY, f64::min);
        // A part cannot lie in a wall.
        if wall_gap_m < -WALL_MISS_PX * m_per_px {
            continue;
        }
        let beyond_m =
            outline.iter().map(|corner| detector.tray.inside_sector_m(*corner)).fold(f64::INFINITY, f64::min);
        let (pose, confidence) = recognise(detector, part, config);
        candidates.push(Candidate {
            x_m: part.fit.centre.x,
            y_m: part.fit.centre.y,
            yaw_rad: (detector.sought[part.pose].template.yaw_symmetry != 0).then_some(part.fit.yaw_rad),
            likeness: part.pose,
            pose,
            confidence,
            part_gap_m: f64::INFINITY,
            wall_gap_m,
            on_plateau: beyond_m >= -SECTOR_MISS_PX * m_per_px,
        });
        outlines.push((part.pose, outline));
    }
    let (own_px, foreign_px) = measure_gaps(detector, view, &outlines, &mut candidates);
    (candidates, health(detector, view, config, found, own_px, foreign_px))
}

/// What the frame is worth, of whose uncovered foreground `own_px` belong to parts as their shade and `foreign_px` do not.
fn health(
    detector: &Detector,
    view: &View,
    config: &SelectorConfig,
    found: &[Found],
    own_px: usize,
    foreign_px: usize,
) -> FrameHealth {
    let recognised: Vec<&Found> = found.iter().filter(|part| is_recognised(detector, part, config)).collect();
    let part_px: usize = found.iter().map(|part| part.px).sum();
    let recognised_px: usize = recognised.iter().map(|part| part.px).sum();
    let (plateau_ratio, hub_ratio) = detector.light_ratios().unwrap_or((1.0, None));
    let covered_px = part_px + own_px + foreign_px;
    let middle = |mode: usize, spread: f32| {
        let mut amounts: Vec<f32> = recognised.iter().map(|part| part.fit.amounts[mode] * spread).collect();
        amounts.sort_by(f32::total_cmp);
        amounts.get(amounts.len() / 2).map(|amount| f64::from(*amount))
    };
    let explained = if recognised.is_empty() { 0 } else { recognised_px + own_px };
    FrameHealth {
        covered_ratio: covered_px as f64 / detector.plateau_px().max(1) as f64,
        explained_ratio: if covered_px == 0 { 1.0 } else { explained as f64 / covered_px as f64 },
        plateau_ratio,
        hub_ratio,
        light_change_ratio: detector.light_change(view),
        clipped_ratio: detector.segmentation.clipped_ratio,
        blur_excess_px2: middle(BLUR, 2.0 * BLUR_SPREAD_PX2),
        size_excess_ratio: middle(SCALE, SCALE_SPREAD),
        recognised: recognised.len(),
    }
}

/// Whether a part looks as taught, in size too, and like nothing else.
fn is_recognised(detector: &Detector, part: &Found, config: &SelectorConfig) -> bool {
    let miss_max = detector.sought[part.pose].template.miss_max + detector.sought[part.pose].noise_miss;
    let yaw_shows = [part.turned, part.yaw_lead].into_iter().flatten().all(|share| share >= YAW_LEAD_SHARE_MIN);
    let figure_shows = part.figure.is_none_or(|share| share >= FIGURE_SHARE_MIN);
    if part.fit.cost > miss_max || !yaw_shows || !figure_shows {
        return false;
    }
    if detector.light == Light::Taught {
        return part.lead >= single(config.evidence_lead_min);
    }
    let led = part.lead_ratio.map_or(part.lead >= single(config.evidence_lead_min), |ratio| ratio >= LEAD_RATIO_MIN);
    let size_off_max = if part.in_company { SIZE_OFF_IN_COMPANY_MAX } else { SIZE_OFF_MAX };
    let like = part.unlike <= UNLIKE_MAX && size_off(&part.fit.amounts) <= size_off_max && !part.weak;
    let strong = part.evidence_per_texel >= detector.sought[part.pose].template.evidence_min;
    led && like && strong && part.first_cost <= ALONE_COST_MAX
}

/// The pose, and how sure it is: from one half at the least accepted to 1, with the match and with the lead over other
/// explanations.
fn recognise(detector: &Detector, part: &Found, config: &SelectorConfig) -> (Option<usize>, f64) {
    let lead_min = single(config.evidence_lead_min);
    let miss_max = detector.sought[part.pose].template.miss_max + detector.sought[part.pose].noise_miss;
    if !is_recognised(detector, part, config) {
        return (None, 0.0);
    }
    let matched = (miss_max - part.fit.cost) / (0.5 * miss_max);
    let led =
        part.lead_ratio.map_or((part.lead - lead_min) / lead_min, |ratio| (ratio - LEAD_RATIO_MIN) / LEAD_RATIO_SURE);
    (Some(part.pose), f64::from(0.5 + 0.5 * matched.min(led).clamp(0.0, 1.0)))
}
