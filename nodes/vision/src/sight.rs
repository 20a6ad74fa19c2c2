//! Looks at a frame in the light taught, and where that leaves much unexplained, in any light.
//!
//! In the light taught a part's picture is known to a hundredth of the plateau's brightness, and what differs from it more is no
//! part: that is exact, holds in a crowd, and is quick. Light, lens or surface that differ from those taught show in
//! things that nothing explains, and light in how it falls across the bare plateau. Then both looks are made, and what
//! one of them is sure of and the other contradicts is not sure.

use image::GrayImage;
use nalgebra::Isometry2;

use super::candidate::{self, Candidate};
use super::detector::Detector;
use super::health::FrameHealth;
use super::modes::Light;
use super::template::PartModel;
use super::{ImageFault, SelectorConfig};
use feeder_model::camera::{CameraModel, MountedTray, single};

/// Share of what lies on the plateau that must be explained for the light to be taken for the one taught without a second
/// look; and with it: below, an explanation by the light taught counts for nothing. In rendered crowds under the light taught 0.86 to
/// 1 is explained, in path-traced pictures under a low lamp 0.2 to 0.6.
const EXPLAINED_MIN: f64 = 0.97;
const EXPLAINED_BETTER_MIN: f64 = 0.8;

/// Things seen by both looks nearer to each other than this, relative to the part's radius, are one.
const SAME_THING_RATIO: f64 = 0.5;

/// Both ways to look.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    pub taught: Detector,
    any: Detector,
}

impl Sight {
    pub(super) fn new(camera: &CameraModel, tray: &MountedTray, model: &PartModel) -> Self {
        let in_light = |light| Detector::new(camera, tray, model, light);
        Self { taught: in_light(Light::Taught), any: in_light(Light::Any) }
    }

    /// The parts that a frame shows, and what the frame is worth.
    pub(super) fn look(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
        config: &SelectorConfig,
    ) -> Result<(Vec<Candidate>, FrameHealth), ImageFault> {
        let look = |detector: &mut Detector| {
            let found = detector.find(image, platen_from_tray, config.contrast_min_levels, single(config.miss_max))?;
            Ok(candidate::judge(detector, &detector.view(platen_from_tray), config, &found))
        };
        let (mut taught, taught_health) = look(&mut self.taught)?;
        let taught_ratio = taught_health.explained_ratio;
        if taught_ratio >= EXPLAINED_MIN && !taught_health.light_differs() {
            return Ok((taught, taught_health));
        }
        let (any, any_health) = look(&mut self.any)?;
        if taught_ratio < EXPLAINED_BETTER_MIN || taught_ratio <= any_health.explained_ratio {
            return Ok((any, any_health));
        }
        for candidate in &mut taught {
            if any.iter().any(|other| self.contradicts(candidate, other, config)) {
                (candidate.pose, candidate.confidence) = (None, 0.0);
            }
        }
        Ok((taught, taught_health))
    }

    /// Whether one look is sure to see, where another sees `candidate`, the part in another pose, at another yaw, or further
    /// beside than a calibration may be off without a warning.
    pub(super) fn contradicts(&self, candidate: &Candidate, other: &Candidate, config: &SelectorConfig) -> bool {
        let near_m = SAME_THING_RATIO * self.taught.sought[candidate.likeness].radius_m;
        let apart_m = (other.centre() - candidate.centre()).norm();
        if other.pose.is_none() || apart_m > near_m {
            return false;
        }
        let turned = candidate
            .yaw_rad
            .zip(other.yaw_rad)
            .is_some_and(|(yaw_rad, other_rad)| self.taught.yaws_differ(candidate.likeness, yaw_rad, other_rad));
        other.pose != candidate.pose || turned || apart_m > config.calibration.warning_m
    }
}
