use std::{
    future::Future,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use minifactory_msgs::{
    Action, Message,
    action_msgs::{
        msg::{GoalInfo, GoalStatusArray},
        srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse},
    },
    builtin_interfaces::msg::Time,
    unique_identifier_msgs::msg::UUID,
};

use super::{GoalId, GoalStatus};
use crate::{
    dds::{DdsError, Participant, Qos, Reader, Sample},
    service::{Answer, ServiceClient, ServiceError},
};

/// News of an action server.
pub enum ActionUpdate<A: Action> {
    /// How far a goal is.
    Feedback(GoalId, A::Feedback),
    /// How all goals of the server fare, other clients' included.
    Status(Vec<(GoalId, GoalStatus)>),
}

/// A client of an action.
pub struct ActionClient<A: Action> {
    _topics: [Reader; 2],
    send_goal: ServiceClient<A::SendGoal>,
    cancel_goal: ServiceClient<CancelGoal>,
    get_result: ServiceClient<A::GetResult>,
}

impl<A: Action> ActionClient<A> {
    /// Makes a client of an action, e.g. `/feeder/deliver_part`. `deliver` gets feedback and status of all goals, on the
    /// participant's thread, and must return soon (see [`crate::dds`]).
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad name, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn new(
        participant: &Participant,
        name: &str,
        deliver: impl FnMut(ActionUpdate<A>) + Send + 'static,
    ) -> Result<Self, DdsError> {
        let topic = |part: &str| format!("{name}/_action/{part}");
        let deliver = Arc::new(Mutex::new(deliver));
        let feedback_type = <A::FeedbackMessage as Message>::INFO.dds_type();
        let feedback = participant.reader(&topic("feedback"), &feedback_type, &Qos::command(), {
            let deliver = deliver.clone();
            move |sample| {
                if let Some(message) = read::<A::FeedbackMessage>(&sample) {
                    let (id, feedback): (UUID, _) = message.into();
                    deliver.lock().unwrap_or_else(PoisonError::into_inner)(ActionUpdate::Feedback(id.into(), feedback));
                }
            }
        })?;
        let status_type = GoalStatusArray::INFO.dds_type();
        let status = participant.reader(&topic("status"), &status_type, &Qos::latched(), move |sample| {
            if let Some(message) = read::<GoalStatusArray>(&sample) {
                let fare = |goal: &minifactory_msgs::action_msgs::msg::GoalStatus| {
                    (goal.goal_info.goal_id.into(), GoalStatus::from_number(goal.status))
                };
                let statuses = message.status_list.iter().map(fare).collect();
                deliver.lock().unwrap_or_else(PoisonError::into_inner)(ActionUpdate::Status(statuses));
            }
        })?;
        Ok(Self {
            _topics: [feedback, status],
            send_goal: participant.service_client(&topic("send_goal"))?,
            cancel_goal: participant.service_client(&topic("cancel_goal"))?,
            get_result: participant.service_client(&topic("get_result"))?,
        })
    }

    /// Whether a server is there.
    #[must_use]
    pub fn is_available(&self) -> bool {
        self.send_goal.is_available() && self.cancel_goal.is_available() && self.get_result.is_available()
    }

    /// Sends a goal under an id of the caller's choice, unlike all others of the server. The answer says whether, and
    /// when, it was accepted.
    pub fn send_goal(&self, id: GoalId, goal: A::Goal, timeout: Duration) -> Answer<A::SendGoalResponse> {
        self.send_goal.call(&(UUID::from(id), goal).into(), timeout)
    }

    /// Asks to cancel one goal, or all goals of the server. Which are canceling is in the answer; how they end is in
    /// their results.
    pub fn cancel(&self, goal: Option<GoalId>, timeout: Duration) -> Answer<CancelGoalResponse> {
        let goal_id = goal.map(UUID::from).unwrap_or_default();
        let goal_info = GoalInfo { goal_id, stamp: Time::default() };
        self.cancel_goal.call(&CancelGoalRequest { goal_info }, timeout)
    }

    /// Asks for a goal's result, which comes when it has ended; status [`GoalStatus::Unknown`] when the server does not
    /// know the goal.
    pub fn result(
        &self,
        goal: GoalId,
        timeout: Duration,
    ) -> impl Future<Output = Result<(GoalStatus, A::Result), ServiceError>> + Send + use<A> {
        let answer = self.get_result.call(&UUID::from(goal).into(), timeout);
        async move {
            let (status, result) = answer.await?.into();
            Ok((GoalStatus::from_number(status), result))
        }
    }
}

/// Reads a message; one that cannot be read is logged.
fn read<M: Message>(sample: &Sample) -> Option<M> {
    sample
        .decode()
        .inspect_err(|error| tracing::warn!(writer = %sample.writer_guid, "action message refused: {error}"))
        .ok()
}
