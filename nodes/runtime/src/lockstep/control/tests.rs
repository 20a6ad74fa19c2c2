//! What operators ask of a run of one node, and what they are answered.

use bytes::Bytes;
use minifactory_msgs::action_msgs::srv::CancelGoalRequest;
use minifactory_msgs::msg::LoopStatus;
use minifactory_msgs::simulation_interfaces::action::{
    SimulateSteps, SimulateStepsFeedback, SimulateStepsGoal, SimulateStepsResult,
};
use minifactory_msgs::simulation_interfaces::msg::SimulationState;
use minifactory_msgs::simulation_interfaces::srv::{
    GetSimulationState, ResetSimulation, ResetSimulationRequest, SetSimulationState, SetSimulationStateRequest,
    SetSimulationStateResponse, StepSimulationRequest, StepSimulationResponse,
};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::{Action, Message, Service};

use super::*;
use crate::cdr;
use crate::lockstep::{LoopContract, LoopTiming, Speed};
use crate::node::{Arrival, Interface};

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
        let status = LoopStatus { run_id: 7, node: "/a".into(), tick, wired: true, goal_tick, ..LoopStatus::default() };
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
    assert_eq!(bench.set_state(SimulationState::STATE_PLAYING), SetSimulationStateResponse::ALREADY_IN_TARGET_STATE);
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
    assert_eq!((playing.result, &*playing.error_message), (Answer::RESULT_OPERATION_FAILED, "the run is not paused"));
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
    let goal = SimulateStepsGoal { steps: 8 };
    let (accepted, _): (bool, _) = bench.call::<Sent>("/simulate_steps/_action/send_goal", &(GOAL, goal).into()).into();
    assert!(accepted);
    bench.ask("/simulate_steps/_action/get_result", &<Ended as Service>::Request::from(GOAL));
    bench.reach(34);
    let sent = bench.serve();
    let feedback: <SimulateSteps as Action>::FeedbackMessage = said(&sent, "/simulate_steps/_action/feedback").unwrap();
    let (_, feedback): (UUID, SimulateStepsFeedback) = feedback.into();
    assert_eq!((feedback.completed_steps, feedback.remaining_steps), (2, 6));
    let mut cancel = CancelGoalRequest::default();
    cancel.goal_info.goal_id = GOAL;
    bench.ask("/simulate_steps/_action/cancel_goal", &cancel);
    let sent = bench.serve();
    let result: <Ended as Service>::Response = said(&sent, "/simulate_steps/_action/get_result").unwrap();
    let (status, result): (i8, SimulateStepsResult) = result.into();
    assert_eq!((status, &*result.result.error_message), (5, "cancelled after 2 steps"));
    assert_eq!(bench.clock.grant(Duration::ZERO, true).unwrap().until_tick, 40, "what is granted is granted");
}
