//! Steps that somebody asks a paused run to take, by the service or by the action: one such request at a time.

use std::ops::Range;

use minifactory_msgs::interface::simulation;
use minifactory_msgs::simulation_interfaces::action::{SimulateSteps, SimulateStepsFeedback, SimulateStepsResult};
use minifactory_msgs::simulation_interfaces::msg::Result as Answer;
use minifactory_msgs::simulation_interfaces::srv::{StepSimulation, StepSimulationResponse};

use super::{answer, ok};
use crate::lockstep::clock::LoopClock;
use crate::node::{ActionServer, ActionServerPorts, Asker, Declare, GoalEnd, GoalId, Server, ServerEvent, StepIo};

/// Who waits for steps to be taken.
enum Waiting {
    Caller(Asker),
    Goal(GoalId),
}

/// Steps under way.
struct UnderWay {
    ticks: Range<u64>,
    /// How many were told of last.
    told: u64,
    waiting: Waiting,
}

impl UnderWay {
    fn new(ticks: Range<u64>, waiting: Waiting) -> Self {
        Self { ticks, told: 0, waiting }
    }

    /// How many are taken when every node has reached `tick`.
    fn taken(&self, tick: u64) -> u64 {
        tick.clamp(self.ticks.start, self.ticks.end) - self.ticks.start
    }
}

/// Whoever asks for steps, and how far they are.
pub(super) struct Steps {
    service: Server<StepSimulation>,
    action: ActionServer<SimulateSteps>,
    under_way: Option<UnderWay>,
}

impl Steps {
    pub(super) fn declare(io: &mut Declare) -> Self {
        let action: ActionServerPorts<SimulateSteps> = io.action_server(&simulation::SIMULATE_STEPS);
        let service = io.server(&simulation::STEP_SIMULATION);
        Self { service, action: ActionServer::new(action), under_way: None }
    }

    pub(super) fn are_under_way(&self) -> bool {
        self.under_way.is_some()
    }

    /// Tells whoever waits how far they are, also that they have ended: with the last one, or as the run plays on.
    pub(super) fn follow(&mut self, io: &mut StepIo, clock: &LoopClock) {
        let Some(under_way) = &mut self.under_way else { return };
        let steps = under_way.ticks.end - under_way.ticks.start;
        let completed_steps = under_way.taken(clock.tick());
        if let Waiting::Goal(id) = under_way.waiting
            && completed_steps > under_way.told
        {
            under_way.told = completed_steps;
            let remaining_steps = steps - completed_steps;
            self.action.feedback(io, id, SimulateStepsFeedback { completed_steps, remaining_steps });
        }
        if completed_steps == steps
            && let Some(under_way) = self.under_way.take()
        {
            self.end(io, under_way.waiting, GoalEnd::Succeeded, ok());
        }
        if !clock.is_paused() {
            self.leave(io, clock.tick(), GoalEnd::Aborted, "the run plays on");
        }
    }

    /// Takes what was asked since, unless the run does not obey for the reason given. Whether steps have begun.
    pub(super) fn serve(&mut self, io: &mut StepIo, clock: &mut LoopClock, not_ready: Option<&Answer>) -> bool {
        let mut have_begun = false;
        for (asker, request) in io.requests(&self.service) {
            match self.begin(clock, request.steps, not_ready) {
                Ok(ticks) => {
                    self.under_way = Some(UnderWay::new(ticks, Waiting::Caller(asker)));
                    have_begun = true;
                }
                Err(result) => io.reply(&self.service, asker, &StepSimulationResponse { result }),
            }
        }
        for event in self.action.poll(io) {
            match event {
                ServerEvent::Requested(request) => match self.begin(clock, request.goal.steps, not_ready) {
                    Ok(ticks) => {
                        self.under_way = Some(UnderWay::new(ticks, Waiting::Goal(request.id)));
                        self.action.accept(io, request);
                        have_begun = true;
                    }
                    // The answer to a goal has no room for a reason; its result has.
                    Err(result) => {
                        let id = request.id;
                        self.action.accept(io, request);
                        self.action.finish(io, id, GoalEnd::Aborted, SimulateStepsResult { result });
                    }
                },
                ServerEvent::CancelRequested(_) => self.stop(io, clock, GoalEnd::Canceled, "cancelled"),
            }
        }
        have_begun
    }

    fn begin(&self, clock: &mut LoopClock, steps: u64, not_ready: Option<&Answer>) -> Result<Range<u64>, Answer> {
        let failed = |message: &str| answer(Answer::RESULT_OPERATION_FAILED, message);
        if let Some(not_ready) = not_ready {
            return Err(not_ready.clone());
        }
        if steps == 0 {
            return Err(failed("steps = 0, allowed: 1 or more"));
        }
        if self.under_way.is_some() {
            return Err(failed("other steps are being taken"));
        }
        clock.step(steps).ok_or_else(|| failed("the run is not paused"))
    }

    /// Has no more taken than are granted already.
    pub(super) fn stop(&mut self, io: &mut StepIo, clock: &mut LoopClock, end: GoalEnd, why: &str) {
        clock.stop_stepping();
        self.leave(io, clock.tick(), end, why);
    }

    /// Tells whoever waits that the rest is not taken.
    pub(super) fn leave(&mut self, io: &mut StepIo, tick: u64, end: GoalEnd, why: &str) {
        if let Some(under_way) = self.under_way.take() {
            let message = format!("{why} after {} steps", under_way.taken(tick));
            self.end(io, under_way.waiting, end, answer(Answer::RESULT_OPERATION_FAILED, &message));
        }
    }

    fn end(&mut self, io: &mut StepIo, waiting: Waiting, end: GoalEnd, result: Answer) {
        match waiting {
            Waiting::Caller(asker) => io.reply(&self.service, asker, &StepSimulationResponse { result }),
            Waiting::Goal(id) => self.action.finish(io, id, end, SimulateStepsResult { result }),
        }
    }
}
