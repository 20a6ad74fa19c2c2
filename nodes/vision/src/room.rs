//! The room round parts: how far it is from their outlines to each other, and to whatever else stands out from the plateau.

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};

use super::align::Fit;
use super::detector::{Detector, covered};
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
/// What fits a thing badly is as large as it where the thing shows on this share of it. Set by hand, for nuts that touch one on edge: a
/// fifth and a third do the same for path-traced parts, half misses one of three.
const THING_SHARE_MIN: f64 = 0.25;

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
            let gap_m = between_m(detector, part, other);
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
    // Some of a thing may pass for the shade of what it touches. What fits it best, though badly, tells how far it reaches.
    for thing in unlikely_things(detector, view, &is_thing) {
        for (part, foreign_gap_m) in parts.iter().zip(&mut foreign_gaps_m) {
            *foreign_gap_m = foreign_gap_m.min(between_m(detector, part, &thing));
        }
    }
    Room { part_gaps_m, foreign_gaps_m, own_px, foreign_px }
}

/// Gap between two parts, m; if they are not near, that between the circles round them.
fn between_m(detector: &Detector, part: &Lying, other: &Lying) -> f64 {
    let reach_m = |part: &Lying| detector.sought[part.pose].radius_m;
    let circles_m = (part.centre - other.centre).norm() - reach_m(part) - reach_m(other);
    if circles_m > NEAR_M { circles_m } else { gap_m(&part.outline, &other.outline) }
}

/// What fits badly where a thing shows on more than [`THING_SHARE_MIN`] of it.
fn unlikely_things(detector: &Detector, view: &View, is_thing: &[bool]) -> Vec<Lying> {
    let shows = |(pose, fit): &&(usize, Fit)| {
        let (mut px, mut thing_px) = (0.0, 0.0);
        covered(&detector.segmentation, view, &detector.sought[*pose], fit, |pixel| {
            px += 1.0;
            thing_px += f64::from(u8::from(is_thing[pixel]));
        });
        thing_px > THING_SHARE_MIN * px
    };
    let lying = |(pose, fit): &(usize, Fit)| {
        let outline = detector.outline(*pose, fit.centre, fit.yaw_rad);
        Lying { pose: *pose, centre: fit.centre, yaw_rad: fit.yaw_rad, outline, pictured: None }
    };
    detector.unlikely.iter().filter(shows).map(lying).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SelectorConfig;
    use crate::tests::recognition::IN_ANY_LIGHT;
    use crate::tests::{at, over_camera, simple_picture};

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

    /// The near side of a thing is as bright as the plateau, and what fits it tells where it ends.
    #[test]
    fn what_fits_a_thing_badly_tells_how_far_the_thing_reaches() {
        let mut detector = IN_ANY_LIGHT.clone();
        let part = at(0.06, 4.5, 0);
        let reach_m = detector.sought[0].radius_m;
        let touching = Vector2::new(2.0 * reach_m, 0.0);
        let contrast_min_levels = SelectorConfig::default().contrast_min_levels;
        let find = |detector: &mut Detector, image: &image::GrayImage, cost_max: f32| {
            detector.find(image, &over_camera(), contrast_min_levels, cost_max).unwrap()
        };
        let mut image = simple_picture(&[part, crate::LaidPart { place: part.place + touching, ..part }]);
        // Nothing may miss by nothing.
        assert!(find(&mut detector, &image, 0.0).is_empty());
        let is_other = |(_, fit): &&(usize, Fit)| (fit.centre - (part.place + touching)).norm() < 0.000_2;
        let unlikely: Vec<(usize, Fit)> = detector.unlikely.iter().filter(is_other).copied().collect();
        assert_eq!((unlikely.len(), detector.unlikely.len()), (1, 2));
        let bare = simple_picture(&[]);
        let (camera, tray) = (detector.camera.clone(), detector.tray);
        let view = View { camera: &camera, tray: &tray, platen_from_tray: over_camera() };
        for (x, y, level) in image.enumerate_pixels_mut() {
            let pixel = Point2::new(f64::from(x), f64::from(y));
            let beside = view.tray_point(pixel, tray.plateau_height_m()).map(|place| place - part.place);
            if beside.is_some_and(|beside| beside.y.abs() < reach_m && (1.1..1.6).contains(&(beside.x / reach_m))) {
                *level = *bare.get_pixel(x, y);
            }
        }
        let found = find(&mut detector, &image, 2.0);
        let [found] = found[..] else { panic!("{found:?}") };
        let outline = detector.outline(0, found.fit.centre, 0.0);
        let lying = [Lying { pose: 0, centre: found.fit.centre, yaw_rad: 0.0, outline, pictured: None }];
        let mut gap_m = |unlikely: &[(usize, Fit)]| {
            detector.unlikely = unlikely.to_vec();
            measure_room(&detector, &view, &lying).gap_m(0)
        };
        assert!((0.001..0.002).contains(&gap_m(&[])), "{}", gap_m(&[]));
        assert!(gap_m(&unlikely) < 0.000_1, "{}", gap_m(&unlikely));
        // Where nothing shows, nothing lies.
        let elsewhere = Fit { centre: part.place - touching, ..unlikely[0].1 };
        assert!(gap_m(&[(0, elsewhere)]) > 0.001);
    }
}
