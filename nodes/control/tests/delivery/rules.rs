//! The sequencer's rules one by one, with reports made by hand: what it must not act on, and when.

use std::time::Duration;

use feeder_control::courier::CourierLimits;
use feeder_control::delivery::{
    CandidateFrame, CourierReport, DeliveryConfig, DeliverySequencer, Failure, FeedRate, HandOver, MoveId, OfferedPart,
    Output, Phase, Refusal, Warning,
};
use feeder_control::platen::Area;
use feeder_model::motor::Load;
use feeder_model::part::Refusals;
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
fn nobody_is_told_to_load_parts_where_it_is_not_known_what_lies_there() {
    for (is_blind, told) in [(true, 0), (false, 1)] {
        let mut hand = ByHand::new(config(), 0.5e-3, None);
        let is_starved = |output: &Output| matches!(output, Output::Warning(Warning::Starved(_)));
        let mut warned = 0;
        for second in 2..40 {
            let s = f64::from(second);
            hand.sequencer.candidates(CandidateFrame { stamp: at(s), candidates: Vec::new(), is_blind });
            warned += hand.step(s).iter().filter(|output| is_starved(output)).count();
        }
        assert_eq!(warned, told, "{is_blind}");
        assert!(hand.sequencer.is_starved());
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

/// The washer at [`PART_M`], of which something is said.
fn washer_with(id: u64, refusals: Refusals) -> OfferedPart {
    OfferedPart { refusals, ..washer(id, PART_M.into()) }
}

fn frame(s: f64, candidates: Vec<OfferedPart>) -> CandidateFrame {
    CandidateFrame { stamp: at(s), candidates, is_blind: false }
}

#[test]
fn a_part_under_the_tool_whose_pose_is_not_yet_sure_again_is_looked_at_until_it_is() {
    let rechecked = || DeliveryConfig { rechecked_stations: ["right".to_owned()].into(), ..config() };
    let none = Refusals::default();
    let unsure = Refusals { pose_unsure: true, ..none };
    let disagrees = Refusals { pose_disagrees: true, ..unsure };
    let near = Refusals { part_too_near: true, ..none };
    let lost = |end: Option<Result<(), Failure>>| matches!(end, Some(Err(Failure::PartLost(_))));
    let seen = |hand: &mut ByHand, s: f64, refusals| {
        hand.sequencer.candidates(frame(s, vec![washer_with(1, refusals)]));
        hand.ends(s + 0.01).0
    };
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    hand.step(2.0);
    for s in [2.1, 2.2, 2.3] {
        assert_eq!(seen(&mut hand, s, unsure), None);
        assert_eq!(hand.sequencer.phase(), Phase::Looking);
    }
    assert_eq!(seen(&mut hand, 2.4, none), None);
    assert_eq!(hand.sequencer.phase(), Phase::Presented);
    // What an image itself speaks against is not waited for, nor is a doubt that stays.
    for refusals in [disagrees, near, Refusals { part_too_near: true, ..unsure }] {
        let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
        hand.step(2.0);
        assert!(lost(seen(&mut hand, 2.1, refusals)), "{refusals}");
    }
    // Nor is a part that has turned over.
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    hand.step(2.0);
    let turned = OfferedPart { pose_class: Some("face_down".into()), ..washer_with(1, unsure) };
    hand.sequencer.candidates(frame(2.1, vec![turned]));
    assert!(lost(hand.ends(2.11).0));
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    hand.step(2.0);
    let ends = [2.1, 2.5, 2.9, 3.3].map(|s| lost(seen(&mut hand, s, unsure)));
    assert_eq!(ends, [false, false, false, true]);
    // Nor are images that do not come.
    let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
    hand.step(2.0);
    assert_eq!(seen(&mut hand, 2.1, unsure), None);
    assert_eq!(hand.ends(2.05 + config().look_timeout_s).0, None);
    assert_eq!(hand.ends(2.15 + config().look_timeout_s).0, Some(Err(Failure::NoImage)));
}

#[test]
fn a_part_that_was_not_as_chosen_under_the_tool_is_passed_over_until_parts_are_fed_on() {
    let rechecked = || DeliveryConfig { rechecked_stations: ["right".to_owned()].into(), ..config() };
    let (none, near) = (Refusals::default(), Refusals { part_too_near: true, ..Refusals::default() });
    // Home again, with the next request, and a look in which the part seems to have room.
    let looked_again = || {
        let mut hand = ByHand::arrived(rechecked(), 0.5e-3, None, 0.0);
        hand.step(2.0);
        hand.sequencer.candidates(frame(2.1, vec![washer_with(1, near)]));
        let back = hand.departs(2.11).unwrap();
        assert_eq!(hand.sequencer.open().count(), 0);
        hand.home(2.9, true);
        hand.sequencer.move_ended(back, Ok(()));
        hand.home(3.0, false);
        hand.sequencer.request(at(3.0), asking("right", 0.5e-3)).unwrap();
        hand.step(3.0);
        hand.step(3.1);
        hand.sequencer.candidates(frame(3.15, vec![washer_with(1, none)]));
        assert_eq!(hand.departs(3.16), None);
        hand
    };
    let mut hand = looked_again();
    let beside = washer(2, [0.01, -0.07].into());
    hand.sequencer.candidates(frame(3.25, vec![washer_with(1, none), beside]));
    assert!(hand.departs(3.26).is_some());
    let mut hand = looked_again();
    hand.sequencer.candidates(frame(3.25, vec![washer_with(1, none)]));
    hand.step(3.26);
    assert_eq!(hand.sequencer.phase(), Phase::Feeding);
    hand.sequencer.candidates(frame(3.9, vec![washer_with(1, none)]));
    hand.step(3.91);
    hand.home(4.0, false);
    assert!(hand.departs(4.0).is_some());
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
    let asked = |place_m: [f64; 2], keep_out: Vec<Area>| {
        let stations_m = [("right".to_owned(), place_m.into())].into();
        let config = DeliveryConfig { stations_m, keep_out, ..config() };
        let (tray, limits) = (TrayGeometry::PAPER, CourierLimits::default());
        let mut sequencer = DeliverySequencer::new(config, tray, limits, Load::default()).unwrap();
        sequencer.request(at(0.0), asking("right", 1e-3))
    };
    for place_m in [[0.58, -0.01], [-0.58, -0.01], [0.0, -0.58]] {
        assert!(asked(place_m, Vec::new()).is_ok(), "{place_m:?}");
    }
    assert!(matches!(asked([0.0, 0.58], Vec::new()), Err(Refusal::Blocked { .. })));
    // A thin post under the tool keeps the courier off by its own 0.1 m, which is more than the plateau bridges.
    let post = Area::disc(Vector2::new(0.3, 0.1), 0.02);
    assert!(matches!(asked([0.3, 0.1], vec![post]), Err(Refusal::Blocked { .. })));
    // A wall from bound to bound leaves a place to stand but no way; one with a gap that the courier fits through leaves both.
    let wall =
        |end_m: f64| Area { points_m: vec![Vector2::new(0.25, -0.9), Vector2::new(0.25, end_m)], radius_m: 0.01 };
    assert!(matches!(asked([0.45, 0.1], vec![wall(0.9)]), Err(Refusal::Blocked { .. })));
    assert!(matches!(asked([0.45, 0.1], vec![wall(0.45)]), Err(Refusal::Blocked { .. })));
    assert!(asked([0.45, 0.1], vec![wall(0.2)]).is_ok());
}

#[test]
fn a_part_that_only_stands_behind_a_wall_would_bring_under_the_tool_is_left() {
    // The station stands above the end of a wall: from this side parts of the plateau that lie right are brought, from the other
    // side those that lie left.
    let wall = Area { points_m: vec![Vector2::new(0.3, -0.9), Vector2::new(0.3, 0.9)], radius_m: 0.0 };
    let stations_m = [("right".to_owned(), Vector2::new(0.26, 0.0))].into();
    let config = DeliveryConfig { stations_m, keep_out: vec![wall], footprint_radius_m: 0.04, ..config() };
    let mut hand = ByHand::new(config, 0.5e-3, None);
    hand.step(1.06);
    hand.see(1.08, &[[-0.085, -0.01]]);
    assert_eq!(hand.departs(1.1), None);
    hand.see(1.12, &[[-0.085, -0.01], [0.07, -0.01]]);
    assert!(hand.departs(1.13).is_some());
}

#[test]
fn who_asks_is_told_a_time_at_which_his_part_may_come() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.step(1.06);
    hand.see(1.10, &[]);
    hand.step(1.10);
    hand.see(1.20, &[]);
    let expected_s = |outputs: Vec<Output>, of: Phase| {
        outputs.into_iter().find_map(|output| match output {
            Output::Phase { phase, presented_at, .. } if phase == of => presented_at.map(|at| at.as_secs_f64()),
            _ => None,
        })
    };
    // One fitting part every two seconds, 0.6 s to stop and to look, and a move of less than a second.
    let feeding_s = expected_s(hand.step(1.20), Phase::Feeding).unwrap();
    assert!((4.0..4.8).contains(&feeding_s), "{feeding_s}");
    hand.see(1.80, &[PART_M]);
    let stopping_s = expected_s(hand.step(1.80), Phase::Stopping).unwrap();
    assert!((2.3..2.5).contains(&stopping_s), "{stopping_s}");
}

#[test]
fn an_empty_plateau_is_one_of_which_several_pictures_show_nothing() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.0), hand.id));
    hand.see(1.05, &[]);
    hand.sequencer.purge(at(1.1), Duration::from_secs(9)).unwrap();
    let purged = |outputs: Vec<Output>| outputs.contains(&Output::Purged(Ok(())));
    // However often it is looked at: one from before, and four since.
    for frame in 0..=4 {
        hand.see(1.1 + 0.1 * f64::from(frame), &[]);
        for later in 1..=9 {
            assert!(!purged(hand.step(1.1 + 0.1 * f64::from(frame) + 0.01 * f64::from(later))), "{frame}");
        }
    }
    hand.see(1.6, &[]);
    assert!(purged(hand.step(1.6)));
}

#[test]
fn parts_that_move_otherwise_than_the_waveform_should_move_them_are_told_once() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    hand.sequencer.expect_feed(vec![FeedRate { radius_m: 0.07, rate_rad_s: 0.2 }], 0.1, None);
    hand.step(1.06);
    for s in [1.10, 1.20] {
        hand.see(s, &[]);
        hand.step(s);
    }
    let mut told = 0;
    for frame in 1..=100 {
        let s = 1.20 + 0.1 * f64::from(frame);
        let position = config().feeding_place;
        hand.sequencer.courier(CourierReport { stamp: at(s), position, vibrating: true, moving: false });
        // Half as fast as it should, in a pose nobody asked for, so that feeding goes on.
        let angle_rad = 3.5 + 0.1 * f64::from(frame) * 0.1;
        let place_m = Vector2::new(angle_rad.cos(), angle_rad.sin()) * 0.07;
        let part = OfferedPart { pose_class: None, ..washer(1, place_m) };
        hand.sequencer.candidates(CandidateFrame { stamp: at(s), candidates: vec![part], is_blind: false });
        let is_told = |output: &&Output| matches!(output, Output::Warning(Warning::FeedOff { ratio }) if *ratio < 0.6);
        told += hand.step(s).iter().filter(is_told).count();
    }
    assert_eq!(told, 1);
}
