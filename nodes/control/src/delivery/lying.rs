//! The parts as they lie since the tray was shaken last: gentle moves change nothing of that.

use super::choice::{CandidateFrame, OfferedPart};
use super::request::Stamp;

/// A part that lies farther from where it lay has slid, m: more than the camera errs.
const SLID_M: f64 = 0.3e-3;

/// Parts at rest.
#[derive(Clone, Debug)]
pub(super) struct Lying {
    /// When they were seen.
    pub(super) look: Stamp,
    /// Those that were seen, but for those that were taken or are not to be taken.
    pub(super) parts: Vec<OfferedPart>,
}

impl Lying {
    pub(super) fn seen(frame: &CandidateFrame) -> Self {
        Self { look: frame.stamp, parts: frame.candidates.clone() }
    }

    /// A part is there no longer, or is not to be taken.
    pub(super) fn forget(&mut self, id: u64) {
        self.parts.retain(|part| part.id != id);
    }

    /// Takes a later look at the parts, of which some may not be in the picture. Returns how far the one that slid farthest has
    /// slid, m, if any has.
    pub(super) fn look_again(&mut self, frame: &CandidateFrame) -> Option<f64> {
        let mut farthest_m: Option<f64> = None;
        for part in &mut self.parts {
            let Some(seen) = frame.candidates.iter().find(|seen| seen.id == part.id) else { continue };
            let slid_m = (seen.position_in_tray_m - part.position_in_tray_m).norm();
            if slid_m > SLID_M {
                part.position_in_tray_m = seen.position_in_tray_m;
                farthest_m = Some(farthest_m.map_or(slid_m, |m| m.max(slid_m)));
            }
        }
        farthest_m
    }
}

#[cfg(test)]
mod tests {
    use super::super::tour::testing::candidate;
    use super::*;

    fn frame(candidates: &[OfferedPart]) -> CandidateFrame {
        CandidateFrame { stamp: Stamp::from_secs(2), candidates: candidates.to_vec(), is_blind: false }
    }

    #[test]
    fn a_part_that_slid_is_noticed_once_and_one_that_is_out_of_the_picture_has_not() {
        let mut lying = Lying::seen(&frame(&[candidate(1, 0.0, -0.07), candidate(2, 0.02, -0.07)]));
        assert_eq!(lying.look_again(&frame(&[candidate(1, 0.0002, -0.07)])), None);
        let slid_m = lying.look_again(&frame(&[candidate(1, 0.0, -0.07), candidate(2, 0.021, -0.07)]));
        assert!((slid_m.unwrap() - 0.001).abs() < 1e-9);
        assert_eq!(lying.look_again(&frame(&[candidate(2, 0.021, -0.07)])), None);
        lying.forget(2);
        assert_eq!(lying.parts.iter().map(|part| part.id).collect::<Vec<_>>(), [1]);
    }
}
