//! Managed lifecycle: the states of a ROS 2 lifecycle node, its services and its topic, on a node's ports.
//!
//! ```text
//! unconfigured ──configure──▶ inactive ──activate──▶ active
//!              ◀──cleanup────          ◀─deactivate─
//! any of them ──shutdown──▶ finalized
//! ```

use minifactory_msgs::lifecycle_msgs::msg::{
    State as StateMessage, Transition, TransitionDescription, TransitionEvent,
};
use minifactory_msgs::lifecycle_msgs::srv::{
    ChangeState, ChangeStateResponse, GetAvailableStates, GetAvailableStatesResponse, GetAvailableTransitions,
    GetAvailableTransitionsResponse, GetState, GetStateResponse,
};

use super::ports::{Declare, Publisher, Server};
use super::step::StepIo;
use crate::dds::Qos;

/// A primary state of a lifecycle node. The numbers are those of `lifecycle_msgs/msg/State`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LifecycleState {
    /// Nothing is set up.
    Unconfigured = StateMessage::PRIMARY_STATE_UNCONFIGURED,
    /// Set up, but idle.
    Inactive = StateMessage::PRIMARY_STATE_INACTIVE,
    /// At work.
    Active = StateMessage::PRIMARY_STATE_ACTIVE,
    /// At the end.
    Finalized = StateMessage::PRIMARY_STATE_FINALIZED,
}

/// A transition that a client may ask for, with the state on the way and the transition that ends it well or not.
struct Edge {
    id: u8,
    label: &'static str,
    from: LifecycleState,
    to: LifecycleState,
    passing: (u8, &'static str),
    success: u8,
    failure: u8,
}

const EDGES: [Edge; 7] = {
    use LifecycleState::{Active, Finalized, Inactive, Unconfigured};
    const CONFIGURING: (u8, &str) = (StateMessage::TRANSITION_STATE_CONFIGURING, "configuring");
    const CLEANING_UP: (u8, &str) = (StateMessage::TRANSITION_STATE_CLEANINGUP, "cleaningup");
    const ACTIVATING: (u8, &str) = (StateMessage::TRANSITION_STATE_ACTIVATING, "activating");
    const DEACTIVATING: (u8, &str) = (StateMessage::TRANSITION_STATE_DEACTIVATING, "deactivating");
    const SHUTTING_DOWN: (u8, &str) = (StateMessage::TRANSITION_STATE_SHUTTINGDOWN, "shuttingdown");
    // The numbers of what ends a transition well and badly, in lifecycle_msgs/msg/Transition: ON_CONFIGURE_SUCCESS …
    const fn edge(
        id: u8,
        label: &'static str,
        from: LifecycleState,
        to: LifecycleState,
        passing: (u8, &'static str),
        success: u8,
    ) -> Edge {
        Edge { id, label, from, to, passing, success, failure: success + 1 }
    }
    [
        edge(
            Transition::TRANSITION_CONFIGURE,
            "configure",
            Unconfigured,
            Inactive,
            CONFIGURING,
            Transition::TRANSITION_ON_CONFIGURE_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_CLEANUP,
            "cleanup",
            Inactive,
            Unconfigured,
            CLEANING_UP,
            Transition::TRANSITION_ON_CLEANUP_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_ACTIVATE,
            "activate",
            Inactive,
            Active,
            ACTIVATING,
            Transition::TRANSITION_ON_ACTIVATE_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_DEACTIVATE,
            "deactivate",
            Active,
            Inactive,
            DEACTIVATING,
            Transition::TRANSITION_ON_DEACTIVATE_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_UNCONFIGURED_SHUTDOWN,
            "shutdown",
            Unconfigured,
            Finalized,
            SHUTTING_DOWN,
            Transition::TRANSITION_ON_SHUTDOWN_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_INACTIVE_SHUTDOWN,
            "shutdown",
            Inactive,
            Finalized,
            SHUTTING_DOWN,
            Transition::TRANSITION_ON_SHUTDOWN_SUCCESS,
        ),
        edge(
            Transition::TRANSITION_ACTIVE_SHUTDOWN,
            "shutdown",
            Active,
            Finalized,
            SHUTTING_DOWN,
            Transition::TRANSITION_ON_SHUTDOWN_SUCCESS,
        ),
    ]
};

impl LifecycleState {
    const ALL: [Self; 4] = [Self::Unconfigured, Self::Inactive, Self::Active, Self::Finalized];

    /// The label that ROS 2 tools show.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Unconfigured => "unconfigured",
            Self::Inactive => "inactive",
            Self::Active => "active",
            Self::Finalized => "finalized",
        }
    }

    fn message(self) -> StateMessage {
        StateMessage { id: self as u8, label: self.label().to_owned() }
    }
}

impl Edge {
    fn transition(&self) -> Transition {
        Transition { id: self.id, label: self.label.to_owned() }
    }

    fn passing(&self) -> StateMessage {
        StateMessage { id: self.passing.0, label: self.passing.1.to_owned() }
    }

    fn description(&self) -> TransitionDescription {
        TransitionDescription {
            transition: self.transition(),
            start_state: self.from.message(),
            goal_state: self.passing(),
        }
    }
}

/// The ports of a lifecycle.
pub struct LifecyclePorts {
    get_state: Server<GetState>,
    change_state: Server<ChangeState>,
    get_available_states: Server<GetAvailableStates>,
    get_available_transitions: Server<GetAvailableTransitions>,
    get_transition_graph: Server<GetAvailableTransitions>,
    transition_event: Publisher<TransitionEvent>,
}

impl Declare {
    /// Declares the lifecycle of the node called `node`: its services lie below its name.
    pub fn lifecycle(&mut self, node: &str) -> LifecyclePorts {
        let namespace = self.namespace().to_owned();
        let name = |what: &str| format!("{namespace}/{node}/{what}");
        LifecyclePorts {
            get_state: self.server_named(name("get_state")),
            change_state: self.server_named(name("change_state")),
            get_available_states: self.server_named(name("get_available_states")),
            get_available_transitions: self.server_named(name("get_available_transitions")),
            get_transition_graph: self.server_named(name("get_transition_graph")),
            transition_event: self.publisher_named(name("transition_event"), Qos::command()),
        }
    }
}

/// The lifecycle of a node, unconfigured at first.
pub struct Lifecycle {
    ports: LifecyclePorts,
    state: LifecycleState,
}

impl Lifecycle {
    /// An unconfigured lifecycle on `ports`.
    #[must_use]
    pub fn new(ports: LifecyclePorts) -> Self {
        Self { ports, state: LifecycleState::Unconfigured }
    }

    /// The present state.
    #[must_use]
    pub fn state(&self) -> LifecycleState {
        self.state
    }

    /// Answers clients, and in a simulated run goes to active by itself. `enter` is called for each state on the way and
    /// may refuse it; then the node stays where it is. Call it once a step.
    pub fn poll(&mut self, io: &mut StepIo, mut enter: impl FnMut(LifecycleState) -> Result<(), String>) {
        if io.tick() == 0 && io.simulated() {
            for edge in [&EDGES[0], &EDGES[2]] {
                self.change(io, edge, &mut enter);
            }
        }
        for (asker, request) in io.requests(&self.ports.change_state) {
            let Transition { id, label } = &request.transition;
            let named = |edge: &&Edge| if label.is_empty() { edge.id == *id } else { edge.label == label };
            let edge = EDGES.iter().filter(|edge| edge.from == self.state).find(named);
            if edge.is_none() {
                tracing::warn!("no transition {id} {label:?} from {}", self.state.label());
            }
            let success = edge.is_some_and(|edge| self.change(io, edge, &mut enter));
            io.reply(&self.ports.change_state, asker, &ChangeStateResponse { success });
        }
        for (asker, _) in io.requests(&self.ports.get_state) {
            io.reply(&self.ports.get_state, asker, &GetStateResponse { current_state: self.state.message() });
        }
        for (asker, _) in io.requests(&self.ports.get_available_states) {
            let mut available_states: Vec<_> = LifecycleState::ALL.map(LifecycleState::message).into();
            for passing in EDGES.iter().map(Edge::passing) {
                if !available_states.contains(&passing) {
                    available_states.push(passing);
                }
            }
            io.reply(&self.ports.get_available_states, asker, &GetAvailableStatesResponse { available_states });
        }
        for (asker, _) in io.requests(&self.ports.get_available_transitions) {
            let from_here = EDGES.iter().filter(|edge| edge.from == self.state).map(Edge::description);
            let response = GetAvailableTransitionsResponse { available_transitions: from_here.collect() };
            io.reply(&self.ports.get_available_transitions, asker, &response);
        }
        for (asker, _) in io.requests(&self.ports.get_transition_graph) {
            let all = EDGES.iter().map(Edge::description);
            let response = GetAvailableTransitionsResponse { available_transitions: all.collect() };
            io.reply(&self.ports.get_transition_graph, asker, &response);
        }
    }

    /// Follows an edge, says so, and tells whether the node arrived.
    fn change(
        &mut self,
        io: &mut StepIo,
        edge: &Edge,
        enter: &mut impl FnMut(LifecycleState) -> Result<(), String>,
    ) -> bool {
        self.say(io, edge.transition(), edge.from.message(), edge.passing());
        let entered = enter(edge.to);
        let (id, label) = match &entered {
            Ok(()) => (edge.success, "transition_success"),
            Err(_) => (edge.failure, "transition_failure"),
        };
        match &entered {
            Ok(()) => {
                self.state = edge.to;
                tracing::debug!("{}", self.state.label());
            }
            Err(reason) => tracing::warn!("cannot {}: {reason}", edge.label),
        }
        self.say(io, Transition { id, label: label.to_owned() }, edge.passing(), self.state.message());
        entered.is_ok()
    }

    fn say(&self, io: &mut StepIo, transition: Transition, start_state: StateMessage, goal_state: StateMessage) {
        let event = TransitionEvent { timestamp: io.now_ns(), transition, start_state, goal_state };
        io.publish(&self.ports.transition_event, &event);
    }
}

#[cfg(test)]
mod tests {
    use minifactory_msgs::lifecycle_msgs::srv::ChangeStateRequest;

    use super::*;
    use crate::node::{Arrival, Asker, AskerInner, Output};

    struct Bench {
        io: StepIo,
        lifecycle: Lifecycle,
        tick: u64,
        ports: usize,
    }

    impl Bench {
        fn new(simulated: bool) -> Self {
            let mut declare = Declare::new("node", "/feeder");
            let lifecycle = Lifecycle::new(declare.lifecycle("node"));
            let ports = declare.finish().unwrap().ports.len();
            let mut io = StepIo::new(ports, 1);
            io.set_simulated(simulated);
            Self { io, lifecycle, tick: 0, ports }
        }

        /// Steps with a request for a transition; gives its success and the states passed.
        fn step(&mut self, id: u8, label: &str, refuse: bool) -> (bool, Vec<String>) {
            assert_eq!(self.ports, 6);
            self.io.begin(self.tick, self.tick);
            self.tick += 1;
            let request = ChangeStateRequest { transition: Transition { id, label: label.to_owned() } };
            let payload = crate::cdr::encode(&request).unwrap();
            let asker = Asker(AskerInner::Loop { edge: 0, call: 0 });
            self.io.arrive(1, Arrival::Request { payload, little_endian: true, asker });
            self.lifecycle.poll(&mut self.io, |_| if refuse { Err("no".to_owned()) } else { Ok(()) });
            let (mut success, mut passed) = (false, Vec::new());
            for output in std::mem::take(&mut self.io.outputs) {
                match output {
                    Output::Reply { payload, .. } => {
                        success = crate::cdr::decode::<ChangeStateResponse>(&payload, true).unwrap().success;
                    }
                    Output::Message { payload, .. } => {
                        passed.push(crate::cdr::decode::<TransitionEvent>(&payload, true).unwrap().goal_state.label);
                    }
                    Output::Request { .. } => {}
                }
            }
            (success, passed)
        }
    }

    #[test]
    fn a_client_takes_the_node_through_its_states_by_number_or_label() {
        let mut bench = Bench::new(false);
        assert_eq!(bench.step(Transition::TRANSITION_ACTIVATE, "", false), (false, vec![]));
        assert_eq!(bench.step(Transition::TRANSITION_CONFIGURE, "", false).1, ["configuring", "inactive"]);
        assert_eq!(bench.step(0, "activate", false), (true, vec!["activating".into(), "active".into()]));
        assert_eq!(bench.step(Transition::TRANSITION_DEACTIVATE, "", true).1, ["deactivating", "active"]);
        assert_eq!(bench.lifecycle.state(), LifecycleState::Active);
        assert!(bench.step(0, "shutdown", false).0);
        assert_eq!(bench.lifecycle.state(), LifecycleState::Finalized);
        assert!(!bench.step(0, "configure", false).0);
    }

    #[test]
    fn in_a_simulated_run_the_node_becomes_active_by_itself() {
        let mut bench = Bench::new(true);
        let (deactivated, passed) = bench.step(0, "deactivate", false);
        assert!(deactivated);
        assert_eq!(passed, ["configuring", "inactive", "activating", "active", "deactivating", "inactive"]);
    }
}
