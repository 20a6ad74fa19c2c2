use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use minifactory_msgs::{
    Action, Message,
    action_msgs::{
        msg::GoalStatusArray,
        srv::{CancelGoal, CancelGoalResponse},
    },
    builtin_interfaces::msg::Time,
};
use tokio::{sync::Notify, time::sleep};

use super::goals::{GoalError, GoalId, GoalStatus, Goals, NothingToCancel, ResultOf};
use crate::{
    dds::{BackgroundTask, DdsError, Outlet, Participant, Qos, Server, Writer},
    service::Responder,
};

/// What the clients of an action server want.
pub enum GoalEvent<A: Action> {
    /// A goal is to be taken on.
    Goal(GoalRequest<A>),
    /// Goals are to be cancelled.
    Cancel(CancelRequest<A>),
}

/// An action on offer, until dropped.
pub struct ActionServer<A: Action> {
    // Dropped in this order: nothing is taken that could not be answered.
    _services: [Server; 3],
    _expiry: BackgroundTask,
    _topics: [Writer; 2],
    state: Arc<State<A>>,
}

impl<A: Action> ActionServer<A> {
    /// Offers an action, e.g. `/feeder/deliver_part`. Results are kept for `keep_results` after a goal has ended, for
    /// clients that ask late. `deliver` runs on the participant's thread and must return soon (see [`crate::dds`]); its
    /// events may be answered later and from any thread.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad name, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn new(
        participant: &Participant,
        name: &str,
        keep_results: Duration,
        deliver: impl FnMut(GoalEvent<A>) + Send + 'static,
    ) -> Result<Self, DdsError> {
        let topic = |part: &str| format!("{name}/_action/{part}");
        let feedback_type = <A::FeedbackMessage as Message>::INFO.dds_type();
        let feedback = participant.writer(&topic("feedback"), &feedback_type, &Qos::command())?;
        // Every change of every goal is published at once, the newest must not be refused.
        let status_qos = Qos { backlog: 256, ..Qos::latched() };
        let status = participant.writer(&topic("status"), &GoalStatusArray::INFO.dds_type(), &status_qos)?;
        let state = Arc::new(State {
            goals: Mutex::new(Goals::new(keep_results)),
            ended: Notify::new(),
            began: Instant::now(),
            feedback: feedback.outlet(),
            status: status.outlet(),
        });
        // Both kinds of event go through the one function, whichever service they came by.
        let deliver = Arc::new(Mutex::new(deliver));
        let send_goal = participant.serve_later::<A::SendGoal>(&topic("send_goal"), {
            let (state, deliver) = (state.clone(), deliver.clone());
            move |request, responder| {
                let (id, goal) = request.into();
                let id = id.into();
                let pending = Pending { state: state.clone(), responder: Some(responder), id };
                if state.goals().status(id) == GoalStatus::Unknown {
                    lock(&deliver)(GoalEvent::Goal(GoalRequest { goal, pending }));
                }
            }
        })?;
        let cancel_goal = participant.serve_later::<CancelGoal>(&topic("cancel_goal"), {
            let (state, deliver) = (state.clone(), deliver);
            move |request, responder| {
                let meant = state.goals().to_cancel(&request);
                match meant {
                    Ok(goals) => {
                        let (state, responder) = (state.clone(), Some(responder));
                        lock(&deliver)(GoalEvent::Cancel(CancelRequest { goals, state, responder }));
                    }
                    Err(reason) => responder.send(&refusal(reason)),
                }
            }
        })?;
        let get_result = participant.serve_later::<A::GetResult>(&topic("get_result"), {
            let state = state.clone();
            move |request, responder| {
                let id: minifactory_msgs::unique_identifier_msgs::msg::UUID = request.into();
                match state.goals().result(id.into(), responder) {
                    ResultOf::Known(responder, _, response) => responder.send(response),
                    ResultOf::Unknown(responder) => {
                        responder.send(&result_response::<A>(GoalStatus::Unknown, A::Result::default()));
                    }
                    ResultOf::Later => {}
                }
            }
        })?;
        let expiry = participant.background({
            let state = state.clone();
            async move { state.expire_results().await }
        });
        state.publish_status();
        Ok(Self {
            _services: [send_goal, cancel_goal, get_result],
            _expiry: expiry,
            _topics: [feedback, status],
            state,
        })
    }

    /// How a goal fares.
    #[must_use]
    pub fn status(&self, id: GoalId) -> GoalStatus {
        self.state.goals().status(id)
    }
}

fn refusal(reason: NothingToCancel) -> CancelGoalResponse {
    let return_code = match reason {
        NothingToCancel::UnknownGoal => CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID,
        NothingToCancel::Terminated => CancelGoalResponse::ERROR_GOAL_TERMINATED,
        NothingToCancel::NoneRunning => CancelGoalResponse::ERROR_REJECTED,
    };
    CancelGoalResponse { return_code, goals_canceling: Vec::new() }
}

fn result_response<A: Action>(status: GoalStatus, result: A::Result) -> A::GetResultResponse {
    (status as i8, result).into()
}

fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a server and the handles of its goals share; it does not keep the participant alive.
struct State<A: Action> {
    goals: Mutex<Goals<A::GetResultResponse, Responder<A::GetResult>>>,
    /// Rung when a goal has ended, for then its result begins to age.
    ended: Notify,
    began: Instant,
    feedback: Arc<Outlet>,
    status: Arc<Outlet>,
}

impl<A: Action> State<A> {
    fn goals(&self) -> MutexGuard<'_, Goals<A::GetResultResponse, Responder<A::GetResult>>> {
        lock(&self.goals)
    }

    fn publish_status(&self) {
        // Under the lock, lest an older status follow a newer one.
        let goals = self.goals();
        self.status.publish_message(&GoalStatusArray { status_list: goals.statuses().collect() });
    }

    fn finish(&self, id: GoalId, status: GoalStatus, result: A::Result) -> Result<(), GoalError> {
        let response = result_response::<A>(status, result);
        let waiting = self.goals().finish(id, status, response.clone(), self.began.elapsed())?;
        self.publish_status();
        waiting.into_iter().for_each(|responder| responder.send(&response));
        self.ended.notify_one();
        Ok(())
    }

    async fn expire_results(&self) {
        loop {
            let next = self.goals().next_expiry();
            match next {
                None => self.ended.notified().await,
                Some(next) => {
                    // Results live equally long, so a goal that ends meanwhile does not expire earlier.
                    sleep(next.saturating_sub(self.began.elapsed())).await;
                    let expired = self.goals().expire(self.began.elapsed());
                    if !expired.is_empty() {
                        self.publish_status();
                    }
                }
            }
        }
    }
}

/// A goal a client wants to be taken on. Dropped undecided, it is rejected.
pub struct GoalRequest<A: Action> {
    /// What is wanted.
    pub goal: A::Goal,
    pending: Pending<A>,
}

impl<A: Action> GoalRequest<A> {
    /// The goal's id.
    #[must_use]
    pub fn id(&self) -> GoalId {
        self.pending.id
    }

    /// Takes the goal on, at a time of the node's clock.
    ///
    /// # Errors
    /// [`GoalError::Known`] when the same goal was sent twice and is accepted already; this one is rejected.
    pub fn accept(mut self, stamp: Time) -> Result<GoalHandle<A>, GoalError> {
        let (state, id) = (self.pending.state.clone(), self.pending.id);
        state.goals().accept(id, stamp)?;
        self.pending.decide(true, stamp);
        state.publish_status();
        Ok(GoalHandle { state, id, finished: false })
    }

    /// Refuses the goal.
    pub fn reject(self) {
        drop(self);
    }
}

struct Pending<A: Action> {
    state: Arc<State<A>>,
    responder: Option<Responder<A::SendGoal>>,
    id: GoalId,
}

impl<A: Action> Pending<A> {
    fn decide(&mut self, accepted: bool, stamp: Time) {
        if let Some(responder) = self.responder.take() {
            responder.send(&(accepted, stamp).into());
        }
    }
}

impl<A: Action> Drop for Pending<A> {
    fn drop(&mut self) {
        self.decide(false, Time::default());
    }
}

/// A client's wish to cancel goals. Dropped undecided, it is refused.
pub struct CancelRequest<A: Action> {
    /// The running goals it is about.
    pub goals: Vec<GoalId>,
    state: Arc<State<A>>,
    responder: Option<Responder<CancelGoal>>,
}

impl<A: Action> CancelRequest<A> {
    /// Grants the wish for some of the goals, or all or none: they become canceling and are to be ended soon.
    pub fn grant(mut self, goals: impl IntoIterator<Item = GoalId>) {
        self.decide(goals);
    }

    fn decide(&mut self, granted: impl IntoIterator<Item = GoalId>) {
        let Some(responder) = self.responder.take() else {
            return;
        };
        let goals_canceling: Vec<_> = {
            let mut goals = self.state.goals();
            let canceling = granted.into_iter().filter(|id| self.goals.contains(id) && goals.begin_cancel(*id).is_ok());
            let canceling: Vec<_> = canceling.collect();
            canceling.into_iter().filter_map(|id| goals.info(id)).collect()
        };
        let return_code = if goals_canceling.is_empty() {
            CancelGoalResponse::ERROR_REJECTED
        } else {
            self.state.publish_status();
            CancelGoalResponse::ERROR_NONE
        };
        responder.send(&CancelGoalResponse { return_code, goals_canceling });
    }
}

impl<A: Action> Drop for CancelRequest<A> {
    fn drop(&mut self) {
        self.decide([]);
    }
}

/// A goal that was taken on. Dropped unfinished, it is aborted with an empty result.
pub struct GoalHandle<A: Action> {
    state: Arc<State<A>>,
    id: GoalId,
    finished: bool,
}

impl<A: Action> GoalHandle<A> {
    /// The goal's id.
    #[must_use]
    pub fn id(&self) -> GoalId {
        self.id
    }

    /// How it fares; [`GoalStatus::Canceling`] asks for [`cancel`](Self::cancel) soon.
    #[must_use]
    pub fn status(&self) -> GoalStatus {
        self.state.goals().status(self.id)
    }

    /// Begins to work on it.
    ///
    /// # Errors
    /// [`GoalError::Transition`] when it is not merely accepted.
    pub fn start(&self) -> Result<(), GoalError> {
        self.state.goals().start(self.id)?;
        self.state.publish_status();
        Ok(())
    }

    /// Tells clients how far it is.
    pub fn feedback(&self, feedback: A::Feedback) {
        self.state.feedback.publish_message(&A::FeedbackMessage::from((self.id.into(), feedback)));
    }

    /// Ends it as wished for.
    ///
    /// # Errors
    /// [`GoalError::Transition`] when it was never started; it is then aborted.
    pub fn succeed(self, result: A::Result) -> Result<(), GoalError> {
        self.finish(GoalStatus::Succeeded, result)
    }

    /// Ends it because a client wished so.
    ///
    /// # Errors
    /// [`GoalError::Transition`] when it is not canceling; it is then aborted.
    pub fn cancel(self, result: A::Result) -> Result<(), GoalError> {
        self.finish(GoalStatus::Canceled, result)
    }

    /// Ends it for a reason of the server's.
    ///
    /// # Errors
    /// [`GoalError::Transition`] when it was never started; it is aborted all the same, with an empty result.
    pub fn abort(self, result: A::Result) -> Result<(), GoalError> {
        self.finish(GoalStatus::Aborted, result)
    }

    fn finish(mut self, status: GoalStatus, result: A::Result) -> Result<(), GoalError> {
        self.state.finish(self.id, status, result)?;
        self.finished = true;
        Ok(())
    }
}

impl<A: Action> Drop for GoalHandle<A> {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        // A goal that was never started has to pass through executing; one that was, refuses to.
        let _ = self.state.goals().start(self.id);
        if let Err(error) = self.state.finish(self.id, GoalStatus::Aborted, A::Result::default()) {
            tracing::error!("an abandoned goal cannot be aborted: {error}");
        }
    }
}
