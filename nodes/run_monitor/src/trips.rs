//! How the planner's trips went, and what an oracle would make of the same feed and the same moves.

use crate::progress::Activity;

/// What ending the feed costs an oracle each trip, s: until the tray is at rest and a picture of it has been looked at.
const STOP_S: f64 = 0.4;
/// What a hand-over costs it, s, beside the moves.
const HAND_OVER_S: f64 = 0.6;

/// Sums over the trips of one feeder.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Trips {
    /// Trips on which a part was presented.
    pub trips: u32,
    /// To the first station of a trip and back from the last, s.
    pub moves_s: f64,
    /// Parts presented on a trip beyond the first.
    pub further_stops: u32,
    /// What they took, the move and the hand-over, s.
    pub further_stops_s: f64,
    /// Most goals that were open at a time.
    pub goals_open_max: u32,
    /// Parts presented on the trip under way.
    presented: u32,
    /// The move after the first of them, until it is known whether it leads to a further stop, s.
    next_move_s: f64,
}

impl Trips {
    /// The planner has been at something for so long, s; `begins` another part's hand-over now.
    pub(crate) fn pass(&mut self, activity: Activity, spent_s: f64, begins: bool) {
        match activity {
            Activity::Pick | Activity::Move if self.presented > 1 => self.further_stops_s += spent_s,
            // On the way to a further stop.
            Activity::Move if self.presented == 1 => self.next_move_s += spent_s,
            Activity::Move | Activity::Return => self.moves_s += spent_s,
            Activity::Idle | Activity::Wait | Activity::Stop | Activity::Settle => self.presented = 0,
            Activity::Pick | Activity::Look | Activity::Reserve => {}
        }
        if begins {
            self.presented += 1;
            self.trips += u32::from(self.presented == 1);
            self.further_stops += u32::from(self.presented > 1);
            self.further_stops_s += std::mem::take(&mut self.next_move_s);
        }
    }
}

/// A planner that loses no time and no part: it feeds until as many right parts lie ready as goals are open, at the rate at
/// which they come while feeding, and takes them all on one trip. Moves and further stops cost it what they cost in the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oracle {
    /// Right parts that could be picked, for each second of feeding, 1/s.
    pub right_per_s: f64,
    /// Moves of a trip: there and back, s.
    pub moves_s: f64,
    /// A further stop: the move and the hand-over, s; nothing where no trip had one.
    pub further_stop_s: Option<f64>,
    /// Parts it takes on a trip.
    pub stops: u32,
}

impl Oracle {
    /// What would have been possible in a run in which `good` parts could be picked and `fed_s` was fed; nothing before the
    /// first trip, or while no part could be picked.
    #[must_use]
    pub fn of(trips: &Trips, good: u32, fed_s: f64) -> Option<Self> {
        let mean_s = |sum_s: f64, count: u32| (count > 0).then(|| sum_s / f64::from(count));
        let moves_s = mean_s(trips.moves_s, trips.trips)?;
        (good > 0 && fed_s > 0.0).then(|| Self {
            right_per_s: f64::from(good) / fed_s,
            moves_s,
            further_stop_s: mean_s(trips.further_stops_s, trips.further_stops),
            stops: trips.goals_open_max.max(1),
        })
    }

    /// Parts that it delivers a minute.
    #[must_use]
    pub fn per_minute(&self) -> f64 {
        let stops = f64::from(self.stops);
        let further_s = self.further_stop_s.unwrap_or(HAND_OVER_S) * (stops - 1.0);
        60.0 * stops / (stops / self.right_per_s + STOP_S + self.moves_s + further_s + HAND_OVER_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trips(goals_open_max: u32) -> Trips {
        let mut trips = Trips { goals_open_max, ..Trips::default() };
        // What was done, for how long, and whether a hand-over begins after it.
        for (activity, spent_s, begins) in [
            (Activity::Wait, 3.0, false),
            (Activity::Stop, 0.3, false),
            (Activity::Look, 0.1, false),
            (Activity::Move, 0.4, false),
            (Activity::Move, 0.1, false),
            (Activity::Look, 0.1, true),
            (Activity::Pick, 0.5, false),
            (Activity::Pick, 0.2, false),
            (Activity::Move, 0.2, true),
            // The next part lies under the same tool: no move between.
            (Activity::Pick, 0.6, true),
            (Activity::Pick, 0.5, false),
            (Activity::Return, 0.5, false),
            (Activity::Wait, 1.0, false),
            (Activity::Stop, 0.3, false),
            (Activity::Move, 0.7, true),
            (Activity::Pick, 0.7, false),
            (Activity::Return, 0.7, false),
        ] {
            trips.pass(activity, spent_s, begins);
        }
        trips
    }

    #[test]
    fn moves_are_those_of_a_trip_and_further_stops_those_after_its_first_part() {
        let trips = trips(1);
        assert_eq!((trips.trips, trips.further_stops), (2, 2));
        assert!((trips.moves_s - 2.4).abs() < 1e-12 && (trips.further_stops_s - 1.3).abs() < 1e-12, "{trips:?}");
    }

    #[test]
    fn every_part_after_the_first_of_a_trip_is_a_further_stop() {
        let mut trips = Trips::default();
        for activity in [Activity::Move, Activity::Pick, Activity::Pick] {
            trips.pass(activity, 1.0, true);
        }
        assert_eq!((trips.trips, trips.further_stops), (1, 2));
    }

    #[test]
    fn the_oracle_takes_as_many_parts_a_trip_as_goals_are_open() {
        // 3 parts in 4 s of feeding.
        let rate = |goals_open_max| Oracle::of(&trips(goals_open_max), 3, 4.0).unwrap().per_minute();
        let one_s = 4.0 / 3.0 + 0.4 + 1.2 + 0.6;
        assert!((rate(1) - 60.0 / one_s).abs() < 1e-9);
        assert!((rate(4) - 240.0 / (one_s + 3.0 * (4.0 / 3.0 + 0.65))).abs() < 1e-9);
        assert_eq!(Oracle::of(&trips(1), 0, 4.0), None);
        assert_eq!(Oracle::of(&trips(1), 3, 0.0), None);
        assert_eq!(Oracle::of(&Trips::default(), 3, 4.0), None);
    }
}
