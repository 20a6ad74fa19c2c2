//! Parts as a frame shows them, and the room round them.

use nalgebra::Point2;

use super::SelectorConfig;
use super::detector::{Detector, Found};
use super::hull::{distance_m, gap_m};
use super::view::View;
use feeder_model::camera::single;

/// Strip along the plateau's edges, px, where the walls' shade may pass for an obstacle and is not taken for one.
pub(super) const EDGE_STRIP_PX: f64 = 4.0;
/// How far into a wall a part that touches it may be measured, px.
const WALL_MISS_PX: f64 = 1.5;
/// How far beyond the edge of the plateau a part's outline may be measured for the part to lie on it, px.
const SECTOR_MISS_PX: f64 = 0.5;
/// Gaps of more than this are not measured to the last: the distance between the circles round the outlines is enough, m.
const NEAR_M: f64 = 0.004;

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
pub(super) fn judge(detector: &Detector, view: &View, config: &SelectorConfig, found: &[Found]) -> Vec<Candidate> {
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
        let miss_max = detector.sought[part.pose].template.miss_max + detector.sought[part.pose].noise_miss;
        let (pose, confidence) = recognise(part, miss_max, config);
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
    measure_gaps(detector, view, &outlines, &mut candidates);
    candidates
}

/// The pose, and how sure it is: from one half at the least accepted to 1, with the match and with the lead over other
/// explanations.
fn recognise(part: &Found, miss_max: f32, config: &SelectorConfig) -> (Option<usize>, f64) {
    let lead_min = single(config.evidence_lead_min);
    if part.fit.cost > miss_max || part.lead < lead_min {
        return (None, 0.0);
    }
    let matched = (miss_max - part.fit.cost) / (0.5 * miss_max);
    let led = (part.lead - lead_min) / lead_min;
    (Some(part.pose), f64::from(0.5 + 0.5 * matched.min(led).clamp(0.0, 1.0)))
}

/// Free gaps between candidates and to whatever else stands out from the plateau.
fn measure_gaps(
    detector: &Detector,
    view: &View,
    outlines: &[(usize, Vec<Point2<f64>>)],
    candidates: &mut [Candidate],
) {
    let reach_m = |pose: usize| detector.sought[pose].radius_m;
    let shade_m = |pose: usize| detector.sought[pose].template.shade_reach_m;
    let centres: Vec<Point2<f64>> = candidates.iter().map(Candidate::centre).collect();
    for (index, (pose, outline)) in outlines.iter().enumerate() {
        for (other, (other_pose, other_outline)) in outlines.iter().enumerate().skip(index + 1) {
            let circles_m = (centres[index] - centres[other]).norm() - reach_m(*pose) - reach_m(*other_pose);
            let gap_m = if circles_m > NEAR_M { circles_m } else { gap_m(outline, other_outline) };
            candidates[index].part_gap_m = candidates[index].part_gap_m.min(gap_m);
            candidates[other].part_gap_m = candidates[other].part_gap_m.min(gap_m);
        }
    }
    for obstacle in detector.unexplained(view, EDGE_STRIP_PX) {
        let near: Vec<(usize, f64)> = outlines
            .iter()
            .enumerate()
            .filter(|(index, (pose, _))| (centres[*index] - obstacle).norm() < reach_m(*pose) + shade_m(*pose) + NEAR_M)
            .map(|(index, (pose, outline))| (index, distance_m(outline, &obstacle) - shade_m(*pose)))
            .collect();
        // Within a part's own shade nothing else can be told.
        if near.iter().any(|(_, beyond_m)| *beyond_m <= 0.0) {
            continue;
        }
        // What begins in the shade shows only where that ends: gaps are counted from there.
        for (index, beyond_m) in near {
            candidates[index].part_gap_m = candidates[index].part_gap_m.min(beyond_m);
        }
    }
}
