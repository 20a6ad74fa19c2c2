//! Whether as many parts come up the ramp as the waveform should bring.
//!
//! The ramp is not seen. But how many parts are in the feeder is known, and how many of them lie on the plateau is seen; of
//! those that are left the waveform should bring so many up each second, if they are spread evenly over the ramp. Parts that
//! cross a line on the plateau just beyond the ramp are counted against that. Both fade with the parts that were to be
//! expected, however fast they come. Heaps and places where nothing climbs are not known: only far too few, and fewer than
//! chance explains, are a reason for a word.

use std::collections::BTreeMap;

use super::choice::{CandidateFrame, angle_rad};
use super::request::Stamp;

/// Compares how many parts come with how many should.
#[derive(Clone, Debug)]
pub(super) struct ArrivalWatch {
    /// Share of the parts on the ramp that should come up each second, 1/s; nothing: not known.
    climb_per_s: Option<f64>,
    /// Parts in the feeder.
    parts: u32,
    /// The line that is crossed, rad.
    line_rad: f64,
    /// Time for which the first parts are still on their way from the end of the ramp to the line, s.
    under_way_s: f64,
    /// Where the parts of the last frame were, rad.
    last: Option<(Stamp, BTreeMap<u64, f64>)>,
    /// Parts that came and that should have come, both fading.
    arrived: f64,
    expected: f64,
    /// Parts that came over those expected when they became too few, while they are.
    few: Option<f64>,
    /// Parts on the ramp.
    on_ramp: f64,
    /// Parts that should have come since somebody waits for one.
    due: f64,
}

impl ArrivalWatch {
    /// The line is so far beyond the ramp's end, rad: parts are seen on both sides of it.
    const BEYOND_RAD: f64 = 0.2;
    /// Parts expected after which a count is 1/e.
    const MEMORY: f64 = 30.0;
    /// Chance explains so many times the square root of the parts expected, if parts come independently of each other.
    const CHANCE: f64 = 2.3;
    /// Fewer than this share of those expected are too few, and from this share on they are enough again.
    const FEW: f64 = 0.35;
    const ENOUGH: f64 = 0.6;
    /// So many should have come before it means anything that none of them fits, or that none came.
    const DUE: f64 = 6.0;

    /// A watch over a tray whose ramp ends at `ramp_angle_rad`.
    pub(super) fn new(ramp_angle_rad: f64) -> Self {
        Self {
            climb_per_s: None,
            parts: 0,
            line_rad: ramp_angle_rad + Self::BEYOND_RAD,
            under_way_s: 0.0,
            last: None,
            arrived: 0.0,
            expected: 0.0,
            few: None,
            on_ramp: 0.0,
            due: 0.0,
        }
    }

    /// Takes which share of the parts on the ramp should come up each second from now on, 1/s.
    pub(super) fn expect(&mut self, climb_per_s: Option<f64>) {
        (self.climb_per_s, self.last, self.few) = (climb_per_s, None, None);
        (self.arrived, self.expected) = (0.0, 0.0);
        // As fast as on the ramp, at least.
        let ramp_rad = self.line_rad - Self::BEYOND_RAD;
        self.under_way_s = climb_per_s.map_or(0.0, |climb_per_s| Self::BEYOND_RAD / (climb_per_s * ramp_rad));
    }

    /// Somebody waits for a part from now on.
    pub(super) fn wait(&mut self) {
        self.due = 0.0;
    }

    /// Whether parts are on the ramp, and it is too soon to wonder that none has come that fits.
    pub(super) fn is_too_soon(&self) -> bool {
        self.climb_per_s.is_some() && self.on_ramp > 0.0 && self.due < Self::DUE
    }

    /// Takes how many parts there are in the feeder.
    pub(super) fn carry(&mut self, parts: u32) {
        self.parts = parts;
    }

    /// The vibration ends, or has only just begun.
    pub(super) fn pause(&mut self) {
        self.last = None;
    }

    /// Takes a frame of parts under vibration.
    pub(super) fn see(&mut self, frame: &CandidateFrame) {
        let Some(climb_per_s) = self.climb_per_s.filter(|_| !frame.is_blind) else { return self.pause() };
        let places: BTreeMap<u64, f64> = frame.candidates.iter().map(|part| (part.id, angle_rad(part))).collect();
        let crossed = |before: &BTreeMap<u64, f64>| {
            let crosses = |(id, now_rad): (&u64, &f64)| {
                *now_rad >= self.line_rad && before.get(id).is_some_and(|was_rad| *was_rad < self.line_rad)
            };
            places.iter().filter(|part| crosses(*part)).count()
        };
        if let Some((since, before)) = &self.last {
            let elapsed_s = frame.stamp.saturating_sub(*since).as_secs_f64();
            let seen = u32::try_from(frame.candidates.len()).unwrap_or(u32::MAX);
            self.on_ramp = f64::from(self.parts.saturating_sub(seen));
            let arrived = crossed(before) as f64;
            let coming_per_s = climb_per_s * self.on_ramp;
            self.due += coming_per_s * elapsed_s;
            let expected = coming_per_s * (elapsed_s - self.under_way_s).max(0.0);
            self.under_way_s = (self.under_way_s - elapsed_s).max(0.0);
            let fading = (-expected / Self::MEMORY).exp();
            self.arrived = self.arrived * fading + arrived;
            self.expected = self.expected * fading + expected;
        }
        self.last = Some((frame.stamp, places));
        let by_chance = self.expected - Self::CHANCE * self.expected.sqrt();
        let too_few = (Self::FEW * self.expected).min(by_chance);
        let enough = if self.few.is_some() { Self::ENOUGH * self.expected } else { too_few };
        // That the share changes is no news.
        self.few = (self.arrived < enough).then(|| self.few.unwrap_or(self.arrived / self.expected));
    }

    /// Parts that came over those expected when they became too few, while they are.
    pub(super) fn few(&self) -> Option<f64> {
        self.few
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::tour::testing::candidate;
    use super::*;

    /// Feeds for so many seconds ten frames a second, with a part over the line every `every_s`, and ten parts on the ramp of
    /// which a tenth should come each second: one a second.
    fn feed(watch: &mut ArrivalWatch, from_s: u32, seconds: u32, every_s: Option<f64>) {
        for frame in 0..10 * seconds {
            let now_s = f64::from(from_s) + 0.1 * f64::from(frame);
            let came = every_s.map_or(0.0, |every_s| now_s / every_s);
            // One part at a time crosses the line half way between its arrivals.
            let angle_rad = PI + 0.4 * came.fract();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozens")]
            let part = candidate(1 + came as u64, 0.07 * angle_rad.cos(), 0.07 * angle_rad.sin());
            let candidates = if every_s.is_some() { vec![part] } else { Vec::new() };
            watch.carry(10 + u32::from(every_s.is_some()));
            watch.see(&CandidateFrame { stamp: Stamp::from_secs_f64(now_s), candidates, is_blind: false });
        }
    }

    fn watched(seconds: u32, every_s: Option<f64>) -> ArrivalWatch {
        let mut watch = ArrivalWatch::new(PI);
        watch.expect(Some(0.1));
        feed(&mut watch, 0, seconds, every_s);
        watch
    }

    #[test]
    fn as_many_parts_as_computed_or_half_as_many_are_no_reason_for_a_word_and_far_too_few_are() {
        for (every_s, few) in
            [(Some(0.8), false), (Some(1.0), false), (Some(2.0), false), (Some(4.0), true), (None, true)]
        {
            assert_eq!(watched(40, every_s).few().is_some(), few, "{every_s:?}");
        }
    }

    #[test]
    fn no_part_is_missed_that_is_still_on_its_way_to_the_line() {
        // Eight a second should come, the first after 0.64 s.
        let seen_for = |frames: u32| {
            let mut watch = ArrivalWatch::new(PI);
            watch.expect(Some(0.1));
            watch.carry(80);
            for frame in 0..=frames {
                let stamp = Stamp::from_secs_f64(0.1 * f64::from(frame));
                watch.see(&CandidateFrame { stamp, candidates: Vec::new(), is_blind: false });
            }
            watch
        };
        assert_eq!(seen_for(10).few(), None);
        assert!(seen_for(20).few().is_some());
    }

    #[test]
    fn where_little_was_to_be_expected_or_nothing_is_known_nothing_is_said() {
        assert_eq!(watched(4, None).few(), None);
        let mut unknown = watched(40, None);
        unknown.expect(None);
        feed(&mut unknown, 40, 40, None);
        assert_eq!(unknown.few(), None);
    }

    #[test]
    fn it_is_too_soon_to_wonder_until_six_parts_should_have_come_and_never_without_parts_on_the_ramp() {
        assert!(watched(5, None).is_too_soon());
        assert!(!watched(7, None).is_too_soon());
        let mut again = watched(7, Some(1.0));
        again.wait();
        assert!(again.is_too_soon());
        again.expect(None);
        assert!(!again.is_too_soon());
        assert!(!ArrivalWatch::new(PI).is_too_soon());
    }

    #[test]
    fn it_is_taken_back_when_parts_come_again() {
        let mut watch = watched(40, None);
        feed(&mut watch, 40, 120, Some(1.0));
        assert_eq!(watch.few(), None);
    }

    #[test]
    fn what_was_told_stands_as_it_was_told_until_six_in_ten_come() {
        let mut watch = watched(100, Some(5.0));
        let told = watch.few().unwrap();
        assert!((0.1..0.3).contains(&told), "{told}");
        feed(&mut watch, 100, 200, Some(2.0));
        assert_eq!(watch.few(), Some(told));
    }

    #[test]
    fn no_part_is_missed_of_those_that_should_have_come_unseen_or_while_nothing_vibrated() {
        let nothing = |at_s: u64, is_blind: bool| CandidateFrame {
            stamp: Stamp::from_secs(at_s),
            candidates: Vec::new(),
            is_blind,
        };
        let mut watch = watched(1, None);
        watch.pause();
        watch.see(&nothing(100, false));
        assert_eq!(watch.few(), None);
        watch.see(&nothing(101, true));
        watch.see(&nothing(200, true));
        watch.see(&nothing(300, false));
        assert_eq!(watch.few(), None);
        watch.see(&nothing(320, false));
        assert!(watch.few().is_some());
    }

    #[test]
    fn an_empty_ramp_brings_nothing_and_is_no_reason_for_a_word() {
        let mut watch = ArrivalWatch::new(PI);
        watch.expect(Some(0.1));
        for frame in 0..1000 {
            watch.see(&CandidateFrame {
                stamp: Stamp::from_millis(100 * frame),
                candidates: Vec::new(),
                is_blind: false,
            });
        }
        assert_eq!(watch.few(), None);
    }
}
