//! What operators may ask of a run as a whole, by the services of `simulation_interfaces`. None of it changes a result.

use std::ops::Range;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use minifactory_msgs::interface::simulation;
use minifactory_msgs::interface::standard::CLOCK_OF_A_RUN;
use minifactory_msgs::simulation_interfaces::action::{SimulateSteps, SimulateStepsFeedback, SimulateStepsResult};
use minifactory_msgs::simulation_interfaces::msg::{Result as Answer, SimulationState, SimulatorFeatures};
use minifactory_msgs::simulation_interfaces::srv::{
    GetSimulationState, GetSimulationStateResponse, GetSimulatorFeatures, GetSimulatorFeaturesResponse,
    ResetSimulation, ResetSimulationRequest, ResetSimulationResponse, SetSimulationState, SetSimulationStateResponse,
    StepSimulation, StepSimulationResponse,
};

use super::clock::LoopClock;
use super::runner::{Incoming, RunError};
use crate::dds::Participant;
use crate::node::{
    ActionServer, ActionServerPorts, Asker, AskerInner, Declare, GoalEnd, GoalId, Interface, NodeError, Output, Server,
    ServerEvent, StepIo,
};
use crate::public::PublicSide;

/// How long answers may take to arrive when the run has ended.
const SETTLE_LIMIT: Duration = Duration::from_secs(2);
/// Between looks whether they have.
const SETTLE_POLL: Duration = Duration::from_millis(1);

/// Why a run cannot be started again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ResetRefusal {
    /// It can be later.
    Now(String),
    /// It never can.
    Never(String),
}

/// What is to become of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// Time is to stand still, or to pass.
    Pause(bool),
    /// The run is to be started again.
    Reset,
    /// The run is to end.
    End,
}

/// Asks whether anything keeps the run from being started again.
pub(super) type Refusal<'a> = &'a dyn Fn() -> Option<ResetRefusal>;

/// The services and the action, on the graph.
pub(super) struct Control {
    desk: Desk,
    io: StepIo,
    public: PublicSide,
    inbox: Receiver<Incoming>,
    opened_at: Instant,
}

impl Control {
    /// Offers everything. A run that `stands` at its beginning waits for somebody who lets it play.
    ///
    /// # Errors
    /// [`RunError`] when DDS refuses an endpoint.
    pub(super) fn open(participant: &Participant, stands: bool) -> Result<Self, RunError> {
        let (desk, interface) = Desk::declare(stands).map_err(RunError::Node)?;
        let (sender, inbox) = channel();
        let public = PublicSide::open(participant, &interface, &sender)?;
        // Its time is wall time: what is asked for comes while simulated time stands still, too.
        let io = StepIo::new(interface.ports.len(), 0);
        Ok(Self { desk, io, public, inbox, opened_at: Instant::now() })
    }

    /// Answers what has come.
    pub(super) fn serve(&mut self, clock: &mut LoopClock, refusal: Refusal) -> Vec<Wish> {
        for incoming in self.inbox.try_iter() {
            if let Incoming::Outside(port, arrival) = incoming {
                self.io.arrive(port, arrival);
            }
        }
        self.io.begin(0, u64::try_from(self.opened_at.elapsed().as_nanos()).unwrap_or(u64::MAX));
        let wishes = self.desk.serve(&mut self.io, clock, refusal);
        self.send();
        wishes
    }

    /// Answers those who still wait, as the run has come to its end at `tick`.
    pub(super) fn close(&mut self, tick: u64) {
        self.desk.close(&mut self.io, tick);
        self.send();
    }

    /// Waits until all answers have arrived: who asked for the end is to hear that it comes.
    pub(super) fn settle(&self) {
        let since = Instant::now();
        while self.public.replies_on_the_way() > 0 && since.elapsed() < SETTLE_LIMIT {
            std::thread::sleep(SETTLE_POLL);
        }
    }

    fn send(&mut self) {
        for output in std::mem::take(&mut self.io.outputs) {
            match output {
                Output::Message { port, payload } => self.public.publish(port, payload),
                Output::Reply { asker: Asker(AskerInner::Graph(handle)), payload, .. } => handle.send(payload),
                Output::Reply { .. } | Output::Request { .. } => {}
            }
        }
    }
}

/// Who waits for steps to be taken.
enum Waiting {
    Caller(Asker),
    Goal(GoalId),
}

/// Steps under way.
struct Stepping {
    ticks: Range<u64>,
    /// How many were told of last.
    told: u64,
    waiting: Waiting,
}

/// What is asked and answered, without the graph.
struct Desk {
    features: Server<GetSimulatorFeatures>,
    state: Server<GetSimulationState>,
    set_state: Server<SetSimulationState>,
    reset: Server<ResetSimulation>,
    step: Server<StepSimulation>,
    steps: ActionServer<SimulateSteps>,
    stepping: Option<Stepping>,
    /// The run stands at its beginning, and nobody has let it play or has asked it to pause.
    is_stopped: bool,
    /// The state that is told while the run is about to end, or to be started again.
    leaving: Option<u8>,
}

fn answer(result: u8, message: &str) -> Answer {
    Answer { result, error_message: message.to_owned() }
}

fn ok() -> Answer {
    answer(Answer::RESULT_OK, "")
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
    fn declare(stands: bool) -> Result<(Self, Interface), NodeError> {
        let mut io = Declare::new(CLOCK_OF_A_RUN, "");
        let steps: ActionServerPorts<SimulateSteps> = io.action_server(&simulation::SIMULATE_STEPS);
        let desk = Self {
            features: io.server(&simulation::GET_SIMULATOR_FEATURES),
            state: io.server(&simulation::GET_SIMULATION_STATE),
            set_state: io.server(&simulation::SET_SIMULATION_STATE),
            reset: io.server(&simulation::RESET_SIMULATION),
            step: io.server(&simulation::STEP_SIMULATION),
            steps: ActionServer::new(steps),
            stepping: None,
            is_stopped: stands,
            leaving: None,
        };
        Ok((desk, io.finish().map_err(NodeError::new)?))
    }

    fn serve(&mut self, io: &mut StepIo, clock: &mut LoopClock, refusal: Refusal) -> Vec<Wish> {
        self.is_stopped &= clock.is_paused();
        self.follow_steps(io, clock);
        if self.stepping.is_some() && !clock.is_paused() {
            self.leave_steps(io, clock.tick(), GoalEnd::Aborted, "the run plays on");
        }
        for (asker, _) in io.requests(&self.features) {
            io.reply(&self.features, asker, &GetSimulatorFeaturesResponse { features: features() });
        }
        let mut wishes = Vec::new();
        for (asker, request) in io.requests(&self.set_state) {
            let wanted = request.state.state;
            let is_stepping = self.stepping.is_some() && wishes.is_empty() && self.leaving.is_none();
            let result = if wanted == SimulationState::STATE_PAUSED && is_stepping {
                self.stop_steps(io, clock, GoalEnd::Aborted, "paused");
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
        for (asker, request) in io.requests(&self.step) {
            match self.begin_steps(clock, request.steps) {
                Ok(ticks) => self.stepping = Some(Stepping { ticks, told: 0, waiting: Waiting::Caller(asker) }),
                Err(result) => io.reply(&self.step, asker, &StepSimulationResponse { result }),
            }
        }
        self.serve_action(io, clock);
        for (asker, _) in io.requests(&self.state) {
            let state = SimulationState { state: self.state(clock, &wishes) };
            io.reply(&self.state, asker, &GetSimulationStateResponse { state, result: ok() });
        }
        wishes
    }

    fn serve_action(&mut self, io: &mut StepIo, clock: &mut LoopClock) {
        for event in self.steps.poll(io) {
            match event {
                ServerEvent::Requested(request) => match self.begin_steps(clock, request.goal.steps) {
                    Ok(ticks) => {
                        self.stepping = Some(Stepping { ticks, told: 0, waiting: Waiting::Goal(request.id) });
                        self.steps.accept(io, request);
                    }
                    // The answer to a goal has no room for a reason; its result has.
                    Err(result) => {
                        let id = request.id;
                        self.steps.accept(io, request);
                        self.steps.finish(io, id, GoalEnd::Aborted, SimulateStepsResult { result });
                    }
                },
                ServerEvent::CancelRequested(_) => self.stop_steps(io, clock, GoalEnd::Canceled, "cancelled"),
            }
        }
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

    fn begin_steps(&mut self, clock: &mut LoopClock, steps: u64) -> Result<Range<u64>, Answer> {
        let failed = |message: &str| answer(Answer::RESULT_OPERATION_FAILED, message);
        if let Some(not_ready) = self.not_ready(clock) {
            return Err(not_ready);
        }
        if steps == 0 {
            return Err(failed("steps = 0, allowed: 1 or more"));
        }
        if self.stepping.is_some() {
            return Err(failed("other steps are being taken"));
        }
        let ticks = clock.step(steps).ok_or_else(|| failed("the run is not paused"))?;
        self.is_stopped = false;
        Ok(ticks)
    }

    /// Tells whoever waits for steps how far they are.
    fn follow_steps(&mut self, io: &mut StepIo, clock: &LoopClock) {
        let Some(stepping) = &mut self.stepping else { return };
        let steps = stepping.ticks.end - stepping.ticks.start;
        let completed_steps = taken(&stepping.ticks, clock.tick());
        if let Waiting::Goal(id) = stepping.waiting
            && completed_steps > stepping.told
        {
            stepping.told = completed_steps;
            let remaining_steps = steps - completed_steps;
            self.steps.feedback(io, id, SimulateStepsFeedback { completed_steps, remaining_steps });
        }
        if completed_steps == steps
            && let Some(stepping) = self.stepping.take()
        {
            self.end_steps(io, stepping.waiting, GoalEnd::Succeeded, ok());
        }
    }

    fn end_steps(&mut self, io: &mut StepIo, waiting: Waiting, end: GoalEnd, result: Answer) {
        match waiting {
            Waiting::Caller(asker) => io.reply(&self.step, asker, &StepSimulationResponse { result }),
            Waiting::Goal(id) => self.steps.finish(io, id, end, SimulateStepsResult { result }),
        }
    }

    /// Takes no more steps than are granted already.
    fn stop_steps(&mut self, io: &mut StepIo, clock: &mut LoopClock, end: GoalEnd, why: &str) {
        clock.stop_stepping();
        self.leave_steps(io, clock.tick(), end, why);
    }

    fn leave_steps(&mut self, io: &mut StepIo, tick: u64, end: GoalEnd, why: &str) {
        if let Some(stepping) = self.stepping.take() {
            let message = format!("{why} after {} steps", taken(&stepping.ticks, tick));
            self.end_steps(io, stepping.waiting, end, answer(Answer::RESULT_OPERATION_FAILED, &message));
        }
    }

    fn close(&mut self, io: &mut StepIo, tick: u64) {
        self.leave_steps(io, tick, GoalEnd::Aborted, "the run has ended");
    }
}

/// How many of the steps are taken when every node has reached `tick`.
fn taken(ticks: &Range<u64>, tick: u64) -> u64 {
    tick.clamp(ticks.start, ticks.end) - ticks.start
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use minifactory_msgs::simulation_interfaces::srv::{SetSimulationStateRequest, StepSimulationRequest};
    use minifactory_msgs::unique_identifier_msgs::msg::UUID;
    use minifactory_msgs::{Action, Message, Service};

    use super::*;
    use crate::cdr;
    use crate::lockstep::{LoopContract, LoopTiming, Speed};
    use crate::node::Arrival;
    use minifactory_msgs::msg::LoopStatus;

    /// A run of one node, and who asks of it.
    struct Bench {
        desk: Desk,
        io: StepIo,
        interface: Interface,
        clock: LoopClock,
        refusal: Option<ResetRefusal>,
        wishes: Vec<Wish>,
    }

    impl Bench {
        /// A run that plays; `stands` has it stand at its beginning.
        fn new(stands: bool) -> Self {
            let timing = LoopTiming { tick_ns: 10, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 32 };
            let contract = LoopContract::connect(7, timing, &[("/a".to_owned(), Interface::default())]).unwrap();
            let mut clock = LoopClock::new(contract, Speed::Max, 1000, Duration::from_secs(10));
            clock.set_paused(stands, Duration::ZERO);
            let (desk, interface) = Desk::declare(stands).unwrap();
            let io = StepIo::new(interface.ports.len(), 0);
            Self { desk, io, interface, clock, refusal: None, wishes: Vec::new() }
        }

        /// The node has reached this tick.
        fn reach(&mut self, tick: u64) {
            let goal_tick = LoopStatus::NO_GOAL;
            let status =
                LoopStatus { run_id: 7, node: "/a".into(), tick, wired: true, goal_tick, ..LoopStatus::default() };
            self.clock.accept(&status, Duration::ZERO).unwrap();
            self.clock.grant(Duration::ZERO, false);
        }

        fn serve(&mut self) -> Vec<(String, Bytes)> {
            let refusal = self.refusal.clone();
            self.wishes = self.desk.serve(&mut self.io, &mut self.clock, &|| refusal.clone());
            for wish in &self.wishes {
                if let Wish::Pause(paused) = wish {
                    self.clock.set_paused(*paused, Duration::ZERO);
                }
            }
            self.sent()
        }

        fn sent(&mut self) -> Vec<(String, Bytes)> {
            let sent = std::mem::take(&mut self.io.outputs).into_iter().map(|output| match output {
                Output::Message { port, payload } | Output::Reply { port, payload, .. } => (port, payload),
                Output::Request { .. } => panic!("it asks nobody"),
            });
            sent.map(|(port, payload)| (self.interface.ports[port].name.clone(), payload)).collect()
        }

        fn ask(&mut self, name: &str, request: &impl Message) {
            let port = self.interface.ports.iter().position(|port| port.name == name).unwrap();
            let asker = Asker(AskerInner::Loop { edge: 0, call: 0 });
            let payload = cdr::encode(request).unwrap();
            self.io.arrive(port, Arrival::Request { payload, little_endian: true, asker });
        }

        fn call<S: Service>(&mut self, name: &str, request: &S::Request) -> S::Response {
            self.ask(name, request);
            let sent = self.serve();
            said(&sent, name).unwrap_or_else(|| panic!("{name} has not answered"))
        }

        fn set_state(&mut self, state: u8) -> u8 {
            let request = SetSimulationStateRequest { state: SimulationState { state } };
            self.call::<SetSimulationState>("/set_simulation_state", &request).result.result
        }

        fn state(&mut self) -> u8 {
            self.call::<GetSimulationState>("/get_simulation_state", &Default::default()).state.state
        }

        fn reset(&mut self, scope: u8) -> u8 {
            self.call::<ResetSimulation>("/reset_simulation", &ResetSimulationRequest { scope }).result.result
        }

        fn step(&mut self, steps: u64) -> Option<StepSimulationResponse> {
            self.ask("/step_simulation", &StepSimulationRequest { steps });
            said(&self.serve(), "/step_simulation")
        }
    }

    fn said<M: Message>(sent: &[(String, Bytes)], name: &str) -> Option<M> {
        sent.iter().find(|(port, _)| port == name).map(|(_, payload)| cdr::decode(payload, true).unwrap())
    }

    #[test]
    fn a_run_is_stopped_paused_or_playing_and_says_which() {
        let mut bench = Bench::new(false);
        assert_eq!(bench.set_state(SimulationState::STATE_PAUSED), Answer::RESULT_INCORRECT_STATE, "not begun");
        bench.reach(0);
        assert_eq!(bench.state(), SimulationState::STATE_PLAYING);
        assert_eq!(
            bench.set_state(SimulationState::STATE_PLAYING),
            SetSimulationStateResponse::ALREADY_IN_TARGET_STATE
        );
        assert_eq!(bench.set_state(SimulationState::STATE_PAUSED), Answer::RESULT_OK);
        assert_eq!(bench.state(), SimulationState::STATE_PAUSED);
        assert_eq!(bench.set_state(SimulationState::STATE_NO_WORLD), SetSimulationStateResponse::INCORRECT_TRANSITION);
        assert_eq!(bench.set_state(200), SetSimulationStateResponse::INCORRECT_TRANSITION);
        assert_eq!(bench.set_state(SimulationState::STATE_PLAYING), Answer::RESULT_OK);
        assert_eq!(bench.wishes, [Wish::Pause(false)]);
        assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), Answer::RESULT_OK);
        assert_eq!(bench.wishes, [Wish::Pause(true), Wish::Reset]);
        assert_eq!(bench.set_state(SimulationState::STATE_PLAYING), Answer::RESULT_INCORRECT_STATE, "it is leaving");
    }

    #[test]
    fn a_run_that_stands_at_its_beginning_is_stopped_until_somebody_asks_more_of_it() {
        for (wanted, then) in [
            (SimulationState::STATE_PAUSED, SimulationState::STATE_PAUSED),
            (SimulationState::STATE_PLAYING, SimulationState::STATE_PLAYING),
        ] {
            let mut bench = Bench::new(true);
            bench.reach(0);
            assert_eq!(bench.state(), SimulationState::STATE_STOPPED);
            assert_eq!(bench.set_state(wanted), Answer::RESULT_OK);
            assert_eq!(bench.state(), then);
        }
        // By its parameter, too.
        let mut bench = Bench::new(true);
        bench.reach(0);
        bench.clock.set_paused(false, Duration::ZERO);
        assert_eq!(bench.state(), SimulationState::STATE_PLAYING);
    }

    #[test]
    fn a_run_is_reset_as_a_whole_and_at_the_right_moment() {
        let mut bench = Bench::new(false);
        assert_eq!(bench.reset(0), Answer::RESULT_INCORRECT_STATE, "not begun");
        bench.reach(0);
        assert_eq!(bench.reset(ResetSimulationRequest::SCOPE_STATE), Answer::RESULT_FEATURE_UNSUPPORTED);
        bench.refusal = Some(ResetRefusal::Now("busy".into()));
        assert_eq!(bench.reset(ResetSimulationRequest::SCOPE_ALL), Answer::RESULT_INCORRECT_STATE);
        bench.refusal = Some(ResetRefusal::Never("recorded".into()));
        assert_eq!(bench.reset(0), Answer::RESULT_OPERATION_FAILED);
        let failed = SetSimulationStateResponse::STATE_TRANSITION_ERROR;
        assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), failed);
        assert!(bench.wishes.is_empty());
        bench.refusal = None;
        assert_eq!(bench.reset(7), Answer::RESULT_OK, "all three at once");
        assert_eq!(bench.wishes, [Wish::Reset]);
        assert_eq!(bench.state(), SimulationState::STATE_LOADING_WORLD);
        let mut bench = Bench::new(false);
        bench.reach(0);
        bench.refusal = Some(ResetRefusal::Now("busy".into()));
        assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), Answer::RESULT_OK, "who stops it means it");
    }

    #[test]
    fn steps_are_answered_when_they_are_taken() {
        let mut bench = Bench::new(false);
        bench.reach(0);
        let playing = bench.step(3).unwrap().result;
        assert_eq!(
            (playing.result, &*playing.error_message),
            (Answer::RESULT_OPERATION_FAILED, "the run is not paused")
        );
        bench.set_state(SimulationState::STATE_PAUSED);
        bench.reach(32);
        assert_eq!(bench.step(0).unwrap().result.result, Answer::RESULT_OPERATION_FAILED);
        assert_eq!(bench.step(3), None);
        assert_eq!(bench.step(1).unwrap().result.result, Answer::RESULT_OPERATION_FAILED, "one after the other");
        bench.reach(34);
        assert!(bench.serve().is_empty());
        bench.reach(35);
        let sent = bench.serve();
        let answer: StepSimulationResponse = said(&sent, "/step_simulation").unwrap();
        assert_eq!(answer.result.result, Answer::RESULT_OK);
        assert_eq!(bench.step(500), None);
        bench.reach(40);
        bench.ask("/set_simulation_state", &SetSimulationStateRequest { state: SimulationState { state: 2 } });
        let answer: StepSimulationResponse = said(&bench.serve(), "/step_simulation").unwrap();
        assert_eq!(answer.result.error_message, "paused after 5 steps");
        bench.reach(72);
        assert_eq!(bench.step(500), None);
        bench.set_state(SimulationState::STATE_PLAYING);
        let answer: StepSimulationResponse = said(&bench.serve(), "/step_simulation").unwrap();
        assert_eq!(answer.result.error_message, "the run plays on after 0 steps");
        assert_eq!(bench.set_state(SimulationState::STATE_PAUSED), Answer::RESULT_OK);
        assert_eq!(bench.state(), SimulationState::STATE_PAUSED);
        assert_eq!(bench.step(500), None);
        bench.reach(104);
        bench.desk.close(&mut bench.io, 104);
        let answer: StepSimulationResponse = said(&bench.sent(), "/step_simulation").unwrap();
        assert_eq!(answer.result.error_message, "the run has ended after 32 steps");
    }

    #[test]
    fn the_action_tells_how_far_it_is_and_can_be_cancelled() {
        const GOAL: UUID = UUID { uuid: [3; 16] };
        type Sent = <SimulateSteps as Action>::SendGoal;
        type Ended = <SimulateSteps as Action>::GetResult;
        let mut bench = Bench::new(false);
        bench.reach(0);
        bench.set_state(SimulationState::STATE_PAUSED);
        bench.reach(32);
        let goal = minifactory_msgs::simulation_interfaces::action::SimulateStepsGoal { steps: 8 };
        let (accepted, _): (bool, _) =
            bench.call::<Sent>("/simulate_steps/_action/send_goal", &(GOAL, goal).into()).into();
        assert!(accepted);
        bench.ask("/simulate_steps/_action/get_result", &<Ended as Service>::Request::from(GOAL));
        bench.reach(34);
        let sent = bench.serve();
        let feedback: <SimulateSteps as Action>::FeedbackMessage =
            said(&sent, "/simulate_steps/_action/feedback").unwrap();
        let (_, feedback): (UUID, SimulateStepsFeedback) = feedback.into();
        assert_eq!((feedback.completed_steps, feedback.remaining_steps), (2, 6));
        let mut cancel = minifactory_msgs::action_msgs::srv::CancelGoalRequest::default();
        cancel.goal_info.goal_id = GOAL;
        bench.ask("/simulate_steps/_action/cancel_goal", &cancel);
        let sent = bench.serve();
        let result: <Ended as Service>::Response = said(&sent, "/simulate_steps/_action/get_result").unwrap();
        let (status, result): (i8, SimulateStepsResult) = result.into();
        assert_eq!((status, &*result.result.error_message), (5, "cancelled after 2 steps"));
        assert_eq!(bench.clock.grant(Duration::ZERO, true).unwrap().until_tick, 40, "what is granted is granted");
    }
}
