//! The room round parts: how far it is from their outlines to each other, and to whatever else stands out from the plateau.

use nalgebra::Point2;

use super::candidate::Candidate;
use super::detector::Detector;
use super::modes::Light;
use super::segment::Uncovered;
use super::surround::DISTANCES;
use super::view::View;
use feeder_model::geometry::apart::{distance_m, gap_m};

/// Strip along the plateau's edges, px, where the walls' shade may pass for an obstacle and is not taken for one.
const EDGE_STRIP_PX: f64 = 4.0;
/// Gaps of more than this are not measured to the last: the distance between the circles round the outlines is enough, m.
const NEAR_M: f64 = 0.004;
/// How much brighter or darker than shade something must be to be no shade, beyond what makes it stand out: relative to the
/// plateau's brightness.
const OBSTACLE_TOLERANCE: f32 = 0.04;

/// Foreground that may be a part's own shade: the pixel of the window, its place, and the parts within whose reach it lies.
struct Shade {
    pixel: usize,
    place: Point2<f64>,
    near: Vec<usize>,
}

/// Free gaps between candidates, whose poses and outlines are given, and to whatever else stands out from the plateau. Returns
/// how many pixels of that are the parts' own, as their shade, and how many are not.
pub(super) fn measure_gaps(
    detector: &Detector,
    view: &View,
    outlines: &[(usize, Vec<Point2<f64>>)],
    candidates: &mut [Candidate],
) -> (usize, usize) {
    let reach_m = |pose: usize| detector.sought[pose].radius_m;
    let centres: Vec<Point2<f64>> = candidates.iter().map(Candidate::centre).collect();
    for (index, (pose, outline)) in outlines.iter().enumerate() {
        for (other, (other_pose, other_outline)) in outlines.iter().enumerate().skip(index + 1) {
            let circles_m = (centres[index] - centres[other]).norm() - reach_m(*pose) - reach_m(*other_pose);
            let gap_m = if circles_m > NEAR_M { circles_m } else { gap_m(outline, other_outline) };
            candidates[index].part_gap_m = candidates[index].part_gap_m.min(gap_m);
            candidates[other].part_gap_m = candidates[other].part_gap_m.min(gap_m);
        }
    }
    let keep_off = |place: &Point2<f64>, near: &[usize], candidates: &mut [Candidate]| {
        for index in near {
            let gap_m = distance_m(&outlines[*index].1, place);
            candidates[*index].part_gap_m = candidates[*index].part_gap_m.min(gap_m);
        }
    };
    let frame = &detector.segmentation;
    let tolerance = frame.threshold + OBSTACLE_TOLERANCE;
    let mut is_thing = vec![false; frame.window.len()];
    let mut shades: Vec<Shade> = Vec::new();
    let (mut own_px, mut foreign_px) = (0, 0);
    for Uncovered { pixel, place, level, px } in detector.uncovered(view, EDGE_STRIP_PX) {
        let reach_m = |pose: usize| reach_m(pose) + DISTANCES as f64 * detector.sought[pose].m_per_px;
        let is_near = |index: &usize| (centres[*index] - place).norm() < reach_m(outlines[*index].0).max(NEAR_M);
        let near: Vec<usize> = (0..outlines.len()).filter(is_near).collect();
        let range = |index: &usize| {
            let (pose, candidate) = (outlines[*index].0, &candidates[*index]);
            let lies = (centres[*index], candidate.yaw_rad.unwrap_or(0.0));
            detector.surrounds[pose].range(view, &detector.sought[pose], lies, place, detector.light.scatters())
        };
        // What is a part's own is in the way of none. Shades add up, where they are known exactly.
        let together = |(low, high): (f32, f32), (lower, higher): (f32, f32)| match detector.light {
            Light::Taught => (low + lower, high + higher),
            Light::Any => (low.min(lower), high.max(higher)),
        };
        let (low, high) = near.iter().map(range).fold((0.0, 0.0), together);
        if level < 0.0 && level >= low - tolerance || level >= 0.0 && level <= high + tolerance {
            own_px += px;
            shades.push(Shade { pixel, place, near });
        } else {
            foreign_px += px;
            is_thing[pixel] = true;
            keep_off(&place, &near, candidates);
        }
    }
    // The edge of a thing is blurred, and shaded, as a part's own is: what touches a thing may be part of it.
    for Shade { pixel, place, near } in &shades {
        if frame.window.about(*pixel).any(|touching| is_thing[touching]) {
            keep_off(place, near, candidates);
        }
    }
    (own_px, foreign_px)
}
