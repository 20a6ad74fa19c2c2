//! Finds the tray's rim, hub and drop-off in a picture: points of their edges, to a fraction of a pixel.

use std::f64::consts::TAU;

use image::GrayImage;
use nalgebra::{Point2, Point3, Vector2};

use crate::view::View;

/// Spokes on which the outer edge of the rim and that of the hub are looked for, and places along the drop-off.
pub(super) const RIM_SPOKES: u32 = 120;
const HUB_SPOKES: u32 = 72;
const DROP_OFF_PLACES: u32 = 48;
/// Share of the plateau's width at both ends of the drop-off that is left out: there the walls' shade lies.
const DROP_OFF_MARGIN_RATIO: f64 = 0.08;
/// Between samples across an edge, px, and over how many of them brightness is compared.
const STEP_PX: f64 = 0.5;
const SPAN: usize = 4;
/// Samples on both sides of the steepest place that say where an edge lies.
const PEAK: usize = 3;
/// Grey levels by which the two sides of an edge differ at least: five times the noise of a poor camera.
const STEP_LEVELS_MIN: f32 = 12.0;
/// An edge that differs by less than this share of the usual step on its curve is another one.
const STEP_RATIO_MIN: f32 = 0.4;
/// An edge further than this from the line on which the others lie is not the drop-off's, and of fewer than a third of the places
/// looked at any line is chance: of those of a crowd's own edges at most 15 of 48 lie on one, of the drop-off's behind it 17 to 23.
const STRAIGHT_PX: f64 = 0.5;

/// A place on an edge of the tray, and where the picture shows that edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePoint {
    /// On the edge, platen frame, m.
    pub place: Point3<f64>,
    /// Where the camera should see the place, px.
    pub expected: Point2<f64>,
    /// Across the edge, in the picture.
    pub across: Vector2<f64>,
    /// How far across the edge is seen from where it should be, px.
    pub miss_px: f64,
}

/// What is found of the edges.
#[derive(Clone, Debug)]
pub(super) struct Edges {
    /// Where an edge is seen, the rim's first.
    pub seen: Vec<EdgePoint>,
    /// How many of them are the rim's.
    pub rim_seen: usize,
    /// How many places on the rim lie in the picture.
    pub rim_in_view: usize,
}

/// Finds the edges, up to `reach_px` from where they should be.
pub(super) fn find(view: &View, image: &GrayImage, reach_px: f64) -> Edges {
    let geometry = &view.tray.geometry;
    let (inner_m, outer_m) = (geometry.inner_radius_m, geometry.outer_radius_m);
    let spokes = |radius_m: f64, spokes: u32| {
        (0..spokes).map(move |spoke| {
            let (sin, cos) = (TAU * f64::from(spoke) / f64::from(spokes)).sin_cos();
            let outward = Vector2::new(cos, sin);
            (Point2::from(outward * radius_m), outward)
        })
    };
    let drop_off = (0..DROP_OFF_PLACES).map(|place| {
        let share = f64::from(place) / f64::from(DROP_OFF_PLACES - 1);
        let share = DROP_OFF_MARGIN_RATIO + (1.0 - 2.0 * DROP_OFF_MARGIN_RATIO) * share;
        (Point2::new(inner_m + share * (outer_m - inner_m), 0.0), Vector2::y())
    });
    let top_m = view.tray.wall_top_m();
    let profile = |height_m: f64| move |(place, across)| Profile::new(view, image, place, across, height_m, reach_px);
    let rim = spokes(outer_m + view.tray.wall_thickness_m, RIM_SPOKES).filter_map(profile(top_m)).collect::<Vec<_>>();
    let hub = spokes(inner_m, HUB_SPOKES).filter_map(profile(top_m)).collect::<Vec<_>>();
    let drop_off = drop_off.filter_map(profile(view.tray.plateau_height_m())).collect::<Vec<_>>();
    let mut seen: Vec<EdgePoint> = steps(&rim).collect();
    let rim_seen = seen.len();
    seen.extend(steps(&hub));
    seen.extend(straight(&drop_off));
    Edges { seen, rim_seen, rim_in_view: rim.len() }
}

/// Brightness across an edge.
struct Profile {
    point: EdgePoint,
    reach_px: f64,
    /// How much brighter it gets over a few samples.
    rises: Vec<f32>,
}

impl Profile {
    /// `None` where the camera does not see so far to both sides.
    fn new(
        view: &View,
        image: &GrayImage,
        place: Point2<f64>,
        across: Vector2<f64>,
        height_m: f64,
        reach_px: f64,
    ) -> Option<Self> {
        let expected = view.pixel(place, height_m)?;
        let across = (view.px_from_tray(place, height_m)? * across).try_normalize(0.0)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
        let half = (reach_px / STEP_PX).ceil() as usize + SPAN / 2;
        let mut levels = Vec::with_capacity(2 * half + 1);
        for index in 0..=2 * half {
            levels.push(level(image, expected + across * (STEP_PX * (index as f64 - half as f64)))?);
        }
        let rises = levels.windows(SPAN + 1).map(|window| window[SPAN] - window[0]).collect();
        let platen = view.platen_from_tray * place;
        let point = EdgePoint { place: Point3::new(platen.x, platen.y, height_m), expected, across, miss_px: 0.0 };
        Some(Self { point, reach_px: STEP_PX * (half - SPAN / 2) as f64, rises })
    }

    /// The steepest rise, or fall where `sign` is −1: how steep, and at which sample.
    fn steepest(&self, sign: f32) -> (f32, usize) {
        let steeper = |best: (f32, usize), (index, rise): (usize, &f32)| {
            if sign * rise > best.0 { (sign * rise, index) } else { best }
        };
        self.rises.iter().enumerate().fold((0.0, 0), steeper)
    }

    /// Where about a sample the brightness changes, px from where the edge should be.
    fn middle_px(&self, sign: f32, index: usize) -> f64 {
        let range = index.saturating_sub(PEAK)..(index + PEAK + 1).min(self.rises.len());
        let (sum, moment) = range.fold((0.0, 0.0), |(sum, moment), index| {
            let rise = f64::from((sign * self.rises[index]).max(0.0));
            (sum + rise, moment + rise * index as f64)
        });
        STEP_PX * moment / sum - self.reach_px
    }
}

/// The usual step on a curve where it rises, or falls where `sign` is −1, grey levels.
fn usual_step(profiles: &[Profile], sign: f32) -> f32 {
    let mut steps: Vec<f32> = profiles.iter().map(|profile| profile.steepest(sign).0).collect();
    steps.sort_by(f32::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

/// The edge on each profile of a curve. All have the brighter side on the same side, whichever that is.
fn steps(profiles: &[Profile]) -> impl Iterator<Item = EdgePoint> {
    let sign = if usual_step(profiles, 1.0) > usual_step(profiles, -1.0) { 1.0 } else { -1.0 };
    signed_steps(profiles, sign)
}

/// The edge on each profile of a curve that has its brighter side ahead, or behind where `sign` is −1.
fn signed_steps(profiles: &[Profile], sign: f32) -> impl Iterator<Item = EdgePoint> {
    let least = STEP_LEVELS_MIN.max(STEP_RATIO_MIN * usual_step(profiles, sign));
    profiles.iter().filter_map(move |profile| {
        let (step, index) = profile.steepest(sign);
        (step >= least).then(|| EdgePoint { miss_px: profile.middle_px(sign, index), ..profile.point })
    })
}

/// The edge on each profile of a straight line that lies on one, whichever side is brighter; nothing unless a third of them does.
/// Parts that hang over the drop-off show steeper edges than it has, but not in a row.
fn straight(profiles: &[Profile]) -> Vec<EdgePoint> {
    let Some(start) = profiles.first().map(|profile| profile.point.expected) else { return Vec::new() };
    let line = [1.0, -1.0].map(|sign| {
        let edge: Vec<EdgePoint> = signed_steps(profiles, sign).collect();
        let along_px = |point: &EdgePoint| (point.expected - start).norm();
        let on_line = |from: &EdgePoint, to: &EdgePoint| {
            let slope = (to.miss_px - from.miss_px) / (along_px(to) - along_px(from));
            let line = |point: &EdgePoint| from.miss_px + slope * (along_px(point) - along_px(from));
            edge.iter().filter(|point| (point.miss_px - line(point)).abs() <= STRAIGHT_PX).copied().collect()
        };
        let third = edge.len() / 3;
        let ends = edge[..third].iter().flat_map(|from| edge[edge.len() - third..].iter().map(move |to| (from, to)));
        ends.map(|(from, to)| on_line(from, to)).max_by_key(Vec::len).unwrap_or_default()
    });
    let [rising, falling] = line;
    let line = if rising.len() > falling.len() { rising } else { falling };
    if 3 * line.len() >= profiles.len() { line } else { Vec::new() }
}

/// Grey level at a place, by straight lines between pixels; `None` off the picture.
fn level(image: &GrayImage, place: Point2<f64>) -> Option<f32> {
    let (width, height) = image.dimensions();
    let inside = place.x >= 0.0 && place.y >= 0.0 && place.x < f64::from(width - 1) && place.y < f64::from(height - 1);
    if !inside {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
    let (column, row) = (place.x as usize, place.y as usize);
    #[expect(clippy::cast_possible_truncation, reason = "a share of a pixel")]
    let (across, down) = ((place.x - column as f64) as f32, (place.y - row as f64) as f32);
    let along = |row: usize| {
        let start = row * width as usize + column;
        let [left, right] = image.as_raw().get(start..)?.first_chunk()?.map(f32::from);
        Some(left + across * (right - left))
    };
    let (upper, lower) = (along(row)?, along(row + 1)?);
    Some(upper + down * (lower - upper))
}
