//! The sequencer's rules one by one, with reports made by hand: what it must not act on, and when.

use std::f64::consts::TAU;
use std::time::Duration;

use feeder_control::courier::CourierLimits;
use feeder_control::delivery::{
    CandidateFrame, DeliveryConfig, DeliverySequencer, Failure, HandOver, MoveId, Output, Refusal, ReserveId,
};
use feeder_model::motor::Load;
use feeder_model::tray::TrayGeometry;
use nalgebra::Vector2;

use crate::by_hand::{ByHand, PART_M, STAND, at};
use crate::world::{asking, config, washer};

#[test]
fn parts_are_chosen_from_a_picture_taken_after_they_settled() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert!((config().settle_s - 0.05).abs() < 1e-12);
    hand.see(1.02, &[PART_M]);
    assert_eq!(hand.departs(1.03), None);
    assert_eq!(hand.departs(1.06), None);
    hand.see(1.05, &[PART_M]);
    assert!(hand.departs(1.07).is_some());
}

#[test]
fn a_courier_that_moves_again_during_the_look_is_looked_at_anew() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert_eq!(hand.departs(1.06), None);
    hand.home(1.06, true);
    hand.home(1.07, false);
    hand.see(1.08, &[PART_M]);
    assert_eq!(hand.departs(1.09), None);
    hand.home(1.10, false);
    assert_eq!(hand.departs(1.13), None);
    hand.see(1.12, &[PART_M]);
    assert!(hand.departs(1.14).is_some());
}

#[test]
fn a_purge_does_not_take_a_plateau_on_which_nothing_is_recognised_for_an_empty_one() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.0), hand.id));
    hand.sequencer.purge(at(1.1), Duration::from_secs(3)).unwrap();
    let mut purged = |is_blind: bool, s: f64| {
        hand.sequencer.candidates(CandidateFrame { stamp: at(s), candidates: Vec::new(), is_blind });
        hand.step(s).into_iter().find_map(|output| match output {
            Output::Purged(result) => Some(result),
            _ => None,
        })
    };
    for frame in 1..=20 {
        assert_eq!(purged(true, 1.1 + 0.1 * f64::from(frame)), None);
    }
    let gave_up = purged(true, 4.2);
    assert!(matches!(&gave_up, Some(Err(reason)) if reason.contains("not recognised")), "{gave_up:?}");
    hand.sequencer.purge(at(5.0), Duration::from_secs(3)).unwrap();
    let mut purged = |s: f64| {
        hand.sequencer.candidates(CandidateFrame { stamp: at(s), candidates: Vec::new(), is_blind: false });
        hand.step(s).contains(&Output::Purged(Ok(())))
    };
    assert!((1..=10).any(|frame| purged(5.0 + 0.1 * f64::from(frame))));
}

#[test]
fn feeding_lasts_its_shortest_time_though_a_part_lies_right() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.step(1.06);
    // As many empty looks as there may be: feeding begins with the last.
    for s in [1.10, 1.20] {
        hand.see(s, &[]);
        hand.step(s);
    }
    let mut stopped_s = None;
    for frame in 1..=10 {
        let s = 1.20 + 0.1 * f64::from(frame);
        hand.see(s, &[PART_M]);
        if hand.step(s).contains(&Output::Feed(false)) {
            stopped_s = stopped_s.or(Some(s));
        }
    }
    assert!(stopped_s.is_some_and(|s| (s - 1.20 - config().feed_s_min).abs() < 0.11), "{stopped_s:?}");
    assert!(stopped_s.is_some_and(|s| s > 1.20 + config().feed_s_min - 1e-9), "{stopped_s:?}");
}

#[test]
fn for_a_part_that_would_go_over_the_drop_off_feeding_does_not_stop_however_often_its_picture_is_looked_at() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.step(1.06);
    for s in [1.10, 1.20] {
        hand.see(s, &[]);
        hand.step(s);
    }
    let (radius_m, rate_rad_s) = (0.07_f64, 0.2);
    for frame in 1..=7 {
        let s = 1.20 + 0.1 * f64::from(frame);
        // From the shortest feeding on, it would come to the edge before the tray is at rest.
        let left_rad = rate_rad_s * (1.20 + config().feed_s_min + 0.9 * config().stop_drift_s - s);
        let angle_rad = TAU - (washer(1, Vector2::zeros()).radius_m / radius_m).asin() - left_rad;
        hand.see(s, &[[radius_m * angle_rad.cos(), radius_m * angle_rad.sin()]]);
        for later_s in [0.0, 0.01, 0.02] {
            assert!(!hand.step(s + later_s).contains(&Output::Feed(false)), "{s}");
        }
    }
}

#[test]
fn what_comes_late_and_is_older_is_passed_over() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.step(1.06);
    hand.see(1.20, &[]);
    hand.see(1.10, &[PART_M]);
    assert_eq!(hand.departs(1.21), None);
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.step(1.06);
    hand.home(1.20, false);
    hand.home(1.10, true);
    hand.see(1.15, &[PART_M]);
    assert!(hand.departs(1.21).is_some());
}

#[test]
fn a_part_is_presented_when_the_move_has_ended_and_the_courier_rests() {
    let (mut hand, id) = ByHand::departed(config(), 0.5e-3, None);
    hand.courier(1.9, STAND.into(), false);
    assert_eq!(hand.presents(1.9), None);
    hand.sequencer.move_ended(MoveId(id.0 + 1), Ok(()));
    assert_eq!(hand.presents(1.91), None);
    hand.sequencer.move_ended(id, Ok(()));
    hand.courier(1.95, STAND.into(), true);
    assert_eq!(hand.presents(1.95), None);
    hand.courier(2.0, STAND.into(), false);
    assert!(hand.presents(2.0).is_some());
}

#[test]
fn a_part_beside_the_tool_by_more_than_the_request_allows_is_not_presented() {
    let mut hand = ByHand::arrived(config(), 0.7e-3, None, 0.6e-3);
    let offset_m = hand.presents(2.0).unwrap().part_in_station_m;
    assert!((offset_m - Vector2::new(0.6e-3, 0.0)).norm() < 1e-9, "{offset_m}");
    for off_m in [0.6e-3, -0.6e-3] {
        let mut hand = ByHand::arrived(config(), 0.5e-3, None, off_m);
        assert_eq!(hand.presents(2.0), None);
        assert_eq!(hand.ends(10.0).0, Some(Err(Failure::DidNotArrive)));
    }
}

#[test]
fn a_station_that_a_camera_sees_is_looked_at_anew_and_the_part_presented_where_it_lies_now() {
    let rechecked = || DeliveryConfig { rechecked_stations: ["right".to_owned()].into(), ..config() };
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    assert_eq!(hand.presents(2.0), None);
    // Taken on the way.
    hand.see(1.9, &[PART_M]);
    assert_eq!(hand.presents(2.05), None);
    let slipped_m = [PART_M[0] + 0.3e-3, PART_M[1]];
    hand.see(2.1, &[slipped_m]);
    let delivered = hand.presents(2.11).unwrap();
    assert_eq!(delivered.choice.candidate.position_in_tray_m, Vector2::from(slipped_m));
    assert!((delivered.part_in_station_m - Vector2::new(0.3e-3, 0.0)).norm() < 1e-9);
    // Farther than the request allows it is another part, or lost.
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    hand.step(2.0);
    hand.see(2.1, &[[PART_M[0] + 0.6e-3, PART_M[1]]]);
    assert!(matches!(hand.ends(2.11).0, Some(Err(Failure::PartLost(reason))) if reason.contains("0.60 mm")));
}

#[test]
fn a_hand_over_is_reported_by_the_name_of_its_own_delivery() {
    let mut hand = ByHand::arrived(config(), 0.5e-3, None, 0.0);
    let other = hand.sequencer.request(at(2.0), asking("left", 0.5e-3)).unwrap();
    assert!(hand.presents(2.0).is_some());
    assert_eq!(hand.sequencer.report_hand_over(other, HandOver::Taken), Err(Refusal::NotPresented(other)));
    assert_eq!(hand.sequencer.report_hand_over(hand.id, HandOver::Taken), Ok(()));
    assert_eq!(hand.sequencer.report_hand_over(other, HandOver::Released), Err(Refusal::NotPresented(other)));
}

#[test]
fn a_part_under_the_tool_is_not_taken_away_when_the_requests_time_is_over() {
    let mut hand = ByHand::arrived(config(), 0.5e-3, Some(Duration::from_secs(5)), 0.0);
    assert!(hand.presents(2.0).is_some());
    assert_eq!(hand.ends(6.0).0, None);
    hand.sequencer.report_hand_over(hand.id, HandOver::Taken).unwrap();
    assert_eq!(hand.ends(7.0).0, None);
    hand.sequencer.report_hand_over(hand.id, HandOver::Released).unwrap();
    assert_eq!(hand.ends(8.0).0, Some(Ok(())));
}

#[test]
fn each_report_of_a_hand_over_has_a_time_of_its_own() {
    let timeout_s = config().hand_over_timeout_s;
    let mut hand = ByHand::arrived(config(), 0.5e-3, None, 0.0);
    assert!(hand.presents(2.0).is_some());
    let taken_s = 2.0 + timeout_s - 0.1;
    hand.sequencer.report_hand_over(hand.id, HandOver::Taken).unwrap();
    assert_eq!(hand.ends(taken_s), (None, vec![]));
    let released_s = taken_s + timeout_s - 0.1;
    assert_eq!(hand.ends(released_s), (None, vec![]));
    hand.sequencer.report_hand_over(hand.id, HandOver::Released).unwrap();
    assert_eq!(hand.ends(released_s), (Some(Ok(())), vec![]));
    // Nobody waits for ever for the first.
    let mut hand = ByHand::arrived(config(), 0.5e-3, None, 0.0);
    hand.presents(2.0);
    assert_eq!(hand.ends(2.0 + timeout_s - 0.1).0, None);
    assert_eq!(hand.ends(2.0 + timeout_s).0, Some(Err(Failure::NoHandOver)));
}

#[test]
fn a_station_is_served_where_the_plateau_reaches_it_and_the_ramp_does_not_count() {
    // The courier's bounds are at 0.5 m, the tray's rim is at 90 mm, and its half towards −y is the plateau.
    let places_m = [([0.58, -0.01], true), ([-0.58, -0.01], true), ([0.0, -0.58], true), ([0.0, 0.58], false)];
    for (place_m, is_served) in places_m {
        let config = DeliveryConfig { stations_m: [("right".to_owned(), place_m.into())].into(), ..config() };
        let (tray, limits) = (TrayGeometry::PAPER, CourierLimits::default());
        let mut sequencer = DeliverySequencer::new(config, tray, limits, Load::default()).unwrap();
        let asked = sequencer.request(at(0.0), asking("right", 1e-3));
        assert_eq!(asked.is_ok(), is_served, "{place_m:?}: {asked:?}");
        assert!(is_served || matches!(asked, Err(Refusal::Blocked { .. })), "{asked:?}");
    }
}

#[test]
fn the_area_of_a_trip_is_asked_for_until_all_its_hand_overs_have_had_their_time_and_with_room_to_spare() {
    let granted = |lease: &str| Ok((lease.to_owned(), at(1e5)));
    for stops in [1, 2] {
        let mut hand = ByHand::new(DeliveryConfig { arbitrated: true, ..config() }, 0.5e-3, None);
        let mut parts_m = vec![PART_M];
        if stops == 2 {
            hand.sequencer.request(at(1.0), asking("left", 0.5e-3)).unwrap();
            parts_m.push([-0.05, -0.05]);
        }
        hand.sequencer.area_answered(ReserveId(1), granted("parking"));
        hand.step(1.0);
        hand.step(1.06);
        hand.see(1.08, &parts_m);
        let asked = hand.step(1.1).into_iter().find_map(|output| match output {
            Output::Reserve { parked: false, duration, area, .. } => Some((duration.as_secs_f64(), area)),
            _ => None,
        });
        let (asked_s, area) = asked.unwrap();
        // Beside them each move may take its grace longer than its second or so, and the trip once more.
        let hand_overs_s = f64::from(stops) * 2.0 * config().hand_over_timeout_s;
        let moves_s = f64::from(stops + 1) * (config().move_grace_s + 1.0) + config().move_grace_s;
        let beside_s = asked_s - hand_overs_s;
        assert!((moves_s - 2.0..moves_s + 2.0).contains(&beside_s), "{beside_s}, {moves_s}");
        // It covers courier and tray wherever control lets them be: corners are cut where there are some.
        let cut_m = if stops == 1 { 0.0 } else { config().corner_m };
        let radius_m = config().footprint_radius_m + cut_m + DeliverySequencer::TRACKING_M;
        assert!((area.radius_m - radius_m).abs() < 1e-12, "{}", area.radius_m);
    }
}
