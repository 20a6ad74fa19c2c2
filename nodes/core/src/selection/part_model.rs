//! What a part looks like from above in each resting pose, taught from pictures.

use std::sync::LazyLock;

use image::GrayImage;
use nalgebra::{Isometry2, Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::circles::Disc;
use super::segment::{Background, Segmentation};
use super::view::View;
use super::{Detector, ImageFault, PartSize, require_above};
use crate::camera::{CameraModel, InvalidValue, MountedTray, require, single};

/// Rings a face is divided into, of equal width, and points on each.
const RINGS: usize = 12;
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
/// Share of the rim a part must show to be taught from.
const TEACH_SUPPORT_MIN: f64 = 0.8;
/// Parts closer than this, in diameters from centre to centre, do not teach: their shadows meet.
const TEACH_SEPARATION: f64 = 1.4;
/// Least tolerance of the diameter, relative, and the number of standard deviations it covers.
const DIAMETER_TOLERANCE_RATIO: f64 = 0.08;
const DIAMETER_SIGMAS: f64 = 6.0;
/// Faces that correlate more than this cannot be told apart.
const FACE_CORRELATION_MAX: f64 = 0.6;

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

/// A picture to teach from: parts that all lie in one known pose.
#[derive(Clone, Copy, Debug)]
pub struct TeachFrame<'a> {
    /// The picture.
    pub image: &'a GrayImage,
    /// Pose of the tray when it was taken.
    pub platen_from_tray: Isometry2<f64>,
    /// Resting pose of all parts in it.
    pub pose: usize,
}

/// What must be known of a part before it is taught: its drawing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeachSpec {
    /// Nominal diameter, m; a tenth off does no harm.
    pub diameter_m: f64,
    /// Nominal height, m.
    pub height_m: f64,
    /// Grey levels by which a part differs from the plateau at least.
    pub contrast_min_levels: f64,
}

/// Why teaching failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TeachError {
    /// A number out of range.
    #[error(transparent)]
    Value(#[from] InvalidValue),
    /// A picture that cannot be used.
    #[error("teaching frame {index}")]
    Frame {
        /// Which picture.
        index: usize,
        /// What is wrong with it.
        source: ImageFault,
    },
    /// A pose without a picture that shows a part lying free.
    #[error("no teaching frame shows a free part of diameter {diameter_m} m in pose {pose}")]
    NoPart {
        /// The pose.
        pose: usize,
        /// The diameter looked for, m.
        diameter_m: f64,
    },
    /// Two poses that look the same.
    #[error(
        "poses {first} and {second} look the same: correlation {correlation:.2}; allowed: up to {FACE_CORRELATION_MAX}"
    )]
    Alike {
        /// One pose.
        first: usize,
        /// The other.
        second: usize,
        /// Correlation of their faces.
        correlation: f64,
    },
}

impl PartModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        for (field, value) in [
            ("part_model.diameter_m", self.diameter_m),
            ("part_model.seen_diameter_m", self.seen_diameter_m),
        ] {
            require((5e-4..=0.2).contains(&value), field, value, "5e-4 to 0.2 m")?;
        }
        let tolerance = self.diameter_tolerance_m;
        let tolerance_ok = tolerance > 0.0 && tolerance <= self.diameter_m;
        require(
            tolerance_ok,
            "part_model.diameter_tolerance_m",
            tolerance,
            "above 0 up to diameter_m",
        )?;
        require(
            (0.0..=0.1).contains(&self.height_m),
            "part_model.height_m",
            self.height_m,
            "0 to 0.1 m",
        )?;
        require(
            !self.poses.is_empty(),
            "part_model.poses",
            0.0,
            "at least one",
        )?;
        for template in &self.poses {
            for (field, values) in [
                (
                    "part_model.poses.ring_brightness",
                    &template.ring_brightness,
                ),
                ("part_model.poses.ring_deviation", &template.ring_deviation),
            ] {
                require(
                    values.len() == RINGS,
                    field,
                    values.len() as f64,
                    "12 numbers",
                )?;
                for value in values {
                    require((0.0..=100.0).contains(value), field, *value, "0 to 100")?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn size(&self) -> PartSize {
        PartSize {
            diameter_m: self.diameter_m,
            height_m: self.height_m,
        }
    }
}

impl PoseTemplate {
    /// Correlation of a face's rings with this one's, −1 to 1, rings weighted by their area: structure counts, brightness and
    /// contrast as a whole do not.
    pub(super) fn correlation(&self, rings: &[f64]) -> f64 {
        let pairs = || {
            let weights = (0..RINGS).map(|ring| (2 * ring + 1) as f64 / (RINGS * RINGS) as f64);
            weights.zip(
                self.ring_brightness
                    .iter()
                    .copied()
                    .zip(rings.iter().copied()),
            )
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
    let mut face = Face {
        rings: [0.0; RINGS],
        centre,
        sharpness: 0.0,
    };
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
    let offset = if square > 0.0 {
        product / square
    } else {
        Vector2::zeros()
    };
    // Linear only for a shift of about a ring.
    (offset.cap_magnitude(1.0), square)
}

/// Learns a part from pictures of it lying free on the plateau, each pose in at least one picture.
///
/// # Errors
///
/// [`TeachError`] if a number is out of range, a picture unusable, a pose not shown, or two poses look the same.
pub fn teach(
    frames: &[TeachFrame],
    camera: &CameraModel,
    tray: &MountedTray,
    spec: TeachSpec,
) -> Result<PartModel, TeachError> {
    require(
        (5e-4..=0.2).contains(&spec.diameter_m),
        "teach.diameter_m",
        spec.diameter_m,
        "5e-4 to 0.2 m",
    )?;
    require(
        (0.0..=0.1).contains(&spec.height_m),
        "teach.height_m",
        spec.height_m,
        "0 to 0.1 m",
    )?;
    tray.validate()?;
    require_above(camera, tray)?;
    let size = PartSize {
        diameter_m: spec.diameter_m,
        height_m: spec.height_m,
    };
    let mut detector = Detector::new(camera, tray);
    let pose_count = frames.iter().map(|frame| frame.pose + 1).max().unwrap_or(1);
    let mut faces: Vec<Vec<Face>> = vec![Vec::new(); pose_count];
    let mut diameters = Vec::new();
    for (index, frame) in frames.iter().enumerate() {
        let (discs, background) = detector
            .discs(
                frame.image,
                &frame.platen_from_tray,
                size,
                spec.contrast_min_levels,
            )
            .map_err(|source| TeachError::Frame { index, source })?;
        let view = View {
            camera,
            tray,
            platen_from_tray: frame.platen_from_tray,
        };
        let height_m = size.face_height_m(tray);
        for disc in &discs {
            let near = |other: &&Disc| {
                let apart_m = (other.centre - disc.centre).norm();
                apart_m > 0.0 && apart_m < TEACH_SEPARATION * spec.diameter_m
            };
            if disc.support < TEACH_SUPPORT_MIN || discs.iter().any(|other| near(&other)) {
                continue;
            }
            if let Some(face) = sample_face(
                &detector.segmentation,
                &background,
                &view,
                height_m,
                disc.centre,
                spec.diameter_m / 2.0,
            ) {
                faces[frame.pose].push(face);
                diameters.push(2.0 * disc.radius_m);
            }
        }
    }
    let mut poses = Vec::with_capacity(pose_count);
    for (pose, faces) in faces.iter().enumerate() {
        if faces.is_empty() {
            return Err(TeachError::NoPart {
                pose,
                diameter_m: spec.diameter_m,
            });
        }
        let ring = |ring: usize| moments(faces.iter().map(|face| face.rings[ring]));
        let (ring_brightness, ring_deviation) = (0..RINGS).map(ring).unzip();
        poses.push(PoseTemplate {
            ring_brightness,
            ring_deviation,
        });
    }
    for second in 1..poses.len() {
        for first in 0..second {
            let correlation = poses[first].correlation(&poses[second].ring_brightness);
            if correlation > FACE_CORRELATION_MAX {
                return Err(TeachError::Alike {
                    first,
                    second,
                    correlation,
                });
            }
        }
    }
    let (seen_diameter_m, deviation_m) = moments(diameters.iter().copied());
    let diameter_tolerance_m =
        (DIAMETER_SIGMAS * deviation_m).max(DIAMETER_TOLERANCE_RATIO * seen_diameter_m);
    let TeachSpec {
        diameter_m,
        height_m,
        ..
    } = spec;
    Ok(PartModel {
        diameter_m,
        seen_diameter_m,
        diameter_tolerance_m,
        height_m,
        poses,
    })
}

/// Mean and standard deviation.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}
