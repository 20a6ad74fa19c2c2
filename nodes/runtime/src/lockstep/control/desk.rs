//! What is asked of a run and answered, without the graph.

use minifactory_msgs::interface::simulation;
use minifactory_msgs::interface::standard::CLOCK_OF_A_RUN;
use minifactory_msgs::simulation_interfaces::msg::{Result as Answer, SimulationState, SimulatorFeatures};
use minifactory_msgs::simulation_interfaces::srv::{
    GetSimulationState, GetSimulationStateResponse, GetSimulatorFeatures, GetSimulatorFeaturesResponse,
    ResetSimulation, ResetSimulationRequest, ResetSimulationResponse, SetSimulationState, SetSimulationStateResponse,
};

use super::steps::Steps;
use super::{Refusal, ResetRefusal, Wish, answer, ok};
use crate::lockstep::clock::LoopClock;
use crate::node::{Declare, GoalEnd, Interface, NodeError, Server, StepIo};

/// The services that concern a run as a whole, and its steps.
pub(super) struct Desk {
    features: Server<GetSimulatorFeatures>,
    state: Server<GetSimulationState>,
    set_state: Server<SetSimulationState>,
    reset: Server<ResetSimulation>,
    steps: Steps,
    /// The run stands at its beginning, and nobody has let it play or has asked it to pause.
    is_stopped: bool,
    /// The state that is told while the run is about to end, or to be started again.
    leaving: Option<u8>,
}

/// What of the standard is offered, by whom it is.
fn features() -> SimulatorFeatures {
    let features = [
        SimulatorFeatures::SPAWNING,
        SimulatorFeatures::DELETING,
        SimulatorFeatures::ENTITY_TAGS,
        SimulatorFeatures::ENTITY_BOUNDS_BOX,
        SimulatorFeatures::ENTITY_CATEGORIES,
        SimulatorFeatures::ENTITY_STATE_GETTING,
        SimulatorFeatures::ENTITY_STATE_SETTING,
        SimulatorFeatures::ENTITY_INFO_GETTING,
        SimulatorFeatures::SPAWNABLES,
        SimulatorFeatures::SIMULATION_RESET,
        SimulatorFeatures::SIMULATION_STATE_GETTING,
        SimulatorFeatures::SIMULATION_STATE_SETTING,
        SimulatorFeatures::SIMULATION_STATE_PAUSE,
        SimulatorFeatures::STEP_SIMULATION_SINGLE,
        SimulatorFeatures::STEP_SIMULATION_MULTIPLE,
        SimulatorFeatures::STEP_SIMULATION_ACTION,
    ];
    SimulatorFeatures {
        features: features.map(u16::from).to_vec(),
        spawn_formats: Vec::new(),
        custom_info: "Entities are the parts. Where a run has several feeders, each feeder's are asked for in its \
                      namespace. How fast time passes is the parameter speed of /feeder_up."
            .to_owned(),
    }
}

impl Desk {
    pub(super) fn declare(stands: bool) -> Result<(Self, Interface), NodeError> {
        let mut io = Declare::new(CLOCK_OF_A_RUN, "");
        let desk = Self {
            features: io.server(&simulation::GET_SIMULATOR_FEATURES),
            state: io.server(&simulation::GET_SIMULATION_STATE),
            set_state: io.server(&simulation::SET_SIMULATION_STATE),
            reset: io.server(&simulation::RESET_SIMULATION),
            steps: Steps::declare(&mut io),
            is_stopped: stands,
            leaving: None,
        };
        Ok((desk, io.finish().map_err(NodeError::new)?))
    }

    pub(super) fn serve(&mut self, io: &mut StepIo, clock: &mut LoopClock, refusal: Refusal) -> Vec<Wish> {
        self.is_stopped &= clock.is_paused();
        self.steps.follow(io, clock);
        for (asker, _) in io.requests(&self.features) {
            io.reply(&self.features, asker, &GetSimulatorFeaturesResponse { features: features() });
        }
        let mut wishes = Vec::new();
        for (asker, request) in io.requests(&self.set_state) {
            let wanted = request.state.state;
            let is_stepping = self.steps.are_under_way() && wishes.is_empty() && self.leaving.is_none();
            let result = if wanted == SimulationState::STATE_PAUSED && is_stepping {
                self.steps.stop(io, clock, GoalEnd::Aborted, "paused");
                ok()
            } else {
                self.set_state(clock, refusal, wanted, &mut wishes)
            };
            io.reply(&self.set_state, asker, &SetSimulationStateResponse { result });
        }
        for (asker, request) in io.requests(&self.reset) {
            let result = self.reset(clock, refusal, request.scope);
            if result.result == Answer::RESULT_OK {
                wishes.push(Wish::Reset);
            }
            io.reply(&self.reset, asker, &ResetSimulationResponse { result });
        }
        let not_ready = self.not_ready(clock);
        self.is_stopped &= !self.steps.serve(io, clock, not_ready.as_ref());
        for (asker, _) in io.requests(&self.state) {
            let state = SimulationState { state: self.state(clock, &wishes) };
            io.reply(&self.state, asker, &GetSimulationStateResponse { state, result: ok() });
        }
        wishes
    }

    fn state(&self, clock: &LoopClock, wishes: &[Wish]) -> u8 {
        let is_paused = wishes.iter().rev().find_map(|wish| match wish {
            Wish::Pause(paused) => Some(*paused),
            Wish::Reset | Wish::End => None,
        });
        if let Some(state) = self.leaving {
            return state;
        }
        match is_paused.unwrap_or_else(|| clock.is_paused()) {
            _ if clock.started_at().is_none() => SimulationState::STATE_LOADING_WORLD,
            _ if self.is_stopped => SimulationState::STATE_STOPPED,
            true => SimulationState::STATE_PAUSED,
            false => SimulationState::STATE_PLAYING,
        }
    }

    /// What keeps the run from obeying at all.
    fn not_ready(&self, clock: &LoopClock) -> Option<Answer> {
        let incorrect = |message| Some(answer(Answer::RESULT_INCORRECT_STATE, message));
        match (clock.started_at(), self.leaving) {
            (None, _) => incorrect("the run has not begun"),
            (_, Some(_)) => incorrect("the run is about to end"),
            _ => None,
        }
    }

    fn set_state(&mut self, clock: &mut LoopClock, refusal: Refusal, wanted: u8, wishes: &mut Vec<Wish>) -> Answer {
        let state = self.state(clock, wishes);
        if let Some(not_ready) = self.not_ready(clock) {
            return not_ready;
        }
        if wanted == state {
            return answer(SetSimulationStateResponse::ALREADY_IN_TARGET_STATE, "the run is in that state already");
        }
        match wanted {
            SimulationState::STATE_PLAYING | SimulationState::STATE_PAUSED => {
                self.is_stopped = false;
                wishes.push(Wish::Pause(wanted == SimulationState::STATE_PAUSED));
                ok()
            }
            SimulationState::STATE_STOPPED => match refusal() {
                Some(ResetRefusal::Never(reason)) => {
                    answer(SetSimulationStateResponse::STATE_TRANSITION_ERROR, &reason)
                }
                // Who stops a run means to lose what is under way.
                Some(ResetRefusal::Now(_)) | None => {
                    self.leaving = Some(SimulationState::STATE_LOADING_WORLD);
                    wishes.extend([Wish::Pause(true), Wish::Reset]);
                    ok()
                }
            },
            SimulationState::STATE_QUITTING => {
                self.leaving = Some(SimulationState::STATE_QUITTING);
                wishes.push(Wish::End);
                ok()
            }
            other => answer(
                SetSimulationStateResponse::INCORRECT_TRANSITION,
                &format!("state = {other}: allowed are STOPPED 0, PLAYING 1, PAUSED 2 and QUITTING 3"),
            ),
        }
    }

    fn reset(&mut self, clock: &mut LoopClock, refusal: Refusal, scope: u8) -> Answer {
        const EVERYTHING: u8 = ResetSimulationRequest::SCOPE_TIME
            | ResetSimulationRequest::SCOPE_STATE
            | ResetSimulationRequest::SCOPE_SPAWNED;
        if scope != ResetSimulationRequest::SCOPE_DEFAULT && scope & EVERYTHING != EVERYTHING {
            let message = format!("scope = {scope}: time, state and spawned parts are reset together, scope 0 or 255");
            return answer(Answer::RESULT_FEATURE_UNSUPPORTED, &message);
        }
        if let Some(not_ready) = self.not_ready(clock) {
            return not_ready;
        }
        match refusal() {
            Some(ResetRefusal::Now(reason)) => answer(Answer::RESULT_INCORRECT_STATE, &reason),
            Some(ResetRefusal::Never(reason)) => answer(Answer::RESULT_OPERATION_FAILED, &reason),
            None => {
                self.leaving = Some(SimulationState::STATE_LOADING_WORLD);
                ok()
            }
        }
    }

    pub(super) fn close(&mut self, io: &mut StepIo, tick: u64) {
        self.steps.leave(io, tick, GoalEnd::Aborted, "the run has ended");
    }
}
