//! Trips that bring several stations their parts.

use super::choice::{CandidateFrame, Choice, OfferedPart, angle_rad, fitting};
use super::config::DeliveryConfig;
use super::planner::MovePlanner;
use super::request::{DeliveryId, DeliveryRequest};
use nalgebra::Vector2;

/// An open request.
#[derive(Clone, Copy, Debug)]
pub struct Open<'a> {
    /// Its name.
    pub id: DeliveryId,
    /// What is asked for.
    pub request: &'a DeliveryRequest,
    /// Where the station's tool axis is, m.
    pub station_m: Vector2<f64>,
}

/// How long the parts of a delivery take that do not depend on the choice, s, as seen so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overheads {
    /// From the order to stop feeding to departure.
    pub stop_s: f64,
    /// From presentation to the release of the courier.
    pub hand_over_s: f64,
}

/// A delivery on a trip.
#[derive(Clone, Debug, PartialEq)]
pub struct Stop {
    /// The request it serves.
    pub id: DeliveryId,
    /// The part it takes there.
    pub choice: Choice,
}

/// A trip from the feeding place and back.
#[derive(Clone, Debug, PartialEq)]
pub struct Tour {
    /// The deliveries, in order.
    pub stops: Vec<Stop>,
    /// How long it takes with all hand-overs, s.
    pub duration_s: f64,
}

impl Tour {
    /// How long it takes for each of its parts, stopping and settling included, s.
    #[must_use]
    pub fn per_part_s(&self, overheads: &Overheads) -> f64 {
        (self.duration_s + overheads.stop_s) / self.stops.len() as f64
    }
}

/// Parts and requests considered at a time: enough for any tray that feeds well, and few enough to try all trips.
const CONSIDERED: usize = 5;

/// The trip that delivers most parts per second, of those that serve the oldest request which any part fits: nobody
/// waits for ever because it is out of the way. All orders and assignments are tried.
#[must_use]
pub fn best_tour(
    frame: &CandidateFrame,
    open: &[Open],
    config: &DeliveryConfig,
    planner: &MovePlanner,
    overheads: &Overheads,
) -> Option<Tour> {
    let mut candidates: Vec<&OfferedPart> = frame.candidates.iter().collect();
    // Those that the feed would lose next come first.
    candidates.sort_by(|a, b| angle_rad(b).total_cmp(&angle_rad(a)));
    let fits = |open: &Open, candidate: &OfferedPart| {
        fitting(candidate, frame.stamp, open.request, &open.station_m, config, planner)
    };
    candidates.retain(|candidate| open.iter().any(|open| fits(open, candidate).is_some()));
    candidates.truncate(CONSIDERED);
    let rows = open.iter().map(|open| {
        let choices = candidates.iter().map(|candidate| fits(open, candidate));
        (open.id, choices.collect::<Vec<_>>())
    });
    let rows: Vec<_> = rows.filter(|(_, choices)| choices.iter().any(Option::is_some)).take(CONSIDERED).collect();
    let mut search = Search { rows: &rows, config, planner, overheads, best: None };
    search.extend(&mut Vec::new(), 0.0);
    search.best.map(|(_, tour)| tour)
}

struct Search<'a> {
    /// For each request the choice that each candidate would be; the first request must be served.
    rows: &'a [(DeliveryId, Vec<Option<Choice>>)],
    config: &'a DeliveryConfig,
    planner: &'a MovePlanner,
    overheads: &'a Overheads,
    best: Option<(f64, Tour)>,
}

impl Search<'_> {
    /// Tries every trip that begins with `taken` (request and candidate), which takes `so_far_s` up to its last hand-over.
    fn extend(&mut self, taken: &mut Vec<(usize, usize)>, so_far_s: f64) {
        let home_m = self.config.feeding_place.xy();
        let here_m = taken.last().and_then(|&(row, part)| self.stand_m(row, part)).unwrap_or(home_m);
        if taken.iter().any(|(row, _)| *row == 0) {
            let duration_s = so_far_s + self.planner.estimate_s((here_m - home_m).norm());
            let rate_per_s = taken.len() as f64 / (duration_s + self.overheads.stop_s);
            if self.best.as_ref().is_none_or(|(best, _)| rate_per_s > *best) {
                let stops = taken.iter().filter_map(|&(row, part)| {
                    let (id, choices) = &self.rows[row];
                    choices[part].clone().map(|choice| Stop { id: *id, choice })
                });
                self.best = Some((rate_per_s, Tour { stops: stops.collect(), duration_s }));
            }
        }
        if taken.len() >= usize::try_from(self.config.stops_max).unwrap_or(1) {
            return;
        }
        for row in 0..self.rows.len() {
            for part in 0..self.rows[row].1.len() {
                if taken.iter().any(|&(other_row, other_part)| other_row == row || other_part == part) {
                    continue;
                }
                let Some(stand_m) = self.stand_m(row, part) else { continue };
                let leg_s = self.planner.estimate_s((stand_m - here_m).norm());
                taken.push((row, part));
                self.extend(taken, so_far_s + leg_s + self.overheads.hand_over_s);
                taken.pop();
            }
        }
    }

    fn stand_m(&self, row: usize, part: usize) -> Option<Vector2<f64>> {
        self.rows[row].1[part].as_ref().map(|choice| choice.courier.xy())
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

#[cfg(test)]
mod tests {
    use super::testing::{candidate, setup};
    use super::*;
    use crate::delivery::Stamp;

    const OVERHEADS: Overheads = Overheads { stop_s: 0.6, hand_over_s: 0.7 };

    fn tour(candidates: &[OfferedPart], stations: &[(f64, f64)], stops_max: u32) -> Option<Tour> {
        let (mut config, planner, request) = setup();
        config.stops_max = stops_max;
        let open: Vec<Open> = (1..)
            .zip(stations)
            .map(|(id, &(x, y))| Open { id: DeliveryId(id), request: &request, station_m: Vector2::new(x, y) })
            .collect();
        let frame = CandidateFrame { stamp: Stamp::ZERO, candidates: candidates.to_vec(), is_blind: false };
        best_tour(&frame, &open, &config, &planner, &OVERHEADS)
    }

    #[test]
    fn nothing_fits_nothing_goes() {
        assert_eq!(tour(&[], &[(0.3, 0.0)], 4), None);
        assert_eq!(tour(&[candidate(1, 0.0, -0.07)], &[], 4), None);
    }

    #[test]
    fn neighbours_are_served_on_one_trip_in_the_short_order() {
        let parts = [candidate(1, 0.06, -0.03), candidate(2, 0.03, -0.06), candidate(3, -0.03, -0.06)];
        let found = tour(&parts, &[(0.35, 0.3), (0.35, 0.0), (0.35, 0.15)], 4).unwrap();
        assert_eq!(found.stops.len(), 3);
        let order: Vec<u64> = found.stops.iter().map(|stop| stop.id.0).collect();
        assert!(order == [1, 3, 2] || order == [2, 3, 1], "{order:?}");
        let mut parts: Vec<u64> = found.stops.iter().map(|stop| stop.choice.candidate.id).collect();
        parts.sort_unstable();
        assert_eq!(parts, [1, 2, 3]);
    }

    #[test]
    fn one_stop_a_trip_serves_the_oldest_request_though_another_is_nearer() {
        let found = tour(&[candidate(1, 0.06, -0.03)], &[(0.4, 0.4), (0.1, 0.0)], 1).unwrap();
        assert_eq!(found.stops[0].id, DeliveryId(1));
        // It is passed over only while no part fits it.
        let found = tour(&[candidate(1, -0.07, -0.03)], &[(0.49, 0.0), (0.1, 0.0)], 1).unwrap();
        assert_eq!(found.stops[0].id, DeliveryId(2));
    }

    #[test]
    fn verif_no_trip_of_a_brute_force_search_is_better() {
        // Two requests, two parts: the eight trips written out.
        let (config, planner, request) = setup();
        let parts = [candidate(1, 0.06, -0.03), candidate(2, -0.05, -0.05)];
        let stations = [Vector2::new(0.3, 0.2), Vector2::new(-0.3, 0.1)];
        let stand = |station: usize, part: usize| {
            let frame = fitting(&parts[part], Stamp::ZERO, &request, &stations[station], &config, &planner);
            frame.unwrap().courier.xy()
        };
        let leg = |from: Vector2<f64>, to: Vector2<f64>| planner.estimate_s((to - from).norm());
        let home = Vector2::zeros();
        let mut best = 0.0_f64;
        for part in 0..2 {
            let at = stand(0, part);
            best = best.max(1.0 / (leg(home, at) + 0.7 + leg(at, home) + 0.6));
            let other = stand(1, 1 - part);
            for (first, second) in [(at, other), (other, at)] {
                best = best.max(2.0 / (leg(home, first) + leg(first, second) + leg(second, home) + 1.4 + 0.6));
            }
        }
        let found = tour(&parts, &[(0.3, 0.2), (-0.3, 0.1)], 4).unwrap();
        assert!((1.0 / found.per_part_s(&OVERHEADS) - best).abs() < 1e-12);
    }
}
