//! The room round parts: how far it is from their outlines to each other, and to whatever else stands out from the plateau.

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};

use super::align::Fit;
use super::detector::Detector;
use super::modes::{Light, not_darker_beside};
use super::segment::Uncovered;
use super::sought::Sought;
use super::surround::DISTANCES;
use super::view::View;
use feeder_model::geometry::apart::{distance_m, gap_m};

/// Strip along the plateau's edges, px, where the walls' shade may pass for an obstacle and is not taken for one.
const EDGE_STRIP_PX: f64 = 4.0;
/// Gaps of more than this are not measured to the last: the distance between the circles round the outlines is enough, m.
const NEAR_M: f64 = 0.004;
/// How much brighter or darker than shade something must be to be no shade, beyond what makes it stand out: relative to the
/// plateau's brightness.
const OBSTACLE_TOLERANCE: f32 = 0.02;

/// Foreground that may be a part's own shade: the pixel of the window, its place, and the parts within whose reach it lies.
struct Shade {
    pixel: usize,
    place: Point2<f64>,
    near: Vec<usize>,
}

/// The room round parts, and what stands out from the plateau and is covered by none of them.
pub(super) struct Room {
    /// For each part the free gap to the nearest other one, and to what stands out and is nobody's, m.
    pub part_gaps_m: Vec<f64>,
    pub foreign_gaps_m: Vec<f64>,
    /// Pixels of what stands out that are the parts' own, as their shade, and those that are not.
    pub own_px: usize,
    pub foreign_px: usize,
}

impl Room {
    /// Free gap round a part, m.
    pub(super) fn gap_m(&self, part: usize) -> f64 {
        self.part_gaps_m[part].min(self.foreign_gaps_m[part])
    }
}

/// Where a part lies: its pose, place, yaw and outline, tray frame.
pub(super) struct Lying {
    pub pose: usize,
    pub centre: Point2<f64>,
    pub yaw_rad: f64,
    pub outline: Vec<Point2<f64>>,
    /// How it was seen; nothing out of the camera's sight.
    pub pictured: Option<Pictured>,
}

/// A part's picture as it was fitted, laid over the window: beside the outline it tells the part's own walls and shadow. That all round
/// it is darker is not believed, for that a thing beside it may have told.
pub(super) struct Pictured {
    picture: Vec<f32>,
    middle: Point2<f64>,
    part_from_px: Matrix2<f64>,
}

impl Pictured {
    /// `None` where the place is out of the camera's sight.
    pub(super) fn new(detector: &Detector, view: &View, pose: usize, fit: &Fit) -> Option<Self> {
        let sought = &detector.sought[pose];
        let window = detector.segmentation.window;
        let aspect = sought.aspect(view, fit);
        let turn = Rotation2::new(view.platen_from_tray.rotation.angle() - aspect.yaw_rad);
        let tray_from_px = view.px_from_tray(fit.centre, sought.plane_m)?.try_inverse()?;
        Some(Self {
            picture: sought.fitted(&aspect, &not_darker_beside(&fit.amounts)),
            middle: view.pixel(fit.centre, sought.plane_m)? - Vector2::new(window.left as f64, window.top as f64),
            part_from_px: turn.matrix() * tray_from_px,
        })
    }

    /// How dark and how bright it is at a pixel of the window and so far beside, relative to the plateau. Beyond the picture the
    /// plateau is bare.
    fn range(&self, sought: &Sought, (column, row): (usize, usize), beside_px: &[f64]) -> (f32, f32) {
        let around = beside_px.iter().flat_map(|down| beside_px.iter().map(move |right| Vector2::new(*right, *down)));
        let from_middle = Point2::new(column as f64, row as f64) - self.middle;
        let texels = around.filter_map(|beside| sought.texel(self.part_from_px * (from_middle + beside)));
        let levels = texels.map(|texel| self.picture[texel]);
        levels.fold((0.0, 0.0), |(low, high): (f32, f32), level| (low.min(level), high.max(level)))
    }
}

/// Measures the room round parts.
pub(super) fn measure_room(detector: &Detector, view: &View, parts: &[Lying]) -> Room {
    let reach_m = |pose: usize| detector.sought[pose].radius_m;
    let mut part_gaps_m = vec![f64::INFINITY; parts.len()];
    for (index, part) in parts.iter().enumerate() {
        for (other_index, other) in parts.iter().enumerate().skip(index + 1) {
            let circles_m = (part.centre - other.centre).norm() - reach_m(part.pose) - reach_m(other.pose);
            let gap_m = if circles_m > NEAR_M { circles_m } else { gap_m(&part.outline, &other.outline) };
            part_gaps_m[index] = part_gaps_m[index].min(gap_m);
            part_gaps_m[other_index] = part_gaps_m[other_index].min(gap_m);
        }
    }
    let mut foreign_gaps_m = vec![f64::INFINITY; parts.len()];
    let mut keep_off = |place: &Point2<f64>, near: &[usize]| {
        for index in near {
            foreign_gaps_m[*index] = foreign_gaps_m[*index].min(distance_m(&parts[*index].outline, place));
        }
    };
    let frame = &detector.segmentation;
    let tolerance = frame.threshold + OBSTACLE_TOLERANCE;
    let shadow_misses_px = detector.light.shadow_misses_px(detector.is_lit_from_a_side);
    let mut is_thing = vec![false; frame.window.len()];
    let mut shades: Vec<Shade> = Vec::new();
    let (mut own_px, mut foreign_px) = (0, 0);
    for Uncovered { pixel, place, level, px } in detector.uncovered(view, EDGE_STRIP_PX) {
        let reach_m = |pose: usize| reach_m(pose) + DISTANCES as f64 * detector.sought[pose].m_per_px;
        let is_near = |part: &Lying| (part.centre - place).norm() < reach_m(part.pose).max(NEAR_M);
        let near: Vec<usize> = (0..parts.len()).filter(|index| is_near(&parts[*index])).collect();
        let of_surround = |index: &usize| {
            let Lying { pose, centre, yaw_rad, .. } = parts[*index];
            let scatters = detector.light.scatters();
            detector.surrounds[pose].range(view, &detector.sought[pose], (centre, yaw_rad), place, scatters)
        };
        let shared: Vec<(f32, f32)> = near.iter().map(of_surround).collect();
        let pictured = |(index, (low, high)): (&usize, &(f32, f32))| {
            let Lying { pose, ref pictured, .. } = parts[*index];
            let sought = &detector.sought[pose];
            let at = (pixel % frame.window.width, pixel / frame.window.width);
            let seen = pictured.as_ref().map(|pictured| pictured.range(sought, at, shadow_misses_px));
            let (darkest, brightest) = seen.unwrap_or((0.0, 0.0));
            (low.min(darkest), high.max(brightest))
        };
        // What is a part's own is in the way of none. Shades add up, where they are known exactly.
        let together = |(low, high): (f32, f32), (lower, higher): (f32, f32)| match detector.light {
            Light::Taught => (low + lower, high + higher),
            Light::Any => (low.min(lower), high.max(higher)),
        };
        let is_within = |(low, high): (f32, f32)| {
            level < 0.0 && level >= low - tolerance || level >= 0.0 && level <= high + tolerance
        };
        // Most of it is within what parts share, and that is sooner told than what each is pictured with.
        if is_within(shared.iter().copied().fold((0.0, 0.0), together))
            || is_within(near.iter().zip(&shared).map(pictured).fold((0.0, 0.0), together))
        {
            own_px += px;
            shades.push(Shade { pixel, place, near });
        } else {
            foreign_px += px;
            is_thing[pixel] = true;
            keep_off(&place, &near);
        }
    }
    // The edge of a thing is blurred, and shaded, as a part's own is: what touches a thing may be part of it.
    for Shade { pixel, place, near } in &shades {
        if frame.window.about(*pixel).any(|touching| is_thing[touching]) {
            keep_off(place, near);
        }
    }
    Room { part_gaps_m, foreign_gaps_m, own_px, foreign_px }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::recognition::IN_ANY_LIGHT;

    #[test]
    fn a_part_is_as_dark_and_as_bright_as_its_picture_there_and_the_plateau_beyond_is_bare() {
        let sought = &IN_ANY_LIGHT.sought[0];
        let (side, texel_m) = (sought.template.side(), sought.template.texel_m);
        // Dark two texels to the right of the middle and bright three below it, in pixels of twice a texel about (100, 50).
        let mut picture = vec![0.0; side * side];
        let middle = (side / 2) * side + side / 2;
        (picture[middle + 2], picture[middle + 3 * side]) = (-0.3, 0.2);
        let pictured = Pictured {
            picture,
            middle: Point2::new(100.0, 50.0),
            part_from_px: Matrix2::from_diagonal_element(2.0 * texel_m),
        };
        let range = |at: (usize, usize), beside_px: &[f64]| pictured.range(sought, at, beside_px);
        assert_eq!(range((101, 50), &[0.0]), (-0.3, 0.0));
        assert_eq!(range((100, 50), &[0.0]), (0.0, 0.0));
        assert_eq!(range((99, 50), &[0.0]), (0.0, 0.0));
        assert_eq!(range((100, 51), &[0.5]), (0.0, 0.0));
        assert_eq!(range((100, 51), &[0.0, 0.5]), (0.0, 0.2));
        assert_eq!(range((100, 51), &[-1.0, 0.0, 0.5, 1.0]), (-0.3, 0.2));
        assert_eq!(range((100 + side, 50), &[0.0]), (0.0, 0.0));
    }
}
