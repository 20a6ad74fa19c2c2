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
    feeders: Vec<String>,
    footprint_radius_m: f64,
    places_m: Vec<Option<Vector2<f64>>>,
    leases: Option<Vec<(String, Area)>>,
}

impl PlatenMonitor {
    pub(crate) fn new(ports: Ports, config: &RunMonitorConfig) -> Self {
        let feeders = config.feeders.clone();
        Self { ports, places_m: Vec::new(), feeders, footprint_radius_m: config.footprint_radius_m, leases: None }
    }

    /// Watches the couriers, which stand there, in the order of the feeders.
    pub(crate) fn watch(
        &mut self,
        io: &mut StepIo,
        places_m: impl IntoIterator<Item = Option<Vector2<f64>>>,
        progress: &mut Progress,
    ) {
        self.places_m.clear();
        self.places_m.extend(places_m);
        if let Some(message) = io.take(&self.ports.leases).pop() {
            let leases = area::from_leases(&message).leases.into_iter();
            self.leases = Some(leases.map(|lease| (lease.agent, lease.area)).collect());
        }
        self.check_distances(progress);
        self.check_areas(progress);
    }

    fn check_distances(&self, progress: &mut Progress) {
        for (index, first) in self.places_m.iter().enumerate() {
            for second in &self.places_m[..index] {
                let (Some(first), Some(second)) = (first, second) else { continue };
                let distance_m = (first - second).norm();
                progress.couriers_closest_m =
                    Some(progress.couriers_closest_m.map_or(distance_m, |closest_m| closest_m.min(distance_m)));
                progress.collisions += u32::from(distance_m < 2.0 * self.footprint_radius_m);
            }
        }
    }

    fn check_areas(&self, progress: &mut Progress) {
        let Some(leases) = &self.leases else { return };
        for (feeder, place_m) in self.feeders.iter().zip(&self.places_m) {
            let Some(place_m) = place_m else { continue };
            let mut leased = leases.iter().filter(|(agent, _)| agent == feeder).peekable();
            // Before its first lease a courier rests where it was put.
            let has_any = leased.peek().is_some();
            let inside = leased.any(|(_, area)| area.excess_m(place_m, self.footprint_radius_m) <= SLACK_M);
            progress.out_of_area += u32::from(has_any && !inside);
        }
    }
}
