//! What the monitor must notice: runs in which something is wrong on purpose, and each figure that must rise then.

use std::path::{Path, PathBuf};

use feeder_scenario::plan::{PlannedConfig, RunPlan, load_plan};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::Up;

fn file(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs").join(name)
}

/// What becomes of a scenario's plan when `sabotage` has had each of its nodes.
#[track_caller]
fn summary_of(scenario: &str, duration_s: u32, sabotage: impl Fn(&mut PlannedConfig)) -> Value {
    let mut plan: RunPlan = load_plan(Some(&file(scenario))).unwrap();
    plan.nodes.iter_mut().for_each(|node| sabotage(&mut node.node));
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("plan.yaml");
    std::fs::write(&path, plan.to_yaml().unwrap()).unwrap();
    let outcome = Up::new(&format!("--duration {duration_s} --composed")).scenario_file(&path).success();
    outcome.summary().clone()
}

fn count(value: &Value) -> u64 {
    value.as_u64().unwrap()
}

/// The selector takes each pose of the part for the other.
#[test]
fn parts_taken_for_what_they_are_not_are_counted_as_wrong() {
    let summary = summary_of("default.yaml", 15, |node| {
        if let PlannedConfig::VisionSelector(selector) = node {
            selector.part_model.poses.swap(0, 1);
        }
    });
    assert!(count(&summary["delivered"]) >= 1, "{summary}");
    assert_eq!(summary["wrong_pose_delivered"], summary["delivered"], "{summary}");
    let feeding = &summary["feeding"][0];
    assert!(count(&feeding["wrong_selections"]) >= 1 && count(&feeding["right_selections"]) == 0, "{summary}");
}

/// Selector and agents are told that a gripper needs no room.
#[test]
fn parts_presented_without_room_for_the_gripper_are_counted() {
    let summary = summary_of("blocks.yaml", 40, |node| match node {
        PlannedConfig::VisionSelector(selector) => selector.selector.part_clearance_m = 0.0,
        PlannedConfig::OverheadManipulator(manipulator) => manipulator.part_gap_m_min = 0.0,
        _ => {}
    });
    assert!(count(&summary["chosen_without_room"]) >= 1, "{summary}");
    assert!(summary["room_short_m_max"].as_f64().unwrap() > 0.0, "{summary}");
}

/// The tool is turned by a right angle from where the jaws close across the narrow side.
#[test]
fn a_gripper_that_is_turned_wrongly_takes_nothing() {
    let turned_rad = |by_rad: f64| {
        move |node: &mut PlannedConfig| {
            if let PlannedConfig::OverheadManipulator(manipulator) = node {
                manipulator.jaws_yaw_rad += by_rad;
            }
        }
    };
    let right = summary_of("blocks.yaml", 12, turned_rad(0.0));
    assert!(count(&right["delivered"]) >= 1, "{right}");
    let wrong = summary_of("blocks.yaml", 12, turned_rad(std::f64::consts::FRAC_PI_2));
    assert_eq!((count(&wrong["delivered"]), count(&wrong["selected"]) >= 1), (0, true), "{wrong}");
    assert!(count(&wrong["failed"]["not_taken"]) >= 1, "{wrong}");
}

/// Planners that believe their couriers to be smaller than they are reserve too little room.
#[test]
fn couriers_that_leave_their_areas_are_counted() {
    let summary = summary_of("three_feeders.yaml", 12, |node| {
        if let PlannedConfig::DeliveryPlanner(planner) = node {
            planner.delivery.footprint_radius_m = 0.02;
        }
    });
    assert!(count(&summary["platen"]["out_of_area"]) >= 1, "{summary}");
}
