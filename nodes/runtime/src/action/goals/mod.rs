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
        [Self::Accepted, Self::Executing, Self::Canceling, Self::Succeeded, Self::Canceled, Self::Aborted]
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
        Self { goals: BTreeMap::new(), keep_results }
    }

    /// Takes a goal on.
    ///
    /// # Errors
    /// [`GoalError::Known`] when its id is in use.
    pub fn accept(&mut self, id: GoalId, stamp: Time) -> Result<(), GoalError> {
        if self.goals.contains_key(&id) {
            return Err(GoalError::Known(id));
        }
        let goal = Goal { accepted: stamp, status: GoalStatus::Accepted, result: None, waiting: Vec::new() };
        self.goals.insert(id, goal);
        Ok(())
    }

    /// How a goal fares; [`GoalStatus::Unknown`] when there is none of this id.
    #[must_use]
    pub fn status(&self, id: GoalId) -> GoalStatus {
        self.goals.get(&id).map_or(GoalStatus::Unknown, |goal| goal.status)
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
    pub fn finish(&mut self, id: GoalId, status: GoalStatus, result: R, now: Duration) -> Result<Vec<W>, GoalError> {
        let from = self.status(id);
        if !status.is_terminal() {
            return Err(GoalError::Transition { id, from, to: status });
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
            Some(Goal { result: Some((result, _)), status, .. }) => ResultOf::Known(who, *status, result),
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
        let expired = |goal: &Goal<R, W>| goal.result.as_ref().is_some_and(|(_, forget)| *forget <= now);
        let ids: Vec<_> = self.goals.iter().filter(|(_, goal)| expired(goal)).map(|(id, _)| *id).collect();
        for id in &ids {
            self.goals.remove(id);
        }
        ids
    }

    /// All goals, for the status topic.
    pub fn statuses(&self) -> impl Iterator<Item = StatusMessage> {
        self.goals.iter().map(|(id, goal)| StatusMessage {
            goal_info: GoalInfo { goal_id: (*id).into(), stamp: goal.accepted },
            status: goal.status as i8,
        })
    }

    /// What the answer to a request to cancel says of a goal.
    #[must_use]
    pub fn info(&self, id: GoalId) -> Option<GoalInfo> {
        self.goals.get(&id).map(|goal| GoalInfo { goal_id: id.into(), stamp: goal.accepted })
    }

    fn advance(&mut self, id: GoalId, to: GoalStatus) -> Result<&mut Goal<R, W>, GoalError> {
        let goal = self.goals.get_mut(&id).ok_or(GoalError::Unknown(id))?;
        if !goal.status.may_become(to) {
            return Err(GoalError::Transition { id, from: goal.status, to });
        }
        goal.status = to;
        Ok(goal)
    }
}

#[cfg(test)]
mod tests;
