//! Nodes without simulated time, as on hardware: paced by the wall clock, together over the ROS graph alone.

use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use courier_driver::CourierDriver;
use delivery_planner::DeliveryPlanner;
use feeder_runtime::dds::{NodeName, Participant, Qos, Reader};
use feeder_runtime::launch::run_real;
use feeder_runtime::node::ns_of_stamp;
use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use feeder_scenario::plan::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, WaveformGeneratorConfig,
};
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::action_msgs::msg::GoalStatusArray;
use minifactory_msgs::interface::{ServiceSpec, TopicSpec};
use minifactory_msgs::lifecycle_msgs::msg::Transition;
use minifactory_msgs::lifecycle_msgs::srv::{ChangeState, ChangeStateRequest};
use minifactory_msgs::std_srvs::srv::SetBoolRequest;
use minifactory_msgs::{Message, Service};
use overhead_manipulator::OverheadManipulator;
use waveform_generator::WaveformGenerator;

use crate::common::FEEDER;

pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

pub(crate) fn participant(domain: &TestDomain) -> Participant {
    Participant::open(domain, &NodeName::new("/", "test").unwrap()).unwrap()
}

pub(crate) fn hear<M: Message>(
    participant: &Participant,
    topic: &TopicSpec<M>,
    namespace: &str,
) -> (Reader, Receiver<M>) {
    let (sender, heard) = channel();
    let reader = participant.topic_reader(topic, namespace, move |sample| {
        // A closed channel belongs to a test that has seen enough.
        let _ = sender.send(sample.decode().unwrap());
    });
    (reader.unwrap(), heard)
}

/// Calls a service of the feeder and waits for its answer.
pub(crate) fn call<S: Service>(here: &Participant, service: &ServiceSpec<S>, request: &S::Request) -> S::Response {
    let client = here.service_client::<S>(&service.name_in(FEEDER)).unwrap();
    client.call(request, PATIENCE).wait().unwrap()
}

/// Takes the courier driver through these transitions of its lifecycle.
pub(crate) fn lead_driver(here: &Participant, transitions: &[&str]) {
    for label in transitions {
        assert!(lead(here, nodes::COURIER_DRIVER, label), "{label}");
    }
}

/// Asks a node of the feeder for a transition of its lifecycle; whether it was made.
pub(crate) fn lead(here: &Participant, node: &str, label: &str) -> bool {
    let client = here.service_client::<ChangeState>(&format!("{FEEDER}/{node}/change_state")).unwrap();
    let transition = Transition { id: 0, label: label.to_owned() };
    client.call(&ChangeStateRequest { transition }, PATIENCE).wait().unwrap().success
}

#[test]
fn a_courier_vibrates_when_a_client_asks_the_generator_to_feed() {
    let domain = TestDomain::claim();
    let plan = Scenario::default().plan().unwrap();
    let (_, generator) = plan.of_kind::<WaveformGeneratorConfig>().next().unwrap();
    let (_, courier) = plan.of_kind::<CourierDriverConfig>().next().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let generator = std::thread::spawn({
        let (domain, config, stop) = (*domain, generator.clone(), stop.clone());
        move || run_real::<WaveformGenerator>(&domain, FEEDER, &config, &stop)
    });
    let courier = std::thread::spawn({
        let (domain, config, stop) = (*domain, courier.clone(), stop.clone());
        move || run_real::<CourierDriver>(&domain, FEEDER, &config, &stop)
    });
    let here = participant(&domain);
    let (_odometry_reader, odometry) = hear(&here, &topics::ODOMETRY, FEEDER);
    let (_state_reader, states) = hear(&here, &topics::COURIER_STATE, FEEDER);

    assert!(!states.recv_timeout(PATIENCE).unwrap().vibrating);
    let stamps: Vec<u64> =
        (0..50).map(|_| ns_of_stamp(&odometry.recv_timeout(PATIENCE).unwrap().header.stamp)).collect();
    for pair in stamps.windows(2) {
        // A machine that stands still for a while makes the node skip, never hurry.
        assert!(pair[1] - pair[0] >= plan.time.tick_ns(), "{pair:?}");
    }

    // Without simulated time nothing moves before somebody makes the driver active.
    lead_driver(&here, &["configure", "activate"]);
    for feeding in [true, false] {
        assert!(call(&here, &services::SET_FEEDING, &SetBoolRequest { data: feeding }).success);
        while states.recv_timeout(PATIENCE).unwrap().vibrating != feeding {}
    }
    stop.store(true, Ordering::Relaxed);
    generator.join().unwrap().unwrap();
    courier.join().unwrap().unwrap();
}

#[test]
fn a_manipulator_asks_the_planner_that_comes_in_anothers_place() {
    let domain = TestDomain::claim();
    let plan = Scenario::default().plan().unwrap();
    let (_, planner) = plan.of_kind::<DeliveryPlannerConfig>().next().unwrap();
    let (namespace, manipulator) = plan.of_kind::<OverheadManipulatorConfig>().next().unwrap();
    let planner = || {
        let stop = Arc::new(AtomicBool::new(false));
        let (domain, config, stopping) = (*domain, planner.clone(), stop.clone());
        (stop, std::thread::spawn(move || run_real::<DeliveryPlanner>(&domain, FEEDER, &config, &stopping)))
    };
    let stop = Arc::new(AtomicBool::new(false));
    let manipulator = std::thread::spawn({
        let (domain, namespace, config, stop) = (*domain, namespace.to_owned(), manipulator.clone(), stop.clone());
        move || run_real::<OverheadManipulator>(&domain, &namespace, &config, &stop)
    });
    let here = participant(&domain);
    let name = format!("{}/_action/status", services::DELIVER_PART.name_in(FEEDER));
    let mut requests = Vec::new();
    for _ in 0..2 {
        let (stop, planner) = planner();
        let (sender, heard) = channel();
        let status_type = GoalStatusArray::INFO.dds_type();
        let _reader = here.reader(&name, &status_type, &Qos::latched(), move |sample| {
            let _ = sender.send(sample.decode::<GoalStatusArray>().unwrap());
        });
        let goal = loop {
            if let Some(goal) = heard.recv_timeout(PATIENCE).unwrap().status_list.pop() {
                break goal.goal_info.goal_id;
            }
        };
        requests.push(goal);
        stop.store(true, Ordering::Relaxed);
        planner.join().unwrap().unwrap();
    }
    assert_ne!(requests[0], requests[1]);
    stop.store(true, Ordering::Relaxed);
    manipulator.join().unwrap().unwrap();
}

#[test]
fn a_nodes_command_runs_it_until_it_is_told_to_go() {
    let domain = TestDomain::claim();
    let mut node = Command::new(env!("CARGO_BIN_EXE_feeder-under-test"))
        .args(["node", "waveform_generator", "--ros-args", "-r", "__ns:=/other"])
        .env("ROS_DOMAIN_ID", domain.id.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env_remove("ROS_LOCALHOST_ONLY")
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let here = participant(&domain);
    let (_reader, heard) = hear(&here, &topics::WAVEFORM, "/other");
    let waveform = heard.recv_timeout(PATIENCE);
    let terminated = Command::new("kill").args(["-TERM", &node.id().to_string()]).status();
    let left = node.wait().unwrap();
    assert_eq!(waveform.map(|waveform| waveform.sequence), Ok(1));
    assert!(terminated.unwrap().success());
    assert!(left.success(), "{left}");
}
