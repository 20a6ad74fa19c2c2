//! The ways of trips, by hand: how gently parts are carried, and where and for how long a courier may go on a shared platen.

use std::time::Duration;

use feeder_control::delivery::{DeliveryConfig, DeliverySequencer, MovePlan, Output, Policy, ReserveId};
use feeder_control::platen::Area;
use nalgebra::Vector2;

use crate::by_hand::{ByHand, PART_M, STAND, at};
use crate::world::{asking, config};

/// The move that begins, if one does.
fn plan(outputs: Vec<Output>) -> Option<MovePlan> {
    outputs.into_iter().find_map(|output| if let Output::Move(_, plan) = output { Some(plan) } else { None })
}

/// On a shared platen, with a lease of the place to park, and the trip of one part or of two asked for at 1.1 s.
fn asking_for_a_trip(stops: u32) -> (ByHand, Vec<Output>) {
    let mut hand = ByHand::new(DeliveryConfig { arbitrated: true, ..config() }, 0.5e-3, None);
    let mut parts_m = vec![PART_M];
    if stops == 2 {
        hand.sequencer.request(at(1.0), asking("left", 0.5e-3)).unwrap();
        parts_m.push([-0.05, -0.05]);
    }
    hand.sequencer.area_answered(ReserveId(1), Ok(("parking".to_owned(), at(1e5))));
    hand.step(1.0);
    hand.step(1.06);
    hand.see(1.08, &parts_m);
    let asked = hand.step(1.1);
    (hand, asked)
}

/// The same on its way, with a lease until then, s, and the area leased.
fn on_a_trip(stops: u32, until_s: f64) -> (ByHand, Area) {
    let (mut hand, asked) = asking_for_a_trip(stops);
    hand.sequencer.area_answered(ReserveId(2), Ok(("trip".to_owned(), at(until_s))));
    assert!(plan(hand.step(1.2)).is_some());
    (hand, trip(asked).unwrap().1)
}

/// For how long and of what area a trip is asked for.
fn trip(outputs: Vec<Output>) -> Option<(Duration, Area)> {
    outputs.into_iter().find_map(|output| match output {
        Output::Reserve { parked: false, duration, area, .. } => Some((duration, area)),
        _ => None,
    })
}

#[test]
fn where_all_parts_are_protected_the_courier_is_as_gentle_as_the_ramp_needs_out_and_home() {
    let peaks_m_s2 = |policy: Policy| {
        let mut hand = ByHand::new(DeliveryConfig { policy, ..config() }, 0.5e-3, None);
        hand.step(1.06);
        hand.see(1.08, &[PART_M]);
        let out = plan(hand.step(1.1)).unwrap();
        assert!(hand.sequencer.cancel(at(1.5), hand.id));
        hand.courier(1.6, STAND.into(), false);
        [out, plan(hand.step(1.6)).unwrap()].map(|plan| plan.peak_acceleration_m_s2)
    };
    let (selected, all) = (peaks_m_s2(Policy::Selected), peaks_m_s2(Policy::All));
    let held_m_s2 = config().gentle.friction * config().gentle.gravity_m_s2;
    for (selected_m_s2, all_m_s2) in selected.into_iter().zip(all) {
        assert!(selected_m_s2 <= held_m_s2 && all_m_s2 < 0.9 * selected_m_s2, "{selected_m_s2} {all_m_s2}");
    }
}

#[test]
fn the_area_of_a_trip_is_asked_for_until_all_its_hand_overs_have_had_their_time_and_with_room_to_spare() {
    for stops in [1, 2] {
        let (asked, area) = trip(asking_for_a_trip(stops).1).unwrap();
        // Beside them each move may take its grace longer than its second or so, and the trip once more.
        let hand_overs_s = f64::from(stops) * 2.0 * config().hand_over_timeout_s;
        let moves_s = f64::from(stops + 1) * (config().move_grace_s + 1.0) + config().move_grace_s;
        let beside_s = asked.as_secs_f64() - hand_overs_s;
        assert!((moves_s - 2.0..moves_s + 2.0).contains(&beside_s), "{beside_s}, {moves_s}");
        // It covers courier and tray wherever control lets them be: corners are cut where there are some.
        let cut_m = if stops == 1 { 0.0 } else { config().corner_m };
        let radius_m = config().footprint_radius_m + cut_m + DeliverySequencer::TRACKING_M;
        assert!((area.radius_m - radius_m).abs() < 1e-12, "{}", area.radius_m);
    }
}

#[test]
fn a_trip_given_up_comes_home_by_the_shorter_way_within_its_area() {
    let length_m = |way_m: &[Vector2<f64>]| way_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>();
    // On the first leg, from home; on the second, from station to station; on the third, to home.
    for (leg, share, is_back) in [(0, 0.2, true), (0, 0.9, true), (1, 0.1, true), (1, 0.9, false), (2, 0.5, false)] {
        let (mut hand, area) = on_a_trip(2, 1e3);
        let way_m = area.points_m;
        let here_m = way_m[leg] + (way_m[leg + 1] - way_m[leg]) * share;
        let back_m = length_m(&way_m[..=leg]) + (here_m - way_m[leg]).norm();
        let on_m = length_m(&way_m[leg + 1..]) + (way_m[leg + 1] - here_m).norm();
        assert_eq!(back_m < on_m, is_back, "{way_m:?}");
        let ids: Vec<_> = hand.sequencer.open().map(|(id, _)| id).collect();
        for id in ids {
            assert!(hand.sequencer.cancel(at(1.3), id));
        }
        hand.courier(1.6, here_m.push(0.0), false);
        let home = plan(hand.step(1.6)).unwrap();
        assert!((length_m(&home.route_m) - back_m.min(on_m)).abs() < 1e-3, "{leg} {share}: {:?}", home.route_m);
    }
}

#[test]
fn a_return_that_may_outlast_the_trips_lease_begins_when_that_is_renewed() {
    let (mut hand, _) = on_a_trip(1, 3.5);
    assert!(hand.sequencer.cancel(at(1.3), hand.id));
    hand.courier(1.6, STAND.into(), false);
    // The move takes less than a second, and may take its grace longer.
    let outputs = hand.step(1.6);
    let renews = |output: &Output| matches!(output, Output::Renew { id: ReserveId(3), lease, .. } if lease == "trip");
    assert!(outputs.iter().any(renews), "{outputs:?}");
    assert!(plan(outputs).is_none() && plan(hand.step(1.7)).is_none());
    hand.sequencer.area_answered(ReserveId(3), Ok(("trip".to_owned(), at(9.0))));
    assert!(plan(hand.step(1.8)).is_some());
}
