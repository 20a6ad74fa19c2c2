//! Learns from pictures what a part looks like.

use image::GrayImage;
use nalgebra::Isometry2;
use serde::{Deserialize, Serialize};

use super::circles::Disc;
use super::detector::{Detector, PartSize};
use super::part_model::{Face, PartModel, PoseTemplate, RINGS, sample_face};
use super::view::View;
use super::{ImageFault, require_above};
use crate::camera::{CameraModel, InvalidValue, MountedTray, require};

/// Share of the rim a part must show to be taught from.
const TEACH_SUPPORT_MIN: f64 = 0.8;
/// Parts closer than this, in diameters from centre to centre, do not teach: their shadows meet.
const TEACH_SEPARATION: f64 = 1.4;
/// Least tolerance of the diameter, relative, and the number of standard deviations it covers.
const DIAMETER_TOLERANCE_RATIO: f64 = 0.08;
const DIAMETER_SIGMAS: f64 = 6.0;
/// Faces that correlate more than this cannot be told apart.
const FACE_CORRELATION_MAX: f64 = 0.6;

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
    require((5e-4..=0.2).contains(&spec.diameter_m), "teach.diameter_m", spec.diameter_m, "5e-4 to 0.2 m")?;
    require((0.0..=0.1).contains(&spec.height_m), "teach.height_m", spec.height_m, "0 to 0.1 m")?;
    tray.validate()?;
    require_above(camera, tray)?;
    let size = PartSize { diameter_m: spec.diameter_m, height_m: spec.height_m };
    let mut detector = Detector::new(camera, tray);
    let pose_count = frames.iter().map(|frame| frame.pose + 1).max().unwrap_or(1);
    let mut faces: Vec<Vec<Face>> = vec![Vec::new(); pose_count];
    let mut diameters = Vec::new();
    for (index, frame) in frames.iter().enumerate() {
        let (discs, background) = detector
            .discs(frame.image, &frame.platen_from_tray, size, spec.contrast_min_levels)
            .map_err(|source| TeachError::Frame { index, source })?;
        let view = View { camera, tray, platen_from_tray: frame.platen_from_tray };
        let height_m = size.face_height_m(tray);
        for disc in &discs {
            let near = |other: &&Disc| {
                let apart_m = (other.centre - disc.centre).norm();
                apart_m > 0.0 && apart_m < TEACH_SEPARATION * spec.diameter_m
            };
            if disc.support < TEACH_SUPPORT_MIN || discs.iter().any(|other| near(&other)) {
                continue;
            }
            if let Some(face) =
                sample_face(&detector.segmentation, &background, &view, height_m, disc.centre, spec.diameter_m / 2.0)
            {
                faces[frame.pose].push(face);
                diameters.push(2.0 * disc.radius_m);
            }
        }
    }
    let mut poses = Vec::with_capacity(pose_count);
    for (pose, faces) in faces.iter().enumerate() {
        if faces.is_empty() {
            return Err(TeachError::NoPart { pose, diameter_m: spec.diameter_m });
        }
        let ring = |ring: usize| moments(faces.iter().map(|face| face.rings[ring]));
        let (ring_brightness, ring_deviation) = (0..RINGS).map(ring).unzip();
        poses.push(PoseTemplate { ring_brightness, ring_deviation });
    }
    for second in 1..poses.len() {
        for first in 0..second {
            let correlation = poses[first].correlation(&poses[second].ring_brightness);
            if correlation > FACE_CORRELATION_MAX {
                return Err(TeachError::Alike { first, second, correlation });
            }
        }
    }
    let (seen_diameter_m, deviation_m) = moments(diameters.iter().copied());
    let diameter_tolerance_m = (DIAMETER_SIGMAS * deviation_m).max(DIAMETER_TOLERANCE_RATIO * seen_diameter_m);
    let TeachSpec { diameter_m, height_m, .. } = spec;
    Ok(PartModel { diameter_m, seen_diameter_m, diameter_tolerance_m, height_m, poses })
}

/// Mean and standard deviation.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}
