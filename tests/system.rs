//! The whole suite in lockstep over DDS, run as a user runs it.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use feeder_control::delivery::Policy;
use feeder_scenario::Scenario;
use feeder_wire::topics;
use rustix::process::Signal;

use crate::common::{FEEDER, Outcome, Up};

/// Largest slip of a part that was carried gently, m.
const GENTLE_SLIP_M: f64 = 1e-4;

/// What the planner says when far fewer parts come than computed.
const FEW_COME: &str = "of the parts come up the ramp that the waveform should bring";

#[test]
fn parts_that_move_otherwise_than_computed_are_told_of() {
    // There is more friction than control believes: on the plateau parts then slide less far, 0.75 times.
    let mut scenario = Scenario::default();
    scenario.world.differences.friction_ratio = 1.65;
    let outcome = Up::new("--duration 60 --composed").scenario(&scenario).success();
    let told = outcome.stderr.matches("parts on the plateau move at").count();
    assert!(told >= 1, "{}", outcome.stderr);
}

#[test]
fn parts_that_do_not_come_up_the_ramp_are_told_of() {
    // Control believes two fifths more friction than there is, and the waveform is designed for that: parts hardly climb.
    let mut scenario = Scenario::default();
    scenario.believed.part_friction = Some(0.28);
    let outcome = Up::new("--duration 60 --composed").scenario(&scenario).success();
    assert!(outcome.stderr.contains(FEW_COME), "{}", outcome.stderr);
}

#[test]
fn parts_that_come_up_faster_than_they_lie_apart_are_followed_and_not_told_of_as_missing() {
    // Control believes a fifth more friction than there is: the waveform is quicker for that, and parts still climb.
    let mut scenario = Scenario::default();
    scenario.believed.part_friction = Some(0.24);
    let outcome = Up::new("--duration 60 --composed").scenario(&scenario).success();
    assert!(!outcome.stderr.contains(FEW_COME), "{}", outcome.stderr);
    assert!(outcome.number("delivered") >= 7.0, "{}", outcome.summary());
    assert!(outcome.number("wrong_pose_delivered").abs() < 0.5, "{}", outcome.summary());
    assert!(outcome.number("max_slip_m") < GENTLE_SLIP_M, "{}", outcome.summary());
}

#[test]
fn every_motor_that_comes_with_a_scenario_of_its_own_feeds() {
    let launch_configs = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs");
    for motor in ["xplanar_apm4220", "xplanar_apm4330", "xplanar_apm4550"] {
        let scenario = launch_configs.join(motor).with_extension("yaml");
        let outcome = Up::new("--duration 20 --composed").scenario_file(&scenario).success();
        assert!(outcome.number("delivered") >= 3.0, "{motor}: {}", outcome.summary());
        assert!(!outcome.stderr.contains(FEW_COME), "{motor}: {}", outcome.stderr);
        assert!(outcome.number("wrong_pose_delivered").abs() < 0.5, "{motor}: {}", outcome.summary());
        assert!(outcome.number("max_slip_m") < GENTLE_SLIP_M, "{motor}: {}", outcome.summary());
    }
}

#[test]
fn the_built_in_scenario_delivers_parts_the_right_way_up_and_without_slip() {
    let outcome = Up::new("--duration 60 --composed").success();
    assert!(!outcome.stderr.contains(FEW_COME), "{}", outcome.stderr);
    assert!(outcome.number("delivered") >= 3.0, "{}", outcome.summary());
    assert!(outcome.number("selected") >= outcome.number("delivered"), "{}", outcome.summary());
    assert!(outcome.number("fed") >= outcome.number("selected"), "{}", outcome.summary());
    assert!(outcome.number("wrong_pose_delivered").abs() < 0.5, "{}", outcome.summary());
    assert!(outcome.number("max_slip_m") < GENTLE_SLIP_M, "{}", outcome.summary());
    assert!((outcome.number("sim_s") - 60.0).abs() < 1e-9, "{}", outcome.summary());
    assert!(!outcome.stderr.contains("parts on the plateau move at"), "{}", outcome.stderr);

    let keys: BTreeSet<&str> = outcome.summary().as_object().unwrap().keys().map(String::as_str).collect();
    let agreed = [
        "accepted",
        "chosen_without_room",
        "delivered",
        "delivered_per_minute",
        "failed",
        "fed",
        "feeding",
        "max_slip_m",
        "max_yaw_error_rad",
        "odometry",
        "parts_doubled",
        "parts_lost",
        "per_delivery_s",
        "platen",
        "real_time_factor",
        "room_short_m_max",
        "selected",
        "sim_s",
        "slips_unknown",
        "startup_s",
        "succeeded",
        "wall_s",
        "wrong_pose_delivered",
        "wrong_yaw_delivered",
    ];
    assert_eq!(keys, BTreeSet::from(agreed));
    let factor = outcome.number("sim_s") / outcome.number("wall_s");
    assert!((outcome.number("real_time_factor") - factor).abs() < 1e-9 * factor, "{}", outcome.summary());
    let spent = outcome.summary()["per_delivery_s"].as_object().unwrap();
    let parts = ["wait", "stop", "settle", "look", "reserve", "move", "pick", "return"];
    let sum_s: f64 = parts.iter().map(|part| spent[*part].as_f64().unwrap()).sum();
    // All the time since the first request, but for what the last phase has lasted, belongs to some delivery.
    assert!(sum_s * outcome.number("delivered") > 50.0, "{}", outcome.summary());
    for row in ["parts fed", "parts delivered", "largest slip", "real-time factor"] {
        assert!(outcome.stdout.contains(row), "{}", outcome.stdout);
    }
}

/// Parts are carried with 95.5 % of what friction holds; 20 % more is too much, and the measure of slip must say so. It
/// looks at the delivered part, so that one must be what sets the limit, not the parts on the ramp, which hold less.
#[test]
fn parts_carried_too_fast_are_seen_to_slip() {
    let mut scenario = Scenario::default();
    scenario.delivery.policy = Policy::Selected;
    scenario.delivery.gentle.friction_share *= 1.2;
    scenario.run.goal_delivered = Some(1);
    let outcome = Up::new("--duration 60 --composed").scenario(&scenario).success();
    assert!(outcome.number("delivered") >= 1.0, "{}", outcome.summary());
    assert!(outcome.number("max_slip_m") > GENTLE_SLIP_M, "{}", outcome.summary());
}

#[test]
fn a_run_ends_when_its_goal_is_reached() {
    let mut scenario = Scenario::default();
    scenario.run.goal_delivered = Some(1);
    let first = Up::new("--duration 60").scenario(&scenario).digest().success();
    assert!((first.number("delivered") - 1.0).abs() < 0.5, "{}", first.summary());
    assert!(first.number("sim_s") < 59.0, "{}", first.summary());
    // The tick of the end is no matter of chance either.
    let again = Up::new("--duration 60 --composed").scenario(&scenario).digest().success();
    assert_eq!(first.digest(), again.digest());
}

#[test]
fn a_run_that_misses_its_goal_fails_and_says_so() {
    let outcome = Up::new("--duration 1 --goal 100 --composed").outcome();
    assert_eq!(outcome.status.code(), Some(1), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("0 of 100 parts delivered"), "{}", outcome.stderr);
    // How it went is told all the same.
    assert!(outcome.number("sim_s") > 0.9, "{}", outcome.summary());
}

/// Long enough for parts to be seen, chosen and delivered.
pub(crate) const REPEATED: &str = "--duration 15";

/// What every run of the same scenario and seed must publish.
pub(crate) static REFERENCE: LazyLock<Outcome> = LazyLock::new(|| Up::new(REPEATED).digest().success());

#[test]
fn a_digest_covers_what_the_nodes_publish_and_nothing_else() {
    assert!(REFERENCE.number("delivered") >= 1.0, "{}", REFERENCE.summary());
    let lines: Vec<Vec<&str>> = REFERENCE.digest().lines().map(|line| line.split(' ').collect()).collect();
    let listed: Vec<&str> = lines.iter().map(|line| line[0]).collect();
    assert!(listed.is_sorted());
    for (topic, count) in [
        (topics::CLOCK.name_in(""), 1500),
        (topics::TRAY_MOTION.name_in(FEEDER), 1499),
        (topics::JOINT_STATES.name_in(FEEDER), 1500),
        (topics::PARTS.name_in(FEEDER), 1500),
        (topics::IMAGE_COMPRESSED.name_in(FEEDER), 149),
        (topics::CANDIDATES.name_in(FEEDER), 148),
        (topics::WAVEFORM.name_in(FEEDER), 1),
        (topics::TOOL_JOINT_STATES.name_in("/station_1"), 1500),
        (topics::TF.name_in(""), 1500),
    ] {
        let line = lines.iter().find(|line| line[0] == topic).unwrap_or_else(|| panic!("no {topic} in {listed:?}"));
        assert!(line[1].parse::<u64>().unwrap() >= count, "{line:?}");
    }
    for line in &lines {
        assert_eq!(line.len(), 3, "{line:?}");
        assert!(line[2].len() == 64 && line[2].chars().all(|c| c.is_ascii_hexdigit()), "{line:?}");
    }
    for word in ["rosout", "parameter_events", "diagnostics", "ros_discovery_info", "loop", "/_"] {
        assert!(listed.iter().all(|topic| !topic.contains(word)), "{listed:?}");
    }
}

#[test]
fn the_same_seed_publishes_the_same_again_on_a_loaded_machine() {
    // The load ends with this, also where the run fails.
    let load = Arc::new(());
    for _ in 0..2 {
        let load = Arc::downgrade(&load);
        std::thread::spawn(move || {
            while load.strong_count() > 0 {
                std::hint::spin_loop();
            }
        });
    }
    let again = Up::new(REPEATED).digest().outcome();
    drop(load);
    assert!(again.status.success(), "{}", again.stderr);
    assert_eq!(again.digest(), REFERENCE.digest());
}

#[test]
fn the_same_seed_publishes_the_same_composed_in_one_process() {
    let composed = Up::new(&format!("{REPEATED} --composed")).digest().success();
    assert_eq!(composed.digest(), REFERENCE.digest());
}

#[test]
fn the_same_seed_publishes_the_same_at_another_speed() {
    let paced = Up::new(&format!("{REPEATED} --speed 3")).digest().success();
    assert_eq!(paced.digest(), REFERENCE.digest());
}

#[test]
fn another_seed_publishes_something_else() {
    let other = Up::new(&format!("{REPEATED} --seed 2")).digest().success();
    let differs = |topic: &str| {
        let line = |outcome: &Outcome| {
            let mut lines = outcome.digest().lines().map(str::to_owned);
            lines.find(|line| line.starts_with(&format!("{topic} "))).unwrap()
        };
        line(&other) != line(&REFERENCE)
    };
    let by_chance = [topics::PARTS.facts(), topics::IMAGE_COMPRESSED.facts(), topics::CANDIDATES.facts()];
    for topic in by_chance.map(|topic| topic.name_in(FEEDER)) {
        assert!(differs(&topic), "{topic} is the same");
    }
    assert!(!differs(&topics::CLOCK.name_in("")));
}

/// How long it takes has a lower bound only: a slow machine may take any time.
#[test]
fn speed_1_keeps_to_the_wall_clock() {
    let outcome = Up::new("--duration 5 --speed 1").success();
    assert!(outcome.number("wall_s") >= 4.9, "{}", outcome.summary());
}

#[test]
fn a_signal_ends_a_run_cleanly() {
    for (signal, layout) in [(Signal::INT, ""), (Signal::TERM, ""), (Signal::INT, "--composed")] {
        let mut run = Up::new(&format!("--duration 3600 --speed 10 {layout}")).start();
        run.wait_until_simulated(Duration::from_secs(1));
        let nodes = run.nodes();
        assert_eq!(nodes.len(), if layout.is_empty() { 6 } else { 0 });
        run.process().signal(signal);
        let outcome = run.outcome();
        assert_eq!(outcome.status.code(), Some(0), "{signal:?}: {}", outcome.stderr);
        assert!(outcome.number("sim_s") >= 1.0, "{}", outcome.summary());
        assert!(nodes.iter().all(|node| !node.is_running()), "a node is left after {signal:?}");
    }
}
