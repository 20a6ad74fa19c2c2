//! Actions, made of the same ports as everything else: three services and two topics, with ROS 2's hidden names.

use std::collections::BTreeMap;

use minifactory_msgs::action_msgs::msg::{GoalInfo, GoalStatus, GoalStatusArray};
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::Action;

use super::ports::{Client, Declare, Latency, Publisher, Server, Subscriber};
use super::step::{Asker, CallId, StepIo, ns_of_stamp};
use crate::dds::Qos;

/// Identifies a goal for as long as anybody may ask for it.
pub type GoalId = [u8; 16];

/// How long the result of a finished goal can still be asked for, ns. What rcl_action calls result_timeout, with its
/// default of 10 s.
const RESULT_LIFETIME_NS: u64 = 10_000_000_000;

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
    fn status(self) -> i8 {
        match self {
            Self::Succeeded => GoalStatus::STATUS_SUCCEEDED,
            Self::Canceled => GoalStatus::STATUS_CANCELED,
            Self::Aborted => GoalStatus::STATUS_ABORTED,
        }
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
    pub fn action_server<A: Action>(&mut self, name: &str) -> ActionServerPorts<A> {
        ActionServerPorts {
            send_goal: self.server(&format!("{name}/_action/send_goal")),
            cancel: self.server(&format!("{name}/_action/cancel_goal")),
            get_result: self.server(&format!("{name}/_action/get_result")),
            feedback: self.publisher(&format!("{name}/_action/feedback"), Qos::command()),
            status: self.publisher(&format!("{name}/_action/status"), Qos::latched()),
        }
    }

    /// Declares the use of another node's action. Requests are as late as `latency` says; answers come forward.
    pub fn action_client<A: Action>(&mut self, name: &str, latency: Latency) -> ActionClientPorts<A> {
        ActionClientPorts {
            send_goal: self.client(&format!("{name}/_action/send_goal"), latency),
            cancel: self.client(&format!("{name}/_action/cancel_goal"), latency),
            get_result: self.client(&format!("{name}/_action/get_result"), latency),
            feedback: self.subscriber(&format!("{name}/_action/feedback"), Latency::Forward, Qos::command()),
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

#[derive(Debug)]
struct Goal<R> {
    accepted: Time,
    status: i8,
    result: Option<R>,
    ended_ns: u64,
    waiting: Vec<Asker>,
}

/// The server's side of an action.
pub struct ActionServer<A: Action> {
    ports: ActionServerPorts<A>,
    goals: BTreeMap<GoalId, Goal<A::Result>>,
    changed: bool,
}

impl<A: Action> ActionServer<A> {
    /// A server on `ports` without goals.
    #[must_use]
    pub fn new(ports: ActionServerPorts<A>) -> Self {
        Self { ports, goals: BTreeMap::new(), changed: true }
    }

    /// Answers what needs no decision and returns what does. Call it once a step, before anything else.
    pub fn poll(&mut self, io: &mut StepIo) -> Vec<ServerEvent<A>> {
        self.expire(io.now_ns());
        let mut events = Vec::new();
        for (asker, request) in io.requests(&self.ports.send_goal) {
            let (id, goal): (UUID, A::Goal) = request.into();
            if self.goals.contains_key(&id.uuid) {
                // A second goal of the same identifier would make results ambiguous.
                tracing::warn!("rejected a goal: its identifier is in use");
                io.reply(&self.ports.send_goal, asker, &(false, io.stamp()).into());
            } else {
                events.push(ServerEvent::Requested(GoalRequest { id: id.uuid, goal, asker }));
            }
        }
        for (asker, request) in io.requests(&self.ports.cancel) {
            let (response, canceling) = self.cancel(&request);
            events.extend(canceling.into_iter().map(ServerEvent::CancelRequested));
            io.reply(&self.ports.cancel, asker, &response);
        }
        for (asker, request) in io.requests(&self.ports.get_result) {
            let id: UUID = request.into();
            match self.goals.get_mut(&id.uuid) {
                None => {
                    let unknown = (GoalStatus::STATUS_UNKNOWN, A::Result::default());
                    io.reply(&self.ports.get_result, asker, &unknown.into());
                }
                Some(Goal { status, result: Some(result), .. }) => {
                    io.reply(&self.ports.get_result, asker, &(*status, result.clone()).into());
                }
                Some(goal) => goal.waiting.push(asker),
            }
        }
        self.publish_status(io);
        events
    }

    /// Takes up a goal.
    pub fn accept(&mut self, io: &mut StepIo, request: GoalRequest<A>) {
        let accepted = io.stamp();
        io.reply(&self.ports.send_goal, request.asker, &(true, accepted.clone()).into());
        let status = GoalStatus::STATUS_EXECUTING;
        self.goals.insert(request.id, Goal { accepted, status, result: None, ended_ns: 0, waiting: Vec::new() });
        self.changed = true;
        self.publish_status(io);
    }

    /// Refuses a goal, and logs why: the answer itself has no room for a reason.
    pub fn reject(&mut self, io: &mut StepIo, request: GoalRequest<A>, reason: &str) {
        tracing::warn!("rejected a goal: {reason}");
        io.reply(&self.ports.send_goal, request.asker, &(false, io.stamp()).into());
    }

    /// Tells how far a goal is.
    pub fn feedback(&self, io: &mut StepIo, id: GoalId, feedback: A::Feedback) {
        io.publish(&self.ports.feedback, &(UUID { uuid: id }, feedback).into());
    }

    /// Ends a goal. A goal that is unknown or has ended stays as it is.
    pub fn finish(&mut self, io: &mut StepIo, id: GoalId, end: GoalEnd, result: A::Result) {
        let Some(goal) = self.goals.get_mut(&id).filter(|goal| goal.result.is_none()) else { return };
        goal.status = end.status();
        goal.ended_ns = io.now_ns();
        for asker in goal.waiting.drain(..) {
            io.reply(&self.ports.get_result, asker, &(goal.status, result.clone()).into());
        }
        goal.result = Some(result);
        self.changed = true;
        self.publish_status(io);
    }

    /// Marks the goals that a request selects as canceling: one, all, or all accepted up to a time.
    fn cancel(&mut self, request: &CancelGoalRequest) -> (CancelGoalResponse, Vec<GoalId>) {
        let GoalInfo { goal_id, stamp } = &request.goal_info;
        let (any_id, any_time) = (goal_id.uuid == [0; 16], ns_of_stamp(stamp) == 0);
        let selected = |id: &GoalId, accepted: &Time| {
            let by_time = !any_time && ns_of_stamp(accepted) <= ns_of_stamp(stamp);
            if any_id { any_time || by_time } else { *id == goal_id.uuid || by_time }
        };
        let mut response = CancelGoalResponse { return_code: CancelGoalResponse::ERROR_NONE, ..Default::default() };
        let mut canceling = Vec::new();
        for (id, goal) in &mut self.goals {
            if goal.result.is_none() && selected(id, &goal.accepted) {
                goal.status = GoalStatus::STATUS_CANCELING;
                self.changed = true;
                canceling.push(*id);
                response.goals_canceling.push(GoalInfo { goal_id: UUID { uuid: *id }, stamp: goal.accepted.clone() });
            }
        }
        if canceling.is_empty() && !any_id {
            response.return_code = match self.goals.get(&goal_id.uuid) {
                None => CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID,
                Some(_) => CancelGoalResponse::ERROR_GOAL_TERMINATED,
            };
        }
        (response, canceling)
    }

    fn expire(&mut self, now_ns: u64) {
        let before = self.goals.len();
        self.goals.retain(|_, goal| goal.result.is_none() || now_ns < goal.ended_ns + RESULT_LIFETIME_NS);
        self.changed |= self.goals.len() != before;
    }

    fn publish_status(&mut self, io: &mut StepIo) {
        if !std::mem::take(&mut self.changed) {
            return;
        }
        let status_list = self.goals.iter().map(|(id, goal)| GoalStatus {
            goal_info: GoalInfo { goal_id: UUID { uuid: *id }, stamp: goal.accepted.clone() },
            status: goal.status,
        });
        io.publish(&self.ports.status, &GoalStatusArray { status_list: status_list.collect() });
    }
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
        let call = io.call(&self.ports.send_goal, &(UUID { uuid: id }, goal).into());
        self.sent.insert(call, id);
    }

    /// Asks for a goal to end.
    pub fn cancel(&mut self, io: &mut StepIo, id: GoalId) {
        let goal_info = GoalInfo { goal_id: UUID { uuid: id }, stamp: Time::default() };
        io.call(&self.ports.cancel, &CancelGoalRequest { goal_info });
    }

    /// What has been heard of goals of this client since the last step.
    pub fn poll(&mut self, io: &mut StepIo) -> Vec<ClientEvent<A>> {
        let mut events = Vec::new();
        for (call, response) in io.replies(&self.ports.send_goal) {
            let Some(id) = self.sent.remove(&call) else { continue };
            let (accepted, _): (bool, Time) = response.into();
            if accepted {
                let call = io.call(&self.ports.get_result, &UUID { uuid: id }.into());
                self.asked.insert(call, id);
                events.push(ClientEvent::Accepted(id));
            } else {
                events.push(ClientEvent::Rejected(id));
            }
        }
        for message in io.take(&self.ports.feedback) {
            let (id, feedback): (UUID, A::Feedback) = message.into();
            if self.sent.values().chain(self.asked.values()).any(|known| *known == id.uuid) {
                events.push(ClientEvent::Feedback(id.uuid, feedback));
            }
        }
        for (call, response) in io.replies(&self.ports.get_result) {
            let Some(id) = self.asked.remove(&call) else { continue };
            let (status, result): (i8, A::Result) = response.into();
            let end = match status {
                GoalStatus::STATUS_SUCCEEDED => Some(GoalEnd::Succeeded),
                GoalStatus::STATUS_CANCELED => Some(GoalEnd::Canceled),
                GoalStatus::STATUS_ABORTED => Some(GoalEnd::Aborted),
                _ => None,
            };
            events.push(ClientEvent::Finished(id, end, result));
        }
        io.replies(&self.ports.cancel);
        events
    }
}
