//! Nodes with a lifecycle: led through it by a client, in a run and outside one.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Stdio;
use std::sync::mpsc::{Receiver, channel};

use feeder_runtime::dds::{NodeName, Participant, Qos, Reader};
use feeder_runtime::node::ns_of_stamp;
use feeder_runtime::testing::TestDomain;
use feeder_wire::courier_state::NOT_ACTIVE;
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::Message;
use minifactory_msgs::interface::TopicSpec;
use minifactory_msgs::lifecycle_msgs::msg::{State, TransitionEvent};
use minifactory_msgs::lifecycle_msgs::srv::{
    GetAvailableStates, GetAvailableStatesRequest, GetAvailableTransitions, GetAvailableTransitionsRequest, GetState,
    GetStateRequest,
};
use minifactory_msgs::msg::{CourierState, DeliveryState, FeederState};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::std_srvs::srv::SetBoolRequest;
use rustix::process::Signal;

use crate::common::{FEEDER, Process, Run, Up, feeder, wait_for};
use crate::wall_clock::{PATIENCE, call, hear, lead, participant};

/// In the order in which a launch file brings them up.
const MANAGED: [&str; 5] = [
    nodes::PART_SIMULATOR,
    nodes::COURIER_DRIVER,
    nodes::WAVEFORM_GENERATOR,
    nodes::VISION_SELECTOR,
    nodes::DELIVERY_PLANNER,
];

/// How much older than the message its stamp may be, ns of simulated time: a picture is looked at some ticks after it was taken.
const LATE_NS: u64 = 200_000_000;
/// Within which the courier comes to rest from anything that it does, ns of simulated time: at most four periods of the
/// waveform, as a vibration that fades in for two does so to the end before it fades out.
const BRAKING_NS: u64 = 1_000_000_000;

/// A run that goes on until it is told to go, and somebody who watches it.
struct Bench {
    run: Run,
    here: Participant,
    courier: Receiver<CourierState>,
    feeder: Receiver<FeederState>,
    deliveries: Receiver<DeliveryState>,
    /// What each node says of its transitions.
    transitions: BTreeMap<&'static str, (Reader, Receiver<TransitionEvent>)>,
    _readers: [Reader; 3],
}

impl Bench {
    fn new() -> Self {
        let run = Up::new("--duration 86400 --speed 10 --composed").start();
        let here = Participant::open(run.domain(), &NodeName::new("/", "test").unwrap()).unwrap();
        let (courier_reader, courier) = hear(&here, &topics::COURIER_STATE, FEEDER);
        let (feeder_reader, feeder) = hear(&here, &topics::STATE, FEEDER);
        let (delivery_reader, deliveries) = hear(&here, &topics::DELIVERY_STATE, FEEDER);
        let transitions = MANAGED.map(|node| (node, hear_transitions(&here, node))).into();
        let _readers = [courier_reader, feeder_reader, delivery_reader];
        Self { run, here, courier, feeder, deliveries, transitions, _readers }
    }

    /// Waits for something that is heard.
    #[track_caller]
    fn wait<T>(&self, what: &str, heard: &Receiver<T>, is_it: impl Fn(&T) -> bool) -> T {
        wait_for(&format!("{what}, in {}", self.run.domain().id), || heard.try_iter().find(|message| is_it(message)))
    }

    /// Waits for what the courier says at this time or later, ns of simulated time.
    #[track_caller]
    fn wait_until(&self, ns: u64) -> CourierState {
        self.wait("simulated time to pass", &self.courier, |state| stamp_ns(&state.header) >= ns)
    }

    /// Waits until one part more is delivered than was when this is asked.
    #[track_caller]
    fn wait_for_delivery(&self) {
        let before = self.wait("the planner's count", &self.deliveries, |_| true).delivered;
        self.wait("another part to be delivered", &self.deliveries, |state| state.delivered > before);
    }

    /// Has a node make a transition; gives when it made it, ns of simulated time.
    #[track_caller]
    fn lead(&self, node: &str, label: &str) -> u64 {
        let (reader, events) = &self.transitions[node];
        wait_for("the transition events", || (reader.matched_writers() > 0).then_some(()));
        assert!(lead(&self.here, node, label), "{node} {label}: {}", self.run.stderr());
        // What was told before somebody asked may come first.
        let on_the_way = self.wait("word of the transition", events, |event| event.transition.label == label);
        let there = events.recv_timeout(PATIENCE).unwrap();
        assert_eq!(on_the_way.goal_state, there.start_state);
        assert_eq!(there.goal_state.label, state(&self.here, node));
        there.timestamp
    }
}

fn stamp_ns(header: &Header) -> u64 {
    ns_of_stamp(&header.stamp)
}

fn hear_transitions(here: &Participant, node: &str) -> (Reader, Receiver<TransitionEvent>) {
    let (sender, heard) = channel();
    let topic = format!("{FEEDER}/{node}/transition_event");
    let reader = here.reader(&topic, &TransitionEvent::INFO.dds_type(), &Qos::command(), move |sample| {
        // A closed channel belongs to a test that has seen enough.
        let _ = sender.send(sample.decode().unwrap());
    });
    (reader.unwrap(), heard)
}

pub(crate) fn state(here: &Participant, node: &str) -> String {
    let client = here.service_client::<GetState>(&format!("{FEEDER}/{node}/get_state")).unwrap();
    client.call(&GetStateRequest::default(), PATIENCE).wait().unwrap().current_state.label
}

/// The transitions that a node names, those that it allows now or all.
fn transitions(here: &Participant, node: &str, service: &str) -> Vec<String> {
    let client = here.service_client::<GetAvailableTransitions>(&format!("{FEEDER}/{node}/{service}")).unwrap();
    let named = client.call(&GetAvailableTransitionsRequest::default(), PATIENCE).wait().unwrap();
    named.available_transitions.into_iter().map(|named| named.transition.label).collect()
}

#[test]
fn every_node_of_a_run_is_active_and_refuses_what_its_state_does_not_allow() {
    let bench = Bench::new();
    let here = &bench.here;
    for node in MANAGED {
        assert_eq!(state(here, node), "active", "{node}");
        assert_eq!(transitions(here, node, "get_available_transitions"), ["deactivate", "shutdown"], "{node}");
        assert_eq!(transitions(here, node, "get_transition_graph").len(), 7, "{node}");
        let client = here.service_client::<GetAvailableStates>(&format!("{FEEDER}/{node}/get_available_states"));
        let states = client.unwrap().call(&GetAvailableStatesRequest::default(), PATIENCE).wait().unwrap();
        let ids: BTreeSet<u8> = states.available_states.iter().map(|state| state.id).collect();
        assert!(ids.contains(&State::PRIMARY_STATE_FINALIZED) && ids.len() == 9, "{node}: {ids:?}");
        for label in ["configure", "activate", "cleanup", "fly"] {
            assert!(!lead(here, node, label), "{node} {label}");
            assert_eq!(state(here, node), "active", "{node}");
        }
    }
    let said = bench.run.stderr();
    let refused = "refused the transition configure: the node is active, which allows deactivate, shutdown";
    assert_eq!(said.matches(refused).count(), MANAGED.len(), "{said}");
}

/// Leads a node out of active and back: what it says in between carries no stamp of that time.
#[track_caller]
fn assert_silent<M: Message>(bench: &Bench, node: &str, topic: &TopicSpec<M>, header: fn(&M) -> &Header) {
    let (_reader, heard) = hear(&bench.here, topic, FEEDER);
    bench.wait("word of an active node", &heard, |_| true);
    let left_ns = bench.lead(node, "deactivate");
    // The others go on meanwhile.
    bench.wait_until(left_ns + 10 * LATE_NS);
    let back_ns = bench.lead(node, "activate");
    bench.wait("word of the node that is active again", &heard, |message| {
        let said_ns = stamp_ns(header(message));
        let back = said_ns + LATE_NS > back_ns;
        assert!(back || said_ns <= left_ns, "{node} left at {left_ns} ns and said something at {said_ns} ns");
        back
    });
    bench.wait_for_delivery();
}

#[test]
fn a_node_that_is_not_active_is_silent_and_the_feeder_delivers_again_when_it_is() {
    let bench = Bench::new();
    assert_silent(&bench, nodes::PART_SIMULATOR, &topics::PARTS, |parts| &parts.header);
    assert_silent(&bench, nodes::VISION_SELECTOR, &topics::PART_CANDIDATES, |candidates| &candidates.header);
    assert_silent(&bench, nodes::WAVEFORM_GENERATOR, &topics::WAVEFORM, |waveform| &waveform.header);
    assert_silent(&bench, nodes::DELIVERY_PLANNER, &topics::DELIVERY_STATE, |state| &state.header);
}

#[test]
fn a_courier_driver_that_is_deactivated_brakes_and_says_so_and_the_planner_waits_for_it() {
    let bench = Bench::new();
    let at_work: [fn(&CourierState) -> bool; 2] = [|state| state.vibrating, |state| state.moving];
    for is_at_work in at_work {
        bench.wait("the courier at work", &bench.courier, is_at_work);
        let left_ns = bench.lead(nodes::COURIER_DRIVER, "deactivate");
        let waits = |state: &FeederState| state.state == FeederState::STOPPED && state.message == NOT_ACTIVE;
        bench.wait("the planner to say why nothing goes on", &bench.feeder, waits);
        let rest = bench.wait_until(left_ns + BRAKING_NS);
        assert!(!rest.vibrating && !rest.moving && rest.fault == NOT_ACTIVE, "{rest:?}");
        let rest = bench.wait_until(left_ns + 5 * BRAKING_NS);
        assert!(!rest.vibrating && !rest.moving && rest.fault == NOT_ACTIVE, "{rest:?}");
        bench.lead(nodes::COURIER_DRIVER, "activate");
        bench.wait("the planner to go on", &bench.feeder, |state| !waits(state));
        bench.wait_for_delivery();
    }
    // Nor does it keep a run from its end.
    bench.lead(nodes::COURIER_DRIVER, "shutdown");
    bench.run.process().signal(Signal::INT);
    let outcome = bench.run.outcome();
    assert!(outcome.status.success() && !outcome.stderr.contains("fault:"), "{}", outcome.stderr);
}

#[test]
fn a_generator_or_planner_that_is_deactivated_stops_the_courier_and_says_why() {
    let bench = Bench::new();
    for node in [nodes::WAVEFORM_GENERATOR, nodes::DELIVERY_PLANNER] {
        bench.wait("the courier to vibrate", &bench.courier, |state| state.vibrating);
        let left_ns = bench.lead(node, "deactivate");
        let rest = bench.wait_until(left_ns + BRAKING_NS);
        assert!(!rest.vibrating && rest.fault.is_empty(), "{node}: {rest:?}");
        let reason = format!("{node} is inactive, not active");
        if node == nodes::WAVEFORM_GENERATOR {
            let refused = call(&bench.here, &services::SET_FEEDING, &SetBoolRequest { data: true });
            assert!(!refused.success && refused.message == reason, "{refused:?}");
            // The tray that should feed stands still: that is told before parts are missed.
            let says =
                |state: &FeederState| state.message.contains("does not vibrate") || state.message.contains(&reason);
            bench.wait("the planner to say what is wrong", &bench.feeder, says);
        } else {
            let says = |state: &FeederState| state.state == FeederState::STOPPED && state.message == reason;
            bench.wait("the planner to say that it has stopped", &bench.feeder, says);
        }
        bench.lead(node, "activate");
        bench.wait_for_delivery();
    }
}

/// As a launch file starts it.
#[test]
fn a_node_told_not_to_start_by_itself_waits_and_takes_nothing() {
    let domain = TestDomain::claim();
    let child = feeder()
        .args(["node", nodes::WAVEFORM_GENERATOR, "--ros-args", "-p", "autostart:=false"])
        .env("ROS_DOMAIN_ID", domain.id.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let mut child = child.unwrap();
    let here = participant(&domain);
    let (_reader, heard) = hear(&here, &topics::WAVEFORM, FEEDER);
    let node = nodes::WAVEFORM_GENERATOR;
    let set_feeding = |on| call(&here, &services::SET_FEEDING, &SetBoolRequest { data: on });
    assert_eq!(state(&here, node), "unconfigured");
    assert!(!lead(&here, node, "activate") && lead(&here, node, "configure"));
    let refused = set_feeding(true);
    assert!(!refused.success && refused.message == format!("{node} is inactive, not active"), "{refused:?}");
    assert!(set_feeding(false).success && heard.try_recv().is_err());
    assert!(lead(&here, node, "activate"));
    assert_eq!(heard.recv_timeout(PATIENCE).map(|waveform| (waveform.sequence, waveform.enabled)), Ok((1, false)));
    assert!(set_feeding(true).success);
    assert!(lead(&here, node, "shutdown") && !lead(&here, node, "configure"));
    assert_eq!(state(&here, node), "finalized");
    assert!(!set_feeding(true).success);
    Process::new(child.id()).signal(Signal::TERM);
    assert!(child.wait().unwrap().success());
}
