//! What frames tell of a part's pose, one after the other.

use super::Candidate;

/// Evidence, in frames, for no pose in particular that a part starts with; it fades as what frames show does.
const DOUBT_FRAMES: f64 = 0.3;
/// What a frame counts, in frames, that shows a thing but no pose: a smear or a neighbour hides a pose, and is no sign of another.
const POSELESS_FRAMES: f64 = 0.4;

/// Evidence for a part's poses, in frames.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    /// For each pose.
    of_poses: Vec<f64>,
    /// What there could be for a pose.
    total: f64,
}

impl Evidence {
    pub(super) fn new(pose_count: usize) -> Self {
        Self { of_poses: vec![0.0; pose_count], total: DOUBT_FRAMES }
    }

    /// Takes in what a frame shows; what was known before counts `memory` of what it did.
    pub(super) fn weigh(&mut self, candidate: &Candidate, memory: f64) {
        let counts = if candidate.pose.is_some() { 1.0 } else { POSELESS_FRAMES };
        self.total = self.total * memory + counts;
        for (pose, evidence) in self.of_poses.iter_mut().enumerate() {
            *evidence *= memory;
            if candidate.pose == Some(pose) {
                *evidence += candidate.confidence;
            }
        }
    }

    /// The pose with most evidence, and its lead over all others as a share of what there could be.
    pub(super) fn pose(&self) -> (Option<usize>, f64) {
        let sum: f64 = self.of_poses.iter().sum();
        let mut best: Option<(usize, f64)> = None;
        for (pose, evidence) in self.of_poses.iter().copied().enumerate() {
            if evidence > best.map_or(0.0, |(_, most)| most) {
                best = Some((pose, evidence));
            }
        }
        let Some((pose, most)) = best else {
            return (None, 0.0);
        };
        let lead = most - (sum - most);
        (Some(pose), (lead / self.total).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SelectorConfig, TrackerConfig};
    use super::*;

    /// How sure a part is of a pose after frames that showed it with such confidence, or no pose.
    fn confidence_after(frames: &[Option<f64>], memory: f64) -> f64 {
        let mut evidence = Evidence::new(2);
        for confidence in frames {
            let candidate = Candidate {
                x_m: 0.0,
                y_m: -0.06,
                yaw_rad: None,
                likeness: 0,
                pose: confidence.map(|_| 0),
                confidence: confidence.unwrap_or(0.0),
                part_gap_m: 0.004,
                wall_gap_m: 0.02,
                on_plateau: true,
            };
            evidence.weigh(&candidate, memory);
        }
        evidence.pose().1
    }

    fn is_sure_after(frames: &[Option<f64>]) -> bool {
        confidence_after(frames, TrackerConfig::default().memory) >= SelectorConfig::default().confidence_min
    }

    #[test]
    fn a_part_becomes_as_sure_as_its_frames_are_and_two_sure_ones_are_enough() {
        for memory in [0.0, 0.5, 0.8, 0.95] {
            for confidence in [0.6, 0.91, 1.0] {
                let last = confidence_after(&[Some(confidence); 150], memory);
                assert!((last - confidence).abs() < 1e-3, "{memory} {confidence} {last}");
            }
        }
        for (frames, is_sure) in [(1, false), (2, true)] {
            assert_eq!(is_sure_after(&vec![Some(1.0); frames]), is_sure, "{frames}");
        }
    }

    #[test]
    fn a_part_stays_sure_through_a_frame_without_a_pose_and_one_without_in_each_third_never_is() {
        let sure = [Some(1.0); 20];
        assert!(is_sure_after(&[&sure[..], &[None, Some(1.0)]].concat()));
        assert!(!is_sure_after(&[&sure[..], &[None, None, None, Some(1.0)]].concat()));
        for frames in 2..60 {
            let two_of_three: Vec<_> = (0..frames).map(|frame| (frame % 3 != 1).then_some(1.0)).collect();
            assert!(!is_sure_after(&two_of_three), "{frames}");
        }
    }
}
