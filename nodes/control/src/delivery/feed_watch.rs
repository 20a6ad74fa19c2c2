//! Whether parts on the plateau move as fast as the waveform should move them.
//!
//! The courier's driver knows what its sensor sees of the courier; what the tray does to the parts only the camera sees. So
//! the angular speed of every part that has room is compared with that which the waveform gives at its radius, by what is
//! believed of the friction, and the median of many is judged: parts that push each other, or are taken for one another, are
//! few. The ramp is not seen.

use std::collections::{BTreeMap, VecDeque};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::choice::{CandidateFrame, angle_rad};
use super::drift::turn_rad;
use super::request::Stamp;

/// How fast a waveform should feed parts at one radius of the plateau.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedRate {
    /// Distance from the tray's axis, m.
    pub radius_m: f64,
    /// Mean angular speed relative to the tray, rad/s, positive towards the drop-off.
    pub rate_rad_s: f64,
}

/// Compares how parts move with how they should.
#[derive(Clone, Debug)]
pub(super) struct FeedWatch {
    /// By growing radius; empty: not known, and nothing is compared.
    expected: Vec<FeedRate>,
    /// Period of the waveform that gives these rates, s; 0: not known.
    period_s: f64,
    deviation_max: f64,
    /// Where each part was when it was first seen in the stretch that is measured now.
    begun: BTreeMap<u64, (Stamp, f64)>,
    /// Speeds over those expected, the oldest first.
    ratios: VecDeque<f64>,
    /// The ratio that is too far off, as told.
    off: Option<f64>,
}

impl FeedWatch {
    /// Speeds that are judged together, and the fewest that are judged.
    const RATIOS: usize = 40;
    const RATIOS_MIN: usize = 12;
    /// A part is followed at least so long for one speed, s: the longer, the less the camera's noise counts.
    const STRETCH_S: f64 = 0.3;
    /// And for a whole number of periods, up to this share of the time: within a period parts go by jerks.
    const PERIOD_MISS_MAX: f64 = 0.03;
    /// Free gap to the next part below which parts may push each other, m.
    const ROOM_M: f64 = 1e-3;
    /// Parts that should turn by less in a stretch tell nothing, rad.
    const TURN_RAD_MIN: f64 = 0.01;
    /// What was told is taken back when the deviation has fallen to this share of its bound, and told anew when the ratio
    /// has changed by this.
    const TAKEN_BACK: f64 = 0.7;
    const CHANGE: f64 = 0.1;

    pub(super) fn new(deviation_max: f64) -> Self {
        let (begun, ratios) = (BTreeMap::new(), VecDeque::new());
        Self { expected: Vec::new(), period_s: 0.0, deviation_max, begun, ratios, off: None }
    }

    /// Takes what is to be expected from now on, by growing radius, of a waveform of this period.
    pub(super) fn expect(&mut self, expected: Vec<FeedRate>, period_s: f64) {
        *self = Self { expected, period_s, ..Self::new(self.deviation_max) };
    }

    /// The vibration ends, or what is seen was seen while it did not run steadily.
    pub(super) fn pause(&mut self) {
        self.begun.clear();
    }

    /// Takes a frame of parts under a steady vibration.
    pub(super) fn see(&mut self, frame: &CandidateFrame) {
        let mut begun = BTreeMap::new();
        for candidate in frame.candidates.iter().filter(|candidate| candidate.part_gap_m > Self::ROOM_M) {
            let now_rad = angle_rad(candidate);
            let mut from = (frame.stamp, now_rad);
            if let Some(&(since, from_rad)) = self.begun.get(&candidate.id) {
                let elapsed_s = frame.stamp.saturating_sub(since).as_secs_f64();
                if !self.is_stretch(elapsed_s) {
                    from = (since, from_rad);
                } else if let Some(expected_rad_s) = self.expected_rad_s(candidate.position_in_tray_m.norm()) {
                    let expected_rad = expected_rad_s * elapsed_s;
                    if expected_rad.abs() > Self::TURN_RAD_MIN {
                        self.ratios.push_back(turn_rad(from_rad, now_rad) / expected_rad);
                    }
                }
            }
            begun.insert(candidate.id, from);
        }
        self.begun = begun;
        let surplus = self.ratios.len().saturating_sub(Self::RATIOS);
        self.ratios.drain(..surplus);
        self.judge();
    }

    /// Whether a part that was followed for so long shows its mean speed.
    fn is_stretch(&self, elapsed_s: f64) -> bool {
        let periods = if self.period_s > 0.0 { elapsed_s / self.period_s } else { 0.0 };
        let miss_s = (periods - periods.round()).abs() * self.period_s;
        elapsed_s >= Self::STRETCH_S && miss_s <= Self::PERIOD_MISS_MAX * elapsed_s
    }

    /// Speed over that expected, if it is off by more than allowed.
    pub(super) fn off(&self) -> Option<f64> {
        self.off
    }

    fn judge(&mut self) {
        if self.ratios.len() < Self::RATIOS_MIN {
            return;
        }
        let mut sorted: Vec<f64> = self.ratios.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let ratio = sorted[sorted.len() / 2];
        let deviation = (ratio - 1.0).abs();
        self.off = match self.off {
            None => (deviation > self.deviation_max).then_some(ratio),
            Some(_) if deviation < Self::TAKEN_BACK * self.deviation_max => None,
            Some(told) if (ratio - told).abs() > Self::CHANGE => Some(ratio),
            told => told,
        };
    }

    /// What is expected at a radius, between those that are known; at those beyond, what the nearest has.
    fn expected_rad_s(&self, radius_m: f64) -> Option<f64> {
        let beyond = self.expected.partition_point(|rate| rate.radius_m < radius_m);
        let (inner, outer) = (self.expected.get(beyond.saturating_sub(1))?, self.expected.get(beyond));
        let outer = outer.unwrap_or(inner);
        let span_m = outer.radius_m - inner.radius_m;
        let share = if span_m > 0.0 { ((radius_m - inner.radius_m) / span_m).clamp(0.0, 1.0) } else { 0.0 };
        Some(inner.rate_rad_s + share * (outer.rate_rad_s - inner.rate_rad_s))
    }
}

#[cfg(test)]
mod tests {
    use super::super::choice::OfferedPart;
    use super::super::tour::testing::candidate;
    use super::*;

    const EXPECTED: [FeedRate; 2] =
        [FeedRate { radius_m: 0.06, rate_rad_s: 0.2 }, FeedRate { radius_m: 0.08, rate_rad_s: 0.3 }];

    /// Two parts with room at 70 mm, where 0.25 rad/s is expected, and more that push each other and stand still.
    fn frame(at_ms: u64, turned_rad: f64, pushing: u64) -> CandidateFrame {
        let at = |id: u64, angle: f64| candidate(id, 0.07 * angle.cos(), 0.07 * angle.sin());
        let mut candidates = vec![at(1, 3.5 + turned_rad), at(2, 4.5 + turned_rad)];
        let crowd = (0..pushing).map(|index| OfferedPart { part_gap_m: 1e-4, ..at(10 + index, 5.5) });
        candidates.extend(crowd);
        CandidateFrame { stamp: Stamp::from_millis(at_ms), candidates, is_blind: false }
    }

    fn watched(rate_rad_s: f64, frames: u32) -> FeedWatch {
        let mut watch = FeedWatch::new(0.15);
        watch.expect(EXPECTED.to_vec(), 0.1);
        watch_on(&mut watch, rate_rad_s, frames);
        watch
    }

    fn watch_on(watch: &mut FeedWatch, rate_rad_s: f64, frames: u32) {
        watch.pause();
        for step in 0..frames {
            watch.see(&frame(u64::from(step) * 100, rate_rad_s * 0.1 * f64::from(step), 5));
        }
    }

    #[test]
    fn parts_that_move_as_computed_are_no_reason_for_a_word_and_others_are() {
        for (rate_rad_s, off) in [(0.25, None), (0.22, None), (0.28, None), (0.15, Some(0.6)), (0.325, Some(1.3))] {
            let told = watched(rate_rad_s, 60).off();
            match (told, off) {
                (Some(told), Some(off)) => assert!((told - off).abs() < 1e-9, "{told} {off}"),
                (told, off) => assert_eq!(told, off, "{rate_rad_s}"),
            }
        }
    }

    #[test]
    fn too_few_parts_say_nothing_and_an_unknown_feed_is_not_judged() {
        assert_eq!(watched(0.1, 10).off(), None);
        let mut unknown = FeedWatch::new(0.15);
        watch_on(&mut unknown, 0.1, 60);
        assert_eq!(unknown.off(), None);
    }

    #[test]
    fn what_was_told_is_taken_back_when_parts_move_as_computed_again() {
        let mut watch = watched(0.15, 60);
        watch_on(&mut watch, 0.24, 80);
        assert_eq!(watch.off(), None);
    }

    #[test]
    fn a_stretch_does_not_reach_over_a_pause() {
        let mut watch = watched(0.25, 60);
        // A second in which nothing moved.
        for step in 0..60_u32 {
            watch.pause();
            watch.see(&frame(7000 + u64::from(step) * 1000, 1.5 + 0.025 * f64::from(step), 0));
        }
        assert_eq!(watch.off(), None);
    }

    /// Whether a word comes of parts that go by jerks, each in the first third of a period, at this share of the speed that the
    /// waveform should give them on the whole, in pictures so far apart; the phase in which they were taken changes with each
    /// of several feedings.
    fn told_of_jerks(period_s: f64, frame_ms: u64, ratio: f64) -> Option<f64> {
        let mut watch = FeedWatch::new(0.15);
        watch.expect(EXPECTED.to_vec(), period_s);
        (0..30_u32).find_map(|feeding| {
            watch.pause();
            let phase_s = f64::from(feeding) * 0.013;
            (0..3000 / frame_ms).find_map(|step| {
                let periods = (phase_s + (step * frame_ms) as f64 * 1e-3) / period_s;
                let jerked = periods.floor() + (3.0 * (periods - periods.floor())).min(1.0);
                watch.see(&frame(step * frame_ms, ratio * 0.25 * period_s * jerked, 0));
                watch.off()
            })
        })
    }

    #[test]
    fn within_a_period_parts_may_go_by_jerks() {
        for (period_s, frame_ms) in [(0.033, 100), (0.1, 100), (0.14, 100), (0.17, 50), (0.17, 100), (0.25, 40)] {
            assert_eq!(told_of_jerks(period_s, frame_ms, 1.0), None, "{period_s} {frame_ms}");
            for ratio in [0.7, 1.3] {
                let told = told_of_jerks(period_s, frame_ms, ratio);
                assert!(told.is_some_and(|told| (told - ratio).abs() < 0.1), "{period_s} {frame_ms} {told:?}");
            }
        }
    }

    #[test]
    fn a_few_parts_that_stand_still_do_not_count_against_many_that_move() {
        let mut watch = FeedWatch::new(0.15);
        watch.expect(EXPECTED.to_vec(), 0.1);
        for step in 0..60_u32 {
            let mut seen = frame(u64::from(step) * 100, 0.25 * 0.1 * f64::from(step), 0);
            seen.candidates.push(candidate(3, 0.0, -0.07));
            watch.see(&seen);
        }
        assert_eq!(watch.off(), None);
    }

    #[test]
    fn what_was_told_is_told_anew_when_it_has_changed_by_a_tenth_and_not_before() {
        let mut watch = watched(0.15, 60);
        for (rate_rad_s, told) in [(0.13, 0.6), (0.11, 0.44), (0.13, 0.44)] {
            watch_on(&mut watch, rate_rad_s, 80);
            assert!((watch.off().unwrap() - told).abs() < 1e-9, "{rate_rad_s} {:?}", watch.off());
        }
    }

    #[test]
    fn between_two_radii_the_rate_is_between_theirs() {
        let watch = watched(0.25, 1);
        for (radius_m, expected) in [(0.05, 0.2), (0.06, 0.2), (0.065, 0.225), (0.08, 0.3), (0.09, 0.3)] {
            assert!((watch.expected_rad_s(radius_m).unwrap() - expected).abs() < 1e-12, "{radius_m}");
        }
    }
}
