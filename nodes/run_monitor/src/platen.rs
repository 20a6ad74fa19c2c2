//! Whether couriers that share a platen keep apart, found from where they are, not from what they say.

use feeder_control::platen::Area;
use feeder_runtime::node::{Declare, StepIo, Subscriber};
use feeder_scenario::plan::RunMonitorConfig;
use feeder_wire::{area, topics};
use minifactory_msgs::msg::AreaLeases;
use nalgebra::Vector2;

use crate::progress::Progress;

/// Rounding and tracking that do not count as leaving an area, m.
const SLACK_M: f64 = 1e-4;

/// Handles of the ports for the platen.
pub(crate) struct Ports {
    leases: Subscriber<AreaLeases>,
}

impl Ports {
    /// Nothing on a platen that is not shared.
    pub(crate) fn declare(io: &mut Declare, config: &RunMonitorConfig) -> Option<Self> {
        config.arbitrated.then(|| Self { leases: io.subscriber(&topics::LEASES) })
    }
}

/// Watches the platen.
pub(crate) struct PlatenMonitor {
    ports: Ports,
    score: PlatenScore,
}

impl PlatenMonitor {
    pub(crate) fn new(ports: Ports, config: &RunMonitorConfig) -> Self {
        let (feeders, footprint_radius_m) = (config.feeders.clone(), config.footprint_radius_m);
        Self { ports, score: PlatenScore { feeders, footprint_radius_m, leases: None } }
    }

    /// Watches the couriers, which stand there, in the order of the feeders.
    pub(crate) fn watch(
        &mut self,
        io: &mut StepIo,
        places_m: impl IntoIterator<Item = Option<Vector2<f64>>>,
        progress: &mut Progress,
    ) {
        if let Some(message) = io.take(&self.ports.leases).pop() {
            let leases = area::from_leases(&message).leases.into_iter();
            self.score.leases = Some(leases.map(|lease| (lease.agent, lease.area)).collect());
        }
        let places_m: Vec<_> = places_m.into_iter().collect();
        self.score.check_distances(&places_m, progress);
        self.score.check_areas(&places_m, progress);
    }
}

/// Scores a shared platen.
struct PlatenScore {
    feeders: Vec<String>,
    footprint_radius_m: f64,
    /// Agents and the areas leased to them, once somebody has told.
    leases: Option<Vec<(String, Area)>>,
}

impl PlatenScore {
    fn check_distances(&self, places_m: &[Option<Vector2<f64>>], progress: &mut Progress) {
        for (index, first) in places_m.iter().enumerate() {
            for second in &places_m[..index] {
                let (Some(first), Some(second)) = (first, second) else { continue };
                let distance_m = (first - second).norm();
                progress.couriers_closest_m =
                    Some(progress.couriers_closest_m.map_or(distance_m, |closest_m| closest_m.min(distance_m)));
                progress.collisions += u32::from(distance_m < 2.0 * self.footprint_radius_m);
            }
        }
    }

    fn check_areas(&self, places_m: &[Option<Vector2<f64>>], progress: &mut Progress) {
        let Some(leases) = &self.leases else { return };
        for (feeder, place_m) in self.feeders.iter().zip(places_m) {
            let Some(place_m) = place_m else { continue };
            let mut leased = leases.iter().filter(|(agent, _)| agent == feeder).peekable();
            // Before its first lease a courier rests where it was put.
            let has_any = leased.peek().is_some();
            let inside = leased.any(|(_, area)| area.excess_m(place_m, self.footprint_radius_m) <= SLACK_M);
            progress.out_of_area += u32::from(has_any && !inside);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(leases: Option<Vec<(String, Area)>>) -> PlatenScore {
        PlatenScore { feeders: vec!["west".to_owned(), "east".to_owned()], footprint_radius_m: 0.1, leases }
    }

    fn at(x_m: f64) -> Option<Vector2<f64>> {
        Some(Vector2::new(x_m, 0.0))
    }

    #[test]
    fn couriers_nearer_than_their_footprints_collide_in_each_tick() {
        let (score, mut progress) = (score(None), Progress::default());
        score.check_distances(&[at(0.0), None], &mut progress);
        assert_eq!((progress.couriers_closest_m, progress.collisions), (None, 0));
        score.check_distances(&[at(1.0), at(1.25)], &mut progress);
        assert_eq!((progress.couriers_closest_m, progress.collisions), (Some(0.25), 0));
        score.check_distances(&[at(1.0), at(0.875)], &mut progress);
        score.check_distances(&[at(1.0), at(1.1875)], &mut progress);
        assert_eq!((progress.couriers_closest_m, progress.collisions), (Some(0.125), 2));
    }

    #[test]
    fn a_courier_that_reaches_out_of_its_own_areas_is_out() {
        let home = |agent: &str, x_m: f64| (agent.to_owned(), Area::disc(Vector2::new(x_m, 0.0), 0.15));
        let out_of = |score: &PlatenScore, west_m: f64, east_m: f64| {
            let mut progress = Progress::default();
            score.check_areas(&[at(west_m), at(east_m)], &mut progress);
            progress.out_of_area
        };
        let both = score(Some(vec![home("west", 0.0), home("east", 1.0), home("east", 1.2)]));
        assert_eq!(out_of(&both, 0.049, 1.0), 0);
        assert_eq!(out_of(&both, 0.051, 1.2), 1);
        // Another's area does not count.
        assert_eq!(out_of(&both, 1.0, 0.0), 2);
        // Who was never leased anything rests where it was put.
        assert_eq!(out_of(&score(Some(vec![home("west", 0.0)])), 0.0, 7.0), 0);
        assert_eq!(out_of(&score(None), 7.0, 7.0), 0);
    }
}
