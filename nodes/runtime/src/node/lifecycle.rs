//! Managed lifecycle: the states of a ROS 2 lifecycle node, its services and its topic, on a node's ports.
//!
//! A node says by [`FeederNode::START`](super::FeederNode::START) that it has one, and asks [`StepIo`] in which state it is.
//! It steps in every state: what it does not do while it is not active is for the node to say.
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

/// When a node with a lifecycle becomes active. In a run of `feeder up` all do in their first step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// By itself, in its first step.
    Active,
    /// When somebody asks for it: something moves then.
    Unconfigured,
}

/// A transition that a client may ask for, with the state on the way and the transition that ends it.
struct Edge {
    id: u8,
    label: &'static str,
    from: LifecycleState,
    to: LifecycleState,
    passing: (u8, &'static str),
    success: u8,
}

const EDGES: [Edge; 7] = {
    use LifecycleState::{Active, Finalized, Inactive, Unconfigured};
    const CONFIGURING: (u8, &str) = (StateMessage::TRANSITION_STATE_CONFIGURING, "configuring");
    const CLEANING_UP: (u8, &str) = (StateMessage::TRANSITION_STATE_CLEANINGUP, "cleaningup");
    const ACTIVATING: (u8, &str) = (StateMessage::TRANSITION_STATE_ACTIVATING, "activating");
    const DEACTIVATING: (u8, &str) = (StateMessage::TRANSITION_STATE_DEACTIVATING, "deactivating");
    const SHUTTING_DOWN: (u8, &str) = (StateMessage::TRANSITION_STATE_SHUTTINGDOWN, "shuttingdown");
    const fn edge(
        id: u8,
        label: &'static str,
        from: LifecycleState,
        to: LifecycleState,
        passing: (u8, &'static str),
        success: u8,
    ) -> Edge {
        Edge { id, label, from, to, passing, success }
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
pub(crate) struct LifecyclePorts {
    get_state: Server<GetState>,
    change_state: Server<ChangeState>,
    get_available_states: Server<GetAvailableStates>,
    get_available_transitions: Server<GetAvailableTransitions>,
    get_transition_graph: Server<GetAvailableTransitions>,
    transition_event: Publisher<TransitionEvent>,
}

impl Declare {
    /// Declares the lifecycle of the node called `node`: its services lie below its name.
    pub(crate) fn lifecycle(&mut self, node: &str) -> LifecyclePorts {
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
pub(crate) struct Lifecycle {
    ports: LifecyclePorts,
    state: LifecycleState,
}

impl Lifecycle {
    pub(crate) fn new(ports: LifecyclePorts) -> Self {
        Self { ports, state: LifecycleState::Unconfigured }
    }

    /// Takes the node from unconfigured to active.
    pub(crate) fn start(&mut self, io: &mut StepIo) {
        for edge in [&EDGES[0], &EDGES[2]] {
            self.change(io, edge);
        }
    }

    /// Answers clients, and tells the step in which state it is. Call it once a step, before the node's own.
    pub(crate) fn poll(&mut self, io: &mut StepIo) {
        for (asker, request) in io.requests(&self.ports.change_state) {
            let asked = &request.transition;
            let success = match self.edge(asked) {
                Ok(edge) => {
                    self.change(io, edge);
                    true
                }
                Err(reason) => {
                    tracing::warn!("{reason}");
                    false
                }
            };
            io.reply(&self.ports.change_state, asker, &ChangeStateResponse { success });
        }
        io.set_lifecycle(self.state);
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

    /// The transition that a client asks for, by its label or else by its number.
    fn edge(&self, asked: &Transition) -> Result<&'static Edge, String> {
        let from_here = || EDGES.iter().filter(|edge| edge.from == self.state);
        let named = |edge: &&Edge| if asked.label.is_empty() { edge.id == asked.id } else { edge.label == asked.label };
        from_here().find(named).ok_or_else(|| {
            let name = if asked.label.is_empty() { format!("number {}", asked.id) } else { asked.label.clone() };
            let allowed: Vec<&str> = from_here().map(|edge| edge.label).collect();
            let allowed = if allowed.is_empty() { "none".to_owned() } else { allowed.join(", ") };
            format!("refused the transition {name}: the node is {}, which allows {allowed}", self.state.label())
        })
    }

    /// Follows an edge and says so.
    fn change(&mut self, io: &mut StepIo, edge: &Edge) {
        self.say(io, edge.transition(), edge.from.message(), edge.passing());
        self.state = edge.to;
        tracing::debug!("{}", self.state.label());
        let arrived = Transition { id: edge.success, label: "transition_success".to_owned() };
        self.say(io, arrived, edge.passing(), self.state.message());
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
    }

    impl Bench {
        fn new() -> Self {
            let mut declare = Declare::new("node", "/feeder");
            let lifecycle = Lifecycle::new(declare.lifecycle("node"));
            let ports = declare.finish().unwrap().ports;
            Self { io: StepIo::new(ports.len(), 1), lifecycle }
        }

        /// Steps with a request for a transition; gives its success.
        fn ask(&mut self, id: u8, label: &str) -> bool {
            let request = ChangeStateRequest { transition: Transition { id, label: label.to_owned() } };
            let payload = crate::cdr::encode(&request).unwrap();
            let asker = Asker(AskerInner::Loop { edge: 0, call: 0 });
            self.io.arrive(
                self.lifecycle.ports.change_state.port,
                Arrival::Request { payload, little_endian: true, asker },
            );
            self.lifecycle.poll(&mut self.io);
            let Some(Output::Reply { payload, .. }) = self.io.outputs.pop() else { panic!("no reply") };
            crate::cdr::decode::<ChangeStateResponse>(&payload, true).unwrap().success
        }

        /// The states that were told since the last look.
        fn told(&mut self) -> Vec<String> {
            let state = |output| {
                let Output::Message { payload, .. } = output else { panic!("{output:?}") };
                crate::cdr::decode::<TransitionEvent>(&payload, true).unwrap().goal_state.label
            };
            std::mem::take(&mut self.io.outputs).into_iter().map(state).collect()
        }
    }

    #[test]
    fn a_client_takes_the_node_through_its_states_by_number_or_label() {
        let mut bench = Bench::new();
        assert!(bench.ask(Transition::TRANSITION_CONFIGURE, ""));
        assert_eq!(bench.told(), ["configuring", "inactive"]);
        assert!(!bench.io.is_active());
        assert!(bench.ask(0, "activate"));
        assert_eq!(bench.told(), ["activating", "active"]);
        assert!(bench.io.is_active());
        assert!(bench.ask(Transition::TRANSITION_DEACTIVATE, ""));
        assert!(bench.ask(0, "cleanup"));
        assert_eq!(bench.told(), ["deactivating", "inactive", "cleaningup", "unconfigured"]);
        assert!(bench.ask(0, "shutdown"));
        assert_eq!(bench.io.lifecycle(), LifecycleState::Finalized);
    }

    #[test]
    fn a_node_that_starts_passes_the_states_on_the_way() {
        let mut bench = Bench::new();
        bench.lifecycle.start(&mut bench.io);
        assert_eq!(bench.told(), ["configuring", "inactive", "activating", "active"]);
    }

    #[test]
    fn a_transition_that_the_state_does_not_allow_is_refused_with_the_reason_and_changes_nothing() {
        let mut bench = Bench::new();
        for (id, label, said) in [
            (
                0,
                "activate",
                "refused the transition activate: the node is unconfigured, which allows configure, shutdown",
            ),
            (Transition::TRANSITION_CLEANUP, "", "refused the transition number 2: the node is unconfigured"),
            (0, "fly", "refused the transition fly"),
            (99, "", "refused the transition number 99"),
            // Shutting down has a number for each state.
            (Transition::TRANSITION_ACTIVE_SHUTDOWN, "", "refused the transition number 7"),
        ] {
            let refused = bench.lifecycle.edge(&Transition { id, label: label.to_owned() }).map(|edge| edge.label);
            assert!(refused.as_ref().is_err_and(|reason| reason.contains(said)), "{refused:?}");
            assert!(!bench.ask(id, label) && bench.told().is_empty());
        }
        assert!(bench.ask(0, "shutdown"));
        bench.told();
        assert!(!bench.ask(0, "configure") && bench.told().is_empty());
    }
}
