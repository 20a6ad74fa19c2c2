//! What the nodes declare, against what is stated of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use feeder_runtime::node::{Latency, Port, PortKind};
use feeder_scenario::plan::{OverheadManipulatorConfig, PartSimulatorConfig, load_plan};
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::interface::standard::DIAGNOSTICS;
use minifactory_msgs::interface::{Entry, EntryKind, Qos};

use super::*;
use crate::up::interfaces;

fn three_feeders() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch_configs/three_feeders.yaml")
}

#[test]
fn every_parameter_of_every_node_is_described() {
    for plan in [load_plan(None).unwrap(), load_plan(Some(&three_feeders())).unwrap()] {
        for planned in &plan.nodes {
            let declared = parameters_of(planned).unwrap();
            assert!(declared.iter().any(|declaration| declaration.name == "tick_ms"));
            let bare = declared.iter().filter(|declaration| declaration.description.is_empty());
            let bare: Vec<_> = bare.map(|declaration| &declaration.name).collect();
            assert!(bare.is_empty(), "{} says nothing of {bare:?}", name_of(planned));
        }
    }
}

/// A topic, service or action in a run.
#[derive(Debug, PartialEq)]
struct Line {
    kind: EntryKind,
    ros_type: String,
    qos: Option<Qos>,
    /// Kinds of the nodes that publish or serve it; one that several nodes of a kind do is there as often.
    owners: Vec<String>,
    /// Kinds of the nodes that hear or call it, and how late what they hear may be.
    users: BTreeSet<(String, &'static str)>,
}

fn word(latency: Latency) -> &'static str {
    match latency {
        Latency::Forward => "forward",
        Latency::Feedback => "feedback",
    }
}

/// Every row of the table under every name that it has in the run of this plan.
fn stated(plan: &RunPlan) -> BTreeMap<String, Line> {
    let feeders: BTreeSet<String> =
        plan.of_kind::<PartSimulatorConfig>().map(|(namespace, _)| namespace.to_owned()).collect();
    let stations = plan.of_kind::<OverheadManipulatorConfig>().map(|(namespace, _)| namespace.to_owned()).collect();
    // Where several feeders share stations, a gripper closes in a namespace of station and feeder.
    let grips = plan.of_kind::<PartSimulatorConfig>().flat_map(|(_, config)| config.pick_namespaces.clone()).collect();
    // Where there is one feeder, its parts are the entities of the simulation, under the names that others give them.
    let entities = plan.of_kind::<PartSimulatorConfig>().map(|(_, config)| config.entity_namespace.clone()).collect();
    let kinds: Vec<&str> = plan.nodes.iter().map(|planned| planned.node.kind()).collect();
    let nowhere = BTreeSet::from([String::new()]);
    let mut lines = BTreeMap::new();
    for Entry { kind, name, ros_type, qos, facts } in topics::all().into_iter().chain(services::all()) {
        let namespaces = match name.split('/').nth(1) {
            Some("<feeder>") if ros_type.starts_with("simulation_interfaces/") => &entities,
            Some("<feeder>") => &feeders,
            Some("<station>") if name == services::PICK.entry().name => &grips,
            Some("<station>") => &stations,
            _ => &nowhere,
        };
        let times =
            |owner: &str| if name.starts_with("/<") { 1 } else { kinds.iter().filter(|k| **k == owner).count() };
        let owners = facts.owners().iter().flat_map(|owner| vec![(*owner).to_owned(); times(owner)]);
        // The selector hears compressed pictures in a run; raw ones are for cameras that send no others.
        let is_heard_by = |kind: &str| !(name == topics::IMAGE_RAW.entry().name && kind == nodes::VISION_SELECTOR);
        let used_by = |kind: &&str| is_heard_by(kind).then_some(((*kind).to_owned(), word(facts.latency_of(kind)?)));
        let (mut owners, users): (Vec<String>, _) = (owners.collect(), kinds.iter().filter_map(used_by).collect());
        owners.sort();
        for namespace in namespaces {
            let line =
                Line { kind, ros_type: ros_type.clone(), qos, owners: owners.clone(), users: BTreeSet::clone(&users) };
            assert!(lines.insert(facts.name_in(namespace), line).is_none(), "{name} is there twice");
        }
    }
    lines
}

/// What is declared, action by action in place of its services and topics.
fn declared(plan: &RunPlan) -> BTreeMap<String, Line> {
    let mut lines = BTreeMap::new();
    for (node, interface) in interfaces(plan).unwrap() {
        let kind = node.rsplit('/').next().unwrap();
        for port in &interface.ports {
            if port.name == DIAGNOSTICS.name_in("") {
                // Every node has one, for its own losses.
                assert_eq!((&port.ros_type, Some(port.qos)), (&DIAGNOSTICS.entry().ros_type, DIAGNOSTICS.entry().qos));
            } else if !port.name.starts_with(&format!("{node}/")) {
                note(&mut lines, kind, port);
            }
        }
    }
    for line in lines.values_mut() {
        line.owners.sort();
    }
    lines
}

fn note(lines: &mut BTreeMap<String, Line>, node: &str, port: &Port) {
    let (name, kind) = match port.name.split_once("/_action/") {
        // The other ports of an action come with this one, and have types of its own.
        Some((action, "send_goal")) => (action, EntryKind::Action),
        Some(_) => return,
        None if matches!(port.kind, PortKind::Publish | PortKind::Subscribe(_)) => (&*port.name, EntryKind::Topic),
        None => (&*port.name, EntryKind::Service),
    };
    let ros_type = match kind {
        EntryKind::Action => port.ros_type.replace("_SendGoal", ""),
        EntryKind::Topic | EntryKind::Service => port.ros_type.clone(),
    };
    let qos = (kind == EntryKind::Topic).then_some(port.qos);
    let line = lines.entry(name.to_owned()).or_insert_with(|| Line {
        kind,
        ros_type: ros_type.clone(),
        qos,
        owners: Vec::new(),
        users: BTreeSet::new(),
    });
    assert_eq!((line.kind, &line.ros_type, line.qos), (kind, &ros_type, qos), "{node} at {name}");
    match port.kind {
        PortKind::Publish | PortKind::Serve => line.owners.push(node.to_owned()),
        PortKind::Subscribe(latency) | PortKind::Call(latency) => {
            line.users.insert((node.to_owned(), word(latency)));
        }
    }
}

#[test]
fn the_graph_of_all_nodes_and_the_table_of_interfaces_say_the_same() {
    let plan = load_plan(Some(&three_feeders())).unwrap();
    let (stated, declared) = (stated(&plan), declared(&plan));
    for (name, line) in &declared {
        assert_eq!(Some(line), stated.get(name), "{name}: declared, and stated");
    }
    for (name, line) in &stated {
        assert_eq!(declared.get(name), Some(line), "{name}: declared, and stated");
    }
}

#[test]
fn the_nodes_of_a_feeder_have_a_lifecycle_and_no_node_has_more_below_its_name() {
    let managed = [
        nodes::WAVEFORM_GENERATOR,
        nodes::COURIER_DRIVER,
        nodes::PART_SIMULATOR,
        nodes::VISION_SELECTOR,
        nodes::DELIVERY_PLANNER,
    ];
    let lifecycle = [
        "change_state",
        "get_available_states",
        "get_available_transitions",
        "get_state",
        "get_transition_graph",
        "transition_event",
    ];
    let plan = load_plan(Some(&three_feeders())).unwrap();
    for (node, interface) in interfaces(&plan).unwrap() {
        let kind = node.rsplit('/').next().unwrap();
        let below = interface.ports.iter().filter_map(|port| port.name.strip_prefix(&format!("{node}/")));
        let below: BTreeSet<&str> = below.collect();
        let expected = if managed.contains(&kind) { lifecycle.into() } else { BTreeSet::new() };
        assert_eq!(below, expected, "{node}");
    }
}
