//! Where in the bag the present is, and how well that is kept.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Time in the bag against the wall clock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Timeline {
    /// Position at `since`, ns.
    position_ns: u64,
    since: Instant,
    rate: f64,
    paused: bool,
}

impl Timeline {
    pub(super) fn new(position_ns: u64, rate: f64, now: Instant) -> Self {
        Self { position_ns, since: now, rate, paused: false }
    }

    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    pub(super) fn is_paused(&self) -> bool {
        self.paused
    }

    /// Time in the bag, ns.
    pub(super) fn position_ns(&self, now: Instant) -> u64 {
        if self.paused {
            return self.position_ns;
        }
        let passed = now.saturating_duration_since(self.since).as_secs_f64() * self.rate;
        self.position_ns.saturating_add(Duration::try_from_secs_f64(passed).map_or(u64::MAX, nanoseconds))
    }

    /// When a message of this time goes out, if nothing changes.
    pub(super) fn due(&self, log_ns: u64) -> Instant {
        let ahead = Duration::from_nanos(log_ns.saturating_sub(self.position_ns)).as_secs_f64() / self.rate;
        // So far ahead that it cannot be said is far enough.
        let ahead = Duration::try_from_secs_f64(ahead).unwrap_or(Duration::from_secs(3600));
        self.since.checked_add(ahead).unwrap_or(self.since + Duration::from_secs(3600))
    }

    /// Goes to a position, paused or not as before.
    pub(super) fn restart(&mut self, position_ns: u64, now: Instant) {
        self.position_ns = position_ns;
        self.since = now;
    }

    pub(super) fn set_rate(&mut self, rate: f64, now: Instant) {
        self.restart(self.position_ns(now), now);
        self.rate = rate;
    }

    pub(super) fn pause(&mut self, now: Instant) {
        self.restart(self.position_ns(now), now);
        self.paused = true;
    }

    pub(super) fn resume(&mut self, now: Instant) {
        self.restart(self.position_ns(now), now);
        self.paused = false;
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// How late messages went out, counted by microseconds; lateness beyond ten seconds counts as ten seconds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Lateness {
    counts: BTreeMap<u32, u64>,
}

impl Lateness {
    const MOST_US: u32 = 10_000_000;

    /// Adds a message.
    pub fn add(&mut self, late: Duration) {
        let late_us = u32::try_from(late.as_micros()).map_or(Self::MOST_US, |late| late.min(Self::MOST_US));
        *self.counts.entry(late_us).or_default() += 1;
    }

    /// The lateness, µs, that this share of the messages (0 to 1) did not exceed; none without messages.
    #[must_use]
    pub fn quantile_us(&self, share: f64) -> Option<u32> {
        let total: u64 = self.counts.values().sum();
        #[expect(clippy::cast_precision_loss, reason = "a share of a count needs no more digits")]
        let wanted = share.clamp(0.0, 1.0) * total as f64;
        let mut below = 0_u64;
        for (late_us, count) in &self.counts {
            below += count;
            #[expect(clippy::cast_precision_loss, reason = "as above")]
            let reached = below as f64;
            if reached >= wanted {
                return Some(*late_us);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn time_passes_at_the_rate_and_not_in_pause() {
        let start = Instant::now();
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let mut timeline = Timeline::new(5 * S, 2.0, start);
        assert_eq!(timeline.position_ns(at(1.0)), 7 * S);
        assert_eq!(timeline.due(9 * S), at(2.0));
        timeline.pause(at(1.0));
        assert_eq!((timeline.position_ns(at(9.0)), timeline.is_paused()), (7 * S, true));
        timeline.set_rate(0.5, at(9.0));
        timeline.resume(at(10.0));
        assert_eq!((timeline.position_ns(at(12.0)), timeline.due(9 * S)), (8 * S, at(14.0)));
        timeline.restart(20 * S, at(12.0));
        assert_eq!((timeline.position_ns(at(12.0)), timeline.due(3 * S)), (20 * S, at(12.0)));
        assert!(timeline.due(u64::MAX) > at(1000.0));
    }

    #[test]
    fn quantiles_of_lateness() {
        let mut lateness = Lateness::default();
        assert_eq!(lateness.quantile_us(0.5), None);
        for late_us in 1..=100 {
            lateness.add(Duration::from_micros(late_us));
        }
        lateness.add(Duration::from_secs(100));
        let quantiles = [0.0, 0.5, 0.99, 1.0].map(|share| lateness.quantile_us(share));
        assert_eq!(quantiles, [Some(1), Some(51), Some(100), Some(10_000_000)]);
    }
}
