//! Actions, made of the same ports as everything else: three services and two topics, with ROS 2's hidden names.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use minifactory_msgs::Action;
use minifactory_msgs::action_msgs::msg::{GoalInfo, GoalStatusArray};
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::interface::ActionSpec;
use minifactory_msgs::unique_identifier_msgs::msg::UUID;

use super::ports::{Client, Declare, Latency, Publisher, Server, Subscriber};
use super::step::{Asker, CallId, StepIo};
use crate::action::goals::{Goals, NothingToCancel, ResultOf};
use crate::action::{GoalId, GoalStatus};
use crate::dds::Qos;

/// How long the result of a finished goal can still be asked for. What rcl_action calls result_timeout, with its
/// default.
const RESULT_LIFETIME: Duration = Duration::from_secs(10);

/// How a goal ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GoalEnd {
    /// As asked.
    Succeeded,
    /// By the client's wish.
    Canceled,
    /// By the server's.
    Aborted,
}

impl GoalEnd {
    fn status(self) -> GoalStatus {
        match self {
            Self::Succeeded => GoalStatus::Succeeded,
            Self::Canceled => GoalStatus::Canceled,
            Self::Aborted => GoalStatus::Aborted,
        }
    }

    fn of_status(status: GoalStatus) -> Option<Self> {
        [Self::Succeeded, Self::Canceled, Self::Aborted].into_iter().find(|end| end.status() == status)
    }
}

/// The ports of an action server.
pub struct ActionServerPorts<A: Action> {
    send_goal: Server<A::SendGoal>,
    cancel: Server<CancelGoal>,
    get_result: Server<A::GetResult>,
    feedback: Publisher<A::FeedbackMessage>,
    status: Publisher<GoalStatusArray>,
}

/// The ports of an action client.
pub struct ActionClientPorts<A: Action> {
    send_goal: Client<A::SendGoal>,
    cancel: Client<CancelGoal>,
    get_result: Client<A::GetResult>,
    feedback: Subscriber<A::FeedbackMessage>,
}

impl Declare {
    /// Declares an action that this node serves.
    pub fn action_server<A: Action>(&mut self, action: &ActionSpec<A>) -> ActionServerPorts<A> {
        let namespace = self.namespace().to_owned();
        let name = self.owned(&namespace, action.facts(), "serves");
        ActionServerPorts {
            send_goal: self.server_named(format!("{name}/_action/send_goal")),
            cancel: self.server_named(format!("{name}/_action/cancel_goal")),
            get_result: self.server_named(format!("{name}/_action/get_result")),
            feedback: self.publisher_named(format!("{name}/_action/feedback"), Qos::command()),
            status: self.publisher_named(format!("{name}/_action/status"), Qos::latched()),
        }
    }

    /// Declares the use of another node's action. Requests are as late as is stated; answers come forward.
    pub fn action_client<A: Action>(&mut self, action: &ActionSpec<A>) -> ActionClientPorts<A> {
        let namespace = self.namespace().to_owned();
        self.action_client_in(&namespace, action)
    }

    /// Declares the use of an action that is served in `namespace`.
    pub fn action_client_in<A: Action>(&mut self, namespace: &str, action: &ActionSpec<A>) -> ActionClientPorts<A> {
        let (name, latency) = self.used(namespace, action.facts(), "calls");
        ActionClientPorts {
            send_goal: self.client_named(format!("{name}/_action/send_goal"), latency),
            cancel: self.client_named(format!("{name}/_action/cancel_goal"), latency),
            get_result: self.client_named(format!("{name}/_action/get_result"), latency),
            feedback: self.subscriber_named(format!("{name}/_action/feedback"), Latency::Forward, Qos::command()),
        }
    }
}

/// What clients ask of an action server.
#[derive(Debug)]
pub enum ServerEvent<A: Action> {
    /// A new goal, waiting for [`ActionServer::accept`] or [`ActionServer::reject`].
    Requested(GoalRequest<A>),
    /// A client wants the goal to end; the node ends it when it can.
    CancelRequested(GoalId),
}

/// A goal that is neither accepted nor rejected yet.
#[derive(Debug)]
pub struct GoalRequest<A: Action> {
    /// Its identifier.
    pub id: GoalId,
    /// What is asked for.
    pub goal: A::Goal,
    asker: Asker,
}

impl<A: Action> GoalRequest<A> {
    /// A number that tells the client from others.
    #[must_use]
    pub fn client(&self) -> u64 {
        self.asker.client()
    }

    /// A number that tells the client's process from others.
    #[must_use]
    pub fn participant(&self) -> u64 {
        self.asker.participant()
    }
}

/// The server's side of an action: [`Goals`] behind ports.
pub struct ActionServer<A: Action> {
    ports: ActionServerPorts<A>,
    goals: Goals<A::GetResultResponse, Asker>,
    /// Who asked for the goals, where they alone may cancel them.
    owners: Option<BTreeMap<GoalId, u64>>,
    /// Goals that are neither accepted nor rejected yet.
    undecided: BTreeSet<GoalId>,
    /// Rejected goals, why, and when to forget that.
    refused: Vec<(GoalId, A::GetResultResponse, Duration)>,
    changed: bool,
}

impl<A: Action> ActionServer<A> {
    /// A server on `ports` without goals.
    #[must_use]
    pub fn new(ports: ActionServerPorts<A>) -> Self {
        Self {
            ports,
            goals: Goals::new(RESULT_LIFETIME),
            owners: None,
            undecided: BTreeSet::new(),
            refused: Vec::new(),
            changed: true,
        }
    }

    /// Only the process that has asked for a goal may cancel it.
    #[must_use]
    pub fn cancelled_by_owners(self) -> Self {
        Self { owners: Some(BTreeMap::new()), ..self }
    }

    /// Answers what needs no decision and returns what does. Call it once a step, before anything else.
    pub fn poll(&mut self, io: &mut StepIo) -> Vec<ServerEvent<A>> {
        for expired in self.goals.expire(now(io)) {
            self.changed = true;
            self.owners.iter_mut().for_each(|owners| _ = owners.remove(&expired));
        }
        self.refused.retain(|(.., forget)| *forget > now(io));
        let mut events = Vec::new();
        for (asker, request) in io.requests(&self.ports.send_goal) {
            let (id, goal): (UUID, A::Goal) = request.into();
            let id = GoalId::from(id);
            if self.goals.status(id) == GoalStatus::Unknown && self.undecided.insert(id) {
                events.push(ServerEvent::Requested(GoalRequest { id, goal, asker }));
            } else {
                // A second goal of the same identifier would make results ambiguous.
                tracing::warn!("rejected goal {id}: its identifier is in use");
                io.reply(&self.ports.send_goal, asker, &(false, io.stamp()).into());
            }
        }
        for (asker, request) in io.requests(&self.ports.cancel) {
            let response = self.cancel(&request, asker.participant());
            let canceling = response.goals_canceling.iter().map(|info| info.goal_id.into());
            events.extend(canceling.map(ServerEvent::CancelRequested));
            io.reply(&self.ports.cancel, asker, &response);
        }
        for (asker, request) in io.requests(&self.ports.get_result) {
            let id: UUID = request.into();
            match self.goals.result(id.into(), asker) {
                ResultOf::Known(asker, _, response) => io.reply(&self.ports.get_result, asker, response),
                ResultOf::Unknown(asker) => {
                    let refused = self.refused.iter().find(|(refused, ..)| *refused == GoalId::from(id));
                    let response = refused.map_or_else(
                        || (GoalStatus::Unknown as i8, A::Result::default()).into(),
                        |(_, response, _)| response.clone(),
                    );
                    io.reply(&self.ports.get_result, asker, &response);
                }
                ResultOf::Later => {}
            }
        }
        self.publish_status(io);
        events
    }

    /// Takes up a goal.
    pub fn accept(&mut self, io: &mut StepIo, request: GoalRequest<A>) {
        let accepted = io.stamp();
        self.owners.iter_mut().for_each(|owners| _ = owners.insert(request.id, request.participant()));
        self.undecided.remove(&request.id);
        if let Err(error) = self.goals.accept(request.id, accepted).and_then(|()| self.goals.start(request.id)) {
            // Identifiers in use never become a request.
            tracing::error!("{error}");
        }
        io.reply(&self.ports.send_goal, request.asker, &(true, accepted).into());
        self.changed = true;
        self.publish_status(io);
    }

    /// Refuses a goal, and logs why: the answer itself has no room for a reason.
    pub fn reject(&mut self, io: &mut StepIo, request: GoalRequest<A>, reason: &str) {
        tracing::warn!("rejected goal {}: {reason}", request.id);
        self.undecided.remove(&request.id);
        io.reply(&self.ports.send_goal, request.asker, &(false, io.stamp()).into());
    }

    /// Refuses a goal and logs why, and gives `result` to a client that asks for the result all the same: the answer to
    /// the goal has no room for a reason.
    pub fn reject_with(&mut self, io: &mut StepIo, request: GoalRequest<A>, reason: &str, result: A::Result) {
        let response = (GoalStatus::Aborted as i8, result).into();
        self.refused.push((request.id, response, now(io) + RESULT_LIFETIME));
        self.reject(io, request, reason);
    }

    /// Tells how far a goal is.
    pub fn feedback(&self, io: &mut StepIo, id: GoalId, feedback: A::Feedback) {
        io.publish(&self.ports.feedback, &(UUID::from(id), feedback).into());
    }

    /// Ends a goal. A goal that is unknown or has ended stays as it is.
    pub fn finish(&mut self, io: &mut StepIo, id: GoalId, end: GoalEnd, result: A::Result) {
        if end == GoalEnd::Canceled {
            // A node may cancel a goal that no client wants cancelled, such as one that another goal replaces; when a
            // client does, the goal is canceling already.
            let _ = self.goals.begin_cancel(id);
        }
        let response: A::GetResultResponse = (end.status() as i8, result).into();
        match self.goals.finish(id, end.status(), response.clone(), now(io)) {
            Ok(waiting) => {
                for asker in waiting {
                    io.reply(&self.ports.get_result, asker, &response);
                }
                self.changed = true;
                self.publish_status(io);
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }

    /// Marks the goals that a participant means, and may cancel, as canceling.
    fn cancel(&mut self, request: &CancelGoalRequest, participant: u64) -> CancelGoalResponse {
        let is_owner = |id: &GoalId| self.owners.as_ref().is_none_or(|owners| owners.get(id) == Some(&participant));
        match self.goals.to_cancel(request) {
            Ok(meant) if !meant.iter().any(is_owner) => {
                CancelGoalResponse { return_code: CancelGoalResponse::ERROR_REJECTED, goals_canceling: Vec::new() }
            }
            Ok(mut meant) => {
                meant.retain(is_owner);
                let canceling = meant.into_iter().filter(|id| self.goals.begin_cancel(*id).is_ok());
                let canceling: Vec<GoalId> = canceling.collect();
                self.changed = true;
                let goals_canceling = canceling.into_iter().filter_map(|id| self.goals.info(id)).collect();
                CancelGoalResponse { return_code: CancelGoalResponse::ERROR_NONE, goals_canceling }
            }
            Err(reason) => {
                let return_code = match reason {
                    NothingToCancel::UnknownGoal => CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID,
                    NothingToCancel::Terminated => CancelGoalResponse::ERROR_GOAL_TERMINATED,
                    // As rclcpp answers: all of no goals are canceling.
                    NothingToCancel::NoneRunning => CancelGoalResponse::ERROR_NONE,
                };
                CancelGoalResponse { return_code, goals_canceling: Vec::new() }
            }
        }
    }

    fn publish_status(&mut self, io: &mut StepIo) {
        if std::mem::take(&mut self.changed) {
            let status_list = self.goals.statuses().collect();
            io.publish(&self.ports.status, &GoalStatusArray { status_list });
        }
    }
}

/// The present, on the clock that results expire by.
fn now(io: &StepIo) -> Duration {
    Duration::from_nanos(io.now_ns())
}

/// What an action client hears of its goals.
#[derive(Debug)]
pub enum ClientEvent<A: Action> {
    /// The goal is being pursued.
    Accepted(GoalId),
    /// The goal was refused.
    Rejected(GoalId),
    /// How far it is.
    Feedback(GoalId, A::Feedback),
    /// How it ended; `None` when the server does not know it.
    Finished(GoalId, Option<GoalEnd>, A::Result),
    /// The server did not answer: whether it pursues the goal, or how it ended, is not known. Nothing more will be heard
    /// of it.
    Lost(GoalId),
}

/// The client's side of an action.
pub struct ActionClient<A: Action> {
    ports: ActionClientPorts<A>,
    sent: BTreeMap<CallId, GoalId>,
    asked: BTreeMap<CallId, GoalId>,
}

impl<A: Action> ActionClient<A> {
    /// A client on `ports` without goals.
    #[must_use]
    pub fn new(ports: ActionClientPorts<A>) -> Self {
        Self { ports, sent: BTreeMap::new(), asked: BTreeMap::new() }
    }

    /// Asks for a goal under an identifier the caller chooses; in a repeatable run it comes from a seeded generator.
    pub fn send(&mut self, io: &mut StepIo, id: GoalId, goal: A::Goal) {
        let call = io.call(&self.ports.send_goal, &(UUID::from(id), goal).into());
        self.sent.insert(call, id);
    }

    /// Asks for a goal to end.
    pub fn cancel(&mut self, io: &mut StepIo, id: GoalId) {
        let goal_info = GoalInfo { goal_id: id.into(), stamp: Time::default() };
        io.call(&self.ports.cancel, &CancelGoalRequest { goal_info });
    }

    /// What has been heard of goals of this client since the last step.
    pub fn poll(&mut self, io: &mut StepIo) -> Vec<ClientEvent<A>> {
        let mut events = Vec::new();
        for (call, response) in io.answers(&self.ports.send_goal) {
            let Some(id) = self.sent.remove(&call) else { continue };
            let Some(response) = response else {
                events.push(ClientEvent::Lost(id));
                continue;
            };
            let (accepted, _): (bool, Time) = response.into();
            if accepted {
                let call = io.call(&self.ports.get_result, &UUID::from(id).into());
                self.asked.insert(call, id);
                events.push(ClientEvent::Accepted(id));
            } else {
                events.push(ClientEvent::Rejected(id));
            }
        }
        for message in io.take(&self.ports.feedback) {
            let (id, feedback): (UUID, A::Feedback) = message.into();
            let id = GoalId::from(id);
            if self.sent.values().chain(self.asked.values()).any(|known| *known == id) {
                events.push(ClientEvent::Feedback(id, feedback));
            }
        }
        for (call, response) in io.answers(&self.ports.get_result) {
            let Some(id) = self.asked.remove(&call) else { continue };
            let Some(response) = response else {
                events.push(ClientEvent::Lost(id));
                continue;
            };
            let (status, result): (i8, A::Result) = response.into();
            let end = GoalEnd::of_status(GoalStatus::from_number(status));
            events.push(ClientEvent::Finished(id, end, result));
        }
        io.replies(&self.ports.cancel);
        events
    }
}

#[cfg(test)]
mod tests;
