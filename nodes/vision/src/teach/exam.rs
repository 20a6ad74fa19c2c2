//! What was learned, looked at with the pictures that it was learned from.

use super::super::SelectorConfig;
use super::super::detector::{Detector, Found};
use super::super::modes::Light;
use super::super::sight::Sight;
use super::super::surround::Samples;
use super::super::template::PartModel;
use super::super::template::RING_MISS_MAX;
use super::{TeachError, TeachFrame, TeachSpec};
use feeder_model::camera::{CameraModel, MountedTray, single};

/// Share of the parts shown in a pose that must be recognised, once it is learned, and that may be taken for another.
const RECOGNISED_RATIO_MIN: f64 = 0.6;
const MISTAKEN_RATIO_MAX: f64 = 0.04;
/// Of fewer parts shown, how many are recognised tells nothing.
const SHOWN_MIN: usize = 4;
/// What the rings of parts among others may miss by more than those of parts shown: relative, and beside.
const RING_ALLOWANCE_RATIO: f32 = 1.5;
const RING_ALLOWANCE: f32 = 1.0;
/// What parts among others may miss by more than those shown: relative, and beside.
const MISS_ALLOWANCE_RATIO: f32 = 1.5;
const MISS_ALLOWANCE: f32 = 1.2;
/// Share of the evidence of those shown that parts must have: under other light they may stand out by less.
const EVIDENCE_RATIO_MIN: f32 = 0.6;
/// Parts that must show what lies round them for it to be theirs.
const SURROUND_SHOWN_MIN: usize = 3;
/// How far from where it was laid a part is recognised as the same, relative to its radius.
const SAME_PLACE_RATIO: f64 = 0.3;

/// The pictures, and what is known of the parts they show.
pub(super) struct Exam<'a> {
    pub frames: &'a [TeachFrame<'a>],
    pub camera: &'a CameraModel,
    pub tray: &'a MountedTray,
    pub spec: &'a TeachSpec,
}

impl Exam<'_> {
    /// Learns how well the templates fit, then asks whether they tell the poses apart.
    pub(super) fn complete(&self, model: &mut PartModel) -> Result<(), TeachError> {
        self.measure_rings(model)?;
        self.measure_parts(model)?;
        self.tell_apart(model)
    }

    /// Calls `each` with what is found in every picture of parts.
    fn look(
        &self,
        model: &PartModel,
        mut each: impl FnMut(&Detector, &TeachFrame, &[Found]),
    ) -> Result<(), TeachError> {
        let mut detector = Detector::new(self.camera, self.tray, model, Light::Any);
        let (contrast, cost_max) = (self.spec.contrast_min_levels, single(SelectorConfig::default().miss_max));
        for (index, frame) in self.frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
            let found = detector
                .find(frame.image, &frame.platen_from_tray, contrast, cost_max)
                .map_err(|source| TeachError::Frame { index, source })?;
            each(&detector, frame, &found);
        }
        Ok(())
    }

    /// Learns how well the rings of brightness about a part fit: from the parts shown, with some allowance for neighbours.
    pub(super) fn measure_rings(&self, model: &mut PartModel) -> Result<(), TeachError> {
        let mut misses: Vec<Vec<f32>> = vec![Vec::new(); self.spec.poses.len()];
        self.look(model, |detector, frame, _| {
            let view = detector.view(&frame.platen_from_tray);
            for part in frame.parts {
                misses[part.pose].extend(detector.ring_miss(&view, part.pose, part.place));
            }
        })?;
        for (pose, misses) in model.poses.iter_mut().zip(&mut misses).filter(|(_, misses)| !misses.is_empty()) {
            pose.ring_miss_max = (RING_ALLOWANCE_RATIO * p98(misses) + RING_ALLOWANCE).min(RING_MISS_MAX);
        }
        Ok(())
    }

    /// Learns from the parts shown how well they fit, and what they have round them.
    fn measure_parts(&self, model: &mut PartModel) -> Result<(), TeachError> {
        let mut misses: Vec<Vec<f32>> = vec![Vec::new(); self.spec.poses.len()];
        let mut evidences: Vec<Vec<f32>> = vec![Vec::new(); self.spec.poses.len()];
        let mut samples = vec![Samples::default(); self.spec.poses.len()];
        self.look(model, |detector, frame, found| {
            let view = detector.view(&frame.platen_from_tray);
            for part in frame.parts {
                let near_m = SAME_PLACE_RATIO * self.spec.poses[part.pose].radius_m();
                let is_it =
                    |found: &&Found| found.pose == part.pose && (found.fit.centre - part.place).norm() <= near_m;
                if let Some(found) = found.iter().find(is_it) {
                    misses[part.pose].push(found.fit.cost - detector.sought[part.pose].noise_miss);
                    evidences[part.pose].push(found.evidence_per_texel);
                    samples[part.pose].add(&detector.sample(&view, found));
                }
            }
        })?;
        for (pose, evidences) in model.poses.iter_mut().zip(&mut evidences).filter(|(_, shown)| !shown.is_empty()) {
            evidences.sort_by(f32::total_cmp);
            pose.evidence_min = EVIDENCE_RATIO_MIN * evidences[evidences.len() / 2];
        }
        for ((pose, misses), samples) in model.poses.iter_mut().zip(&mut misses).zip(samples) {
            if misses.is_empty() {
                continue;
            }
            pose.miss_max = MISS_ALLOWANCE_RATIO * p98(misses).max(0.0) + MISS_ALLOWANCE;
            let surround = samples.told(SURROUND_SHOWN_MIN).or(&pose.surround());
            pose.set_surround(&surround);
        }
        Ok(())
    }

    /// Whether what was learned recognises what it was learned from.
    fn tell_apart(&self, model: &PartModel) -> Result<(), TeachError> {
        let contrast_min_levels = self.spec.contrast_min_levels;
        let config = SelectorConfig { contrast_min_levels, ..SelectorConfig::default() };
        let mut tally = vec![(0_usize, 0_usize, 0_usize); self.spec.poses.len()];
        let mut sight = Sight::new(self.camera, self.tray, model);
        for (index, frame) in self.frames.iter().enumerate().filter(|(_, frame)| !frame.parts.is_empty()) {
            let (candidates, _) = sight
                .look(frame.image, &frame.platen_from_tray, &config)
                .map_err(|source| TeachError::Frame { index, source })?;
            for part in frame.parts {
                let (shown, recognised, mistaken) = &mut tally[part.pose];
                *shown += 1;
                let reach_m = SAME_PLACE_RATIO * self.spec.poses[part.pose].radius_m();
                let seen = candidates.iter().find(|candidate| (candidate.centre() - part.place).norm() <= reach_m);
                match seen.and_then(|candidate| candidate.pose) {
                    Some(pose) if pose == part.pose => *recognised += 1,
                    Some(_) => *mistaken += 1,
                    None => {}
                }
            }
        }
        for (pose, (shown, recognised, mistaken)) in tally.into_iter().enumerate() {
            if !is_learned(shown, recognised, mistaken) {
                return Err(TeachError::NotRecognised { pose, shown, recognised, mistaken });
            }
        }
        Ok(())
    }
}

/// Whether a pose is learned of which so many parts are recognised and so many taken for another pose. A few may be missed by chance, and do
/// no harm: a pose that is hardly shown stays hardly known, as one that is not shown at all.
fn is_learned(shown: usize, recognised: usize, mistaken: usize) -> bool {
    let shown_f64 = shown as f64;
    let is_known = shown < SHOWN_MIN || recognised as f64 >= RECOGNISED_RATIO_MIN * shown_f64;
    is_known && mistaken as f64 <= MISTAKEN_RATIO_MAX * shown_f64
}

/// The value that 98 % do not exceed; 0 without values.
fn p98(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() * 98 / 100).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_learned_if_most_are_recognised_and_next_to_none_is_taken_for_another_but_a_few_may_be_missed() {
        for (shown, recognised, mistaken, wanted) in [
            (0, 0, 0, true),
            (3, 0, 0, true),
            (3, 2, 1, false),
            (4, 3, 0, true),
            (4, 2, 0, false),
            (10, 6, 0, true),
            (10, 5, 0, false),
            (25, 24, 1, true),
            (24, 23, 1, false),
        ] {
            assert_eq!(is_learned(shown, recognised, mistaken), wanted, "{recognised} of {shown}, {mistaken} mistaken");
        }
    }
}
