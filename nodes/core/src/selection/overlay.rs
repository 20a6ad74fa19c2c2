//! The frame with what was seen drawn into it.

use image::{GrayImage, Rgb, RgbImage};
use imageproc::drawing::{draw_cross_mut, draw_hollow_circle_mut, draw_line_segment_mut};
use nalgebra::{Isometry2, Point2};

use super::track::TrackedCandidate;
use super::view::View;
use crate::camera::{CameraModel, MountedTray, single};

/// Colours: may be picked, recognised in some pose, not recognised.
const SELECTABLE: Rgb<u8> = Rgb([40, 220, 70]);
const RECOGNISED: Rgb<u8> = Rgb([250, 190, 40]);
const UNKNOWN: Rgb<u8> = Rgb([230, 50, 50]);
const OUTLINE: Rgb<u8> = Rgb([70, 150, 250]);
/// How far ahead the line of motion reaches, s.
const MOTION_LINE_S: f64 = 1.0;
/// Steps of the drawn arc of the plateau.
const ARC_STEPS: u32 = 90;

/// Draws the plateau's outline (blue) and the parts into a frame: a green ring round those that may be picked, amber
/// round those recognised, red round the rest. A part carries one tick more inside its ring than the number of its pose,
/// and a line to where it will be in a second.
#[must_use]
pub fn draw_overlay(
    image: &GrayImage,
    candidates: &[TrackedCandidate],
    camera: &CameraModel,
    tray: &MountedTray,
    platen_from_tray: &Isometry2<f64>,
) -> RgbImage {
    let mut canvas = image::DynamicImage::from(image.clone()).into_rgb8();
    let view = View { camera, tray, platen_from_tray: *platen_from_tray };
    let height_m = tray.plateau_height_m();
    let pixel = |point: Point2<f64>| view.pixel(point, height_m).map(|pixel| (single(pixel.x), single(pixel.y)));
    let geometry = &tray.geometry;
    let on_circle = |radius_m: f64, psi_rad: f64| Point2::new(radius_m * psi_rad.cos(), radius_m * psi_rad.sin());
    let mut line = |from: Point2<f64>, to: Point2<f64>, colour: Rgb<u8>| {
        if let (Some(from), Some(to)) = (pixel(from), pixel(to)) {
            draw_line_segment_mut(&mut canvas, from, to, colour);
        }
    };
    let span_rad = std::f64::consts::TAU - geometry.ramp_angle_rad;
    let psi = |step: u32| geometry.ramp_angle_rad + span_rad * f64::from(step) / f64::from(ARC_STEPS);
    let (inner_m, outer_m) = (geometry.inner_radius_m, geometry.outer_radius_m);
    for step in 0..ARC_STEPS {
        for radius_m in [inner_m, outer_m] {
            line(on_circle(radius_m, psi(step)), on_circle(radius_m, psi(step + 1)), OUTLINE);
        }
    }
    for step in [0, ARC_STEPS] {
        line(on_circle(inner_m, psi(step)), on_circle(outer_m, psi(step)), OUTLINE);
    }
    for part in candidates {
        let colour = colour(part);
        line(part.position_m, part.predict(part.stamp_s + MOTION_LINE_S), colour);
        let radius_m = part.candidate.diameter_m / 2.0;
        for tick in 0..part.pose.map_or(0, |pose| pose + 1) {
            let x_m = (tick as f64 * 0.3 - 0.3) * radius_m;
            let at = |y_m: f64| part.candidate.centre() + nalgebra::Vector2::new(x_m, y_m);
            line(at(-0.2 * radius_m), at(0.2 * radius_m), colour);
        }
    }
    for part in candidates {
        let Some((x, y)) = pixel(part.candidate.centre()) else {
            continue;
        };
        #[expect(clippy::cast_possible_truncation, reason = "a float cast saturates")]
        let (centre, radius) = (
            (x.round() as i32, y.round() as i32),
            (0.5 * part.candidate.diameter_m / camera.m_per_px(height_m) + 2.0).round() as i32,
        );
        draw_hollow_circle_mut(&mut canvas, centre, radius, colour(part));
        if part.pose.is_none() {
            draw_cross_mut(&mut canvas, UNKNOWN, centre.0, centre.1);
        }
    }
    canvas
}

fn colour(part: &TrackedCandidate) -> Rgb<u8> {
    match (part.selectable, part.pose) {
        (true, _) => SELECTABLE,
        (false, Some(_)) => RECOGNISED,
        (false, None) => UNKNOWN,
    }
}
