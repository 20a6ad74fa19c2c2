//! Several stations and several feeders: the scenarios of a whole cell, and the figures that go with delivery.

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

use feeder_control::platen::Area;
use feeder_scenario::Scenario;
use feeder_scenario::plan::DeliveryPlannerConfig;
use rustix::process::Signal;
use serde_json::Value;

use crate::common::{Outcome, Process, Up, simulated_time, wait_for};

fn file(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs").join(name)
}

fn scenario(name: &str) -> Scenario {
    std::fs::read_to_string(file(name)).unwrap().parse().unwrap()
}

/// What must hold of every run: nothing lost or doubled, every delivery ended or still open, couriers apart and in their
/// areas.
#[track_caller]
fn assert_in_order(outcome: &Outcome, open_max: u64) {
    let summary = outcome.summary();
    let count = |value: &Value| value.as_u64().unwrap();
    for key in ["parts_lost", "parts_doubled", "wrong_pose_delivered"] {
        assert_eq!(count(&summary[key]), 0, "{key}: {summary}");
    }
    let failed: u64 = summary["failed"].as_object().unwrap().values().map(count).sum();
    let ended = count(&summary["succeeded"]) + failed;
    assert!(ended <= count(&summary["accepted"]) && count(&summary["accepted"]) <= ended + open_max, "{summary}");
    for key in ["collisions", "out_of_area"] {
        assert_eq!(count(&summary["platen"][key]), 0, "{key}: {summary}");
    }
    assert!(outcome.number("max_slip_m") < 10e-6, "{summary}");
}

#[test]
fn three_stations_are_served() {
    let outcome = Up::new("--duration 30 --composed").scenario(&scenario("three_stations.yaml")).success();
    assert_in_order(&outcome, 3);
    assert!(outcome.number("delivered") >= 4.0, "{}", outcome.summary());
}

#[test]
fn three_feeders_share_a_platen_and_repeat() {
    let scenario = scenario("three_feeders.yaml");
    let first = Up::new("--duration 8 --composed").scenario(&scenario).digest().success();
    assert_in_order(&first, 4);
    assert!(first.number("delivered") >= 2.0, "{}", first.summary());
    let apart_m = first.summary()["platen"]["couriers_closest_m"].as_f64().unwrap();
    assert!(apart_m >= 2.0 * scenario.delivery.footprint_radius_m, "{}", first.summary());
    let again = Up::new("--duration 8 --composed").scenario(&scenario).digest().success();
    assert_eq!(first.digest(), again.digest());
}

/// Trays that leave the picture, neighbours that cross it, light that falls otherwise elsewhere: none of that is a trouble.
#[test]
fn where_all_is_well_nobody_is_warned() {
    for (name, duration_s) in [("default.yaml", 30), ("blocks.yaml", 20), ("three_feeders.yaml", 15)] {
        let run = Up::new(&format!("--duration {duration_s} --composed")).scenario_file(&file(name)).success();
        // That parts may nest is said of the part, before anything runs.
        let warned = |line: &&str| line.contains("WARN") && !line.contains("likely in bulk");
        let warnings: Vec<&str> = run.stderr.lines().filter(warned).collect();
        assert!(warnings.is_empty(), "{name}: {warnings:#?}");
    }
}

/// A manipulator that falls silent with a part presented to it blocks its feeder for as long as agreed, not for good.
#[test]
fn a_silent_manipulator_blocks_nobody_for_good() {
    let mut scenario = scenario("three_stations.yaml");
    scenario.delivery.hand_over_timeout_s = 3.0;
    scenario.stations[0].manipulator.silent_after = Some(1);
    let outcome = Up::new("--duration 30 --composed").scenario(&scenario).success();
    assert_in_order(&outcome, 3);
    let summary = outcome.summary();
    assert_eq!(summary["failed"]["no_handover"], 1, "{summary}");
    assert!(outcome.number("succeeded") >= 3.0, "{summary}");
}

#[test]
fn a_station_beyond_the_tether_is_refused_and_others_are_served() {
    let mut scenario = Scenario::default();
    let mut far = scenario.stations[0].clone();
    far.name = "station_2".to_owned();
    (far.x_m, far.y_m) = (0.4, 0.4);
    scenario.stations.push(far);
    let limits = &mut scenario.courier.limits;
    (limits.tether_anchor_m, limits.tether_length_m) = ([-0.4, 0.0], 0.65);
    let outcome = Up::new("--duration 20 --composed").scenario(&scenario).success();
    assert!(outcome.number("delivered") >= 1.0, "{}", outcome.summary());
    assert!(outcome.stderr.contains("\"station_2\" cannot be served"), "{}", outcome.stderr);
}

#[test]
fn a_walled_off_station_is_refused_when_it_asks_and_others_are_served() {
    let mut scenario = Scenario::default();
    let mut behind = scenario.stations[0].clone();
    behind.name = "station_2".to_owned();
    (behind.x_m, behind.y_m) = (0.1, -0.38);
    scenario.stations.push(behind);
    // From bound to bound: there is room to stand behind it.
    scenario.platen.keep_out = vec![Area { points_m: vec![[-0.9, -0.2].into(), [0.9, -0.2].into()], radius_m: 0.01 }];
    let outcome = Up::new("--duration 20 --composed").scenario(&scenario).success();
    assert!(outcome.number("delivered") >= 1.0, "{}", outcome.summary());
    assert_eq!(outcome.summary()["failed"].as_object().unwrap().len(), 0, "{}", outcome.summary());
    let said = ["\"station_2\" cannot be served", "no part: the feeder refused the request"];
    assert!(said.iter().all(|said| outcome.stderr.contains(said)), "{}", outcome.stderr);
    assert_eq!(outcome.stderr.matches("no part:").count(), 1, "it asks every second: {}", outcome.stderr);
}

/// The courier comes to rest where the camera sees the part again, from another side.
#[test]
fn a_part_is_looked_at_again_where_the_camera_sees_the_station() {
    let mut scenario = Scenario::default();
    (scenario.stations[0].x_m, scenario.stations[0].y_m) = (-0.03, -0.07);
    let is_rechecked = |scenario: &Scenario| {
        let plan = scenario.plan().unwrap();
        plan.of_kind::<DeliveryPlannerConfig>().any(|(_, config)| config.stations.iter().any(|at| at.rechecked))
    };
    assert!(is_rechecked(&scenario));
    assert!(!is_rechecked(&Scenario::default()));
    let outcome = Up::new("--duration 20 --composed").scenario(&scenario).success();
    assert!(outcome.number("delivered") >= 1.0, "{}", outcome.summary());
    assert_eq!(outcome.summary()["failed"].as_object().unwrap().len(), 0, "{}", outcome.summary());
}

/// A small version of `feeder-lab slip-study`.
#[test]
fn no_protected_part_slides_in_random_moves_and_20_percent_more_is_too_much() {
    let ran = crate::common::lab().args(["slip-study", "--moves", "40"]).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let study: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!(study["over_10_um"], 0, "{study}");
    assert!(study["parts"].as_u64().unwrap() >= 200, "{study}");
    assert!(study["slip_um_at_1_2"].as_f64().unwrap() > 100.0, "{study}");
    assert!(study["duration_over_bound_mean"].as_f64().unwrap() < 1.03, "{study}");
}

/// A short run of `feeder-lab compare-planners`.
#[test]
fn the_planner_delivers_more_than_a_naive_one() {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs/three_stations.yaml");
    let domain = feeder_runtime::testing::TestDomain::claim();
    let ran = crate::common::lab()
        .args(["compare-planners", "--duration", "30", "--domain", &domain.id.to_string(), "--scenario"])
        .arg(file)
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let comparison: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert!(comparison["gain"].as_f64().unwrap() > 1.1, "{comparison}");
}

/// A study gives no figures of a run that was cut short: they would stand under the name of the whole.
#[test]
fn an_interrupted_study_prints_no_row() {
    let domain = feeder_runtime::testing::TestDomain::claim();
    let study = crate::common::lab()
        .args(["good-parts", "as-given", "--seeds", "1", "--duration", "3600", "--domain", &domain.id.to_string()])
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let simulated = simulated_time(&domain);
    wait_for("the run", || (simulated() > Duration::ZERO).then_some(()));
    Process::new(study.id()).signal(Signal::INT);
    let Output { status, stdout, stderr } = study.wait_with_output().unwrap();
    let (rows, said) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    assert!(!status.success() && said.contains("interrupted"), "{status}: {said}");
    assert_eq!(rows.lines().count(), 2, "a head alone: {rows}");
}
