//! How long things take, as far as they do not depend on the choice: learned from what was seen.

use std::collections::BTreeMap;

use super::request::Stamp;
use super::tour::Overheads;

/// Share of a new observation in the running means.
const GAIN: f64 = 0.3;
/// A hand-over that takes so much longer than usual has waited for its manipulator, s.
const WAITED_S: f64 = 0.1;
/// One that begins so long after the last one of its station has not, s.
const RESTED_S: f64 = 5.0;

/// Running means of how long things take.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    overheads: Overheads,
    /// When each station last released the courier.
    released: BTreeMap<String, Stamp>,
}

impl Pace {
    pub(super) fn new() -> Self {
        Self { overheads: Overheads { stop_s: 0.6, hand_over_s: 0.7, busy_s: 0.0 }, released: BTreeMap::new() }
    }

    pub(super) fn overheads(&self) -> &Overheads {
        &self.overheads
    }

    /// The courier departs; it was told to stop feeding at `ordered`.
    pub(super) fn departed(&mut self, ordered: Stamp, now: Stamp) {
        approach(&mut self.overheads.stop_s, seconds(ordered, now));
    }

    /// A station to which a part was presented at `presented` releases the courier.
    pub(super) fn handed_over(&mut self, station: &str, presented: Stamp, now: Stamp) {
        let took_s = seconds(presented, now);
        let before = self.released.insert(station.to_owned(), now);
        let since_s = before.map_or(f64::INFINITY, |released| seconds(released, presented));
        if since_s < RESTED_S && took_s > self.overheads.hand_over_s + WAITED_S {
            approach(&mut self.overheads.busy_s, since_s + took_s - self.overheads.hand_over_s);
        } else {
            approach(&mut self.overheads.hand_over_s, took_s);
        }
    }

    /// How long it will be until a station's manipulator can take a part, s.
    pub(super) fn ready_s(&self, station: &str, now: Stamp) -> f64 {
        let since = self.released.get(station);
        since.map_or(0.0, |released| (self.overheads.busy_s - seconds(*released, now)).max(0.0))
    }
}

fn seconds(since: Stamp, until: Stamp) -> f64 {
    until.saturating_sub(since).as_secs_f64()
}

fn approach(mean_s: &mut f64, seen_s: f64) {
    *mean_s += GAIN * (seen_s - *mean_s);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_over_that_waits_for_its_manipulator_tells_how_long_that_is_busy() {
        let mut pace = Pace::new();
        // The manipulator takes 0.5 s for a part and 1.2 s to put it away; the next part is there after 0.3 s, or after 9 s.
        let mut now_s = 1.0;
        for index in 0..60 {
            let (pause_s, took_s) = if index % 3 == 0 { (9.0, 0.5) } else { (0.3, 0.9 + 0.5) };
            let presented_s = now_s + pause_s;
            now_s = presented_s + took_s;
            pace.handed_over("left", Stamp::from_secs_f64(presented_s), Stamp::from_secs_f64(now_s));
        }
        let Overheads { hand_over_s, busy_s, .. } = pace.overheads;
        assert!((hand_over_s - 0.5).abs() < 0.01 && (busy_s - 1.2).abs() < 0.02, "{hand_over_s} {busy_s}");
        let ready_s = |station, later_s: f64| pace.ready_s(station, Stamp::from_secs_f64(now_s + later_s));
        assert!((ready_s("left", 0.2) - 1.0).abs() < 0.02);
        assert_eq!((ready_s("left", 2.0), ready_s("right", 0.0)), (0.0, 0.0));
    }

    #[test]
    fn a_slow_manipulator_is_told_from_a_busy_one() {
        let mut pace = Pace::new();
        for index in 0..40 {
            let presented_s = 20.0 * f64::from(index);
            pace.handed_over("left", Stamp::from_secs_f64(presented_s), Stamp::from_secs_f64(presented_s + 3.0));
        }
        assert!((pace.overheads.hand_over_s - 3.0).abs() < 0.01 && pace.overheads.busy_s == 0.0);
    }
}
