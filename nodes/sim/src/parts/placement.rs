//! Putting parts onto the tray: bulk loading, and landing at the foot of the ramp.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::touch::{Scratch, touch};
use super::track::TrayPath;
use crate::parts::{BulkSettings, Part, Place};
use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;

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
    /// From the foot of the ramp to the edge of the last surface loaded, clear of the drop-off's face and edge by
    /// `radius_m`, the largest of a part.
    pub(super) fn new(tray: TrayGeometry, radius_m: f64, settings: &BulkSettings) -> Self {
        let inner_m = settings.loading_inner_radius_m.unwrap_or(0.0).max(tray.inner_radius_m + radius_m);
        let clearance_rad = (radius_m / inner_m).asin();
        let end_rad = if settings.load_plateau { TAU - clearance_rad } else { tray.ramp_angle_rad };
        Self { tray, radii_m: inner_m..=tray.outer_radius_m - radius_m, angles_rad: clearance_rad..=end_rad }
    }

    /// Puts `part` somewhere in the band, free of the parts present. Returns whether there was a place.
    pub(super) fn place(
        &self,
        part: &mut Part,
        parts: &[Part],
        track: &TrayPath,
        scratch: &mut Scratch,
        rng: &mut Pcg64Mcg,
    ) -> bool {
        for _ in 0..LOADING_ATTEMPTS {
            // Uniform over the area.
            let squared = self.radii_m.start().powi(2)..=self.radii_m.end().powi(2);
            let radius_m = rng.random_range(squared).sqrt();
            let angle_rad = rng.random_range(self.angles_rad.clone());
            let (sin, cos) = angle_rad.sin_cos();
            (part.x_m, part.y_m) = (radius_m * cos, radius_m * sin);
            part.place = Place::from(self.tray.surface(angle_rad));
            if is_free(part, parts, track, scratch) {
                return true;
            }
        }
        false
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

    /// Puts `part`, which left the plateau where it still is, at a free place at the foot of the ramp. Returns whether
    /// there was one.
    pub(super) fn place(
        &self,
        part: &mut Part,
        parts: &[Part],
        track: &TrayPath,
        scratch: &mut Scratch,
        rng: &mut Pcg64Mcg,
    ) -> bool {
        let (left_at_m, clearance_m) = (part.radius_m(), track.body(part).radius_m);
        let radii_m = track.centres_m(part);
        part.place = Place::Ramp;
        for _ in 0..LANDING_ATTEMPTS {
            let radius_m = (left_at_m + self.scatter_m * symmetric_share(rng)).clamp(*radii_m.start(), *radii_m.end());
            part.y_m = clearance_m + self.length_m * rng.random::<f64>();
            part.x_m = (radius_m * radius_m - part.y_m * part.y_m).max(0.0).sqrt();
            // A part on the end of the plateau hangs over the place, but well above it.
            let mut on_ramp = parts.iter().filter(|other| other.place == Place::Ramp);
            if on_ramp.all(|other| clears(part, other, track, scratch)) {
                return true;
            }
        }
        false
    }
}

/// Whether a part would touch no other on a surface.
pub(super) fn is_free(part: &Part, parts: &[Part], track: &TrayPath, scratch: &mut Scratch) -> bool {
    let mut on_surface = parts.iter().filter(|other| other.place != Place::Falling);
    on_surface.all(|other| clears(part, other, track, scratch))
}

fn clears(part: &Part, other: &Part, track: &TrayPath, scratch: &mut Scratch) -> bool {
    touch((track.body(part), part), (track.body(other), other), scratch).is_none()
}

/// A heading, uniform over the circle, rad.
pub(super) fn random_yaw_rad(rng: &mut Pcg64Mcg) -> f64 {
    PI * symmetric_share(rng)
}

/// Uniform in \[−1, 1).
fn symmetric_share(rng: &mut Pcg64Mcg) -> f64 {
    2.0 * rng.random::<f64>() - 1.0
}

/// The pose of a part poured onto the tray.
pub(super) fn random_pose(part: &PartType, rng: &mut Pcg64Mcg) -> usize {
    draw(part.poured.iter().copied(), rng)
}

/// The pose of a part that fell off the plateau in pose `from`.
pub(super) fn random_pose_after_fall(part: &PartType, from: usize, rng: &mut Pcg64Mcg) -> usize {
    draw(part.dropoff[from].iter().copied(), rng)
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
