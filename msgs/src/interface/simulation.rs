//! The control of a simulation as `simulation_interfaces` states it, under the names that Isaac Sim and O3DE give it.
//! <https://github.com/ros-simulation/simulation_interfaces>, 2.1.0

use super::standard::{CLOCK_OF_A_RUN, GLOBAL};
use super::{ActionSpec, Entry, ServiceSpec, User};
use crate::simulation_interfaces::action::SimulateSteps;
use crate::simulation_interfaces::srv::{
    GetSimulationState, GetSimulatorFeatures, ResetSimulation, SetSimulationState, StepSimulation,
};

const OPERATORS: &[User] = &[User::Outside("operators")];

/// What of the standard is offered.
pub const GET_SIMULATOR_FEATURES: ServiceSpec<GetSimulatorFeatures> = ServiceSpec::new(
    GLOBAL,
    "get_simulator_features",
)
.between(&[CLOCK_OF_A_RUN], OPERATORS, "What of simulation_interfaces is offered");

/// Whether time passes.
pub const GET_SIMULATION_STATE: ServiceSpec<GetSimulationState> = ServiceSpec::new(GLOBAL, "get_simulation_state")
    .between(&[CLOCK_OF_A_RUN], OPERATORS, "Whether time passes, stands still, or has not begun");

/// Lets time pass or stand still, or ends the run.
pub const SET_SIMULATION_STATE: ServiceSpec<SetSimulationState> = ServiceSpec::new(GLOBAL, "set_simulation_state")
    .between(
        &[CLOCK_OF_A_RUN],
        OPERATORS,
        "Lets time pass or stand still, starts the run again and holds it at its beginning, or ends it",
    );

/// Starts the run again.
pub const RESET_SIMULATION: ServiceSpec<ResetSimulation> = ServiceSpec::new(GLOBAL, "reset_simulation").between(
    &[CLOCK_OF_A_RUN],
    OPERATORS,
    "Starts the run again with the same seed; not while a part is on its way to a station",
);

/// Lets time pass for some ticks.
pub const STEP_SIMULATION: ServiceSpec<StepSimulation> = ServiceSpec::new(GLOBAL, "step_simulation").between(
    &[CLOCK_OF_A_RUN],
    OPERATORS,
    "Lets a paused run go on for so many ticks, and answers when they have passed",
);

/// Lets time pass for some ticks, and tells how far it is.
pub const SIMULATE_STEPS: ActionSpec<SimulateSteps> = ActionSpec::new(GLOBAL, "simulate_steps").between(
    &[CLOCK_OF_A_RUN],
    OPERATORS,
    "Lets a paused run go on for so many ticks, tells how far it is, and stops when cancelled",
);

/// All of them.
#[must_use]
pub fn all() -> Vec<Entry> {
    vec![
        GET_SIMULATOR_FEATURES.entry(),
        GET_SIMULATION_STATE.entry(),
        SET_SIMULATION_STATE.entry(),
        RESET_SIMULATION.entry(),
        STEP_SIMULATION.entry(),
        SIMULATE_STEPS.entry(),
    ]
}
