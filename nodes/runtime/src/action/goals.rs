//! The goals of an action server: what may become of them, and who waits for their results.
//!
//! ```text
//! accepted ──▶ executing ──▶ succeeded, aborted
//!     │            ▼
//!     └──────▶ canceling ──▶ canceled, succeeded, aborted
//! ```

use std::{collections::BTreeMap, fmt, time::Duration};

use minifactory_msgs::{
    action_msgs::{
        msg::{GoalInfo, GoalStatus as StatusMessage},
        srv::CancelGoalRequest,
    },
    builtin_interfaces::msg::Time,
    unique_identifier_msgs::msg::UUID,
};

/// Names a goal; chosen by the client.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GoalId(pub [u8; 16]);

impl From<UUID> for GoalId {
    fn from(id: UUID) -> Self {
        Self(id.uuid)
    }
}

impl From<GoalId> for UUID {
    fn from(id: GoalId) -> Self {
        Self { uuid: id.0 }
    }
}

impl fmt::Display for GoalId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for GoalId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GoalId({self})")
    }
}

/// How a goal fares. The numbers are those of `action_msgs/msg/GoalStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(i8)]
pub enum GoalStatus {
    /// The server does not know the goal (any more).
    Unknown = StatusMessage::STATUS_UNKNOWN,
    /// Accepted, not begun.
    Accepted = StatusMessage::STATUS_ACCEPTED,
    /// Being worked on.
    Executing = StatusMessage::STATUS_EXECUTING,
    /// About to stop, as a client wished.
    Canceling = StatusMessage::STATUS_CANCELING,
    /// Ended as wished for.
    Succeeded = StatusMessage::STATUS_SUCCEEDED,
    /// Stopped, as a client wished.
    Canceled = StatusMessage::STATUS_CANCELED,
    /// Stopped by the server.
    Aborted = StatusMessage::STATUS_ABORTED,
}

impl GoalStatus {
    /// The status a message's number stands for; numbers that stand for none are `Unknown`.
    #[must_use]
    pub fn from_number(number: i8) -> Self {
        [
            Self::Accepted,
            Self::Executing,
            Self::Canceling,
            Self::Succeeded,
            Self::Canceled,
            Self::Aborted,
        ]
        .into_iter()
        .find(|status| *status as i8 == number)
        .unwrap_or(Self::Unknown)
    }

    /// Whether the goal has ended.
    #[must_use]
    pub fn is_terminal(self) -> bool {
        matches!(self, Self::Succeeded | Self::Canceled | Self::Aborted)
    }

    fn may_become(self, next: Self) -> bool {
        use GoalStatus::{Aborted, Accepted, Canceled, Canceling, Executing, Succeeded};
        matches!(
            (self, next),
            (Accepted, Executing | Canceling)
                | (Executing, Canceling | Succeeded | Aborted)
                | (Canceling, Canceled | Succeeded | Aborted)
        )
    }
}

/// Why something cannot be done with a goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GoalError {
    /// The goal was accepted before.
    #[error("goal {0} is known already")]
    Known(GoalId),
    /// The goal was never accepted, or its result has expired.
    #[error("goal {0} is not known")]
    Unknown(GoalId),
    /// A goal of its status cannot take the wanted one.
    #[error("goal {id} is {from:?} and cannot become {to:?}")]
    Transition {
        /// The goal.
        id: GoalId,
        /// Its status.
        from: GoalStatus,
        /// The status it was to take.
        to: GoalStatus,
    },
}

/// Why there is nothing to cancel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NothingToCancel {
    /// No goal of this id.
    UnknownGoal,
    /// The goal has ended.
    Terminated,
    /// Goals were not named one by one, and none of those meant is running.
    NoneRunning,
}

/// What [`Goals::result`] has for somebody who asks for a result.
#[derive(Debug, PartialEq, Eq)]
pub enum ResultOf<'a, R, W> {
    /// The goal has ended so.
    Known(W, GoalStatus, &'a R),
    /// It has not ended; whoever asked is among the waiting.
    Later,
    /// There is no such goal.
    Unknown(W),
}

struct Goal<R, W> {
    accepted: Time,
    status: GoalStatus,
    /// The result, and the time at which it may be forgotten.
    result: Option<(R, Duration)>,
    waiting: Vec<W>,
}

/// The goals of one server: `R` is a result, `W` somebody who waits for one.
///
/// Times are spans on any clock that never goes back, always the same one.
pub struct Goals<R, W> {
    goals: BTreeMap<GoalId, Goal<R, W>>,
    keep_results: Duration,
}

impl<R, W> Goals<R, W> {
    /// No goals yet; results are kept for `keep_results` after a goal has ended.
    #[must_use]
    pub fn new(keep_results: Duration) -> Self {
        Self {
            goals: BTreeMap::new(),
            keep_results,
        }
    }

    /// Takes a goal on.
    ///
    /// # Errors
    /// [`GoalError::Known`] when its id is in use.
    pub fn accept(&mut self, id: GoalId, stamp: Time) -> Result<(), GoalError> {
        if self.goals.contains_key(&id) {
            return Err(GoalError::Known(id));
        }
        let goal = Goal {
            accepted: stamp,
            status: GoalStatus::Accepted,
            result: None,
            waiting: Vec::new(),
        };
        self.goals.insert(id, goal);
        Ok(())
    }

    /// How a goal fares; [`GoalStatus::Unknown`] when there is none of this id.
    #[must_use]
    pub fn status(&self, id: GoalId) -> GoalStatus {
        self.goals
            .get(&id)
            .map_or(GoalStatus::Unknown, |goal| goal.status)
    }

    /// Begins to work on an accepted goal.
    ///
    /// # Errors
    /// [`GoalError::Unknown`] or [`GoalError::Transition`].
    pub fn start(&mut self, id: GoalId) -> Result<(), GoalError> {
        self.advance(id, GoalStatus::Executing).map(|_| ())
    }

    /// Grants that a goal is cancelled; it is to be ended soon.
    ///
    /// # Errors
    /// [`GoalError::Unknown`] or [`GoalError::Transition`].
    pub fn begin_cancel(&mut self, id: GoalId) -> Result<(), GoalError> {
        self.advance(id, GoalStatus::Canceling).map(|_| ())
    }

    /// Ends a goal with a terminal status and returns those who waited for its result.
    ///
    /// # Errors
    /// [`GoalError::Unknown`] or [`GoalError::Transition`].
    pub fn finish(
        &mut self,
        id: GoalId,
        status: GoalStatus,
        result: R,
        now: Duration,
    ) -> Result<Vec<W>, GoalError> {
        let from = self.status(id);
        if !status.is_terminal() {
            return Err(GoalError::Transition {
                id,
                from,
                to: status,
            });
        }
        let forget = now.saturating_add(self.keep_results);
        let goal = self.advance(id, status)?;
        goal.result = Some((result, forget));
        Ok(std::mem::take(&mut goal.waiting))
    }

    /// Gives a result to whoever asks, or puts them among the waiting.
    pub fn result(&mut self, id: GoalId, who: W) -> ResultOf<'_, R, W> {
        match self.goals.get_mut(&id) {
            None => ResultOf::Unknown(who),
            Some(Goal {
                result: Some((result, _)),
                status,
                ..
            }) => ResultOf::Known(who, *status, result),
            Some(goal) => {
                goal.waiting.push(who);
                ResultOf::Later
            }
        }
    }

    /// The running goals a request to cancel means, by the rules of `action_msgs/srv/CancelGoal`: an id
    /// means that goal, a stamp means all goals accepted until then, both mean both, neither means all.
    ///
    /// # Errors
    /// [`NothingToCancel`] says why there is none.
    pub fn to_cancel(&self, request: &CancelGoalRequest) -> Result<Vec<GoalId>, NothingToCancel> {
        let GoalInfo { goal_id, stamp } = request.goal_info;
        let id = GoalId::from(goal_id);
        let (any_id, any_time) = (id == GoalId([0; 16]), stamp == Time::default());
        let until = |time: Time| (time.sec, time.nanosec) <= (stamp.sec, stamp.nanosec);
        let meant: Vec<_> = self
            .goals
            .iter()
            .filter(|(goal_id, goal)| match (any_id, any_time) {
                (true, true) => true,
                (true, false) => until(goal.accepted),
                (false, true) => **goal_id == id,
                (false, false) => **goal_id == id || until(goal.accepted),
            })
            .filter(|(_, goal)| goal.status.may_become(GoalStatus::Canceling))
            .map(|(id, _)| *id)
            .collect();
        match (meant.is_empty(), any_id, self.goals.contains_key(&id)) {
            (false, ..) => Ok(meant),
            (true, true, _) => Err(NothingToCancel::NoneRunning),
            (true, false, false) => Err(NothingToCancel::UnknownGoal),
            (true, false, true) => Err(NothingToCancel::Terminated),
        }
    }

    /// Forgets the goals whose results have been kept long enough, and returns them.
    pub fn expire(&mut self, now: Duration) -> Vec<GoalId> {
        let expired = |goal: &Goal<R, W>| {
            goal.result
                .as_ref()
                .is_some_and(|(_, forget)| *forget <= now)
        };
        let ids: Vec<_> = self
            .goals
            .iter()
            .filter(|(_, goal)| expired(goal))
            .map(|(id, _)| *id)
            .collect();
        for id in &ids {
            self.goals.remove(id);
        }
        ids
    }

    /// When the next result expires, if any is kept.
    #[must_use]
    pub fn next_expiry(&self) -> Option<Duration> {
        self.goals
            .values()
            .filter_map(|goal| goal.result.as_ref().map(|(_, forget)| *forget))
            .min()
    }

    /// All goals, for the status topic.
    pub fn statuses(&self) -> impl Iterator<Item = StatusMessage> {
        self.goals.iter().map(|(id, goal)| StatusMessage {
            goal_info: GoalInfo {
                goal_id: (*id).into(),
                stamp: goal.accepted,
            },
            status: goal.status as i8,
        })
    }

    /// What the answer to a request to cancel says of a goal.
    #[must_use]
    pub fn info(&self, id: GoalId) -> Option<GoalInfo> {
        self.goals.get(&id).map(|goal| GoalInfo {
            goal_id: id.into(),
            stamp: goal.accepted,
        })
    }

    fn advance(&mut self, id: GoalId, to: GoalStatus) -> Result<&mut Goal<R, W>, GoalError> {
        let goal = self.goals.get_mut(&id).ok_or(GoalError::Unknown(id))?;
        if !goal.status.may_become(to) {
            return Err(GoalError::Transition {
                id,
                from: goal.status,
                to,
            });
        }
        goal.status = to;
        Ok(goal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const KEEP: Duration = Duration::from_secs(60);
    const NOW: Duration = Duration::from_secs(1_000);

    fn id(number: u8) -> GoalId {
        GoalId([number; 16])
    }

    fn at(sec: i32) -> Time {
        Time { sec, nanosec: 0 }
    }

    fn cancel(goal: u8, until: i32) -> CancelGoalRequest {
        CancelGoalRequest {
            goal_info: GoalInfo {
                goal_id: id(goal).into(),
                stamp: at(until),
            },
        }
    }

    fn goals() -> Goals<&'static str, u32> {
        let mut goals = Goals::new(KEEP);
        for number in 1..=3 {
            goals.accept(id(number), at(number.into())).expect("new");
        }
        goals
    }

    #[test]
    fn a_goal_runs_its_course_and_its_result_is_kept_for_a_while() {
        let mut goals = goals();
        assert_eq!(goals.accept(id(1), at(9)), Err(GoalError::Known(id(1))));
        assert_eq!(goals.result(id(1), 10), ResultOf::Later);
        goals.start(id(1)).expect("accepted");
        assert_eq!(goals.result(id(1), 11), ResultOf::Later);
        assert_eq!(
            goals.finish(id(1), GoalStatus::Succeeded, "done", NOW),
            Ok(vec![10, 11])
        );
        assert_eq!(
            goals.result(id(1), 12),
            ResultOf::Known(12, GoalStatus::Succeeded, &"done")
        );
        assert_eq!(goals.next_expiry(), Some(NOW + KEEP));
        assert!(
            goals
                .expire(NOW + KEEP - Duration::from_nanos(1))
                .is_empty()
        );
        assert_eq!(goals.expire(NOW + KEEP), [id(1)]);
        assert_eq!(goals.result(id(1), 13), ResultOf::Unknown(13));
        assert_eq!(goals.status(id(2)), GoalStatus::Accepted);
    }

    #[test]
    fn what_the_state_does_not_allow_is_refused() {
        let mut goals = goals();
        let refused = |from, to| {
            Err(GoalError::Transition {
                id: id(1),
                from,
                to,
            })
        };
        assert_eq!(
            goals.finish(id(1), GoalStatus::Succeeded, "", NOW),
            refused(GoalStatus::Accepted, GoalStatus::Succeeded).map(|()| vec![])
        );
        goals.start(id(1)).expect("accepted");
        assert_eq!(
            goals.start(id(1)),
            refused(GoalStatus::Executing, GoalStatus::Executing)
        );
        assert!(goals.finish(id(1), GoalStatus::Canceled, "", NOW).is_err());
        assert!(goals.finish(id(1), GoalStatus::Executing, "", NOW).is_err());
        goals.begin_cancel(id(1)).expect("executing");
        goals
            .finish(id(1), GoalStatus::Canceled, "", NOW)
            .expect("canceling");
        assert_eq!(
            goals.begin_cancel(id(1)),
            refused(GoalStatus::Canceled, GoalStatus::Canceling)
        );
        assert_eq!(goals.start(id(9)), Err(GoalError::Unknown(id(9))));
    }

    #[test]
    fn cancel_means_the_goals_that_ros_2_means() {
        let mut goals = goals();
        assert_eq!(
            goals.to_cancel(&cancel(0, 0)),
            Ok(vec![id(1), id(2), id(3)])
        );
        assert_eq!(goals.to_cancel(&cancel(0, 2)), Ok(vec![id(1), id(2)]));
        assert_eq!(goals.to_cancel(&cancel(3, 0)), Ok(vec![id(3)]));
        assert_eq!(goals.to_cancel(&cancel(3, 1)), Ok(vec![id(1), id(3)]));
        assert_eq!(
            goals.to_cancel(&cancel(9, 0)),
            Err(NothingToCancel::UnknownGoal)
        );
        goals.start(id(3)).expect("accepted");
        goals
            .finish(id(3), GoalStatus::Aborted, "", NOW)
            .expect("executing");
        assert_eq!(
            goals.to_cancel(&cancel(3, 0)),
            Err(NothingToCancel::Terminated)
        );
        assert_eq!(
            Goals::<(), ()>::new(KEEP).to_cancel(&cancel(0, 0)),
            Err(NothingToCancel::NoneRunning)
        );
    }

    #[derive(Debug, Clone)]
    enum Step {
        Accept(u8),
        Start(u8),
        Cancel(u8),
        Finish(u8, i8),
        Ask(u8),
        Expire(u64),
    }

    fn step() -> impl Strategy<Value = Step> {
        let goal = 0..4u8;
        prop_oneof![
            goal.clone().prop_map(Step::Accept),
            goal.clone().prop_map(Step::Start),
            goal.clone().prop_map(Step::Cancel),
            (goal.clone(), any::<i8>()).prop_map(|(goal, status)| Step::Finish(goal, status)),
            goal.prop_map(Step::Ask),
            (0..100u64).prop_map(Step::Expire),
        ]
    }

    proptest! {
        /// Whatever happens: nobody who asks is forgotten or answered twice, an ended goal stays as it is, and its
        /// result is kept as long as promised.
        #[test]
        fn every_question_is_answered_once(steps in prop::collection::vec(step(), 0..80)) {
            let mut goals = Goals::<(), usize>::new(Duration::from_secs(10));
            let mut now = Duration::ZERO;
            let (mut asked, mut answered) = (0, Vec::new());
            for step in steps {
                let before: Vec<_> = (0..4).map(|goal| goals.status(id(goal))).collect();
                match step {
                    Step::Accept(goal) => _ = goals.accept(id(goal), Time::default()),
                    Step::Start(goal) => _ = goals.start(id(goal)),
                    Step::Cancel(goal) => _ = goals.begin_cancel(id(goal)),
                    Step::Finish(goal, status) => {
                        let status = GoalStatus::from_number(status.rem_euclid(7));
                        answered.extend(goals.finish(id(goal), status, (), now).unwrap_or_default());
                    }
                    Step::Ask(goal) => {
                        match goals.result(id(goal), asked) {
                            ResultOf::Known(who, status, ()) => {
                                prop_assert!(status.is_terminal());
                                answered.push(who);
                            }
                            ResultOf::Unknown(who) => answered.push(who),
                            ResultOf::Later => prop_assert!(!before[usize::from(goal)].is_terminal()),
                        }
                        asked += 1;
                    }
                    Step::Expire(seconds) => {
                        now += Duration::from_secs(seconds);
                        for gone in goals.expire(now) {
                            prop_assert!(before[usize::from(gone.0[0])].is_terminal());
                        }
                        prop_assert!(goals.next_expiry().is_none_or(|next| next > now));
                    }
                }
                for (goal, before) in (0..4).zip(before) {
                    let after = goals.status(id(goal));
                    let forgotten = before.is_terminal() && after == GoalStatus::Unknown;
                    let begun = before == GoalStatus::Unknown && after == GoalStatus::Accepted;
                    prop_assert!(before == after || before.may_become(after) || forgotten || begun);
                }
            }
            for goal in 0..4 {
                let _ = goals.start(id(goal));
                answered.extend(goals.finish(id(goal), GoalStatus::Aborted, (), now).unwrap_or_default());
            }
            answered.sort_unstable();
            prop_assert_eq!(answered, (0..asked).collect::<Vec<_>>());
        }
    }
}
