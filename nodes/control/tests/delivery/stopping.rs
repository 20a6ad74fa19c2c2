//! When feeding stops and the courier goes.

use std::f64::consts::{SQRT_2, TAU};

use feeder_control::delivery::{DeliveryConfig, Output};
use nalgebra::Vector2;
use proptest::prelude::*;

use crate::by_hand::{ByHand, PART_M, at};
use crate::world::{asking, config, washer};

/// Feeding begins now: as many looks as there may be have shown nothing, s.
const BEGUN_S: f64 = 1.20;

/// A planner that has just begun to feed for requests of `right` and of these stations.
fn feeding(config: DeliveryConfig, others: &[&str]) -> ByHand {
    let mut hand = ByHand::new(config, 0.5e-3, None);
    for station in others {
        hand.sequencer.request(at(1.0), asking(station, 0.5e-3)).unwrap();
    }
    hand.step(1.06);
    for s in [1.10, BEGUN_S] {
        hand.see(s, &[]);
        hand.step(s);
    }
    hand
}

#[test]
fn feeding_lasts_its_shortest_time_though_a_part_lies_right() {
    let mut hand = feeding(config(), &[]);
    let mut stopped_s = None;
    for frame in 1..=10 {
        let s = BEGUN_S + 0.1 * f64::from(frame);
        hand.see(s, &[PART_M]);
        if hand.step(s).contains(&Output::Feed(false)) {
            stopped_s = stopped_s.or(Some(s));
        }
    }
    assert!(stopped_s.is_some_and(|s| (s - BEGUN_S - config().feed_s_min).abs() < 0.11), "{stopped_s:?}");
    assert!(stopped_s.is_some_and(|s| s > BEGUN_S + config().feed_s_min - 1e-9), "{stopped_s:?}");
}

/// Feeding begins for requests of `right` and of these stations, and the pictures from then on show parts at these places; how
/// long it lasts, s.
fn feeds_s(config: DeliveryConfig, others: &[&str], places_m: impl Fn(f64) -> Vec<[f64; 2]>) -> Option<f64> {
    let mut hand = feeding(config, others);
    (1..200).map(|frame| 0.1 * f64::from(frame)).find(|fed_s| {
        hand.see(BEGUN_S + fed_s, &places_m(*fed_s));
        hand.step(BEGUN_S + fed_s).contains(&Output::Feed(false))
    })
}

/// So many parts side by side.
fn side_by_side_m(parts: usize) -> Vec<[f64; 2]> {
    (0..5).map(|index| [PART_M[0] - 0.01 * f64::from(index), PART_M[1]]).take(parts).collect()
}

#[test]
fn feeding_goes_on_until_a_trip_has_a_part_for_every_request() {
    let come = |fed_s: f64| usize::from(fed_s > 1.15) + usize::from(fed_s > 2.15) + usize::from(fed_s > 3.15);
    for (others, expected_s) in [(&[][..], 1.2), (&["right"], 2.2), (&["right", "right"], 3.2)] {
        let fed_s = feeds_s(config(), others, |fed_s| side_by_side_m(come(fed_s)));
        assert!(fed_s.is_some_and(|s| (s - expected_s).abs() < 0.11), "{others:?} {fed_s:?}");
    }
}

#[test]
fn a_trip_of_as_many_stops_as_there_may_be_does_not_wait_for_another_part() {
    let fed_s = |stops_max| feeds_s(DeliveryConfig { stops_max, ..config() }, &["right"], |_| side_by_side_m(1));
    assert!(fed_s(1).is_some_and(|s| s < config().feed_s_min + 0.15), "{:?}", fed_s(1));
    assert!(fed_s(2).is_some_and(|s| s > 2.0), "{:?}", fed_s(2));
}

#[test]
fn a_trip_waits_for_a_while_only_for_a_part_that_does_not_come() {
    // One part in two seconds is what is expected before anything was seen.
    let fed_s = feeds_s(config(), &["right"], |fed_s| side_by_side_m(usize::from(fed_s > 1.15)));
    assert!(fed_s.is_some_and(|s| (3.8..7.8).contains(&s)), "{fed_s:?}");
}

#[test]
fn feeding_stops_for_a_part_that_the_trip_would_leave_behind() {
    // The courier may not stand so far to the right that this station could be served with these parts.
    let mut config = config();
    config.stations_m.insert("rim".into(), Vector2::new(0.58, 0.0));
    let fed_s = |parts| feeds_s(config.clone(), &["rim"], |_| side_by_side_m(parts));
    assert!(fed_s(1).is_some_and(|s| s > 2.0), "{:?}", fed_s(1));
    assert!(fed_s(2).is_some_and(|s| s < config.feed_s_min + 0.15), "{:?}", fed_s(2));
}

#[test]
fn a_further_part_is_waited_for_where_its_stop_takes_less_than_the_trip_for_each_part_as_it_is() {
    // The trip takes a part 50 mm away and comes back; stopping and the hand-over take 1.3 s. A further stop may be so far
    // away that the move there takes as long as those two and 0.6 s: 0.76 m.
    let leaves_at_once = |further_m: f64| {
        let mut config = config();
        let right_m = config.feeding_place.xy() + Vector2::from(PART_M) + Vector2::new(0.05, 0.0);
        let further_m = right_m + Vector2::new(-further_m, further_m) / SQRT_2;
        config.stations_m.extend([("right".into(), right_m), ("further".into(), further_m)]);
        let fed_s = feeds_s(config.clone(), &["further"], |_| side_by_side_m(1)).unwrap();
        fed_s < config.feed_s_min + 0.15
    };
    let leaves = [0.0, 0.2, 0.5, 0.72, 0.8, 0.85].map(leaves_at_once);
    assert_eq!(leaves, [false, false, false, false, true, true]);
}

#[test]
fn for_a_part_that_would_go_over_the_drop_off_feeding_does_not_stop_however_often_its_picture_is_looked_at() {
    let mut hand = feeding(config(), &[]);
    let (radius_m, rate_rad_s) = (0.07_f64, 0.2);
    for frame in 1..=7 {
        let s = BEGUN_S + 0.1 * f64::from(frame);
        // From the shortest feeding on, it would come to the edge before the tray is at rest.
        let left_rad = rate_rad_s * (BEGUN_S + config().feed_s_min + 0.9 * config().stop_drift_s - s);
        let angle_rad = TAU - (washer(1, Vector2::zeros()).radius_m / radius_m).asin() - left_rad;
        hand.see(s, &[[radius_m * angle_rad.cos(), radius_m * angle_rad.sin()]]);
        for later_s in [0.0, 0.01, 0.02] {
            assert!(!hand.step(s + later_s).contains(&Output::Feed(false)), "{s}");
        }
    }
}

proptest! {
    /// However fast it moves and however long it stays: feeding goes on while a part of the trip would stay longer than the next
    /// takes to come, and stops while it can still come to rest on the plateau.
    #[test]
    fn feeding_stops_before_a_part_of_the_trip_leaves_the_plateau(rate_rad_s in 0.05..0.4_f64, stays_s in 1.2..7.0_f64) {
        let radius_m = 0.07_f64;
        let edge_rad = TAU - (washer(1, Vector2::zeros()).radius_m / radius_m).asin();
        let place_m = |fed_s: f64| {
            let angle_rad = edge_rad - rate_rad_s * (stays_s - fed_s);
            vec![[radius_m * angle_rad.cos(), radius_m * angle_rad.sin()]]
        };
        let config = config();
        let fed_s = feeds_s(config.clone(), &["right"], place_m).unwrap();
        prop_assert!(stays_s - fed_s > config.stop_drift_s, "{fed_s}");
        // Nothing has come while it lay there: the next is expected after all the time that was fed for and two seconds.
        let expected_s = ((stays_s - config.stop_drift_s - 2.0) / 2.0).max(config.feed_s_min);
        prop_assert!((-0.05..0.25).contains(&(fed_s - expected_s)), "{fed_s} {expected_s}");
    }
}
