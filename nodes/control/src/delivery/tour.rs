//! Trips that bring stations their parts.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::choice::{Choice, OfferedPart, fitting};
use super::config::DeliveryConfig;
use super::planner::MovePlanner;
use super::request::{DeliveryId, DeliveryRequest, Stamp};

/// An open request.
#[derive(Clone, Copy, Debug)]
pub struct Open<'a> {
    /// Its name.
    pub id: DeliveryId,
    /// What is asked for.
    pub request: &'a DeliveryRequest,
    /// Where the station's tool axis is, m.
    pub station_m: Vector2<f64>,
    /// How long it will be until the station's manipulator can take a part, s.
    pub ready_s: f64,
}

/// What a trip is made of.
#[derive(Clone, Copy)]
pub struct Offer<'a> {
    /// The parts on the plateau.
    pub parts: &'a [OfferedPart],
    /// When they were seen.
    pub look: Stamp,
    /// Which of them the feed would lose next: they are worth a detour of a hand-over.
    pub leaves_soon: &'a dyn Fn(&OfferedPart) -> bool,
    /// The open requests, oldest first.
    pub open: &'a [Open<'a>],
}

/// How long the parts of a delivery take that do not depend on the choice, s, as seen so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overheads {
    /// From the order to stop feeding to departure.
    pub stop_s: f64,
    /// From presentation to the release of the courier, where the manipulator waits for the part.
    pub hand_over_s: f64,
    /// From the release until the manipulator can take the next part.
    pub busy_s: f64,
}

/// Where a trip begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Place of the courier, m.
    pub place_m: Vector2<f64>,
    /// What has been spent on it already, feeding for it and stopping, s, and how many parts were taken.
    pub spent_s: f64,
    /// Parts taken already.
    pub taken: u32,
}

/// A delivery on a trip.
#[derive(Clone, Debug, PartialEq)]
pub struct Stop {
    /// The request it serves.
    pub id: DeliveryId,
    /// The part it takes there.
    pub choice: Choice,
}

/// A trip that ends at the feeding place.
#[derive(Clone, Debug, PartialEq)]
pub struct Tour {
    /// The deliveries, in order.
    pub stops: Vec<Stop>,
    /// How long it takes with all hand-overs, s.
    pub duration_s: f64,
    /// How much of that the courier waits for manipulators, s.
    pub waits_s: f64,
    /// Way from its first stop to its last, m.
    pub way_m: f64,
}

impl Tour {
    /// How long the trip takes for each of its parts, with what was spent on it and taken before, s.
    #[must_use]
    pub fn per_part_s(&self, start: &Start) -> f64 {
        per_part_s(start, self.duration_s, self.stops.len())
    }
}

fn per_part_s(start: &Start, duration_s: f64, stops: usize) -> f64 {
    (start.spent_s + duration_s) / (f64::from(start.taken) + stops as f64)
}

/// Rounds of small changes by which a trip is made shorter, and of further stops and changes.
const ROUNDS: u32 = 3;

/// A trip with the parts that lie there which takes little time for each part, of those that serve the oldest request which
/// any part fits: nobody waits for ever because it is out of the way. A part is taken along as long as the stop for it takes
/// less time than the parts so far have taken each.
///
/// It begins with the part that is nearest, adds where it costs least, and then exchanges parts and order while that helps.
#[must_use]
pub fn best_tour(
    offer: &Offer,
    start: Start,
    config: &DeliveryConfig,
    planner: &MovePlanner,
    overheads: &Overheads,
) -> Option<Tour> {
    let (kinds, parts) = (kinds(offer.open), offer.parts);
    let fits =
        |part: &OfferedPart, open: &Open| fitting(part, offer.look, open.request, &open.station_m, config, planner);
    let stands: Vec<Vec<Option<Vector2<f64>>>> = kinds
        .iter()
        .map(|kind| parts.iter().map(|part| fits(part, kind.open[0]).map(|choice| choice.courier.xy())).collect())
        .collect();
    let first = (0..kinds.len())
        .filter(|kind| stands[*kind].iter().any(Option::is_some))
        .min_by_key(|kind| kinds[*kind].open[0].id)?;
    let bonus_s = parts.iter().map(|part| if (offer.leaves_soon)(part) { overheads.hand_over_s } else { 0.0 });
    let bonus_s = bonus_s.collect();
    let search =
        Search { kinds: &kinds, stands, bonus_s, start, home_m: config.feeding_place.xy(), planner, overheads };
    let stops_max = usize::try_from(config.stops_max).unwrap_or(1);
    let mut order = vec![search.nearest(first)?];
    for _ in 0..ROUNDS {
        let before = order.clone();
        order = search.improved(search.grown(order, stops_max), first);
        if order == before {
            break;
        }
    }
    let (duration_s, waits_s) = search.takes_s(&order);
    let mut served = vec![0; kinds.len()];
    let stops = order.iter().filter_map(|call| {
        let request = kinds[call.kind].open.get(served[call.kind])?;
        served[call.kind] += 1;
        Some(Stop { id: request.id, choice: fits(&parts[call.part], request)? })
    });
    let stands_m: Vec<Vector2<f64>> = order.iter().map(|call| search.stand_m(*call)).collect();
    let way_m = stands_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    Some(Tour { stops: stops.collect(), duration_s, waits_s, way_m })
}

/// Requests for which the same parts will do at the same station, oldest first.
struct Kind<'a> {
    open: Vec<&'a Open<'a>>,
    /// The station, by number.
    station: usize,
}

fn kinds<'a>(open: &'a [Open]) -> Vec<Kind<'a>> {
    let mut stations: BTreeMap<&str, usize> = BTreeMap::new();
    let mut kinds: Vec<Kind> = Vec::new();
    for one in open {
        let known = stations.len();
        let station = *stations.entry(&one.request.station).or_insert(known);
        match kinds.iter_mut().find(|kind| kind.open[0].request.takes_same_as(one.request)) {
            Some(kind) => kind.open.push(one),
            None => kinds.push(Kind { open: vec![one], station }),
        }
    }
    kinds
}

/// A stop, by numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Call {
    kind: usize,
    part: usize,
}

struct Search<'a> {
    kinds: &'a [Kind<'a>],
    /// Where the courier stands for each kind and part, m.
    stands: Vec<Vec<Option<Vector2<f64>>>>,
    /// What taking each part is worth beside, s.
    bonus_s: Vec<f64>,
    start: Start,
    home_m: Vector2<f64>,
    planner: &'a MovePlanner,
    overheads: &'a Overheads,
}

impl Search<'_> {
    fn stand_m(&self, call: Call) -> Vector2<f64> {
        self.stands[call.kind][call.part].unwrap_or(self.home_m)
    }

    fn leg_s(&self, from_m: Vector2<f64>, to_m: Vector2<f64>) -> f64 {
        self.planner.estimate_s((to_m - from_m).norm())
    }

    /// How long a trip takes, and how much of that are waits for manipulators, s.
    fn takes_s(&self, order: &[Call]) -> (f64, f64) {
        let (mut time_s, mut waits_s, mut here_m) = (0.0, 0.0, self.start.place_m);
        // Where one is served again, from when on, s.
        let mut busy_until_s: Vec<(usize, f64)> = Vec::new();
        for call in order {
            let (stand_m, kind) = (self.stand_m(*call), &self.kinds[call.kind]);
            time_s += self.leg_s(here_m, stand_m);
            let again = busy_until_s.iter().rfind(|(station, _)| *station == kind.station);
            let wait_s = (again.map_or(kind.open[0].ready_s, |(_, until_s)| *until_s) - time_s).max(0.0);
            waits_s += wait_s;
            time_s += wait_s + self.overheads.hand_over_s;
            busy_until_s.push((kind.station, time_s + self.overheads.busy_s));
            here_m = stand_m;
        }
        (time_s + self.leg_s(here_m, self.home_m), waits_s)
    }

    /// What a trip costs, s: its time, less what its parts are worth beside.
    fn costs_s(&self, order: &[Call]) -> f64 {
        self.takes_s(order).0 - order.iter().map(|call| self.bonus_s[call.part]).sum::<f64>()
    }

    /// The requests of each kind that a trip leaves open.
    fn left(&self, order: &[Call]) -> Vec<usize> {
        let mut left: Vec<usize> = self.kinds.iter().map(|kind| kind.open.len()).collect();
        order.iter().for_each(|call| left[call.kind] -= 1);
        left
    }

    /// The parts that a trip leaves, with the kinds of requests that they may serve.
    fn free<'a>(&'a self, order: &'a [Call], left: &'a [usize]) -> impl Iterator<Item = Call> + 'a {
        let is_free = |part: &usize| order.iter().all(|call| call.part != *part);
        (0..self.bonus_s.len()).filter(is_free).flat_map(move |part| {
            let serves = move |kind: &usize| left[*kind] > 0 && self.stands[*kind][part].is_some();
            (0..self.kinds.len()).filter(serves).map(move |kind| Call { kind, part })
        })
    }

    /// The one stop that costs least and serves a request of this kind.
    fn nearest(&self, kind: usize) -> Option<Call> {
        let alone = |call: &Call| self.costs_s(&[*call]);
        let parts = (0..self.bonus_s.len()).filter(|part| self.stands[kind][*part].is_some());
        parts.map(|part| Call { kind, part }).min_by(|a, b| alone(a).total_cmp(&alone(b)))
    }

    /// The trip with further stops, as long as one more costs less than one so far.
    fn grown(&self, mut order: Vec<Call>, stops_max: usize) -> Vec<Call> {
        let mut takes_s = self.takes_s(&order).0;
        while order.len() < stops_max {
            let left = self.left(&order);
            let places: Vec<Vector2<f64>> = std::iter::once(self.start.place_m)
                .chain(order.iter().map(|call| self.stand_m(*call)))
                .chain([self.home_m])
                .collect();
            let legs_s: Vec<f64> = places.windows(2).map(|pair| self.leg_s(pair[0], pair[1])).collect();
            // The detour alone decides where a stop is added; its waits are known when it is there.
            let detours = self.free(&order, &left).flat_map(|call| {
                let (stand_m, legs_s, places) = (self.stand_m(call), &legs_s, &places);
                (0..legs_s.len()).map(move |at| {
                    let round_s = self.leg_s(places[at], stand_m) + self.leg_s(stand_m, places[at + 1]);
                    (round_s - legs_s[at] - self.bonus_s[call.part], at, call)
                })
            });
            let Some((_, at, call)) = detours.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            let mut longer = order.clone();
            longer.insert(at, call);
            let longer_s = self.takes_s(&longer).0;
            let so_far_s = per_part_s(&self.start, takes_s, order.len());
            if longer_s - takes_s - self.bonus_s[call.part] > so_far_s {
                break;
            }
            (order, takes_s) = (longer, longer_s);
        }
        order
    }

    /// The same trip with parts exchanged for others, and parts of the way turned round, as long as that makes it cheaper. A
    /// request of the kind `first` stays served.
    fn improved(&self, mut order: Vec<Call>, first: usize) -> Vec<Call> {
        let mut costs_s = self.costs_s(&order);
        for _ in 0..ROUNDS {
            let before_s = costs_s;
            let mut keep = |changed: Vec<Call>, order: &mut Vec<Call>| {
                let changed_s = self.costs_s(&changed);
                if changed_s < costs_s - 1e-9 {
                    (*order, costs_s) = (changed, changed_s);
                }
            };
            for at in 0..order.len() {
                let mut left = self.left(&order);
                left[order[at].kind] += 1;
                let is_last_first = order.iter().filter(|call| call.kind == first).count() == 1;
                let others: Vec<Call> = self.free(&order, &left).collect();
                for other in others {
                    if other.kind != order[at].kind && order[at].kind == first && is_last_first {
                        continue;
                    }
                    // One that was exchanged already may serve another kind.
                    if other.kind != order[at].kind && self.left(&order)[other.kind] == 0 {
                        continue;
                    }
                    let mut changed = order.clone();
                    changed[at] = other;
                    keep(changed, &mut order);
                }
            }
            for from in 0..order.len() {
                for to in from + 1..order.len() {
                    let mut changed = order.clone();
                    changed[from..=to].reverse();
                    keep(changed, &mut order);
                }
            }
            if costs_s >= before_s {
                break;
            }
        }
        order
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::*;
    use crate::courier::CourierLimits;
    use feeder_model::motor::Load;
    use feeder_model::part::Refusals;
    use feeder_model::tray::TrayGeometry;

    pub(crate) fn setup() -> (DeliveryConfig, MovePlanner, DeliveryRequest) {
        let config = DeliveryConfig::default();
        let limits = CourierLimits::default();
        let planner = MovePlanner::new(config.gentle, TrayGeometry::PAPER, limits, Load::default()).unwrap();
        let request = DeliveryRequest {
            station: "station_1".into(),
            part_class: "washer".into(),
            pose_classes: vec!["face_up".into()],
            tolerance_m: 1e-3,
            part_gap_m_min: None,
            timeout: None,
        };
        (config, planner, request)
    }

    pub(crate) fn candidate(id: u64, x_m: f64, y_m: f64) -> OfferedPart {
        OfferedPart {
            id,
            position_in_tray_m: Vector2::new(x_m, y_m),
            yaw_in_tray_rad: 0.0,
            part_class: "washer".into(),
            pose_class: Some("face_up".into()),
            radius_m: 0.0025,
            part_gap_m: 0.01,
            refusals: Refusals::default(),
        }
    }
}
