//! What was learned, looked at with the pictures that it was learned from.

use super::super::SelectorConfig;
use super::super::candidate::{self, EDGE_STRIP_PX};
use super::super::detector::{Detector, Found};
use super::super::hull::distance_m;
use super::super::template::PartModel;
use super::super::template::RING_MISS_MAX;
use super::{TeachError, TeachFrame, TeachSpec};
use feeder_model::camera::{CameraModel, MountedTray, single};

/// Share of the parts shown in a pose that must be recognised, once it is learned, and that may be taken for another.
const RECOGNISED_RATIO_MIN: f64 = 0.6;
const MISTAKEN_RATIO_MAX: f64 = 0.04;
/// What the rings of parts among others may miss by more than those of parts shown: relative, and beside.
const RING_ALLOWANCE_RATIO: f32 = 1.5;
const RING_ALLOWANCE: f32 = 1.0;
/// What parts among others may miss by more than those shown: relative, and beside.
const MISS_ALLOWANCE_RATIO: f32 = 1.5;
const MISS_ALLOWANCE: f32 = 1.2;
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
        let mut detector = Detector::new(self.camera, self.tray, model);
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
    fn measure_rings(&self, model: &mut PartModel) -> Result<(), TeachError> {
        let mut misses: Vec<Vec<f32>> = vec![Vec::new(); self.spec.poses.len()];
        self.look(model, |detector, frame, _| {
            let view = detector.view(&frame.platen_from_tray);
            for part in frame.parts {
                misses[part.pose].extend(detector.ring_miss(&view, part.pose, part.place));
            }
        })?;
        for (pose, misses) in model.poses.iter_mut().zip(&mut misses) {
            pose.ring_miss_max = (RING_ALLOWANCE_RATIO * p98(misses) + RING_ALLOWANCE).min(RING_MISS_MAX);
        }
        Ok(())
    }

    /// Learns from parts that lie alone how well they fit, and how far their shade reaches: what stands out from the plateau
    /// beside them.
    fn measure_parts(&self, model: &mut PartModel) -> Result<(), TeachError> {
        let mut misses: Vec<Vec<f32>> = vec![Vec::new(); self.spec.poses.len()];
        let mut reaches_m = vec![0.0_f64; self.spec.poses.len()];
        self.look(model, |detector, frame, found| {
            for part in frame.parts {
                let near_m = SAME_PLACE_RATIO * self.spec.poses[part.pose].radius_m();
                let is_it =
                    |found: &&Found| found.pose == part.pose && (found.fit.centre - part.place).norm() <= near_m;
                let beyond_noise = |found: &Found| found.fit.cost - detector.sought[part.pose].noise_miss;
                misses[part.pose].extend(found.iter().find(is_it).map(beyond_noise));
            }
            let outlines: Vec<_> =
                frame.parts.iter().map(|part| detector.outline(part.pose, part.place, part.yaw_rad)).collect();
            for point in detector.unexplained(&detector.view(&frame.platen_from_tray), EDGE_STRIP_PX) {
                let distances_m = outlines.iter().map(|outline| distance_m(outline, &point)).enumerate();
                if let Some((part, distance_m)) = distances_m.min_by(|(_, a), (_, b)| a.total_cmp(b)) {
                    let reach_m = &mut reaches_m[frame.parts[part].pose];
                    *reach_m = reach_m.max(distance_m);
                }
            }
        })?;
        for ((pose, misses), reach_m) in model.poses.iter_mut().zip(&mut misses).zip(reaches_m) {
            pose.miss_max = MISS_ALLOWANCE_RATIO * p98(misses).max(0.0) + MISS_ALLOWANCE;
            // Two pixels more: the outline is fitted to a pixel, and more noise frays the shade.
            pose.shade_reach_m = reach_m + 2.0 * pose.texel_m;
        }
        Ok(())
    }

    /// Whether what was learned recognises what it was learned from.
    fn tell_apart(&self, model: &PartModel) -> Result<(), TeachError> {
        let contrast_min_levels = self.spec.contrast_min_levels;
        let config = SelectorConfig { contrast_min_levels, ..SelectorConfig::default() };
        let mut tally = vec![(0_usize, 0_usize, 0_usize); self.spec.poses.len()];
        self.look(model, |detector, frame, found| {
            let candidates = candidate::judge(detector, &detector.view(&frame.platen_from_tray), &config, found);
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
        })?;
        for (pose, (shown, recognised, mistaken)) in tally.into_iter().enumerate() {
            let shown_f64 = shown as f64;
            let unknown = (recognised as f64) < RECOGNISED_RATIO_MIN * shown_f64;
            if unknown || mistaken as f64 > MISTAKEN_RATIO_MAX * shown_f64 {
                return Err(TeachError::NotRecognised { pose, shown, recognised, mistaken });
            }
        }
        Ok(())
    }
}

/// The value that 98 % do not exceed; 0 without values.
fn p98(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() * 98 / 100).copied().unwrap_or(0.0)
}
