//! The planner's sequence: look, feed until something fits, stop, settle, look again, reserve, move, present, return.

mod carrying;
mod feeding;
mod inputs;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use nalgebra::{Vector2, Vector3};

use super::arrival_watch::ArrivalWatch;
use super::choice::{CandidateFrame, Choice, fitting};
use super::config::DeliveryConfig;
use super::drift::Drift;
use super::feed_watch::{FeedRate, FeedWatch};
use super::leases::Leases;
use super::planner::MovePlanner;
use super::protocol::{CourierReport, Delivered, Failure, HandOver, Output, Phase, Warning};
use super::request::{DeliveryId, DeliveryRequest, MoveId, Stamp};
use super::slip_watch::SlipWatch;
use super::tour::{Open, Overheads, Stop};
use crate::courier::CourierLimits;
use crate::platen::Area;
use feeder_model::motor::Load;
use feeder_model::range::OutOfRange;
use feeder_model::tray::TrayGeometry;

/// An accepted request.
#[derive(Clone, Debug)]
struct Delivery {
    id: DeliveryId,
    request: DeliveryRequest,
    station_m: Vector2<f64>,
    deadline: Option<Stamp>,
}

/// A stop of the trip under way.
#[derive(Clone, Debug)]
struct Planned {
    stop: Stop,
    /// The way there from the stop before, m.
    route_m: Vec<Vector2<f64>>,
}

#[derive(Clone, Debug)]
enum SequencerState {
    Idle,
    Feeding {
        since: Stamp,
        starved: bool,
    },
    Purging {
        since: Stamp,
        deadline: Stamp,
        empty: u32,
        seen: Option<Stamp>,
    },
    Stopping {
        since: Stamp,
    },
    Settling,
    Looking {
        since: Stamp,
        rest_since: Stamp,
        seen: Option<Stamp>,
        looks: u32,
    },
    Reserving {
        stops: VecDeque<Planned>,
    },
    Moving {
        stops: VecDeque<Planned>,
        id: MoveId,
        deadline: Stamp,
        ended: bool,
    },
    Checking {
        stops: VecDeque<Planned>,
        since: Stamp,
        seen: Option<Stamp>,
    },
    Presented {
        stops: VecDeque<Planned>,
        delivered: Delivered,
        since: Stamp,
        deadline: Stamp,
        taken: Option<bool>,
    },
    ToReturn {
        not_before: Stamp,
        failures: u32,
    },
    Returning {
        id: MoveId,
        deadline: Stamp,
        ended: bool,
        failures: u32,
    },
    /// One of the courier's own ends with it.
    Fault {
        reason: String,
        of_courier: bool,
    },
    /// Somebody who is needed is not at work; nothing is wrong.
    Suspended {
        reason: String,
    },
}

impl SequencerState {
    /// The delivery that the courier is out for, or about to leave for.
    fn stop(&self) -> Option<&Stop> {
        match self {
            Self::Reserving { stops }
            | Self::Moving { stops, .. }
            | Self::Checking { stops, .. }
            | Self::Presented { stops, .. } => stops.front().map(|planned| &planned.stop),
            _ => None,
        }
    }
}

/// Takes delivery requests and what the other nodes report, and says what is to be done. The oldest request that some
/// part fits is served on the next trip, others along with it where that delivers more parts a minute.
///
/// Reports are noted as they come; [`step`](Self::step) acts on them. Nothing here asks the time: every decision follows
/// from stamps and the time passed to `step`.
#[derive(Clone, Debug)]
pub struct DeliverySequencer {
    config: DeliveryConfig,
    planner: MovePlanner,
    state: SequencerState,
    /// Open requests, oldest first.
    queue: VecDeque<Delivery>,
    deliveries: u64,
    moves: u64,
    leases: Leases,
    /// The way of the trip under way, out and back, m: on a shared platen the courier may go nowhere else.
    trip_m: Vec<Vector2<f64>>,
    drift: Drift,
    feed_watch: FeedWatch,
    arrival_watch: ArrivalWatch,
    /// Since when the courier has vibrated.
    vibrating_since: Option<Stamp>,
    overheads: Overheads,
    /// When feeding was last told to stop for a look.
    stopped: Option<Stamp>,
    /// What the generator was last told; nothing at first, when it may be doing anything.
    feed_on: Option<bool>,
    feed_refusal: Option<String>,
    /// Why feeding could not be switched last, until the courier vibrates.
    not_fed: Option<String>,
    /// Whether it was told that the courier stands still.
    still_told: bool,
    frame: Option<CandidateFrame>,
    /// Parts that were not as chosen under a tool, until parts move on: where they lie they would not be the next time either.
    passed_over: BTreeSet<u64>,
    /// Stamp of the last frame that feeding has looked at.
    fed_frame: Option<Stamp>,
    courier: Option<CourierReport>,
    /// What the courier driver says against its own feeding.
    courier_warning: Option<String>,
    /// What of it has been told, without its numbers, and until when that counts as told.
    courier_told: BTreeMap<String, Stamp>,
    /// Since when the courier has neither moved nor vibrated.
    rest_since: Option<Stamp>,
    slip_watch: SlipWatch,
    move_ended: Option<(MoveId, Result<(), String>)>,
    hand_over: VecDeque<HandOver>,
    outputs: Vec<Output>,
}

impl DeliverySequencer {
    /// A vibration that began less than this ago may still be measured, fade in or be learned, s.
    const STEADY_S: f64 = 1.0;
    /// One that began less than this ago may still be measured or fade in, s.
    const BEGUN_S: f64 = 0.5;
    /// A courier that has been at rest for longer than this although it should feed stands still, s.
    const STILL_S: f64 = 2.0;
    /// Distance from the feeding place within which the courier counts as there, m.
    const ARRIVED_M: f64 = 1e-4;
    /// Room that areas leave for tracking errors, m.
    pub const TRACKING_M: f64 = 1e-3;
    /// Share of a new observation in the running means of overheads.
    const GAIN: f64 = 0.3;

    /// An idle sequencer for a tray on a courier.
    ///
    /// # Errors
    /// A parameter out of its range, or a feeding place where the courier cannot stand.
    pub fn new(
        config: DeliveryConfig,
        tray: TrayGeometry,
        limits: CourierLimits,
        load: Load,
    ) -> Result<Self, OutOfRange> {
        config.validate()?;
        let planner = MovePlanner::new(config.gentle, tray, limits, load)?.among(config.surroundings())?;
        planner.check_reach(&config.feeding_place)?;
        let planner = planner.from_home(&config.feeding_place);
        Ok(Self {
            leases: Leases::new(config.arbitrated),
            trip_m: Vec::new(),
            drift: Drift::new(config.stop_drift_s),
            feed_watch: FeedWatch::new(config.feed_deviation_max),
            arrival_watch: ArrivalWatch::new(tray.ramp_angle_rad),
            vibrating_since: None,
            overheads: Overheads { stop_s: 0.6, hand_over_s: 0.7 },
            config,
            planner,
            state: SequencerState::Idle,
            queue: VecDeque::new(),
            deliveries: 0,
            moves: 0,
            stopped: None,
            feed_on: None,
            feed_refusal: None,
            not_fed: None,
            still_told: false,
            frame: None,
            passed_over: BTreeSet::new(),
            fed_frame: None,
            courier: None,
            courier_warning: None,
            courier_told: BTreeMap::new(),
            rest_since: None,
            slip_watch: SlipWatch::default(),
            move_ended: None,
            hand_over: VecDeque::new(),
            outputs: Vec::new(),
        })
    }

    /// The present phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.state {
            SequencerState::Idle | SequencerState::Suspended { .. } => Phase::Idle,
            SequencerState::Feeding { .. } => Phase::Feeding,
            SequencerState::Purging { .. } => Phase::Purging,
            SequencerState::Stopping { .. } => Phase::Stopping,
            SequencerState::Settling => Phase::Settling,
            SequencerState::Looking { .. } | SequencerState::Checking { .. } => Phase::Looking,
            SequencerState::Reserving { .. } => Phase::Reserving,
            SequencerState::Moving { .. } => Phase::Moving,
            SequencerState::Presented { .. } => Phase::Presented,
            SequencerState::ToReturn { .. } | SequencerState::Returning { .. } => Phase::Returning,
            SequencerState::Fault { .. } => Phase::Fault,
        }
    }

    /// Whether no fitting part has come for the starvation time: nothing is broken, but parts are needed.
    #[must_use]
    pub fn is_starved(&self) -> bool {
        matches!(self.state, SequencerState::Feeding { starved: true, .. })
    }

    /// Why parts may not come although there are some: feeding was refused, what the courier says against its own feeding, or
    /// that it stands still, or that parts are seen to move otherwise than computed, or too few of them to come.
    #[must_use]
    pub fn feed_trouble(&self) -> Option<String> {
        let refused = self.not_fed.clone().map(|reason| Warning::FeedRefused(reason).to_string());
        let still = || self.stands_still().then(|| Warning::StandsStill.to_string());
        let seen = || self.feed_watch.off().map(|ratio| Warning::FeedOff { ratio }.to_string());
        let few = || self.arrival_watch.few().map(|share| Warning::FewArrive { share }.to_string());
        refused.or_else(|| self.courier_warning.clone()).or_else(still).or_else(seen).or_else(few)
    }

    /// Takes how fast the waveform in force should feed parts on the plateau, by growing radius, what its period is (0: not
    /// known), and which share of the parts on the ramp it should bring up each second, 1/s; nothing: not known.
    pub fn expect_feed(&mut self, rates: Vec<FeedRate>, period_s: f64, climb_per_s: Option<f64>) {
        self.feed_watch.expect(rates, period_s);
        self.arrival_watch.expect(climb_per_s);
    }

    /// Takes how many parts there are in the feeder, as far as known.
    pub fn carry(&mut self, parts: u32) {
        self.arrival_watch.carry(parts);
    }

    /// Why the planner is in fault, if it is.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        match &self.state {
            SequencerState::Fault { reason, .. } => Some(reason),
            _ => None,
        }
    }

    /// Why nothing is delivered for now although nothing is wrong, if that is so.
    #[must_use]
    pub fn suspended(&self) -> Option<&str> {
        match &self.state {
            SequencerState::Suspended { reason } => Some(reason),
            _ => None,
        }
    }

    /// The open requests, oldest first.
    pub fn open(&self) -> impl Iterator<Item = (DeliveryId, &DeliveryRequest)> {
        self.queue.iter().map(|delivery| (delivery.id, &delivery.request))
    }

    /// Whether a courier report has come.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.courier.is_some()
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
            let presented = matches!(self.state, SequencerState::Presented { .. });
            if !(presented && self.state.stop().is_some_and(|stop| stop.id == id)) {
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
            match self.state {
                SequencerState::Feeding { .. } | SequencerState::Stopping { .. } => {
                    return self.fail(now, Failure::FeedRefused(reason));
                }
                SequencerState::Purging { .. } => return self.end_purge(Err(reason)),
                _ => self.outputs.push(Output::Warning(Warning::FeedRefused(reason))),
            }
        }
        match self.state.clone() {
            SequencerState::Idle => self.idle(now),
            SequencerState::Feeding { since, starved } => self.feeding(now, since, starved),
            SequencerState::Purging { since, deadline, empty, seen } => self.purging(now, since, deadline, empty, seen),
            SequencerState::Stopping { since } => self.stopping(now, since),
            SequencerState::Settling => self.settling(now),
            SequencerState::Looking { since, rest_since, seen, looks } => {
                self.looking(now, since, rest_since, seen, looks)
            }
            SequencerState::Reserving { stops } => self.reserving(now, stops),
            SequencerState::Moving { stops, id, deadline, ended } => self.moving(now, stops, id, deadline, ended),
            SequencerState::Checking { stops, since, seen } => self.checking(now, stops, since, seen),
            SequencerState::Presented { stops, delivered, since, deadline, taken } => {
                self.presented(now, stops, delivered, since, deadline, taken)
            }
            SequencerState::ToReturn { not_before, failures } => self.try_to_return(now, not_before, failures),
            SequencerState::Returning { id, deadline, ended, failures } => {
                self.returning(now, id, deadline, ended, failures)
            }
            SequencerState::Fault { reason, .. } => self.end_all(&Failure::Fault(reason)),
            SequencerState::Suspended { reason } => self.end_all(&Failure::Suspended(reason)),
        }
    }

    /// Fails every open delivery. Says whether there was one.
    fn end_all(&mut self, failure: &Failure) -> bool {
        let open = !self.queue.is_empty();
        for delivery in std::mem::take(&mut self.queue) {
            self.outputs.push(Output::Finished(delivery.id, Err(failure.clone())));
        }
        open
    }

    fn feed(&mut self, on: bool) {
        if self.feed_on != Some(on) {
            self.feed_on = Some(on);
            self.slip_watch.forget();
            self.outputs.push(Output::Feed(on));
        }
    }

    /// Fails the delivery under way: that of the next stop, or the oldest while none is chosen.
    fn fail(&mut self, now: Stamp, failure: Failure) -> bool {
        let stop = self.state.stop().map(|stop| stop.id);
        match stop.or_else(|| self.queue.front().map(|delivery| delivery.id)) {
            Some(id) => self.finish(now, id, Err(failure)),
            None => self.enter(SequencerState::Idle, None),
        }
    }

    /// Ends an open delivery and goes on to what follows from where the courier is.
    fn finish(&mut self, now: Stamp, id: DeliveryId, result: Result<Delivered, Failure>) -> bool {
        if let SequencerState::Moving { id, ended: false, .. } = self.state
            && !matches!(result, Err(Failure::Move(_)))
        {
            self.outputs.push(Output::CancelMove(id));
        }
        self.close(id, result);
        match self.state.clone() {
            SequencerState::Presented { mut stops, .. } => {
                stops.pop_front();
                self.next_stop(now, stops)
            }
            SequencerState::Moving { .. } | SequencerState::Checking { .. } => self.go_back(now),
            SequencerState::Reserving { .. } => {
                self.leases.end_trip(&mut self.outputs);
                self.enter(SequencerState::Idle, None)
            }
            _ => self.enter(SequencerState::Idle, None),
        }
    }

    /// Takes a delivery off the queue and tells its end.
    fn close(&mut self, id: DeliveryId, result: Result<Delivered, Failure>) {
        if let Some(index) = self.queue.iter().position(|delivery| delivery.id == id) {
            self.queue.remove(index);
            self.outputs.push(Output::Finished(id, result));
        }
    }

    /// Ends an open delivery, under way or waiting. Says whether there was one that could still be ended.
    fn give_up(&mut self, now: Stamp, id: DeliveryId, failure: Failure) -> bool {
        if !self.queue.iter().any(|delivery| delivery.id == id) {
            return false;
        }
        let taken = matches!(self.state, SequencerState::Presented { taken: Some(true), .. });
        match (self.state.stop().is_some_and(|stop| stop.id == id), taken) {
            (true, true) => return false,
            (true, false) => drop(self.finish(now, id, Err(failure))),
            (false, _) => {
                let feeds_for_it = self.queue.len() == 1
                    && self.suspended().is_none()
                    && !matches!(self.phase(), Phase::Returning | Phase::Fault);
                self.close(id, Err(failure));
                if feeds_for_it && self.state.stop().is_none() {
                    self.enter(SequencerState::Idle, None);
                }
            }
        }
        true
    }

    /// The open requests as trips see them.
    fn offers(&self) -> Vec<Open<'_>> {
        let open = self.queue.iter().map(|delivery| Open {
            id: delivery.id,
            request: &delivery.request,
            station_m: delivery.station_m,
        });
        open.collect()
    }

    fn delivery(&self, id: DeliveryId) -> Option<&Delivery> {
        self.queue.iter().find(|delivery| delivery.id == id)
    }

    /// Whether a candidate fits any open request.
    fn is_wanted(&self, candidate: &super::choice::OfferedPart) -> bool {
        let fits = |delivery: &Delivery| -> Option<Choice> {
            fitting(candidate, Stamp::ZERO, &delivery.request, &delivery.station_m, &self.config, &self.planner)
        };
        self.queue.iter().any(|delivery| fits(delivery).is_some())
    }

    fn at_feeding_place(&self, report: &CourierReport) -> bool {
        let offset: Vector3<f64> = report.position - self.config.feeding_place;
        offset.xy().norm() <= Self::ARRIVED_M
    }

    /// Where the courier parks.
    fn parking(&self) -> Area {
        Area::disc(self.config.feeding_place.xy(), self.config.footprint_radius_m)
    }

    fn next_move(&mut self) -> MoveId {
        self.moves += 1;
        self.move_ended = None;
        MoveId(self.moves)
    }

    /// Enters a state and tells its phase.
    fn enter(&mut self, state: SequencerState, presented_at: Option<Stamp>) -> bool {
        self.state = state;
        let phase = self.phase();
        let delivery = self.state.stop().map(|stop| stop.id);
        self.outputs.push(Output::Phase { phase, delivery, presented_at });
        true
    }
}

fn late(now: Stamp, since: Stamp, timeout_s: f64) -> bool {
    now >= since + Duration::from_secs_f64(timeout_s)
}

/// A running mean with one more observation, s.
fn mean_s(mean_s: f64, since: Stamp, now: Stamp) -> f64 {
    mean_s + DeliverySequencer::GAIN * (now.saturating_sub(since).as_secs_f64() - mean_s)
}
