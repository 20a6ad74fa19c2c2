//! What a part looks like from above in each resting pose.

use std::sync::LazyLock;

use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::detector::PartSize;
use super::segment::{Background, Segmentation};
use super::view::View;
use crate::camera::{InvalidValue, require, single};

/// Rings a face is divided into, of equal width, and points on each.
pub(super) const RINGS: usize = 12;
const RING_POINTS: usize = 24;
/// Directions of a ring's points.
static RING_DIRECTIONS: LazyLock<[Vector2<f32>; RING_POINTS]> = LazyLock::new(|| {
    std::array::from_fn(|point| {
        let (sin, cos) = (std::f32::consts::TAU * point as f32 / RING_POINTS as f32).sin_cos();
        Vector2::new(cos, sin)
    })
});
/// Share of the radius the rings cover: the rim itself belongs to the outline.
const FACE_RATIO: f64 = 0.94;
/// A face as a frame shows it: mean brightness of each ring relative to the bare plateau there.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Face {
    pub(super) rings: [f64; RINGS],
    /// Its centre of symmetry, tray frame.
    pub(super) centre: Point2<f64>,
    /// Mean square change of brightness from ring to ring: how well the centre is known.
    pub(super) sharpness: f64,
}

/// A taught face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseTemplate {
    /// Brightness relative to the bare plateau, ring by ring from the centre outwards.
    pub ring_brightness: Vec<f64>,
    /// Standard deviation of the above among the parts taught.
    pub ring_deviation: Vec<f64>,
}

/// A taught part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartModel {
    /// Diameter of the part, m.
    pub diameter_m: f64,
    /// Diameter as the camera measures it, with some of the side and the shadow, m.
    pub seen_diameter_m: f64,
    /// How far a part's measured diameter may be from that, m.
    pub diameter_tolerance_m: f64,
    /// Height of the part above the plateau, m.
    pub height_m: f64,
    /// The upper face in each resting pose.
    pub poses: Vec<PoseTemplate>,
}

impl PartModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        for (field, value) in
            [("part_model.diameter_m", self.diameter_m), ("part_model.seen_diameter_m", self.seen_diameter_m)]
        {
            require((5e-4..=0.2).contains(&value), field, value, "5e-4 to 0.2 m")?;
        }
        let tolerance = self.diameter_tolerance_m;
        let tolerance_ok = tolerance > 0.0 && tolerance <= self.diameter_m;
        require(tolerance_ok, "part_model.diameter_tolerance_m", tolerance, "above 0 up to diameter_m")?;
        require((0.0..=0.1).contains(&self.height_m), "part_model.height_m", self.height_m, "0 to 0.1 m")?;
        require(!self.poses.is_empty(), "part_model.poses", 0.0, "at least one")?;
        for template in &self.poses {
            for (field, values) in [
                ("part_model.poses.ring_brightness", &template.ring_brightness),
                ("part_model.poses.ring_deviation", &template.ring_deviation),
            ] {
                require(values.len() == RINGS, field, values.len() as f64, "12 numbers")?;
                for value in values {
                    require((0.0..=100.0).contains(value), field, *value, "0 to 100")?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn size(&self) -> PartSize {
        PartSize { diameter_m: self.diameter_m, height_m: self.height_m }
    }
}

impl PoseTemplate {
    /// Correlation of a face's rings with this one's, −1 to 1, rings weighted by their area: structure counts, brightness and
    /// contrast as a whole do not.
    pub(super) fn correlation(&self, rings: &[f64]) -> f64 {
        let pairs = || {
            let weights = (0..RINGS).map(|ring| (2 * ring + 1) as f64 / (RINGS * RINGS) as f64);
            weights.zip(self.ring_brightness.iter().copied().zip(rings.iter().copied()))
        };
        let (mut mean_a, mut mean_b) = (0.0, 0.0);
        for (weight, (a, b)) in pairs() {
            mean_a += weight * a;
            mean_b += weight * b;
        }
        let (mut product, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
        for (weight, (a, b)) in pairs() {
            let (a, b) = (a - mean_a, b - mean_b);
            product += weight * a * b;
            square_a += weight * a * a;
            square_b += weight * b * b;
        }
        let scale = (square_a * square_b).sqrt();
        if scale > 0.0 { product / scale } else { 0.0 }
    }
}

/// Samples the face of a disc of `radius_m` at about `centre`, on the plane `height_m` of its upper face; `None` if part
/// of it is out of view.
pub(super) fn sample_face(
    frame: &Segmentation,
    background: &Background,
    view: &View,
    height_m: f64,
    centre: Point2<f64>,
    radius_m: f64,
) -> Option<Face> {
    let pixel = view.pixel(centre, height_m)?.map(single);
    let px_from_tray = view.px_from_tray(centre, height_m)?.map(single);
    let white = background.level(frame.window, pixel.x, pixel.y).max(1.0);
    let ring_m = radius_m * FACE_RATIO / RINGS as f64;
    let mut face = Face { rings: [0.0; RINGS], centre, sharpness: 0.0 };
    // The second look, from the centre found by the first, is the one that counts.
    for _ in 0..2 {
        let shift_px = px_from_tray * (face.centre - centre).map(single);
        let mut harmonics = [Vector2::zeros(); RINGS];
        for (ring, (mean, harmonic)) in face.rings.iter_mut().zip(&mut harmonics).enumerate() {
            let radius_m = single((ring as f64 + 0.5) * ring_m);
            let (mut sum, mut moment) = (0.0, Vector2::zeros());
            for direction in &*RING_DIRECTIONS {
                let place = pixel + shift_px + px_from_tray * direction * radius_m;
                let level = frame.level(place.x, place.y)?;
                sum += level;
                moment += direction * level;
            }
            let scale = 1.0 / (RING_POINTS as f32 * white);
            *mean = f64::from(sum * scale);
            *harmonic = (moment * scale).map(f64::from);
        }
        let (offset, sharpness) = symmetry_offset(&face.rings, &harmonics);
        face.centre += offset * ring_m;
        face.sharpness = sharpness;
    }
    Some(face)
}

/// How far the centre of symmetry of a concentric face lies beside where it was sampled, in ring widths, and how sharply
/// the face tells.
///
/// Displaced by a small s, a profile T(ρ) shows −T′(ρ) s·e(θ) at an angle θ, a first harmonic of −T′ s/2; least squares
/// over the rings, weighted by their area, yields s.
fn symmetry_offset(rings: &[f64; RINGS], harmonics: &[Vector2<f64>; RINGS]) -> (Vector2<f64>, f64) {
    let (mut product, mut square) = (Vector2::zeros(), 0.0);
    // The outermost rings are left out: chamfer and rim look different towards the lamp.
    for ring in 1..RINGS - 2 {
        let slope = (rings[ring + 1] - rings[ring - 1]) / 2.0;
        let weight = (2 * ring + 1) as f64 / (RINGS * RINGS) as f64;
        product += harmonics[ring] * (-2.0 * weight * slope);
        square += weight * slope * slope;
    }
    let offset = if square > 0.0 { product / square } else { Vector2::zeros() };
    // Linear only for a shift of about a ring.
    (offset.cap_magnitude(1.0), square)
}
