//! Friction is known only roughly: what may be is carried without sliding, and what slides all the same is noticed.

use std::f64::consts::FRAC_PI_2;

use feeder_control::delivery::Policy;
use feeder_scenario::{PlacedPart, Scenario};

use crate::common::Up;

/// What the planner says of a slip.
const GENTLER: &str = "moves reckon with a friction of";
/// What counts as no slip, m.
const GENTLE_SLIP_M: f64 = 10e-6;

/// Parts at rest on the plateau that have so much of the friction that their file states. Moves are as fast as the part
/// delivered bears.
fn at_rest(friction_ratio: f64) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.world.differences.friction_ratio = friction_ratio;
    scenario.delivery.policy = Policy::Selected;
    // None has to climb.
    scenario.bulk.critical_radius_m = Some(0.05);
    scenario.bulk.loading_inner_radius_m = Some(0.06);
    scenario.parts_loaded = 0;
    let placed = |angle_rad: f64| PlacedPart {
        pose: "hole_up".to_owned(),
        radius_m: 0.07,
        angle_rad: 3.0 * FRAC_PI_2 + angle_rad,
        yaw_rad: 0.0,
    };
    scenario.parts_placed = [-0.6, -0.2, 0.2, 0.6].map(placed).into();
    scenario
}

/// The file says ± 10 %.
#[test]
fn at_the_edge_of_what_friction_may_be_parts_are_carried_without_sliding() {
    let outcome = Up::new("--duration 15 --composed").scenario(&at_rest(0.9)).success();
    assert!(outcome.number("delivered") >= 3.0, "{}", outcome.summary());
    assert!(outcome.number("max_slip_m") < GENTLE_SLIP_M, "{}", outcome.summary());
    assert_eq!(outcome.summary()["failed"].as_object().unwrap().len(), 0, "{}", outcome.summary());
    assert!(!outcome.stderr.contains(GENTLER), "{}", outcome.stderr);
}

/// Nobody tells control that parts slide: it sees that they are not where they should be.
#[test]
fn moves_are_gentler_until_parts_with_less_friction_than_they_may_have_do_not_slide_any_more() {
    let mut scenario = at_rest(0.75);
    scenario.stations[0].manipulator.goals_open = 1;
    let outcome = Up::new("--duration 40 --composed").scenario(&scenario).success();
    assert!(outcome.stderr.contains(GENTLER), "{}", outcome.stderr);
    // Under 0.18 they slide, for ever if that stays so.
    assert!(outcome.number("delivered") >= 3.0, "{}", outcome.summary());
}

/// What lies below slides. Where the camera sees the station that is found out before the part is presented, elsewhere by a
/// gripper that closes on nothing. It may slide back to its place: what counts as delivered is what the gripper took.
#[test]
fn a_part_with_less_friction_than_it_may_have_slides_and_is_not_delivered_as_if_it_had_not() {
    for (seen, noticed) in [(true, "part_lost"), (false, "not_taken")] {
        let mut scenario = at_rest(0.6);
        let station = &mut scenario.stations[0];
        if seen {
            (station.x_m, station.y_m) = (-0.03, -0.07);
        }
        let outcome = Up::new("--duration 15 --composed").scenario(&scenario).success();
        let summary = outcome.summary();
        assert!(summary["failed"][noticed].as_u64().unwrap_or(0) >= 1, "{noticed}: {summary}");
        assert_eq!(summary["succeeded"], summary["delivered"], "{noticed}: {summary}");
        assert_eq!(summary["wrong_pose_delivered"], 0, "{noticed}: {summary}");
    }
}
