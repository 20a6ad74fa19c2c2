//! What may be picked: the selector decides it, by the outlines it measured, for every pose that is asked for.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use feeder_scenario::{PlacedPart, Recipe, Scenario};
use serde_json::Value;

use crate::common::Up;

/// A scenario with two parts side by side on the plateau, `gap_m` apart; long sides face each other. Only `pose` is asked for,
/// in which they are `width_m` wide.
fn side_by_side(file: &str, pose: &str, width_m: f64, gap_m: f64) -> Scenario {
    const ANGLE_RAD: f64 = 4.2;
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs");
    let mut read = |name: &str| std::fs::read(folder.join(name)).map_err(|error| error.to_string());
    let text = String::from_utf8(read(file).unwrap()).unwrap();
    let mut scenario = Scenario::read(&text, &mut read).unwrap();
    let placed =
        |radius_m| PlacedPart { pose: pose.to_owned(), radius_m, angle_rad: ANGLE_RAD, yaw_rad: ANGLE_RAD + FRAC_PI_2 };
    scenario.parts_placed = vec![placed(0.06), placed(0.06 + width_m + gap_m)];
    scenario.parts_loaded = 0;
    // So that what was accepted is one request, whatever becomes of it.
    scenario.stations[0].manipulator.goals_open = 1;
    scenario.recipes = vec![Recipe { name: pose.to_owned(), pose_classes: vec![pose.to_owned()], waveform: None }];
    scenario
}

#[track_caller]
fn summary_after(duration_s: f64, scenario: &Scenario) -> Value {
    let outcome = Up::new(&format!("--duration {duration_s} --composed")).scenario(scenario).success();
    outcome.summary().clone()
}

/// The circles round them overlap: only outlines show that a gripper has room.
#[test]
fn two_blocks_side_by_side_with_room_for_the_gripper_are_picked() {
    let summary = summary_after(12.0, &side_by_side("blocks.yaml", "flat", 0.004, 0.0015));
    assert_eq!((&summary["delivered"], &summary["selected"]), (&2.into(), &2.into()), "{summary}");
    assert!(summary["max_slip_m"].as_f64().unwrap() < 10e-6, "{summary}");
}

#[test]
fn two_blocks_side_by_side_without_room_are_not() {
    let summary = summary_after(3.0, &side_by_side("blocks.yaml", "flat", 0.004, 0.0003));
    assert_eq!((&summary["accepted"], &summary["delivered"]), (&1.into(), &0.into()), "{summary}");
    assert_eq!(summary["selected"], 0, "{summary}");
}

/// The part is handed over with its hole up by default; who asks for another pose is held to the same rule. What is asked for
/// and presented is not delivered wrongly.
#[test]
fn a_pose_that_only_a_recipe_wants_is_held_to_the_rule() {
    let free = summary_after(6.0, &side_by_side("default.yaml", "boss_up", 0.005, 0.0015));
    assert_eq!(free["wrong_pose_delivered"], 0, "{free}");
    assert!(free["delivered"].as_u64().unwrap() >= 1, "{free}");
    let close = summary_after(3.0, &side_by_side("default.yaml", "boss_up", 0.005, 0.0003));
    assert_eq!((&close["accepted"], &close["delivered"]), (&1.into(), &0.into()), "{close}");
}
