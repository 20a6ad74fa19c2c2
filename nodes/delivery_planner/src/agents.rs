//! The planner's side of the protocol with other agents.

use std::time::Duration;

use feeder_control::delivery::{Delivered, DeliveryId, DeliveryRequest, Failure, HandOver, Phase};
use feeder_model::delivery::Outcome;
use feeder_runtime::node::{Asker, GoalEnd, ServerEvent, StepIo};
use feeder_wire::deliver_part::{self, DeliveryEnd, DeliveryProgress, PartWanted, PresentedPart};
use feeder_wire::delivery_state::{self, ChosenPart};
use feeder_wire::feeder_state::{self, Condition, FeederReport};
use feeder_wire::hand_over::{self, HandOverReport};
use feeder_wire::pose::UprightPose;
use feeder_wire::{response, waveform};
use minifactory_msgs::action::DeliverPartGoal;
use minifactory_msgs::msg::{DeliveryState, FeederState, Waveform};
use minifactory_msgs::srv::{ChangeRecipeRequest, PurgeRequest, ReportHandoverRequest, SetWaveformRequest};

use crate::{DeliveryPlanner, Open, messages};

/// Reports that are remembered, to know them when they come again: those of some dozens of deliveries.
const REPORTS_KEPT: usize = 64;

/// A report on a hand-over that was accepted.
pub(crate) struct Accepted(HandOverReport);

impl Accepted {
    fn is_numbered_as(&self, other: &HandOverReport) -> bool {
        (&self.0.delivery_id, self.0.sequence) == (&other.delivery_id, other.sequence)
    }

    /// Whether `other`, of the same number, is this report once more.
    fn check_same(&self, other: &HandOverReport) -> Result<(), String> {
        if self.0.hand_over == other.hand_over {
            return Ok(());
        }
        Err(format!("sequence = {} of {} was another report", other.sequence, other.delivery_id))
    }
}

impl DeliveryPlanner {
    /// Takes in what other agents ask for.
    pub(crate) fn take_requests(&mut self, io: &mut StepIo, now: Duration) {
        for event in self.deliver.poll(io) {
            match event {
                ServerEvent::Requested(request) => {
                    let (station, owner) = (request.goal.station.clone(), request.participant());
                    match self.request(now, &request.goal) {
                        Ok(id) => {
                            self.said.accepted += 1;
                            self.deliveries.insert(id, Open { goal: request.id, station, owner });
                            self.deliver.accept(io, request);
                            self.tell_accepted(io, id);
                        }
                        Err(reason) => self.deliver.reject(io, request, &reason),
                    }
                }
                ServerEvent::CancelRequested(goal) => {
                    let open = self.deliveries.iter().find(|(_, open)| open.goal == goal).map(|(id, _)| *id);
                    if let Some(id) = open {
                        self.sequencer.cancel(now, id);
                    }
                }
            }
        }
        for (asker, request) in io.requests(&self.ports.handover) {
            let accepted = self.report_handover(request, asker.participant()).map(|()| "");
            io.reply(&self.ports.handover, asker, &response::to_message(accepted));
        }
        for (asker, request) in io.requests(&self.ports.purge) {
            self.begin_purge(io, now, asker, &request);
        }
        for (asker, request) in io.requests(&self.ports.change_recipe) {
            self.begin_change(io, asker, &request);
        }
        for (call, response) in io.replies(&self.ports.set_waveform) {
            if let Some(index) = self.changing.iter().position(|(waiting, ..)| *waiting == call)
                && let Some((_, asker, recipe)) = self.changing.remove(index)
            {
                self.end_change(io, asker, recipe, response::from_message(response).map(|_| ()));
            }
        }
        for (asker, _) in io.requests(&self.ports.reset) {
            let left = self.sequencer.fault().map(|fault| format!("left: {fault}")).ok_or("there is no fault");
            self.sequencer.reset();
            io.reply(&self.ports.reset, asker, &response::to_message(left));
        }
    }

    fn request(&mut self, now: Duration, goal: &DeliverPartGoal) -> Result<DeliveryId, String> {
        let PartWanted { station, part_class, pose_class, tolerance_m, part_gap_m_min, timeout } =
            deliver_part::from_goal(goal)?;
        if let Some(part_class) = part_class.filter(|part_class| *part_class != self.part_class) {
            return Err(format!("part_class = {part_class:?}, allowed is {:?}", self.part_class));
        }
        let recipe = &self.recipes[self.recipe];
        let pose_classes = match pose_class {
            None => recipe.pose_classes.clone(),
            Some(pose_class) if recipe.pose_classes.contains(&pose_class) => vec![pose_class],
            Some(pose_class) => {
                return Err(format!("pose_class = {pose_class:?}, allowed are {:?}", recipe.pose_classes));
            }
        };
        let part_class = self.part_class.clone();
        let request = DeliveryRequest { station, part_class, pose_classes, tolerance_m, part_gap_m_min, timeout };
        self.sequencer.request(now, request).map_err(|refusal| refusal.to_string())
    }

    fn report_handover(&mut self, request: ReportHandoverRequest, reporter: u64) -> Result<(), String> {
        let report = hand_over::from_request(request).map_err(|error| error.to_string())?;
        if let Some(known) = self.reported.iter().find(|known| known.is_numbered_as(&report)) {
            return known.check_same(&report);
        }
        let id = deliver_part::number_of(&report.delivery_id)
            .map(DeliveryId)
            .ok_or_else(|| format!("delivery_id = {:?} names no delivery", report.delivery_id))?;
        if self.deliveries.get(&id).is_some_and(|open| open.owner != reporter) {
            return Err(format!("{} was asked for by another client", report.delivery_id));
        }
        if report.hand_over == HandOver::NotTaken {
            tracing::warn!("{} was not taken: {}", report.delivery_id, report.message);
        }
        self.sequencer.report_hand_over(id, report.hand_over).map_err(|refusal| refusal.to_string())?;
        if self.reported.len() == REPORTS_KEPT {
            self.reported.pop_front();
        }
        self.reported.push_back(Accepted(report));
        Ok(())
    }

    fn begin_purge(&mut self, io: &mut StepIo, now: Duration, asker: Asker, request: &PurgeRequest) {
        let timeout = Duration::try_from_secs_f64(request.timeout_s).ok().filter(|timeout| !timeout.is_zero());
        let begun = match timeout {
            None => Err(format!("timeout_s = {}, allowed is a positive number", request.timeout_s)),
            Some(timeout) => self.sequencer.purge(now, timeout).map_err(|refusal| refusal.to_string()),
        };
        match begun {
            Ok(()) => self.purging = Some(asker),
            Err(message) => io.reply(&self.ports.purge, asker, &response::to_message(Err::<&str, _>(message))),
        }
    }

    pub(crate) fn end_purge(&mut self, io: &mut StepIo, result: Result<(), String>) {
        if let Some(asker) = self.purging.take() {
            io.reply(&self.ports.purge, asker, &response::to_message(result.map(|()| "")));
        }
    }

    /// Sends the recipe's waveform to the generator, if it has one; the recipe is in force when that is accepted.
    fn begin_change(&mut self, io: &mut StepIo, asker: Asker, request: &ChangeRecipeRequest) {
        match self.changeable(&request.recipe) {
            Err(message) => {
                io.reply(&self.ports.change_recipe, asker, &response::to_message(Err::<&str, _>(message)));
            }
            Ok(recipe) => match &self.recipes[recipe].waveform {
                None => self.end_change(io, asker, recipe, Ok(())),
                Some(waveform) => {
                    let waveform = Waveform { name: request.recipe.clone(), ..waveform::to_message(waveform) };
                    let call = io.call(&self.ports.set_waveform, &SetWaveformRequest { waveform });
                    self.changing.push_back((call, asker, recipe));
                }
            },
        }
    }

    /// The index of a recipe that may be changed to now.
    fn changeable(&self, name: &str) -> Result<usize, String> {
        self.sequencer.check_free().map_err(|refusal| refusal.to_string())?;
        self.recipes.iter().position(|recipe| recipe.name == name).ok_or_else(|| {
            let known: Vec<&str> = self.recipes.iter().map(|recipe| recipe.name.as_str()).collect();
            format!("recipe = {name:?}, allowed are {known:?}")
        })
    }

    fn end_change(&mut self, io: &mut StepIo, asker: Asker, recipe: usize, outcome: Result<(), String>) {
        if outcome.is_ok() {
            self.recipe = recipe;
            let recipe = &self.recipes[recipe];
            self.sequencer.expect_feed(recipe.plateau_feed.clone(), recipe.period_s, recipe.climb_per_s);
            self.fact.recipe.clone_from(&recipe.name);
            self.said_fact = false;
        }
        io.reply(&self.ports.change_recipe, asker, &response::to_message(outcome.map(|()| "")));
    }

    pub(crate) fn tell_phase(
        &mut self,
        io: &mut StepIo,
        now: Duration,
        phase: Phase,
        delivery: Option<DeliveryId>,
        presented_at: Option<Duration>,
    ) {
        let station = delivery.and_then(|id| self.deliveries.get(&id)).map(|open| open.station.clone());
        let delivery_id = delivery.map(|id| deliver_part::name_of(id.0));
        if phase != Phase::Presented || delivery_id != self.said.delivery_id {
            self.said.chosen = None;
        }
        self.said.phase = phase;
        self.said.delivery_id = delivery_id;
        self.said.station = station;
        self.said.fault = self.sequencer.fault().map(str::to_owned);
        self.publish_delivery_state(io);
        let eta = presented_at.map(|at| at.saturating_sub(now));
        match (phase, delivery) {
            // What is presented is told with the part's place.
            (Phase::Presented | Phase::Idle | Phase::Returning | Phase::Purging | Phase::Fault, _) => {}
            (_, Some(id)) => self.tell_progress(io, id, phase, eta, None),
            // Feeding serves all; the time is that of the oldest.
            (_, None) => {
                let open: Vec<DeliveryId> = self.sequencer.open().map(|(id, _)| id).collect();
                for (index, id) in open.into_iter().enumerate() {
                    self.tell_progress(io, id, phase, eta.filter(|_| index == 0), None);
                }
            }
        }
    }

    /// Tells who asks that his delivery is open: its phase may not change for long.
    fn tell_accepted(&self, io: &mut StepIo, id: DeliveryId) {
        let phase = match self.said.phase {
            // These serve all that are open.
            Phase::Feeding | Phase::Stopping | Phase::Settling | Phase::Looking => self.said.phase,
            // The trip is others'.
            _ => Phase::Idle,
        };
        self.tell_progress(io, id, phase, None, None);
    }

    fn tell_progress(
        &self,
        io: &mut StepIo,
        id: DeliveryId,
        phase: Phase,
        eta: Option<Duration>,
        part: Option<PresentedPart>,
    ) {
        if let Some(open) = self.deliveries.get(&id) {
            let delivery_id = deliver_part::name_of(id.0);
            let progress = DeliveryProgress { phase, eta, delivery_id, part };
            self.deliver.feedback(io, open.goal, deliver_part::to_feedback(&progress));
        }
    }

    pub(crate) fn tell_presented(&mut self, io: &mut StepIo, id: DeliveryId, delivered: &Delivered) {
        let candidate = &delivered.choice.candidate;
        self.said.chosen = Some(ChosenPart {
            look: delivered.choice.look,
            position_in_tray_m: candidate.position_in_tray_m,
            yaw_in_tray_rad: candidate.yaw_in_tray_rad,
            pose_class: candidate.pose_class.clone(),
        });
        self.publish_delivery_state(io);
        self.tell_progress(io, id, Phase::Presented, Some(Duration::ZERO), Some(presented_part(delivered)));
    }

    pub(crate) fn finish(&mut self, io: &mut StepIo, id: DeliveryId, result: &Result<Delivered, Failure>) {
        let outcome = result.as_ref().err().map_or(Outcome::Delivered, messages::outcome);
        match result {
            Ok(_) => {
                self.said.delivered += 1;
                self.sequencer.carry(self.parts.left(self.said.delivered));
            }
            Err(_) => self.said.failed_by_outcome[usize::from(deliver_part::outcome_number(outcome))] += 1,
        }
        self.publish_delivery_state(io);
        let Some(open) = self.deliveries.remove(&id) else { return };
        let end = match result {
            Ok(_) => GoalEnd::Succeeded,
            Err(Failure::Cancelled) => GoalEnd::Canceled,
            Err(_) => GoalEnd::Aborted,
        };
        let reason = result.as_ref().err().map(ToString::to_string).unwrap_or_default();
        let part = result.as_ref().ok().map(presented_part);
        let ended = DeliveryEnd { outcome, reason, delivery_id: deliver_part::name_of(id.0), part };
        self.deliver.finish(io, open.goal, end, deliver_part::to_result(ended));
    }

    pub(crate) fn publish_delivery_state(&mut self, io: &mut StepIo) {
        self.said_ns = io.now_ns();
        let message = DeliveryState { header: io.header(&self.tray_frame), ..delivery_state::to_message(&self.said) };
        io.publish(&self.ports.delivery_state, &message);
    }

    /// Publishes the factsheet and the feeder's state where they have changed.
    pub(crate) fn tell_state(&mut self, io: &mut StepIo) {
        if !std::mem::replace(&mut self.said_fact, true) {
            io.publish(&self.ports.factsheet, &self.fact);
        }
        let (condition, message) = self.condition();
        let told = FeederReport {
            condition,
            message,
            recipe: self.recipes[self.recipe].name.clone(),
            stations: self.sequencer.open().map(|(_, request)| request.station.clone()).collect(),
        };
        if self.said_state.as_ref() != Some(&told) {
            io.publish(&self.ports.state, &FeederState { header: io.header(""), ..feeder_state::to_message(&told) });
            self.said_state = Some(told);
        }
    }

    fn condition(&self) -> (Condition, String) {
        if let Some(fault) = self.sequencer.fault() {
            return (Condition::Fault, fault.to_owned());
        }
        if let Some(reason) = self.sequencer.suspended() {
            return (Condition::Stopped, reason.to_owned());
        }
        if let Some(doubts) = self.unrecognised.as_ref().filter(|_| self.sequencer.is_starved()) {
            return (Condition::Unrecognised, format!("no fitting part comes: {doubts}"));
        }
        if let Some(trouble) = self.sequencer.feed_trouble().filter(|_| self.sequencer.is_starved()) {
            return (Condition::BadlyFed, format!("no fitting part comes: {trouble}"));
        }
        if self.sequencer.is_starved() {
            return (Condition::Starved, "no fitting part comes".to_owned());
        }
        let station = self.said.station.as_deref().unwrap_or_default();
        match self.sequencer.phase() {
            _ if !self.sequencer.is_connected() => (Condition::Stopped, String::new()),
            Phase::Idle if self.deliveries.is_empty() => (Condition::Idle, String::new()),
            Phase::Presented => (Condition::AwaitsHandOver, format!("at {station}")),
            Phase::Reserving => (Condition::AwaitsArea, format!("for {station}")),
            Phase::Purging => (Condition::Purging, String::new()),
            // What may be wrong with the feed is said before no part comes.
            _ => {
                let said = self.sequencer.feed_trouble().or_else(|| self.sequencer.slid());
                (Condition::AtWork, said.unwrap_or_default())
            }
        }
    }
}

fn presented_part(delivered: &Delivered) -> PresentedPart {
    let (x_m, y_m) = (delivered.part_in_station_m.x, delivered.part_in_station_m.y);
    PresentedPart {
        id: delivered.choice.candidate.id.to_string(),
        pose_in_station: UprightPose { x_m, y_m, z_m: 0.0, yaw_rad: delivered.yaw_rad },
    }
}
