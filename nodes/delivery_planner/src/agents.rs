//! The planner's side of the protocol with other agents.

use std::time::Duration;

use feeder_control::delivery::{Delivered, DeliveryId, DeliveryRequest, Failure, HandOver, Phase};
use feeder_model::delivery::Outcome;
use feeder_runtime::node::{Asker, GoalEnd, ServerEvent, StepIo, stamp_of_ns};
use feeder_wire::delivery;
use feeder_wire::pose::planar_pose;
use minifactory_msgs::action::{DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::geometry_msgs::msg::Pose;
use minifactory_msgs::msg::{FeederState, Waveform};
use minifactory_msgs::srv::{
    ChangeRecipeRequest, ChangeRecipeResponse, PurgeRequest, PurgeResponse, ReportHandoverRequest,
    ReportHandoverResponse, SetWaveformRequest,
};
use minifactory_msgs::std_srvs::srv::TriggerResponse;

use crate::{DeliveryPlanner, Open, messages};

/// Reports that are remembered, to know them when they come again: those of some dozens of deliveries.
const REPORTS_KEPT: usize = 64;

/// A report on a hand-over that was accepted.
pub(crate) struct Reported(ReportHandoverRequest);

impl Reported {
    fn is_numbered_as(&self, other: &ReportHandoverRequest) -> bool {
        (&self.0.delivery_id, self.0.sequence) == (&other.delivery_id, other.sequence)
    }

    /// Whether `other`, of the same number, is this report once more.
    fn check_same(&self, other: &ReportHandoverRequest) -> Result<(), String> {
        if self.0.report == other.report {
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
                    let station = request.goal.station.clone();
                    match self.request(now, &request.goal) {
                        Ok(id) => {
                            self.said.accepted += 1;
                            self.deliveries.insert(id, Open { goal: request.id, station });
                            self.deliver.accept(io, request);
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
            let (accepted, message) = match self.report_handover(request) {
                Ok(()) => (true, String::new()),
                Err(message) => (false, message),
            };
            let response = ReportHandoverResponse { accepted, message };
            io.reply(&self.ports.handover, asker, &response);
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
                let outcome = if response.accepted { Ok(()) } else { Err(response.message) };
                self.end_change(io, asker, recipe, outcome);
            }
        }
        for (asker, _) in io.requests(&self.ports.reset) {
            let response = match self.sequencer.fault() {
                None => TriggerResponse { success: false, message: "there is no fault".to_owned() },
                Some(fault) => TriggerResponse { success: true, message: format!("left: {fault}") },
            };
            self.sequencer.reset();
            io.reply(&self.ports.reset, asker, &response);
        }
    }

    fn request(&mut self, now: Duration, goal: &DeliverPartGoal) -> Result<DeliveryId, String> {
        if !goal.part_class.is_empty() && goal.part_class != self.part_class {
            return Err(format!("part_class = {:?}, allowed is {:?}", goal.part_class, self.part_class));
        }
        let recipe = &self.recipes[self.recipe];
        if !goal.pose_class.is_empty() && !recipe.pose_classes.contains(&goal.pose_class) {
            return Err(format!("pose_class = {:?}, allowed are {:?}", goal.pose_class, recipe.pose_classes));
        }
        let pose_classes =
            if goal.pose_class.is_empty() { recipe.pose_classes.clone() } else { vec![goal.pose_class.clone()] };
        let timeout = match goal.timeout_s {
            0.0 => None,
            timeout_s => Some(
                Duration::try_from_secs_f64(timeout_s)
                    .map_err(|_| format!("timeout_s = {timeout_s}, allowed is 0 (never) or a positive number"))?,
            ),
        };
        let part_gap_m_min = match goal.part_gap_m_min {
            0.0 => None,
            least_m if least_m > 0.0 && least_m.is_finite() => Some(least_m),
            other => {
                return Err(format!(
                    "part_gap_m_min = {other}, allowed is 0 (what the gripper needs) or a positive number"
                ));
            }
        };
        let request = DeliveryRequest {
            station: goal.station.clone(),
            part_class: self.part_class.clone(),
            pose_classes,
            tolerance_m: goal.tolerance_m,
            part_gap_m_min,
            timeout,
        };
        self.sequencer.request(now, request).map_err(|refusal| refusal.to_string())
    }

    fn report_handover(&mut self, request: ReportHandoverRequest) -> Result<(), String> {
        if let Some(known) = self.reported.iter().find(|known| known.is_numbered_as(&request)) {
            return known.check_same(&request);
        }
        let id = delivery::number_of(&request.delivery_id)
            .map(DeliveryId)
            .ok_or_else(|| format!("delivery_id = {:?} names no delivery", request.delivery_id))?;
        let report = delivery::report_of(request.report)
            .ok_or_else(|| format!("report = {}, allowed are 0 to 2", request.report))?;
        if report == HandOver::NotTaken {
            tracing::warn!("{} was not taken: {}", request.delivery_id, request.message);
        }
        self.sequencer.report_hand_over(id, report).map_err(|refusal| refusal.to_string())?;
        if self.reported.len() == REPORTS_KEPT {
            self.reported.pop_front();
        }
        self.reported.push_back(Reported(request));
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
            Err(message) => io.reply(&self.ports.purge, asker, &PurgeResponse { purged: false, message }),
        }
    }

    pub(crate) fn end_purge(&mut self, io: &mut StepIo, result: Result<(), String>) {
        if let Some(asker) = self.purging.take() {
            let (purged, message) = (result.is_ok(), result.err().unwrap_or_default());
            io.reply(&self.ports.purge, asker, &PurgeResponse { purged, message });
        }
    }

    /// Sends the recipe's waveform to the generator, if it has one; the recipe is in force when that is accepted.
    fn begin_change(&mut self, io: &mut StepIo, asker: Asker, request: &ChangeRecipeRequest) {
        match self.changeable(&request.recipe) {
            Err(message) => {
                io.reply(&self.ports.change_recipe, asker, &ChangeRecipeResponse { changed: false, message });
            }
            Ok(recipe) => match &self.recipes[recipe].waveform {
                None => self.end_change(io, asker, recipe, Ok(())),
                Some(waveform) => {
                    let waveform =
                        Waveform { name: request.recipe.clone(), ..feeder_wire::waveform::to_message(waveform) };
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
        let (changed, message) = (outcome.is_ok(), outcome.err().unwrap_or_default());
        if changed {
            self.recipe = recipe;
            self.fact.recipe.clone_from(&self.recipes[recipe].name);
            self.said_fact = false;
        }
        io.reply(&self.ports.change_recipe, asker, &ChangeRecipeResponse { changed, message });
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
        self.said.phase = delivery::phase_number(phase);
        self.said.delivery_id = delivery.map(|id| delivery::name_of(id.0)).unwrap_or_default();
        self.said.station = station.unwrap_or_default();
        self.said.reason = self.sequencer.fault().unwrap_or_default().to_owned();
        if phase != Phase::Presented {
            self.said.look_stamp = stamp_of_ns(0);
            self.said.part_in_tray = Pose::default();
        }
        self.publish_delivery_state(io);
        let eta_s = presented_at.map_or(-1.0, |at| at.saturating_sub(now).as_secs_f64());
        match (phase, delivery) {
            // What is presented is told with the part's place.
            (Phase::Presented | Phase::Idle | Phase::Returning | Phase::Purging | Phase::Fault, _) => {}
            (_, Some(id)) => self.tell_progress(io, id, eta_s),
            // Feeding serves all; the time is that of the oldest.
            (_, None) => {
                let open: Vec<DeliveryId> = self.sequencer.open().map(|(id, _)| id).collect();
                for (index, id) in open.into_iter().enumerate() {
                    self.tell_progress(io, id, if index == 0 { eta_s } else { -1.0 });
                }
            }
        }
    }

    fn tell_progress(&self, io: &mut StepIo, id: DeliveryId, eta_s: f64) {
        if let Some(open) = self.deliveries.get(&id) {
            let feedback = DeliverPartFeedback {
                phase: self.said.phase,
                eta_s,
                delivery_id: delivery::name_of(id.0),
                part_id: String::new(),
                part_in_station: Pose::default(),
            };
            self.deliver.feedback(io, open.goal, feedback);
        }
    }

    pub(crate) fn tell_presented(&mut self, io: &mut StepIo, id: DeliveryId, delivered: &Delivered) {
        let candidate = &delivered.choice.candidate;
        let in_tray = candidate.position_in_tray_m;
        self.said.look_stamp = messages::stamp(delivered.choice.look);
        self.said.part_in_tray = planar_pose(in_tray.x, in_tray.y, 0.0, candidate.yaw_in_tray_rad);
        self.publish_delivery_state(io);
        if let Some(open) = self.deliveries.get(&id) {
            let feedback = DeliverPartFeedback {
                phase: delivery::phase_number(Phase::Presented),
                eta_s: 0.0,
                delivery_id: delivery::name_of(id.0),
                part_id: candidate.id.to_string(),
                part_in_station: part_in_station(delivered),
            };
            self.deliver.feedback(io, open.goal, feedback);
        }
    }

    pub(crate) fn finish(&mut self, io: &mut StepIo, id: DeliveryId, result: &Result<Delivered, Failure>) {
        let outcome = result.as_ref().err().map_or(Outcome::Delivered, messages::outcome);
        let outcome = delivery::outcome_number(outcome);
        match result {
            Ok(_) => self.said.delivered += 1,
            Err(_) => {
                self.said.failed += 1;
                self.said.failed_by_outcome[usize::from(outcome)] += 1;
            }
        }
        self.publish_delivery_state(io);
        let Some(open) = self.deliveries.remove(&id) else { return };
        let end = match result {
            Ok(_) => GoalEnd::Succeeded,
            Err(Failure::Cancelled) => GoalEnd::Canceled,
            Err(_) => GoalEnd::Aborted,
        };
        let (reason, part_id, pose) = match result {
            Ok(delivered) => (String::new(), delivered.choice.candidate.id.to_string(), part_in_station(delivered)),
            Err(failure) => (failure.to_string(), String::new(), Pose::default()),
        };
        let delivery_id = delivery::name_of(id.0);
        let result = DeliverPartResult { outcome, reason, delivery_id, part_id, part_in_station: pose };
        self.deliver.finish(io, open.goal, end, result);
    }

    pub(crate) fn publish_delivery_state(&mut self, io: &mut StepIo) {
        self.said.header = io.header(&self.tray_frame);
        self.said_ns = io.now_ns();
        io.publish(&self.ports.delivery_state, &self.said);
    }

    /// Publishes the factsheet and the feeder's state where they have changed.
    pub(crate) fn tell_state(&mut self, io: &mut StepIo) {
        if !std::mem::replace(&mut self.said_fact, true) {
            io.publish(&self.ports.factsheet, &self.fact);
        }
        let (state, reason, message) = self.condition();
        let stations: Vec<String> = self.sequencer.open().map(|(_, request)| request.station.clone()).collect();
        let told = FeederState {
            header: self.said_state.as_ref().map(|said| said.header.clone()).unwrap_or_default(),
            state,
            reason,
            message,
            recipe: self.recipes[self.recipe].name.clone(),
            open: u32::try_from(stations.len()).unwrap_or(u32::MAX),
            stations,
        };
        if self.said_state.as_ref() != Some(&told) {
            let told = FeederState { header: io.header(""), ..told };
            io.publish(&self.ports.state, &told);
            self.said_state = Some(told);
        }
    }

    fn condition(&self) -> (u8, u8, String) {
        type S = FeederState;
        if let Some(fault) = self.sequencer.fault() {
            return (S::ABORTED, S::FAULT, fault.to_owned());
        }
        if self.sequencer.is_starved() {
            return (S::HELD, S::STARVED, "no fitting part comes".to_owned());
        }
        match self.sequencer.phase() {
            _ if !self.sequencer.is_connected() => (S::STOPPED, S::NO_REASON, String::new()),
            Phase::Idle if self.deliveries.is_empty() => (S::IDLE, S::NO_REASON, String::new()),
            Phase::Presented => (S::SUSPENDED, S::WAITING_FOR_HANDOVER, format!("at {}", self.said.station)),
            Phase::Reserving => (S::SUSPENDED, S::WAITING_FOR_AREA, format!("for {}", self.said.station)),
            Phase::Purging => (S::CLEARING, S::NO_REASON, String::new()),
            _ => (S::EXECUTE, S::NO_REASON, String::new()),
        }
    }
}

fn part_in_station(delivered: &Delivered) -> Pose {
    planar_pose(delivered.part_in_station_m.x, delivered.part_in_station_m.y, 0.0, delivered.yaw_rad)
}
