//! The page of interfaces is what the constants say. `UPDATE=1 cargo test -p feeder_wire --test interface_page` writes it.

use std::collections::BTreeSet;
use std::path::Path;

use feeder_wire::{services, topics};
use minifactory_msgs::interface::{Durability, Entry, EntryKind, Qos, Reliability, simulation};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/topics.md");

const INTRODUCTION: &str = "\
# Topics, services and actions

Made from the constants in `nodes/wire/src/topics.rs` and `services.rs`; write it anew with
`UPDATE=1 cargo test -p feeder_wire --test interface_page`.

`<feeder>` is the name of a feeder (`feeder` unless the scenario names it), `<station>` that of a station. A name is
published in the namespace of the node that owns it. In a simulated run a node hears what is sent in the next tick, or
by the scenario's `feedback_delay_ticks` later where the table says *feedback*: those are paths from what is seen back to
what is done about it. A subscriber asks for the quality of service that the publisher offers; depth is in samples. A node that publishes, hears,
serves or calls what is not stated for it here does not start.

";

const REST: &str = "
Every node also has the six parameter services and `~/get_type_description`; `waveform_generator`, `courier_driver`,
`part_simulator`, `vision_selector` and `delivery_planner` have the services of a lifecycle (`~/get_state`, `~/change_state`,
`~/get_available_states`, `~/get_available_transitions`, `~/get_transition_graph`) with `~/transition_event`. An action is served by the three services and two topics
below its name that ROS 2 gives it. How other agents use what is for them is in
[PROTOCOL.md](../../msgs/PROTOCOL.md).
";

fn entries() -> Vec<Entry> {
    let standard =
        [topics::CLOCK.entry(), topics::DIAGNOSTICS.entry(), topics::ROSOUT.entry(), topics::PARAMETER_EVENTS.entry()];
    topics::all().into_iter().chain(standard).chain(services::all()).chain(simulation::all()).collect()
}

fn quality(qos: &Qos) -> String {
    let reliability = match qos.reliability {
        Reliability::Reliable => "reliable",
        Reliability::BestEffort => "best effort",
    };
    let durability = match qos.durability {
        Durability::Volatile => "",
        Durability::TransientLocal => ", latched",
    };
    format!("{reliability}{durability}, {}", qos.depth)
}

fn ends(entry: &Entry) -> String {
    let users: Vec<String> = entry.facts.users().iter().map(ToString::to_string).collect();
    let (owners, users) = (entry.facts.owners().join(", "), users.join(", "));
    match entry.kind {
        EntryKind::Topic => format!("{owners} → {users}"),
        EntryKind::Service | EntryKind::Action => format!("{users} → {owners}"),
    }
}

fn page() -> String {
    let mut page = INTRODUCTION.to_owned();
    page.push_str("| Topic | Type | Quality of service, depth | From → to | What it says |\n|---|---|---|---|---|\n");
    let entries = entries();
    for entry in entries.iter().filter(|entry| entry.kind == EntryKind::Topic) {
        let qos = entry.qos.as_ref().map(quality).unwrap_or_default();
        let (name, ros_type, meaning) = (&entry.name, &entry.ros_type, entry.facts.meaning());
        page += &format!("| `{name}` | {ros_type} | {qos} | {} | {meaning} |\n", ends(entry));
    }
    page.push_str("\n| Service or action | Type | From → to | What it does |\n|---|---|---|---|\n");
    for entry in entries.iter().filter(|entry| entry.kind != EntryKind::Topic) {
        let (name, ros_type, meaning) = (&entry.name, &entry.ros_type, entry.facts.meaning());
        page += &format!("| `{name}` | {ros_type} | {} | {meaning} |\n", ends(entry));
    }
    page + REST
}

#[test]
fn the_page_of_interfaces_is_what_the_constants_say() {
    let made = page();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::create_dir_all(Path::new(PAGE).parent().unwrap()).unwrap();
        std::fs::write(PAGE, &made).unwrap();
    }
    let found = std::fs::read_to_string(PAGE).unwrap_or_default();
    let stale = made.lines().zip(found.lines()).find(|(made, found)| made != found);
    assert!(made == found, "docs/reference/topics.md is stale at {stale:?}; write it anew with UPDATE=1");
}

#[test]
fn every_entry_says_what_it_is_and_no_name_comes_twice() {
    let mut names = BTreeSet::new();
    for entry in entries() {
        let (is_topic, name) = (entry.kind == EntryKind::Topic, entry.name.clone());
        assert!(!entry.facts.owners().is_empty() && !entry.facts.users().is_empty(), "{name} has no ends");
        assert!(entry.facts.meaning().len() > 10, "{name} has no meaning");
        assert!(names.insert((is_topic, name.clone())), "{name} is there twice");
    }
}
