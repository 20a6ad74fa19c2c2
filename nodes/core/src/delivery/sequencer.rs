//! The planner's sequence: look, feed until something fits, stop, settle, look again, move, present, return.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Rotation2, Vector2, Vector3};

use super::choice::{CandidateFrame, Choice, choose, protected_parts};
use super::config::DeliveryConfig;
use super::plan::MovePlanner;
use super::protocol::{
    CourierReport, Delivered, DeliveryId, DeliveryRequest, Failure, MoveId, Output, Phase, Refusal, Stamp, Warning,
};
use crate::courier::{CourierLimits, Load};
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;

/// An accepted request.
#[derive(Clone, Debug)]
struct Delivery {
    id: DeliveryId,
    request: DeliveryRequest,
    station_m: Vector2<f64>,
    deadline: Option<Stamp>,
}

#[derive(Clone, Debug)]
enum State {
    Idle,
    Feeding { since: Stamp, starved: bool },
    Stopping { since: Stamp },
    Settling,
    Looking { since: Stamp, rest_since: Stamp, seen: Option<Stamp>, looks: u32 },
    Moving { choice: Choice, id: MoveId, deadline: Stamp, ended: bool },
    Presented { delivered: Delivered, deadline: Stamp },
    ToReturn { not_before: Stamp, failures: u32 },
    Returning { id: MoveId, deadline: Stamp, ended: bool, failures: u32 },
    Fault { reason: String },
}

/// Takes delivery requests and what the other nodes report, and says what is to be done. Requests are served in the order
/// in which they came.
///
/// Reports are noted as they come; [`step`](Self::step) acts on them. Nothing here asks the time: every decision follows
/// from stamps and the time passed to `step`.
#[derive(Clone, Debug)]
pub struct DeliverySequencer {
    config: DeliveryConfig,
    planner: MovePlanner,
    state: State,
    queue: VecDeque<Delivery>,
    deliveries: u64,
    moves: u64,
    /// What the generator was last told; nothing at first, when it may be doing anything.
    feed_on: Option<bool>,
    feed_refusal: Option<String>,
    frame: Option<CandidateFrame>,
    courier: Option<CourierReport>,
    /// Since when the courier has neither moved nor vibrated.
    rest_since: Option<Stamp>,
    move_ended: Option<(MoveId, Result<(), String>)>,
    hand_over: Option<bool>,
    outputs: Vec<Output>,
}

impl DeliverySequencer {
    /// Distance from the feeding place within which the courier counts as there, m.
    const ARRIVED_M: f64 = 1e-4;

    /// An idle sequencer for a tray on a courier.
    ///
    /// # Errors
    /// A parameter out of its range, or a feeding place out of the courier's reach.
    pub fn new(
        config: DeliveryConfig,
        tray: TrayGeometry,
        limits: CourierLimits,
        load: Load,
    ) -> Result<Self, OutOfRange> {
        config.validate()?;
        let planner = MovePlanner::new(config.gentle, tray, limits, load)?;
        planner.check_reach(&config.feeding_place)?;
        Ok(Self {
            config,
            planner,
            state: State::Idle,
            queue: VecDeque::new(),
            deliveries: 0,
            moves: 0,
            feed_on: None,
            feed_refusal: None,
            frame: None,
            courier: None,
            rest_since: None,
            move_ended: None,
            hand_over: None,
            outputs: Vec::new(),
        })
    }

    /// The present phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.state {
            State::Idle => Phase::Idle,
            State::Feeding { .. } => Phase::Feeding,
            State::Stopping { .. } => Phase::Stopping,
            State::Settling => Phase::Settling,
            State::Looking { .. } => Phase::Looking,
            State::Moving { .. } => Phase::Moving,
            State::Presented { .. } => Phase::Presented,
            State::ToReturn { .. } | State::Returning { .. } => Phase::Returning,
            State::Fault { .. } => Phase::Fault,
        }
    }

    /// Takes a request that came at `now`.
    ///
    /// # Errors
    /// A station that is unknown or out of reach, a tolerance that cannot be promised, or a planner in fault.
    pub fn request(&mut self, now: Stamp, request: DeliveryRequest) -> Result<DeliveryId, Refusal> {
        if let State::Fault { reason } = &self.state {
            return Err(Refusal::Fault(reason.clone()));
        }
        let Some(&station_m) = self.config.stations_m.get(&request.station) else {
            let known = self.config.stations_m.keys().cloned().collect();
            return Err(Refusal::UnknownStation { station: request.station, known });
        };
        let (tolerance_m, min_m) = (request.tolerance_m, self.config.tolerance_m_min);
        if !(tolerance_m.is_finite() && tolerance_m >= min_m) {
            return Err(Refusal::Tolerance { tolerance_m, min_m });
        }
        let beyond_m = self.planner.distance_to_reach_m(&station_m) - self.planner.tray().outer_radius_m;
        if beyond_m > 0.0 {
            return Err(Refusal::OutOfReach { station: request.station, beyond_m });
        }
        self.deliveries += 1;
        let id = DeliveryId(self.deliveries);
        let deadline = request.timeout.map(|timeout| now.saturating_add(timeout));
        self.queue.push_back(Delivery { id, request, station_m, deadline });
        Ok(id)
    }

    /// Gives a request up. Says whether it was still open.
    pub fn cancel(&mut self, now: Stamp, id: DeliveryId) -> bool {
        self.give_up(now, id, Failure::Cancelled)
    }

    /// Takes the manipulator's report on the part presented to it.
    ///
    /// # Errors
    /// The delivery does not wait for it.
    pub fn report_hand_over(&mut self, id: DeliveryId, taken: bool) -> Result<(), Refusal> {
        let presented = matches!(self.state, State::Presented { .. });
        if !(presented && self.queue.front().is_some_and(|delivery| delivery.id == id)) {
            return Err(Refusal::NotPresented(id));
        }
        self.hand_over = Some(taken);
        Ok(())
    }

    /// Takes what vision saw; a frame older than the last one is ignored.
    pub fn candidates(&mut self, frame: CandidateFrame) {
        if self.frame.as_ref().is_none_or(|last| frame.stamp > last.stamp) {
            self.frame = Some(frame);
        }
    }

    /// Takes the courier's state; a report older than the last one is ignored.
    pub fn courier(&mut self, report: CourierReport) {
        if self.courier.is_none_or(|last| report.stamp > last.stamp) {
            let at_rest = !report.moving && !report.vibrating;
            self.rest_since = at_rest.then(|| self.rest_since.unwrap_or(report.stamp));
            self.courier = Some(report);
        }
    }

    /// Takes the generator's refusal to switch feeding.
    pub fn feed_refused(&mut self, reason: String) {
        self.feed_refusal = Some(reason);
    }

    /// Takes the end of a move: reached, or the driver's reason why not.
    pub fn move_ended(&mut self, id: MoveId, result: Result<(), String>) {
        self.move_ended = Some((id, result));
    }

    /// Leaves the fault.
    pub fn reset(&mut self) {
        if matches!(self.state, State::Fault { .. }) {
            self.enter(State::Idle, None);
        }
    }

    /// Acts on what was reported until `now`.
    pub fn step(&mut self, now: Stamp) -> Vec<Output> {
        let expired: Vec<DeliveryId> = self
            .queue
            .iter()
            .filter(|delivery| delivery.deadline.is_some_and(|deadline| deadline <= now))
            .map(|delivery| delivery.id)
            .collect();
        for id in expired {
            // A part under the tool may be being taken: only the hand-over's own time ends that.
            let presented = matches!(self.state, State::Presented { .. });
            if !(presented && self.queue.front().is_some_and(|delivery| delivery.id == id)) {
                self.give_up(now, id, Failure::TimedOut(self.phase()));
            }
        }
        while self.advance(now) {}
        std::mem::take(&mut self.outputs)
    }

    /// Makes the transition that is due, if any.
    fn advance(&mut self, now: Stamp) -> bool {
        if let Some(reason) = self.feed_refusal.take() {
            self.feed_on = None;
            if matches!(self.state, State::Feeding { .. } | State::Stopping { .. }) {
                self.fail(now, Failure::FeedRefused(reason));
                return true;
            }
            self.outputs.push(Output::Warning(Warning::FeedRefused(reason)));
        }
        match self.state.clone() {
            State::Idle => self.idle(now),
            State::Feeding { since, starved } => self.feeding(now, since, starved),
            State::Stopping { since } => {
                let stopped = self.rest_since.is_some() && self.courier.is_some_and(|report| report.stamp >= since);
                if stopped {
                    self.enter(State::Settling, None)
                } else {
                    late(now, since, self.config.stop_timeout_s) && self.fail(now, Failure::DidNotStop)
                }
            }
            State::Settling => match self.rest_since {
                None => self.stop(now),
                Some(rest_since) if now >= rest_since + self.config.settle() => {
                    self.enter(State::Looking { since: now, rest_since, seen: None, looks: 0 }, None)
                }
                Some(_) => false,
            },
            State::Looking { since, rest_since, seen, looks } => self.looking(now, since, rest_since, seen, looks),
            State::Moving { choice, id, deadline, ended } => self.moving(now, choice, id, deadline, ended),
            State::Presented { delivered, deadline } => match self.hand_over.take() {
                Some(true) => self.finish(now, Ok(delivered)),
                Some(false) => self.fail(now, Failure::NotTaken),
                None => now >= deadline && self.fail(now, Failure::NoHandOver),
            },
            State::ToReturn { not_before, failures } => {
                now >= not_before && self.rest_since.is_some() && self.begin_return(now, failures)
            }
            State::Returning { id, deadline, ended, failures } => self.returning(now, id, deadline, ended, failures),
            State::Fault { reason } => {
                let open = !self.queue.is_empty();
                for delivery in std::mem::take(&mut self.queue) {
                    self.outputs.push(Output::Finished(delivery.id, Err(Failure::Fault(reason.clone()))));
                }
                open
            }
        }
    }

    fn idle(&mut self, now: Stamp) -> bool {
        if self.queue.is_empty() {
            self.feed(false);
            return false;
        }
        match self.courier {
            None => false,
            Some(report) if self.at_feeding_place(&report) => self.stop(now),
            Some(_) => self.go_back(now),
        }
    }

    fn feeding(&mut self, now: Stamp, since: Stamp, starved: bool) -> bool {
        self.feed(true);
        let seen = self.frame.as_ref().map_or(since, |frame| frame.stamp.max(since));
        if late(now, seen, self.config.look_timeout_s) {
            return self.fail(now, Failure::NoImage);
        }
        if seen > since && late(now, since, self.config.feed_s_min) && self.choose().is_some() {
            return self.stop(now);
        }
        if !starved && late(now, since, self.config.starvation_s) {
            self.outputs.push(Output::Warning(Warning::Starved(since)));
            self.state = State::Feeding { since, starved: true };
        }
        false
    }

    fn looking(&mut self, now: Stamp, since: Stamp, rest_since: Stamp, seen: Option<Stamp>, looks: u32) -> bool {
        if self.rest_since != Some(rest_since) {
            return self.stop(now);
        }
        let settled = rest_since + self.config.settle();
        let fresh =
            self.frame.as_ref().map(|frame| frame.stamp).filter(|&stamp| stamp >= settled && seen < Some(stamp));
        let Some(stamp) = fresh else {
            return late(now, seen.unwrap_or(since), self.config.look_timeout_s) && self.fail(now, Failure::NoImage);
        };
        if let Some(choice) = self.choose() {
            return self.begin_move(now, choice);
        }
        if looks + 1 >= self.config.looks {
            return self.enter(State::Feeding { since: now, starved: false }, None);
        }
        self.state = State::Looking { since, rest_since, seen: Some(stamp), looks: looks + 1 };
        true
    }

    fn begin_move(&mut self, now: Stamp, choice: Choice) -> bool {
        let Some(report) = self.courier else { return false };
        let protected = protected_parts(&self.config, &self.planner, Some(&choice.candidate), self.frame.as_ref());
        match self.planner.plan(report.position, choice.courier, &protected) {
            Ok(plan) => {
                let arrival = now + Duration::from_secs_f64(plan.duration_s);
                let deadline = arrival + Duration::from_secs_f64(self.config.move_grace_s);
                let id = self.next_move();
                self.enter(State::Moving { choice, id, deadline, ended: false }, Some(arrival));
                self.outputs.push(Output::Move(id, plan));
                true
            }
            Err(error) => self.fail(now, Failure::Plan(error)),
        }
    }

    fn moving(&mut self, now: Stamp, choice: Choice, id: MoveId, deadline: Stamp, ended: bool) -> bool {
        let ended = match self.move_ended.take_if(|(ended, _)| *ended == id) {
            Some((_, Err(reason))) => return self.fail(now, Failure::Move(reason)),
            Some((_, Ok(()))) => true,
            None => ended,
        };
        let (Some(delivery), Some(report)) = (self.queue.front(), self.courier) else { return false };
        let part_m = report.position.xy() + Rotation2::new(report.position.z) * choice.candidate.position_in_tray_m;
        let part_in_station_m = part_m - delivery.station_m;
        if ended && self.rest_since.is_some() && part_in_station_m.norm() <= delivery.request.tolerance_m {
            let yaw_rad = report.position.z + choice.candidate.yaw_in_tray_rad;
            let delivered = Delivered { part_in_station_m, yaw_rad, choice };
            let deadline = now + Duration::from_secs_f64(self.config.hand_over_timeout_s);
            let id = delivery.id;
            self.hand_over = None;
            self.enter(State::Presented { delivered: delivered.clone(), deadline }, Some(now));
            self.outputs.push(Output::Presented(id, delivered));
            return true;
        }
        self.state = State::Moving { choice, id, deadline, ended };
        now >= deadline && self.fail(now, Failure::DidNotArrive)
    }

    fn begin_return(&mut self, now: Stamp, failures: u32) -> bool {
        let Some(report) = self.courier else { return false };
        if self.at_feeding_place(&report) {
            return self.enter(State::Idle, None);
        }
        let protected = protected_parts(&self.config, &self.planner, None, self.frame.as_ref());
        match self.planner.plan(report.position, self.config.feeding_place, &protected) {
            Ok(plan) => {
                let deadline = now + Duration::from_secs_f64(plan.duration_s + self.config.move_grace_s);
                let id = self.next_move();
                self.state = State::Returning { id, deadline, ended: false, failures };
                self.outputs.push(Output::Move(id, plan));
                true
            }
            Err(error) => self.return_failed(now, failures, error.to_string()),
        }
    }

    fn returning(&mut self, now: Stamp, id: MoveId, deadline: Stamp, ended: bool, failures: u32) -> bool {
        let ended = match self.move_ended.take_if(|(ended, _)| *ended == id) {
            Some((_, Err(reason))) => return self.return_failed(now, failures, reason),
            Some((_, Ok(()))) => true,
            None => ended,
        };
        let there = self.courier.is_some_and(|report| self.at_feeding_place(&report));
        if ended && there && self.rest_since.is_some() {
            return self.enter(State::Idle, None);
        }
        if now >= deadline {
            self.outputs.push(Output::CancelMove(id));
            return self.return_failed(now, failures, "the courier did not arrive".into());
        }
        self.state = State::Returning { id, deadline, ended, failures };
        false
    }

    fn return_failed(&mut self, now: Stamp, failures: u32, reason: String) -> bool {
        self.outputs.push(Output::Warning(Warning::ReturnFailed(reason.clone())));
        if failures >= self.config.retries_max {
            return self.enter(State::Fault { reason }, None);
        }
        let not_before = now + Duration::from_secs_f64(self.config.retry_s);
        self.state = State::ToReturn { not_before, failures: failures + 1 };
        true
    }

    /// Feeding off, and on to a look at the parts at rest.
    fn stop(&mut self, now: Stamp) -> bool {
        self.feed(false);
        self.enter(State::Stopping { since: now }, None)
    }

    fn go_back(&mut self, now: Stamp) -> bool {
        self.feed(false);
        self.enter(State::ToReturn { not_before: now, failures: 0 }, None)
    }

    fn feed(&mut self, on: bool) {
        if self.feed_on != Some(on) {
            self.feed_on = Some(on);
            self.outputs.push(Output::Feed(on));
        }
    }

    fn fail(&mut self, now: Stamp, failure: Failure) -> bool {
        self.finish(now, Err(failure))
    }

    /// Ends the delivery under way and goes on to what follows from where the courier is.
    fn finish(&mut self, now: Stamp, result: Result<Delivered, Failure>) -> bool {
        if let State::Moving { id, ended: false, .. } = self.state
            && !matches!(result, Err(Failure::Move(_)))
        {
            self.outputs.push(Output::CancelMove(id));
        }
        if let Some(delivery) = self.queue.pop_front() {
            self.outputs.push(Output::Finished(delivery.id, result));
        }
        match self.state {
            State::Moving { .. } | State::Presented { .. } => self.go_back(now),
            _ => self.enter(State::Idle, None),
        }
    }

    /// Ends an open delivery, under way or waiting. Says whether there was one.
    fn give_up(&mut self, now: Stamp, id: DeliveryId, failure: Failure) -> bool {
        let Some(index) = self.queue.iter().position(|delivery| delivery.id == id) else { return false };
        let under_way = !matches!(self.phase(), Phase::Idle | Phase::Returning | Phase::Fault);
        if index == 0 && under_way {
            self.fail(now, failure);
        } else {
            self.queue.remove(index);
            self.outputs.push(Output::Finished(id, Err(failure)));
        }
        true
    }

    fn choose(&self) -> Option<Choice> {
        let (frame, delivery) = (self.frame.as_ref()?, self.queue.front()?);
        choose(frame, &delivery.request, &delivery.station_m, &self.config, &self.planner)
    }

    fn at_feeding_place(&self, report: &CourierReport) -> bool {
        let offset: Vector3<f64> = report.position - self.config.feeding_place;
        offset.xy().norm() <= Self::ARRIVED_M
    }

    fn next_move(&mut self) -> MoveId {
        self.moves += 1;
        self.move_ended = None;
        MoveId(self.moves)
    }

    /// Enters a state and tells its phase.
    fn enter(&mut self, state: State, presented_at: Option<Stamp>) -> bool {
        self.state = state;
        let phase = self.phase();
        let serves = !matches!(phase, Phase::Idle | Phase::Returning | Phase::Fault);
        let delivery = self.queue.front().map(|delivery| delivery.id).filter(|_| serves);
        self.outputs.push(Output::Phase { phase, delivery, presented_at });
        true
    }
}

fn late(now: Stamp, since: Stamp, timeout_s: f64) -> bool {
    now >= since + Duration::from_secs_f64(timeout_s)
}
