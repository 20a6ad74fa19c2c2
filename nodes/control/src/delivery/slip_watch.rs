//! Whether parts stay where they lie while they are carried.
//!
//! Nobody sees them on the way. But they are seen at rest before a trip and after it, in the same place and light: what is
//! measured wrong is so both times, and what lies elsewhere afterwards slid. What slides back on the way home lies where it lay;
//! then the manipulator tells, which does not find it. By how much the friction is less than believed none of this tells. So
//! moves are made a little gentler each time.

use std::fmt;

use super::choice::{CandidateFrame, OfferedPart};
use super::protocol::Warning;

/// What tells that parts slid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slip {
    /// They lie elsewhere than before, by so much, m.
    Moved(f64),
    /// So many parts in a row were not where the manipulator looked for them.
    NotTaken(u32),
}

impl fmt::Display for Slip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Moved(slid_m) => write!(f, "parts slid by {:.2} mm while they were carried", 1e3 * slid_m),
            Self::NotTaken(parts) => write!(f, "{parts} parts in a row were not taken, as if they had slid"),
        }
    }
}

/// Compares how parts lie before and after a trip, and counts those that are not taken.
#[derive(Clone, Debug, Default)]
pub(super) struct SlipWatch {
    /// As they lay when the trip under way began.
    before: Vec<OfferedPart>,
    not_taken: u32,
    /// What was said last.
    said: Option<Warning>,
}

impl SlipWatch {
    /// How far the middle one of the parts must have moved, m. Without a slip it was up to 0.02 mm, and a single part up to 0.06 mm.
    const SLID_M: f64 = 0.12e-3;
    /// A gripper misses one now and then.
    const NOT_TAKEN: u32 = 2;

    /// A trip begins with parts that lie so.
    pub(super) fn depart(&mut self, parts: &[OfferedPart]) {
        self.before = parts.to_vec();
    }

    /// Parts are moved on purpose.
    pub(super) fn forget(&mut self) {
        self.before.clear();
    }

    /// Whether the parts that were there before the trip have slid, once at its end.
    pub(super) fn arrive(&mut self, after: &CandidateFrame) -> Option<Slip> {
        let before = std::mem::take(&mut self.before);
        let moved_m = |part: &OfferedPart| {
            let distance_m = |other: &OfferedPart| (other.position_in_tray_m - part.position_in_tray_m).norm();
            // The place of one that was taken is no nearer to another than parts can be.
            let nearest_m = after.candidates.iter().map(distance_m).fold(f64::INFINITY, f64::min);
            (nearest_m < part.radius_m).then_some(nearest_m)
        };
        let mut moved_m: Vec<f64> = before.iter().filter_map(moved_m).collect();
        moved_m.sort_by(f64::total_cmp);
        // Of two the one that moved less: a single part may have been pushed.
        let middle_m = *moved_m.get(moved_m.len().checked_sub(1)? / 2)?;
        (middle_m > Self::SLID_M).then_some(Slip::Moved(middle_m))
    }

    /// Whether a part that the manipulator took or did not take tells of a slip.
    pub(super) fn hand_over(&mut self, taken: bool) -> Option<Slip> {
        self.not_taken = if taken { 0 } else { self.not_taken + 1 };
        (self.not_taken >= Self::NOT_TAKEN).then(|| Slip::NotTaken(std::mem::take(&mut self.not_taken)))
    }

    /// Notes what is to be said of a slip, and tells whether it is news.
    pub(super) fn is_news(&mut self, warning: &Warning) -> bool {
        let same = |said: &Warning| matches!((said, warning), (Warning::SlidAllTheSame(_), Warning::SlidAllTheSame(_)));
        let is_news = !self.said.as_ref().is_some_and(same);
        self.said = Some(warning.clone());
        is_news
    }

    /// What was said last.
    pub(super) fn said(&self) -> Option<&Warning> {
        self.said.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::super::request::Stamp;
    use super::super::tour::testing::candidate;
    use super::*;

    fn frame(parts: &[(f64, f64)]) -> CandidateFrame {
        let candidates = parts.iter().zip(1..).map(|(&(x_m, y_m), id)| candidate(id, x_m, y_m)).collect();
        CandidateFrame { stamp: Stamp::ZERO, candidates, is_blind: false }
    }

    fn slid_m(before: &[(f64, f64)], after: &[(f64, f64)]) -> Option<f64> {
        let mut watch = SlipWatch::default();
        watch.depart(&frame(before).candidates);
        let slip = watch.arrive(&frame(after));
        assert_eq!(watch.arrive(&frame(after)), None, "once");
        slip.map(|slip| match slip {
            Slip::Moved(slid_m) => slid_m,
            Slip::NotTaken(_) => f64::NAN,
        })
    }

    #[test]
    fn two_parts_in_a_row_that_are_not_taken_tell_of_a_slip_and_one_does_not() {
        let mut watch = SlipWatch::default();
        let told = [false, true, false, false, false, false].map(|taken| watch.hand_over(taken));
        assert_eq!(told, [None, None, None, Some(Slip::NotTaken(2)), None, Some(Slip::NotTaken(2))]);
    }

    #[test]
    fn what_lies_elsewhere_after_a_trip_has_slid() {
        let before = [(0.0, -0.07), (0.02, -0.07), (0.04, -0.06)];
        let moved = |by_m: f64| before.map(|(x_m, y_m)| (x_m + by_m, y_m));
        assert!((slid_m(&before, &moved(0.2e-3)).unwrap() - 0.2e-3).abs() < 1e-9);
        assert_eq!(slid_m(&before, &moved(0.05e-3)), None);
        // What was taken is not what slid, nor is one that was pushed.
        assert_eq!(slid_m(&before, &[before[0], before[2]]), None);
        assert_eq!(slid_m(&before, &[before[0], (0.020_5, -0.07), before[2]]), None);
        assert_eq!(slid_m(&before[..2], &[before[0], (0.020_5, -0.07)]), None);
        assert!(slid_m(&before[..1], &[(0.0, -0.069_8)]).is_some());
        assert_eq!(slid_m(&before, &[]), None);
        assert_eq!(slid_m(&[], &before), None);
    }

    #[test]
    fn what_is_moved_on_purpose_has_not_slid() {
        let mut watch = SlipWatch::default();
        watch.depart(&frame(&[(0.0, -0.07)]).candidates);
        watch.forget();
        assert_eq!(watch.arrive(&frame(&[(0.0, -0.069)])), None);
    }
}
