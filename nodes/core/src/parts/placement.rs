//! Putting parts onto the tray: bulk loading, and landing at the foot of the ramp.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::track::Track;
use super::{BulkSettings, Part, PartSpec, Place};
use crate::tray::TrayGeometry;

/// Random places tried for one part before the tray counts as full.
const LOADING_ATTEMPTS: usize = 500;

/// Random places tried for a falling part before it waits.
const LANDING_ATTEMPTS: usize = 8;

/// The region of the tray in which parts are loaded.
#[derive(Clone, Debug)]
pub(super) struct LoadingBand {
    tray: TrayGeometry,
    radii_m: RangeInclusive<f64>,
    angles_rad: RangeInclusive<f64>,
}

impl LoadingBand {
    /// From the foot of the ramp to the edge of the last surface loaded, clear of the drop-off's face and edge.
    pub(super) fn new(tray: TrayGeometry, track: &Track, settings: &BulkSettings) -> Self {
        let inner_m = settings.loading_inner_radius_m.max(track.innermost_m);
        let clearance_rad = (track.part_radius_m / inner_m).asin();
        let end_rad = if settings.load_plateau { TAU - clearance_rad } else { tray.ramp_angle_rad };
        Self { tray, radii_m: inner_m..=track.outermost_m, angles_rad: clearance_rad..=end_rad }
    }

    /// A place in the band, free of the parts present, or `None` if none was found.
    pub(super) fn find_place(&self, parts: &[Part], diameter_m: f64, rng: &mut Pcg64Mcg) -> Option<(Place, f64, f64)> {
        for _ in 0..LOADING_ATTEMPTS {
            // Uniform over the area.
            let squared = self.radii_m.start().powi(2)..=self.radii_m.end().powi(2);
            let radius_m = rng.random_range(squared).sqrt();
            let angle_rad = rng.random_range(self.angles_rad.clone());
            let (sin, cos) = angle_rad.sin_cos();
            let (x_m, y_m) = (radius_m * cos, radius_m * sin);
            if is_free(parts, x_m, y_m, diameter_m) {
                let place = Place::from(self.tray.surface(angle_rad));
                return Some((place, x_m, y_m));
            }
        }
        None
    }
}

/// Where parts that fall off the plateau come to rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandingZone {
    scatter_m: f64,
    length_m: f64,
}

impl LandingZone {
    pub(super) fn new(settings: &BulkSettings) -> Self {
        Self { scatter_m: settings.landing_scatter_m, length_m: settings.landing_length_m }
    }

    /// A free place at the foot of the ramp for the part that left the plateau at radius `left_at_m`, or `None`.
    pub(super) fn find_place(
        &self,
        parts: &[Part],
        left_at_m: f64,
        track: &Track,
        rng: &mut Pcg64Mcg,
    ) -> Option<(f64, f64)> {
        for _ in 0..LANDING_ATTEMPTS {
            let radius_m =
                (left_at_m + self.scatter_m * symmetric_share(rng)).clamp(track.innermost_m, track.outermost_m);
            let y_m = track.part_radius_m + self.length_m * rng.random::<f64>();
            let x_m = (radius_m * radius_m - y_m * y_m).max(0.0).sqrt();
            // A part on the end of the plateau hangs over the place, but well above it.
            let mut on_ramp = parts.iter().filter(|part| part.place == Place::Ramp);
            if on_ramp.all(|part| clears(part, x_m, y_m, 2.0 * track.part_radius_m)) {
                return Some((x_m, y_m));
            }
        }
        None
    }
}

/// Whether a disc at (`x_m`, `y_m`) would touch no part on a surface.
pub(super) fn is_free(parts: &[Part], x_m: f64, y_m: f64, diameter_m: f64) -> bool {
    let mut on_surface = parts.iter().filter(|part| part.place != Place::Falling);
    on_surface.all(|part| clears(part, x_m, y_m, diameter_m))
}

fn clears(part: &Part, x_m: f64, y_m: f64, diameter_m: f64) -> bool {
    part.squared_distance_m2(x_m, y_m) >= diameter_m * diameter_m
}

/// A heading, uniform over the circle, rad.
pub(super) fn random_yaw_rad(rng: &mut Pcg64Mcg) -> f64 {
    PI * symmetric_share(rng)
}

/// Uniform in \[−1, 1).
fn symmetric_share(rng: &mut Pcg64Mcg) -> f64 {
    2.0 * rng.random::<f64>() - 1.0
}

/// The resting pose of a part poured onto the tray.
pub(super) fn random_pose(spec: &PartSpec, rng: &mut Pcg64Mcg) -> usize {
    draw(spec.resting_poses.iter().map(|pose| pose.probability), rng)
}

/// The resting pose of a part that fell off the plateau in pose `from`.
pub(super) fn random_pose_after_fall(spec: &PartSpec, from: usize, rng: &mut Pcg64Mcg) -> usize {
    draw(spec.dropoff_transition[from].iter().copied(), rng)
}

/// Draws an index with the given probabilities, which add up to one but for rounding.
fn draw(probabilities: impl Iterator<Item = f64>, rng: &mut Pcg64Mcg) -> usize {
    let mut left = rng.random::<f64>();
    let mut last_possible = 0;
    for (index, probability) in probabilities.enumerate() {
        if probability > 0.0 {
            if left < probability {
                return index;
            }
            last_possible = index;
        }
        left -= probability;
    }
    last_possible
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn draws_follow_the_probabilities_and_never_the_impossible() {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let mut counts = [0_u32; 4];
        for _ in 0..10_000 {
            counts[draw([0.0, 0.3, 0.7, 0.0].into_iter(), &mut rng)] += 1;
        }
        assert_eq!((counts[0], counts[3]), (0, 0));
        // Four standard deviations of a binomial with p = 0.3.
        assert!((f64::from(counts[1]) - 3000.0).abs() < 4.0 * 2100.0_f64.sqrt());
    }
}
