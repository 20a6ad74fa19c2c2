//! The frame with what was seen drawn into it.

use image::{GrayImage, Rgb, RgbImage};
use imageproc::drawing::{draw_cross_mut, draw_line_segment_mut};
use nalgebra::{Isometry2, Point2, Rotation2, Vector2};

use super::Selector;
use super::track::TrackedCandidate;
use feeder_model::camera::single;

/// Colours: wanted and may be picked, recognised in some pose, not recognised.
const SELECTED: Rgb<u8> = Rgb([40, 220, 70]);
const RECOGNISED: Rgb<u8> = Rgb([250, 190, 40]);
const UNKNOWN: Rgb<u8> = Rgb([230, 50, 50]);
const OUTLINE: Rgb<u8> = Rgb([70, 150, 250]);
/// How far ahead the line of motion reaches, s.
const MOTION_LINE_S: f64 = 1.0;
/// Steps of the drawn arc of the plateau.
const ARC_STEPS: u32 = 90;

/// Draws the plateau's outline (blue) and the parts into a frame: the outline of those in a wanted pose that may be picked green, of others
/// recognised amber, of the rest red and crossed. A part carries one tick more across its middle than the number of its
/// pose, a line from its middle along its own x axis if it has a yaw, and a line to where it will be in a second.
#[must_use]
pub fn draw_overlay(
    image: &GrayImage,
    candidates: &[TrackedCandidate],
    selector: &Selector,
    platen_from_tray: &Isometry2<f64>,
) -> RgbImage {
    let mut canvas = image::DynamicImage::from(image.clone()).into_rgb8();
    let detector = &selector.sight.taught;
    let view = detector.view(platen_from_tray);
    let tray = view.tray;
    let pixel =
        |point: Point2<f64>, height_m: f64| view.pixel(point, height_m).map(|pixel| (single(pixel.x), single(pixel.y)));
    let mut line = |from: Point2<f64>, to: Point2<f64>, height_m: f64, colour: Rgb<u8>| {
        if let (Some(from), Some(to)) = (pixel(from, height_m), pixel(to, height_m)) {
            draw_line_segment_mut(&mut canvas, from, to, colour);
        }
    };
    let geometry = &tray.geometry;
    let plateau_m = tray.plateau_height_m();
    let on_circle = |radius_m: f64, psi_rad: f64| Point2::new(radius_m * psi_rad.cos(), radius_m * psi_rad.sin());
    let span_rad = std::f64::consts::TAU - geometry.ramp_angle_rad;
    let psi = |step: u32| geometry.ramp_angle_rad + span_rad * f64::from(step) / f64::from(ARC_STEPS);
    let (inner_m, outer_m) = (geometry.inner_radius_m, geometry.outer_radius_m);
    for step in 0..ARC_STEPS {
        for radius_m in [inner_m, outer_m] {
            line(on_circle(radius_m, psi(step)), on_circle(radius_m, psi(step + 1)), plateau_m, OUTLINE);
        }
    }
    for step in [0, ARC_STEPS] {
        line(on_circle(inner_m, psi(step)), on_circle(outer_m, psi(step)), plateau_m, OUTLINE);
    }
    for part in candidates {
        let colour = colour(selector, part);
        let sought = &detector.sought[part.candidate.likeness];
        let height_m = sought.plane_m;
        line(part.position_m, part.predict(part.stamp_s + MOTION_LINE_S), height_m, colour);
        let outline = selector.outline(&part.candidate);
        for (index, corner) in outline.iter().enumerate() {
            line(*corner, outline[(index + 1) % outline.len()], height_m, colour);
        }
        let centre = part.candidate.centre();
        let turn = Rotation2::new(part.candidate.yaw_rad.unwrap_or(0.0));
        let at = |x: f64, y: f64| centre + turn * (Vector2::new(x, y) * sought.radius_m);
        if part.candidate.yaw_rad.is_some() {
            line(centre, at(1.0, 0.0), height_m, colour);
        }
        for tick in 0..part.pose.map_or(0, |pose| pose + 1) {
            let x = 0.2 * tick as f64;
            line(at(x, -0.2), at(x, 0.2), height_m, colour);
        }
    }
    for part in candidates.iter().filter(|part| part.pose.is_none()) {
        if let Some((x, y)) = pixel(part.candidate.centre(), plateau_m) {
            #[expect(clippy::cast_possible_truncation, reason = "a float cast saturates")]
            draw_cross_mut(&mut canvas, UNKNOWN, x.round() as i32, y.round() as i32);
        }
    }
    canvas
}

fn colour(selector: &Selector, part: &TrackedCandidate) -> Rgb<u8> {
    match part.pose {
        Some(pose) if selector.is_wanted(pose) && selector.refusals(part).may_be_picked() => SELECTED,
        Some(_) => RECOGNISED,
        None => UNKNOWN,
    }
}
