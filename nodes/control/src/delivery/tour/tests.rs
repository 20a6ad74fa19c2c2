//! Trips by hand, and against all trips there are.

use proptest::array::uniform3;
use proptest::prelude::*;

use super::testing::{candidate, setup};
use super::*;

const OVERHEADS: Overheads = Overheads { stop_s: 0.6, hand_over_s: 0.7, busy_s: 1.0 };
const START: Start = Start { place_m: Vector2::new(0.0, 0.0), spent_s: 2.0, taken: 0 };

/// Stations with how long each is busy, s, one request for each time it is named.
fn tour(candidates: &[OfferedPart], stations: &[(f64, f64, f64)], stops_max: u32, start: Start) -> Option<Tour> {
    let (mut config, planner, request) = setup();
    config.stops_max = stops_max;
    let name = |(x, y, _): &(f64, f64, f64)| format!("at {x} {y}");
    let requests: Vec<DeliveryRequest> =
        stations.iter().map(|place| DeliveryRequest { station: name(place), ..request.clone() }).collect();
    let open = (1..).zip(stations.iter().zip(&requests)).map(|(id, (&(x, y, ready_s), request))| Open {
        id: DeliveryId(id),
        request,
        station_m: Vector2::new(x, y),
        ready_s,
    });
    let open: Vec<Open> = open.collect();
    let leaves_soon = |part: &OfferedPart| part.id >= 100;
    let offer = Offer { parts: candidates, look: Stamp::ZERO, leaves_soon: &leaves_soon, open: &open };
    best_tour(&offer, start, &config, &planner, &OVERHEADS)
}

fn ids(tour: &Tour) -> Vec<u64> {
    tour.stops.iter().map(|stop| stop.id.0).collect()
}

fn parts(tour: &Tour) -> Vec<u64> {
    tour.stops.iter().map(|stop| stop.choice.candidate.id).collect()
}

#[test]
fn nothing_fits_nothing_goes() {
    assert_eq!(tour(&[], &[(0.3, 0.0, 0.0)], 4, START), None);
    assert_eq!(tour(&[candidate(1, 0.0, -0.07)], &[], 4, START), None);
}

#[test]
fn neighbours_are_served_on_one_trip_in_the_short_order() {
    let lying = [candidate(1, 0.06, -0.03), candidate(2, 0.03, -0.06), candidate(3, -0.03, -0.06)];
    let found = tour(&lying, &[(0.35, 0.3, 0.0), (0.35, 0.0, 0.0), (0.35, 0.15, 0.0)], 4, START).unwrap();
    let order = ids(&found);
    assert!(order == [1, 3, 2] || order == [2, 3, 1], "{order:?}");
    let mut parts = parts(&found);
    parts.sort_unstable();
    assert_eq!(parts, [1, 2, 3]);
}

#[test]
fn one_stop_a_trip_serves_the_oldest_request_though_another_is_nearer() {
    let found = tour(&[candidate(1, 0.06, -0.03)], &[(0.4, 0.4, 0.0), (0.1, 0.0, 0.0)], 1, START).unwrap();
    assert_eq!(ids(&found), [1]);
    // It is passed over only while no part fits it.
    let found = tour(&[candidate(1, -0.07, -0.03)], &[(0.49, 0.0, 0.0), (0.1, 0.0, 0.0)], 1, START).unwrap();
    assert_eq!(ids(&found), [2]);
}

#[test]
fn every_request_of_a_station_gets_a_part_of_its_own_the_oldest_first() {
    let lying: Vec<OfferedPart> =
        (0..10_u32).map(|index| candidate(index.into(), 0.07 - 0.01 * f64::from(index), -0.05)).collect();
    let found = tour(&lying, &[(0.2, 0.0, 0.0); 7], 20, START).unwrap();
    assert_eq!(ids(&found), [1, 2, 3, 4, 5, 6, 7]);
    let mut parts = parts(&found);
    parts.sort_unstable();
    parts.dedup();
    assert_eq!(parts.len(), 7);
    // The manipulator puts each away for a second, but the way to it.
    assert!(found.waits_s > 4.0 && found.waits_s < 6.0, "{}", found.waits_s);
    assert_eq!(tour(&lying, &[(0.2, 0.0, 0.0); 7], 3, START).unwrap().stops.len(), 3);
}

#[test]
fn a_stop_that_takes_longer_than_a_part_has_taken_so_far_is_left_for_another_trip() {
    let lying = [candidate(1, 0.06, -0.03), candidate(2, 0.03, -0.06)];
    let far = |spent_s| tour(&lying, &[(0.1, -0.05, 0.0), (-0.4, 0.38, 0.0)], 20, Start { spent_s, ..START }).unwrap();
    assert_eq!(ids(&far(0.0)), [1]);
    // After a long wait for parts it is worth the way.
    assert_eq!(far(9.0).stops.len(), 2);
}

#[test]
fn a_part_that_would_be_lost_next_is_taken_where_another_is_hardly_nearer() {
    let (near, far) = ((0.03, -0.05), (0.05, -0.05));
    for (id, taken) in [(2, 1), (100, 100)] {
        let lying = [candidate(1, near.0, near.1), candidate(id, far.0, far.1)];
        let found = tour(&lying, &[(0.03, -0.05, 0.0)], 1, START).unwrap();
        assert_eq!(parts(&found), [taken]);
    }
}

#[test]
fn a_trip_goes_on_from_where_the_courier_is() {
    let lying = [candidate(1, 0.06, -0.03), candidate(2, -0.03, -0.06)];
    let place_m = Vector2::new(0.23, 0.06);
    let found = tour(&lying, &[(0.2, 0.0, 0.0)], 1, Start { place_m, ..START }).unwrap();
    assert_eq!(parts(&found), [2]);
}

/// The cheapest trip of all, as time for each part.
fn least_s(takes_s: &mut dyn FnMut(&[usize]) -> Option<f64>, order: &mut Vec<usize>, calls: usize, best_s: &mut f64) {
    if let Some(per_part_s) = takes_s(order) {
        *best_s = best_s.min(per_part_s);
    }
    for call in 0..calls {
        if !order.contains(&call) {
            order.push(call);
            least_s(takes_s, order, calls, best_s);
            order.pop();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Against all trips, written out: it serves the oldest request, and takes hardly longer for a part.
    #[test]
    fn verif_hardly_any_trip_of_an_exhaustive_search_is_better(
        angles in uniform3(3.3..6.1_f64), radii in uniform3(0.06..0.085_f64),
        places in uniform3((-0.35..0.35_f64, -0.35..0.35_f64)), ready in uniform3(0.0..2.0_f64),
        spent_s in 0.0..4.0_f64,
    ) {
        let lying: Vec<OfferedPart> =
            (1..).zip(angles.iter().zip(radii)).map(|(id, (angle, r))| candidate(id, r * angle.cos(), r * angle.sin())).collect();
        let stations: Vec<(f64, f64, f64)> = places.iter().zip(ready).map(|(&(x, y), ready)| (x, y, ready)).collect();
        let start = Start { spent_s, ..START };
        let Some(found) = tour(&lying, &stations, 20, start) else { return Ok(()) };
        let (_, planner, _) = setup();
        let stand = |call: usize| Vector2::new(stations[call / 3].0, stations[call / 3].1) - lying[call % 3].position_in_tray_m;
        let leg_s = |a: Vector2<f64>, b: Vector2<f64>| planner.estimate_s((a - b).norm());
        let reach = |call: usize| planner.check_reach(&nalgebra::Vector3::new(stand(call).x, stand(call).y, 0.0)).is_ok();
        let oldest = (0..9).filter(|call| reach(*call)).map(|call| call / 3).min().unwrap();
        let mut takes_s = |order: &[usize]| {
            let twice = |key: fn(usize) -> usize| (0..order.len()).any(|a| (0..a).any(|b| key(order[a]) == key(order[b])));
            let valid = order.iter().all(|call| reach(*call)) && order.iter().any(|call| call / 3 == oldest);
            if !valid || twice(|call| call / 3) || twice(|call| call % 3) {
                return None;
            }
            let (mut here, mut time_s) = (Vector2::zeros(), 0.0_f64);
            for call in order {
                time_s = (time_s + leg_s(here, stand(*call))).max(stations[call / 3].2) + OVERHEADS.hand_over_s;
                here = stand(*call);
            }
            Some((spent_s + time_s + leg_s(here, Vector2::zeros())) / order.len() as f64)
        };
        let mut best_s = f64::INFINITY;
        least_s(&mut takes_s, &mut Vec::new(), 9, &mut best_s);
        let found_s = found.per_part_s(&start);
        prop_assert!(found_s >= best_s - 1e-9 && found_s <= 1.15 * best_s, "{found_s} {best_s}");
        prop_assert!(found.stops.iter().any(|stop| stop.id.0 == oldest as u64 + 1));
    }
}
