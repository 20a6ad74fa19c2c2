//! How a run has gone so far.

use std::collections::BTreeMap;
use std::sync::Arc;

use minifactory_msgs::msg::RunProgress;
use minifactory_msgs::std_msgs::msg::Header;

use crate::feed::Feed;
use crate::trips::{Oracle, Trips};
use crate::whereabouts::OdometryScore;

/// What a planner does with its time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Activity {
    /// Nothing is asked for.
    #[default]
    Idle,
    /// Feeding until parts fit.
    Wait,
    /// The vibration ends.
    Stop,
    /// Parts come to rest.
    Settle,
    /// Looking at the parts at rest, and choosing.
    Look,
    /// Waiting for an area of the platen.
    Reserve,
    /// On the way to a station.
    Move,
    /// Under a station, until released.
    Pick,
    /// On the way back.
    Return,
}

impl Activity {
    /// All but idling, in the order of a delivery, with their names.
    pub const OF_A_DELIVERY: [(Self, &'static str); 8] = [
        (Self::Wait, "wait"),
        (Self::Stop, "stop"),
        (Self::Settle, "settle"),
        (Self::Look, "look"),
        (Self::Reserve, "reserve"),
        (Self::Move, "move"),
        (Self::Pick, "pick"),
        (Self::Return, "return"),
    ];
}

/// How one feeder has done.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FeederProgress {
    /// Name of the feeder.
    pub name: String,
    /// Entries to the plateau.
    pub fed: u32,
    /// Distinct parts that the selector saw.
    pub seen: u32,
    /// Distinct parts that the selector called right.
    pub selected: u32,
    /// Parts picked.
    pub delivered: u32,
    /// Parts picked in another pose than they were presented in.
    pub wrong_pose_delivered: u32,
    /// Parts picked that lay turned otherwise than presented, by more than [`YAW_ERROR_MAX_RAD`](crate::YAW_ERROR_MAX_RAD).
    pub wrong_yaw_delivered: u32,
    /// Largest yaw of a delivered part from the one it was presented with, rad; nothing while no part with a yaw was.
    pub max_yaw_error_rad: Option<f64>,
    /// Parts presented that had less room about them than the gripper of their station needs.
    pub chosen_without_room: u32,
    /// By how much the room about such a part fell short, m: the largest.
    pub room_short_m_max: f64,
    /// Largest displacement in the tray frame of a delivered part between settled and picked, m; nothing while none was
    /// followed.
    pub max_slip_m: Option<f64>,
    /// Delivered parts that could not be followed, so that their slip is not known.
    pub slips_unknown: u32,
    /// Parts that vanished from the feeder without being picked.
    pub parts_lost: u32,
    /// Parts that were picked twice, or that were in the feeder again after they had been picked.
    pub parts_doubled: u32,
    /// Deliveries that the planner accepted.
    pub accepted: u32,
    /// Deliveries that ended with the part taken.
    pub succeeded: u32,
    /// Deliveries that failed, by the outcome of the action's result.
    pub failed_by_outcome: Vec<u32>,
    /// How well the driver knows where its courier is.
    pub odometry: OdometryScore,
    /// What the planner does at present.
    pub activity: Activity,
    /// What the planner did with its time, s.
    pub spent_s: BTreeMap<Activity, f64>,
    /// How its trips went.
    pub trips: Trips,
    /// How well the feeder feeds and the selector selects.
    pub feed: Feed,
    /// The same in the course of the run: stamp (s) and figures, at most a thousand times, at every second of simulated time
    /// while that is enough.
    pub history: Arc<Vec<(f64, Feed)>>,
}

impl FeederProgress {
    /// As a message.
    pub(crate) fn message(&self, header: Header) -> RunProgress {
        RunProgress {
            header,
            fed: self.fed,
            seen: self.seen,
            selected: self.selected,
            delivered: self.delivered,
            wrong_pose_delivered: self.wrong_pose_delivered,
            max_slip_m: self.max_slip_m.unwrap_or(-1.0),
            odometry_error_m_max: self.odometry.error_m_max,
            odometry_error_m_rms: self.odometry.error_m_rms(),
            odometry_error_rad_max: self.odometry.error_rad_max,
            odometry_error_rad_rms: self.odometry.error_rad_rms(),
        }
    }

    /// What an oracle would have made of this feeder's feed and moves; nothing while there is nothing to go by.
    #[must_use]
    pub fn oracle(&self) -> Option<Oracle> {
        let fed_s = self.spent_s.get(&Activity::Wait).copied().unwrap_or(0.0);
        Oracle::of(&self.trips, self.feed.report.good, fed_s)
    }
}

/// How a run has gone so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Progress {
    /// Each feeder.
    pub feeders: Vec<FeederProgress>,
    /// Smallest distance between the centres of two couriers so far, m; nothing with one courier.
    pub couriers_closest_m: Option<f64>,
    /// Ticks in which two couriers overlapped.
    pub collisions: u32,
    /// Ticks in which a courier reached out of the areas leased to it.
    pub out_of_area: u32,
}

impl Progress {
    /// Sums a count over the feeders.
    pub fn sum(&self, count: impl Fn(&FeederProgress) -> u32) -> u32 {
        self.feeders.iter().map(count).sum()
    }

    /// Parts picked.
    #[must_use]
    pub fn delivered(&self) -> u32 {
        self.sum(|feeder| feeder.delivered)
    }

    /// Distinct parts that the selector saw.
    #[must_use]
    pub fn seen(&self) -> u32 {
        self.sum(|feeder| feeder.seen)
    }

    /// Distinct parts that the selector called right.
    #[must_use]
    pub fn selected(&self) -> u32 {
        self.sum(|feeder| feeder.selected)
    }

    /// How well the drivers know where their couriers are.
    #[must_use]
    pub fn odometry(&self) -> OdometryScore {
        self.feeders.iter().fold(OdometryScore::default(), |score, feeder| score.with(&feeder.odometry))
    }

    /// Largest yaw error of a delivered part, rad; nothing while no part with a yaw was delivered.
    #[must_use]
    pub fn max_yaw_error_rad(&self) -> Option<f64> {
        self.feeders.iter().filter_map(|feeder| feeder.max_yaw_error_rad).reduce(f64::max)
    }

    /// By how much the room about a part that was presented fell short, m: the largest.
    #[must_use]
    pub fn room_short_m_max(&self) -> f64 {
        self.feeders.iter().map(|feeder| feeder.room_short_m_max).fold(0.0, f64::max)
    }

    /// Largest slip of a delivered part, m; nothing while none was followed.
    #[must_use]
    pub fn max_slip_m(&self) -> Option<f64> {
        self.feeders.iter().filter_map(|feeder| feeder.max_slip_m).reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::whereabouts::Whereabouts;

    #[test]
    fn counts_of_feeders_are_added_up_and_of_their_errors_the_largest_is_told() {
        let odometry = |count: u32, error_m: f64| {
            let mut whereabouts = Whereabouts::default();
            for stamp_ns in 0..count.into() {
                whereabouts.say(stamp_ns, Vector3::new(error_m, 0.0, 0.0));
                whereabouts.learn(stamp_ns, Vector3::zeros());
            }
            whereabouts.score
        };
        let feeder = |count: u32, error: f64| FeederProgress {
            delivered: count,
            seen: 10 * count,
            selected: 100 * count,
            max_yaw_error_rad: Some(error),
            room_short_m_max: 2.0 * error,
            max_slip_m: Some(3.0 * error),
            odometry: odometry(count, error),
            ..FeederProgress::default()
        };
        let none = Progress { feeders: vec![FeederProgress::default()], ..Progress::default() };
        assert_eq!((none.delivered(), none.seen(), none.selected()), (0, 0, 0));
        assert_eq!((none.max_yaw_error_rad(), none.max_slip_m(), none.room_short_m_max()), (None, None, 0.0));
        let feeders = vec![feeder(2, 0.5), FeederProgress::default(), feeder(3, 0.25)];
        let all = Progress { feeders, ..Progress::default() };
        assert_eq!((all.delivered(), all.seen(), all.selected()), (5, 50, 500));
        assert_eq!((all.max_yaw_error_rad(), all.max_slip_m(), all.room_short_m_max()), (Some(0.5), Some(1.5), 1.0));
        assert_eq!((all.odometry().error_m_max, all.odometry().compared), (0.5, 5));
    }

    #[test]
    fn a_message_tells_what_was_counted_and_below_zero_a_slip_that_is_not_known() {
        let mut whereabouts = Whereabouts::default();
        for (stamp_ns, x_m, yaw_rad) in [(1, 0.5, 0.25), (2, 0.0, 0.0)] {
            whereabouts.say(stamp_ns, Vector3::new(x_m, 0.0, yaw_rad));
            whereabouts.learn(stamp_ns, Vector3::zeros());
        }
        let progress = FeederProgress {
            fed: 1,
            seen: 2,
            selected: 3,
            delivered: 4,
            wrong_pose_delivered: 5,
            max_slip_m: Some(0.125),
            odometry: whereabouts.score,
            ..FeederProgress::default()
        };
        let header = Header { frame_id: "run".to_owned(), ..Header::default() };
        let expected = RunProgress {
            header: header.clone(),
            fed: 1,
            seen: 2,
            selected: 3,
            delivered: 4,
            wrong_pose_delivered: 5,
            max_slip_m: 0.125,
            odometry_error_m_max: 0.5,
            odometry_error_m_rms: 0.125_f64.sqrt(),
            odometry_error_rad_max: 0.25,
            odometry_error_rad_rms: 0.031_25_f64.sqrt(),
        };
        assert_eq!(progress.message(header.clone()), expected);
        let unknown = FeederProgress { max_slip_m: None, ..progress };
        assert_eq!(unknown.message(header), RunProgress { max_slip_m: -1.0, ..expected });
    }
}
