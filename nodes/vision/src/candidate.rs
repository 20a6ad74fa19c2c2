//! Parts as a frame shows them.

use std::f64::consts::TAU;

use nalgebra::Point2;

use super::SelectorConfig;
use super::detector::{ALIKE_MIN, Detector, Found};
use super::health::FrameHealth;
use super::modes::{BLUR, BLUR_SPREAD_PX2, Light, SCALE, SCALE_SPREAD, darker, size_off};
use super::room::{Lying, Pictured, Room, measure_room};
use super::view::View;
use feeder_model::camera::{MountedTray, single};

/// How far into a wall a part that touches it may be measured, px.
const WALL_MISS_PX: f64 = 1.5;
/// How far beyond the edge of the plateau a part's outline may be measured for the part to lie on it, px.
const SECTOR_MISS_PX: f64 = 0.5;
/// A part seen larger or smaller than taught by more than this is another one, relative: sizes of a series differ by a tenth,
/// and no calibration that is of use errs by as much as half of that. Under other light a shaded rim looks as if it belonged
/// to the part: what all parts of a frame share of that may be more.
const SIZE_OFF_MAX: f32 = 0.045;
const SIZE_OFF_IN_COMPANY_MAX: f32 = 0.08;
/// What is seen darker than the part by more than this, relative, is no part: light falls on part and floor alike, so that it would be of
/// another material. Shadows that were taken for parts were seen 0.5 darker or more, parts 0.3 at most.
const DARKER_MAX: f32 = 0.4;
/// A part that differs from others of its pose in the frame by more than this, in spreads from part to part, is none of them; and one
/// alone from the part taught, as where it gleams or is of a lighter batch. Foreign things alone were kept out by other evidence: with 5.2
/// nine more nuts that gleam would be taken in one set of pictures, but two blanks of nuts among few parts.
const UNLIKE_MAX: f32 = 1.8;
const UNLIKE_ALONE_MAX: f32 = 3.8;
/// Share of the lead over another pose that a part must have of what its templates say. Seen of path-traced grommets and coins 0.66 and
/// more, of caps and brackets mostly so, and of coins with another figure, which lie between heads and tails, 0.5 at most.
const LEAD_SHARE_MIN: f32 = 0.55;
/// Share of the template's fine detail that a part must show. Seen of parts 0.63 and more, but for a few, and of blanks up to 0.5.
const DETAIL_SEEN_MIN: f32 = 0.55;
/// How high a part must seem by its shade, between half as high as its like in the frame, 0, and as high, 1. Seen of path-traced blocks,
/// grommets and coins 0.6 and more, but for some two of a thousand, and of blocks half as high 0.55 at most where lamps cast shadows.
const HEIGHT_SEEN_MIN: f32 = 0.6;
/// What seems to be seen in another light than its like in the frame by more than this, in spreads from part to part, is none of them;
/// what another pose explains nearly as well lies between two poses already, and may differ less. Seen of parts 3.1 and 1.9, but of
/// nuts of metal 5; of brackets' and caps' blanks 5 to 8, and of washers among grommets 2.8.
const UNLIKE_IN_LIGHT_MAX: f32 = 4.5;
const UNLIKE_IN_LIGHT_OF_TWO_POSES_MAX: f32 = 2.4;
/// Mean square miss of the template alone from which it does not hold, whatever the parts of the frame have in common: seen of parts
/// up to 1.7, in lights far from the one taught.
const ALONE_COST_MAX: f32 = 1.8;
/// Where at least so many things that may lie in one of two poses, and this share of them, looked as much like the other before the frame's
/// own light was known, or this share of what lies in a pose lies as well the other way round, the light does not tell these apart: what it
/// seems to tell of the rest is chance. Set by hand, on path-traced frames: where caps were taken for the other pose the first share was 0.43
/// and more, and with 0.35 as its limit clips were taken for others, or the other way round, where the second was 0.38 and more.
const ALIKE_COUNT_MIN: usize = 2;
const ALIKE_POSES_RATIO_MIN: f64 = 0.35;
const ALIKE_YAWS_RATIO_MIN: f64 = 0.38;
/// Where the templates say that the right pose must lead by more than this, the light tells them apart: what leads by next to nothing all
/// the same is neither. Seen of caps that were taken for others up to 0.3.
const ALIKE_LEAD_DUE_MAX: f32 = 0.45;
/// So many parts tell that parts look as taught: one alone may by chance.
const COMPANY_MIN: usize = 2;
/// A part must fit worse at another yaw by this share of what its template says: 0 for what looks the same at both, 1 for the part. Set by
/// hand: of path-traced things that lie otherwise, or are no part, all but one have 0.1 at most, of parts one in a hundred 0.2 to 0.3.
const YAW_LEAD_SHARE_MIN: f32 = 0.2;
/// What fits worse by less than this share counts among those that lie as well the other way round.
const YAW_TOLD_SHARE_MIN: f32 = 0.3;

/// Where a template leaves no more than this share of a part's contrast with bare floor unexplained, it need not stand out as it
/// did when taught: a correlation of 0.95 alone, and of 0.89 among its like, which tell of the light. The look-alikes under gleaming light
/// that were seen leave 0.15 and more: among parts other evidence refuses them.
const UNEXPLAINED_RATIO_MAX: f32 = 0.1;
const UNEXPLAINED_IN_COMPANY_RATIO_MAX: f32 = 0.2;
/// It must stand out as much as this, of what the middle one of its like in the frame does, if there are such: light lets all stand
/// out less. Seen of parts 0.9 to 1.15, but of nuts that gleam 0.5 and more, of a washer among nuts 0.5, and of a blank among blocks 0.71.
const AS_OTHERS_RATIO: f32 = 0.75;

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
    /// Place in the tray frame, m.
    #[must_use]
    pub fn centre(&self) -> Point2<f64> {
        Point2::new(self.x_m, self.y_m)
    }
}

/// What a frame shows, as it is judged.
pub(super) struct Judgement {
    pub candidates: Vec<Candidate>,
    /// The share that each of them has in what lies on the plateau.
    pub shares: Vec<f64>,
    /// The room round them.
    pub room: Room,
    pub health: FrameHealth,
    /// For each pose what three of four parts recognised in it miss by at least, of what they may; nothing where too few lie to tell.
    pub miss_ratios: Vec<Option<f64>>,
    /// The same of the parts recognised in any pose; nothing of fewer than two.
    pub miss_ratio: Option<f64>,
    /// For each pose, whether the light of the frame leaves it looking like another one, or the same the other way round.
    pub alike: Vec<bool>,
}

/// Judges what was found: what pose it is in, whether it lies on the plateau, and what room it has.
pub(super) fn judge(detector: &Detector, view: &View, config: &SelectorConfig, found: &[Found]) -> Judgement {
    let m_per_px = detector.camera.m_per_px(detector.tray.plateau_height_m());
    let mut candidates = Vec::with_capacity(found.len());
    let mut lying = Vec::with_capacity(found.len());
    let mut px = Vec::with_capacity(found.len());
    let recognition = Recognition::new(detector, config, found);
    for (part, is_known) in found.iter().zip(&recognition.known) {
        let (centre, yaw_rad) = (part.fit.centre, part.fit.yaw_rad);
        let outline = detector.outline(part.pose, centre, yaw_rad);
        let Some(wall_gap_m) = wall_gap_m(&outline, &detector.tray, m_per_px) else { continue };
        let confidence = if *is_known { confidence(detector, part, config) } else { 0.0 };
        let turns = detector.sought[part.pose].template.yaw_symmetry != 0;
        candidates.push(Candidate {
            x_m: centre.x,
            y_m: centre.y,
            yaw_rad: turns.then_some(yaw_rad),
            likeness: part.pose,
            pose: is_known.then_some(part.pose),
            confidence,
            part_gap_m: f64::INFINITY,
            wall_gap_m,
            on_plateau: is_on_plateau(&outline, &detector.tray, m_per_px),
        });
        px.push(part.px);
        let yaw_rad = if turns { yaw_rad } else { 0.0 };
        let pictured = Pictured::new(detector, view, part.pose, &part.fit);
        lying.push(Lying { pose: part.pose, centre, yaw_rad, outline, pictured });
    }
    let room = measure_room(detector, view, &lying);
    for (index, candidate) in candidates.iter_mut().enumerate() {
        candidate.part_gap_m = room.gap_m(index);
    }
    let health = health(detector, view, config, (found, &recognition), &candidates, &room);
    let covered_px = covered_px(found, &room).max(1) as f64;
    let shares = px.into_iter().map(|px| px as f64 / covered_px).collect();
    let Recognition { miss_ratios, miss_ratio, alike, .. } = recognition;
    Judgement { candidates, shares, room, health, miss_ratios, miss_ratio, alike }
}

/// Free gap from an outline to the nearer wall, m; nothing for one farther in a wall than is measured wrongly: a part cannot lie
/// there.
fn wall_gap_m(outline: &[Point2<f64>], tray: &MountedTray, m_per_px: f64) -> Option<f64> {
    let walls = &tray.geometry;
    let gap_m = |corner: &Point2<f64>| {
        let radius_m = corner.coords.norm();
        (walls.outer_radius_m - radius_m).min(radius_m - walls.inner_radius_m)
    };
    let gap_m = outline.iter().map(gap_m).fold(f64::INFINITY, f64::min);
    (gap_m >= -WALL_MISS_PX * m_per_px).then_some(gap_m)
}

/// Whether an outline lies wholly on the plateau, as well as that is measured.
fn is_on_plateau(outline: &[Point2<f64>], tray: &MountedTray, m_per_px: f64) -> bool {
    outline.iter().all(|corner| tray.inside_sector_m(*corner) >= -SECTOR_MISS_PX * m_per_px)
}

/// Pixels on which something lies.
fn covered_px(found: &[Found], room: &Room) -> usize {
    found.iter().map(|part| part.px).sum::<usize>() + room.own_px + room.foreign_px
}

/// What the frame is worth.
fn health(
    detector: &Detector,
    view: &View,
    config: &SelectorConfig,
    (found, recognition): (&[Found], &Recognition),
    candidates: &[Candidate],
    room: &Room,
) -> FrameHealth {
    let recognised = recognised(found, &recognition.known);
    let recognised_px: usize = recognised.iter().map(|part| part.px).sum();
    let (plateau_ratio, hub_ratio) = detector.light_ratios().unwrap_or((1.0, None));
    let covered_px = covered_px(found, room);
    let middle = |mode: usize, spread: f32| {
        let mut amounts: Vec<f32> = recognised.iter().map(|part| part.fit.amounts[mode] * spread).collect();
        amounts.sort_by(f32::total_cmp);
        amounts.get(amounts.len() / 2).map(|amount| f64::from(*amount))
    };
    let explained = if recognised.is_empty() { 0 } else { recognised_px + room.own_px };
    FrameHealth {
        in_view_ratio: in_view_ratio(detector),
        covered_ratio: covered_px as f64 / detector.plateau_px().max(1) as f64,
        explained_ratio: if covered_px == 0 { 1.0 } else { explained as f64 / covered_px as f64 },
        plateau_ratio,
        hub_ratio,
        light_change_ratio: detector.light_change(view),
        clipped_ratio: detector.segmentation.clipped_ratio,
        blur_excess_px2: middle(BLUR, 2.0 * BLUR_SPREAD_PX2),
        size_excess_ratio: middle(SCALE, SCALE_SPREAD),
        recognised: recognised.len(),
        miss_ratio: recognition.miss_ratios.iter().flatten().copied().fold(0.0, f64::max),
        beset_ratio: beset_ratio(candidates, room, config.part_clearance_m),
        looks_alike: recognition.alike.contains(&true),
    }
}

/// What three of four parts recognised in each pose miss by at least, of what they may; nothing where too few of it lie to tell.
fn miss_ratios(detector: &Detector, recognised: &[&Found]) -> Vec<Option<f64>> {
    let of_pose = |pose: usize| recognised.iter().copied().filter(|part| part.pose == pose).collect();
    (0..detector.sought.len()).map(|pose| miss_ratio(detector, of_pose(pose), ALIKE_MIN)).collect()
}

/// What three of four of these parts miss by at least, of what they may; nothing of fewer than so many. (Some may smear as they
/// move: light, lens and surface are the same for all.)
fn miss_ratio(detector: &Detector, parts: Vec<&Found>, count_min: usize) -> Option<f64> {
    let miss_ratio = |part: &Found| f64::from(part.fit.cost / detector.sought[part.pose].miss_max());
    let mut misses: Vec<f64> = parts.into_iter().map(miss_ratio).collect();
    misses.sort_by(f64::total_cmp);
    (misses.len() >= count_min).then(|| misses[misses.len() / 4])
}

/// Share of the parts recognised to which something that is nobody's leaves too little room; 0 where too few lie to tell.
fn beset_ratio(candidates: &[Candidate], room: &Room, clearance_m: f64) -> f64 {
    let gaps_m = candidates.iter().zip(&room.foreign_gaps_m).filter(|(candidate, _)| candidate.pose.is_some());
    let (beset, free): (Vec<f64>, Vec<f64>) = gaps_m.map(|(_, gap_m)| *gap_m).partition(|gap_m| *gap_m < clearance_m);
    let count = beset.len() + free.len();
    if count < ALIKE_MIN { 0.0 } else { beset.len() as f64 / count as f64 }
}

/// Share of the plateau that is in the picture, by the scale in its middle.
fn in_view_ratio(detector: &Detector) -> f64 {
    let tray = &detector.tray.geometry;
    let m_per_px = detector.camera.m_per_px(detector.tray.plateau_height_m());
    let seen_m2 = detector.plateau_px() as f64 * m_per_px.powi(2);
    let area_m2 = 0.5 * (TAU - tray.ramp_angle_rad) * (tray.outer_radius_m.powi(2) - tray.inner_radius_m.powi(2));
    (seen_m2 / area_m2).min(1.0)
}

/// What of the things found is recognised.
struct Recognition {
    /// For each thing.
    known: Vec<bool>,
    /// See the fields of [`Judgement`] of these names.
    miss_ratios: Vec<Option<f64>>,
    miss_ratio: Option<f64>,
    alike: Vec<bool>,
}

impl Recognition {
    fn new(detector: &Detector, config: &SelectorConfig, found: &[Found]) -> Self {
        let alike = looks_alike(detector, config, found);
        let is_known = |part: &Found| !alike[part.pose] && is_recognised(detector, part, config);
        let known: Vec<bool> = found.iter().map(is_known).collect();
        let recognised = recognised(found, &known);
        let miss_ratios = miss_ratios(detector, &recognised);
        let miss_ratio = miss_ratio(detector, recognised, COMPANY_MIN);
        Self { known, miss_ratios, miss_ratio, alike }
    }
}

/// Those of the things found that are recognised.
fn recognised<'a>(found: &'a [Found], known: &[bool]) -> Vec<&'a Found> {
    found.iter().zip(known).filter_map(|(part, is_known)| is_known.then_some(part)).collect()
}

/// See [`Judgement::alike`].
pub(super) fn looks_alike(detector: &Detector, config: &SelectorConfig, found: &[Found]) -> Vec<bool> {
    let lead_min = single(config.evidence_lead_min);
    let is_alike = |pose: usize| {
        let is = |part: &&Found| part.pose == pose;
        let of_two = |part: &&Found| part.rival.is_some_and(|(rival, _)| rival == pose || part.pose == pose);
        let untold =
            |part: &Found| part.first_lead < lead_min && part.lead_due.is_none_or(|due| due < ALIKE_LEAD_DUE_MAX);
        let poses = found.iter().filter(of_two).map(untold);
        let yaws = found.iter().filter(is).map(|part| !yaw_shows(part, YAW_TOLD_SHARE_MIN));
        many(poses, ALIKE_POSES_RATIO_MIN) || many(yaws, ALIKE_YAWS_RATIO_MIN)
    };
    (0..detector.sought.len()).map(|pose| detector.light == Light::Any && is_alike(pose)).collect()
}

/// Whether of things that each may be untold at least [`ALIKE_COUNT_MIN`] are, and this share.
fn many(untold: impl Iterator<Item = bool>, ratio_min: f64) -> bool {
    let untold: Vec<bool> = untold.collect();
    let count = untold.iter().filter(|untold| **untold).count();
    count >= ALIKE_COUNT_MIN && count as f64 >= ratio_min * untold.len() as f64
}

/// Whether a part fits worse by this share the other way round, and at any other yaw.
fn yaw_shows(part: &Found, share_min: f32) -> bool {
    [part.turned, part.yaw_lead].into_iter().flatten().all(|share| share >= share_min)
}

/// Whether a part looks as taught, in size too, and like nothing else.
pub(super) fn is_recognised(detector: &Detector, part: &Found, config: &SelectorConfig) -> bool {
    let miss_max = detector.sought[part.pose].miss_max();
    let shows_detail = part.detail_seen.is_none_or(|share| share >= DETAIL_SEEN_MIN);
    let is_high = part.height_seen.is_none_or(|height| height >= HEIGHT_SEEN_MIN);
    if part.fit.cost > miss_max || !yaw_shows(part, YAW_LEAD_SHARE_MIN) || !shows_detail || !is_high {
        return false;
    }
    let lead_min = single(config.evidence_lead_min);
    if detector.light == Light::Taught {
        return part.lead >= lead_min;
    }
    // Its like tell of the frame's own light: what it led by before that was known counts for one alone.
    let (first_lead_min, unlike_max, size_off_max, unexplained_max) = match part.evidence_ratio {
        Some(_) => (f32::NEG_INFINITY, UNLIKE_MAX, SIZE_OFF_IN_COMPANY_MAX, UNEXPLAINED_IN_COMPANY_RATIO_MAX),
        None => (lead_min, UNLIKE_ALONE_MAX, SIZE_OFF_MAX, UNEXPLAINED_RATIO_MAX),
    };
    let due = part.lead_due.map_or(lead_min, |due| lead_min.max(LEAD_SHARE_MIN * due));
    let led = part.first_lead >= first_lead_min && part.lead >= due && part.beside_lead >= lead_min;
    let amounts = &part.fit.amounts;
    let unlike_in_light_max =
        if part.lead_due.is_some() { UNLIKE_IN_LIGHT_OF_TWO_POSES_MAX } else { UNLIKE_IN_LIGHT_MAX };
    let lit = part.unlike_in_light <= unlike_in_light_max;
    let like = part.unlike <= unlike_max && size_off(amounts) <= size_off_max && darker(amounts) <= DARKER_MAX && lit;
    let as_others = part.evidence_ratio.is_none_or(|ratio| ratio >= AS_OTHERS_RATIO);
    let strong = part.evidence_per_texel >= detector.sought[part.pose].template.evidence_min
        || as_others && part.correlates(unexplained_max);
    led && like && strong && part.first_cost <= ALONE_COST_MAX
}

/// How sure the pose of a recognised part is: from one half at the least accepted to 1, with the match and, where its like do not tell of it,
/// with the lead over other explanations.
fn confidence(detector: &Detector, part: &Found, config: &SelectorConfig) -> f64 {
    let lead_min = single(config.evidence_lead_min);
    let miss_max = detector.sought[part.pose].miss_max();
    let matched = (miss_max - part.fit.cost) / (0.5 * miss_max);
    let led = if part.evidence_ratio.is_some() { 1.0 } else { (part.lead - lead_min) / lead_min };
    f64::from(0.5 + 0.5 * matched.min(led).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use feeder_model::tray::TrayGeometry;

    use super::*;

    const M_PER_PX: f64 = 0.0004;

    fn tray() -> MountedTray {
        MountedTray::new(TrayGeometry::PAPER)
    }

    /// A square of 4 mm about a place on the plateau, its sides along the radius and across it.
    fn square(radius_m: f64, angle_rad: f64) -> Vec<Point2<f64>> {
        let (sin, cos) = angle_rad.sin_cos();
        let corner = |out_m: f64, across_m: f64| {
            let (along, across) = (radius_m + out_m, across_m);
            Point2::new(along * cos - across * sin, along * sin + across * cos)
        };
        [(-0.002, -0.002), (0.002, -0.002), (0.002, 0.002), (-0.002, 0.002)].map(|(a, b)| corner(a, b)).to_vec()
    }

    #[test]
    fn the_gap_to_the_nearer_wall_is_that_of_the_nearest_corner_and_a_part_in_a_wall_is_none() {
        let gap_m = |radius_m: f64| wall_gap_m(&square(radius_m, 4.5), &tray(), M_PER_PX);
        // The corners of the outer side are farther out than its middle.
        assert!((gap_m(0.080).unwrap() - (0.090 - 0.082_f64.hypot(0.002))).abs() < 1e-12);
        // Those of the inner side too, which are all that is measured.
        assert!((gap_m(0.040).unwrap() - (0.038_f64.hypot(0.002) - 0.030)).abs() < 1e-12);
        // A pixel and a half is how far a part that touches may be measured in the wall.
        for (outer_m, is_part) in [(0.0905, true), (0.0907, false)] {
            assert_eq!(gap_m(outer_m - 0.002).is_some(), is_part, "{outer_m}");
        }
        for (inner_m, is_part) in [(0.0295, true), (0.0292, false)] {
            assert_eq!(gap_m(inner_m + 0.002).is_some(), is_part, "{inner_m}");
        }
    }

    #[test]
    fn a_part_lies_on_the_plateau_if_none_of_its_corners_is_beyond_an_edge_by_more_than_half_a_pixel() {
        // The plateau is the half of the tray from π to 2π; a square beside its end reaches beyond by so much.
        let beside = |end_rad: f64, beyond_m: f64| {
            let side = if end_rad > 4.0 { 1.0 } else { -1.0 };
            let middle = Point2::new(side * 0.06, -0.002 + beyond_m);
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let outline = corners.map(|(x, y)| Point2::new(middle.x + 0.002 * x, middle.y + 0.002 * y));
            is_on_plateau(&outline, &tray(), M_PER_PX)
        };
        for end_rad in [std::f64::consts::PI, std::f64::consts::TAU] {
            assert!(beside(end_rad, -0.01) && beside(end_rad, 0.00019), "{end_rad}");
            assert!(!beside(end_rad, 0.00021), "{end_rad}");
        }
    }

    #[test]
    fn few_parts_do_not_tell_whether_what_lies_beside_them_is_their_shadow() {
        let seen = |pose: Option<usize>| Candidate {
            x_m: 0.0,
            y_m: -0.06,
            yaw_rad: None,
            likeness: 0,
            pose,
            confidence: 1.0,
            part_gap_m: 0.01,
            wall_gap_m: 0.01,
            on_plateau: true,
        };
        // So many parts recognised have something beside them, and so many nothing; one that is not recognised counts for nothing.
        let share = |beset: usize, free: usize| {
            let foreign_gaps_m = [vec![0.000_5; beset], vec![0.005; free], vec![0.0]].concat();
            let mut candidates = vec![seen(Some(0)); beset + free];
            candidates.push(seen(None));
            let part_gaps_m = vec![f64::INFINITY; candidates.len()];
            let room = Room { part_gaps_m, foreign_gaps_m, own_px: 0, foreign_px: 0 };
            beset_ratio(&candidates, &room, 0.001)
        };
        assert!(share(3, 0) < 1e-9);
        assert!((share(4, 0) - 1.0).abs() < 1e-9);
        assert!((share(3, 1) - 0.75).abs() < 1e-9);
        assert!(share(0, 8) < 1e-9);
    }
}
