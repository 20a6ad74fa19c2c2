//! Looks at a frame in the light taught, and where the frame does not look as taught, in any light.
//!
//! In the light taught a part's picture is known to a hundredth of the plateau's brightness, and what differs from it more is no
//! part: that is exact, holds in a crowd, and is quick. Light, lens or surface that differ from those taught show in things that
//! nothing explains, in parts that all fit worse, in shadows beside most of them, and in how light falls across the bare plateau.
//! Then both looks are made, and what one of them sees supports or contradicts the other.

use image::GrayImage;
use nalgebra::Isometry2;

use super::candidate::{self, Candidate, Judgement};
use super::detector::Detector;
use super::health::FrameHealth;
use super::modes::Light;
use super::template::PartModel;
use super::{ImageFault, SelectorConfig};
use feeder_model::camera::{CameraModel, MountedTray, single};

/// Where less of what lies on the plateau is explained by the light taught, that explanation counts for nothing, unless parts look as
/// they did: then no light explains the rest.
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
        let taught: Judgement = look(&mut self.taught)?;
        if taught.health.is_as_taught() {
            return Ok((taught.candidates, taught.health));
        }
        match look(&mut self.any) {
            Ok(any) => Ok(self.together(taught, any, config)),
            // A crowd that leaves nothing of the plateau bare tells of no light.
            Err(ImageFault::NoBackground) if holds(&taught) => Ok((taught.candidates, taught.health)),
            Err(fault) => Err(fault),
        }
    }

    /// What both looks come to together: the one that explains more counts, and the other supports or contradicts it.
    pub(super) fn together(
        &self,
        mut taught: Judgement,
        mut any: Judgement,
        config: &SelectorConfig,
    ) -> (Vec<Candidate>, FrameHealth) {
        if !holds(&taught) || taught.health.explained_ratio <= any.health.explained_ratio {
            if any.health.light_is_as_taught() {
                self.lend_room(&taught, &mut any, config);
            }
            return (any.candidates, any.health);
        }
        // What the light leaves looking alike is told apart by a picture that it does not show as taught only by chance.
        let misses = |ratio: &Option<f64>| !taught.health.looks_as_taught(ratio.unwrap_or(taught.health.miss_ratio));
        let poses = any.alike.iter().zip(&taught.miss_ratios);
        let by_chance: Vec<bool> = poses.map(|(is_alike, miss_ratio)| *is_alike && misses(miss_ratio)).collect();
        for (candidate, share) in taught.candidates.iter_mut().zip(&taught.shares) {
            let was_sure = candidate.pose.is_some();
            if by_chance[candidate.likeness] {
                (candidate.pose, candidate.confidence) = (None, 0.0);
            }
            for (other, part_gap_m) in any.candidates.iter().zip(&any.room.part_gaps_m) {
                if self.contradicts(candidate, other, config) {
                    (candidate.pose, candidate.confidence) = (None, 0.0);
                } else if candidate.pose.is_some() && self.is_same(candidate, other, config) {
                    candidate.confidence = candidate.confidence.max(other.confidence);
                    candidate.part_gap_m = candidate.part_gap_m.min(*part_gap_m);
                }
            }
            if was_sure && candidate.pose.is_none() {
                taught.health.unrecognise(*share);
            }
        }
        // In the light taught neither blur nor size is fitted.
        let FrameHealth { blur_excess_px2, size_excess_ratio, .. } = any.health;
        let looks_alike = by_chance.contains(&true);
        (taught.candidates, FrameHealth { blur_excess_px2, size_excess_ratio, looks_alike, ..taught.health })
    }

    /// Gives what one look sees the room that the other sees round the same things, but for the parts that it sees itself: what was
    /// taught of a part's shade holds while light falls as it did, also where the part itself looks otherwise.
    fn lend_room(&self, taught: &Judgement, any: &mut Judgement, config: &SelectorConfig) {
        let Judgement { candidates, room, .. } = any;
        for (index, candidate) in candidates.iter_mut().enumerate() {
            if let Some(other) = taught.candidates.iter().find(|other| self.is_same(candidate, other, config)) {
                let foreign_gap_m = room.foreign_gaps_m[index].max(other.part_gap_m);
                candidate.part_gap_m = room.part_gaps_m[index].min(foreign_gap_m);
            }
        }
    }

    /// Whether two looks see the part most like the same pose, at the same yaw, and no further beside than a calibration may be off
    /// without a warning.
    fn is_same(&self, candidate: &Candidate, other: &Candidate, config: &SelectorConfig) -> bool {
        let yaws_rad = candidate.yaw_rad.zip(other.yaw_rad);
        let turned = yaws_rad.is_some_and(|(a_rad, b_rad)| self.taught.yaws_differ(candidate.likeness, a_rad, b_rad));
        let apart_m = (other.centre() - candidate.centre()).norm();
        other.likeness == candidate.likeness && !turned && apart_m <= config.calibration.warning_m
    }

    /// Whether one look is sure to see, where another sees `candidate`, the part in another pose, at another yaw, or further
    /// beside than a calibration may be off without a warning.
    pub(super) fn contradicts(&self, candidate: &Candidate, other: &Candidate, config: &SelectorConfig) -> bool {
        let near_m = SAME_THING_RATIO * self.taught.sought[candidate.likeness].radius_m;
        let is_near = (other.centre() - candidate.centre()).norm() <= near_m;
        let differs = other.pose != candidate.pose || !self.is_same(candidate, other, config);
        other.pose.is_some() && is_near && differs
    }
}

/// Whether what the look as taught explains may count, whatever another light would explain.
fn holds(taught: &Judgement) -> bool {
    let looks_so = taught.miss_ratio.is_some_and(|miss_ratio| taught.health.looks_as_taught(miss_ratio));
    taught.health.explained_ratio >= EXPLAINED_BETTER_MIN || looks_so
}
