//! Areas: what a disc covers on its way along a polyline.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::OutOfRange;

/// Where on the ROS graph lies what belongs to a shared platen and to no feeder.
pub const PLATEN_NAMESPACE: &str = "/platen";

/// Everything within a radius of a polyline on the platen: a disc when the line is a single point, a corridor when not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// The polyline in the platen frame, m.
    #[schemars(with = "Vec<[f64; 2]>")]
    pub points_m: Vec<Vector2<f64>>,
    /// Distance from the line that still belongs to the area, m.
    pub radius_m: f64,
}

impl Area {
    /// Most points an area may have.
    pub const POINTS_MAX: usize = 64;

    /// A disc.
    #[must_use]
    pub fn disc(center_m: Vector2<f64>, radius_m: f64) -> Self {
        Self { points_m: vec![center_m], radius_m }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// No or too many points, a coordinate that is not finite or beyond 100 m, a radius that is negative or beyond 100 m.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let count = self.points_m.len();
        let most = Self::POINTS_MAX;
        #[expect(clippy::cast_precision_loss, reason = "shown to people")]
        OutOfRange::unless((1..=most).contains(&count), "number of points", count as f64, format_args!("1 to {most}"))?;
        for coordinate_m in self.points_m.iter().flatten() {
            OutOfRange::unless(coordinate_m.abs() <= 100.0, "coordinate (m)", *coordinate_m, "-100 to 100")?;
        }
        OutOfRange::unless((0.0..=100.0).contains(&self.radius_m), "radius_m", self.radius_m, "0 to 100")?;
        Ok(())
    }

    /// Room between two areas, m; negative where they overlap.
    #[must_use]
    pub fn distance_m(&self, other: &Self) -> f64 {
        let lines = self.segments().flat_map(|a| other.segments().map(move |b| segment_distance_m(a, b)));
        lines.fold(f64::INFINITY, f64::min) - self.radius_m - other.radius_m
    }

    /// Whether the areas share more than a border.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        // Rounding must not make neighbours of areas that were laid out side by side.
        const TOUCHING_M: f64 = 1e-9;
        self.distance_m(other) < -TOUCHING_M
    }

    /// By how much a disc reaches out of the area, m; negative or zero when it lies inside.
    #[must_use]
    pub fn excess_m(&self, center_m: &Vector2<f64>, radius_m: f64) -> f64 {
        let to_line = self.segments().map(|segment| segment_distance_m(segment, (*center_m, *center_m)));
        to_line.fold(f64::INFINITY, f64::min) + radius_m - self.radius_m
    }

    /// The pieces of the line; a single point is a piece of no length.
    fn segments(&self) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
        let single = (self.points_m.len() == 1).then(|| (self.points_m[0], self.points_m[0]));
        single.into_iter().chain(self.points_m.windows(2).map(|pair| (pair[0], pair[1])))
    }
}

/// Distance between two straight pieces, m; 0 where they cross.
#[must_use]
pub fn segment_distance_m(a: (Vector2<f64>, Vector2<f64>), b: (Vector2<f64>, Vector2<f64>)) -> f64 {
    let to_point = |(from, to): (Vector2<f64>, Vector2<f64>), point: Vector2<f64>| {
        let along = to - from;
        let length2 = along.norm_squared();
        let t = if length2 > 0.0 { ((point - from).dot(&along) / length2).clamp(0.0, 1.0) } else { 0.0 };
        (from + along * t - point).norm()
    };
    let side = |(from, to): (Vector2<f64>, Vector2<f64>), point: Vector2<f64>| (to - from).perp(&(point - from));
    let (a0, a1, b0, b1) = (side(b, a.0), side(b, a.1), side(a, b.0), side(a, b.1));
    if a0 * a1 < 0.0 && b0 * b1 < 0.0 {
        return 0.0;
    }
    [to_point(a, b.0), to_point(a, b.1), to_point(b, a.0), to_point(b, a.1)].into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn corridor(points: &[(f64, f64)], radius_m: f64) -> Area {
        Area { points_m: points.iter().map(|&(x, y)| Vector2::new(x, y)).collect(), radius_m }
    }

    #[test]
    fn crossing_touching_and_distant_areas_are_told_apart() {
        let across = corridor(&[(-1.0, 0.0), (1.0, 0.0)], 0.1);
        assert!(across.overlaps(&corridor(&[(0.0, -1.0), (0.0, 1.0)], 0.1)));
        assert!(!across.overlaps(&corridor(&[(0.0, 0.2)], 0.1)));
        assert!(across.overlaps(&corridor(&[(0.0, 0.199)], 0.1)));
        assert!((across.distance_m(&corridor(&[(2.0, 0.0)], 0.1)) - 0.8).abs() < 1e-12);
        let bent = corridor(&[(0.0, 1.0), (0.5, 0.5), (0.5, 2.0)], 0.05);
        assert!((across.distance_m(&bent) - 0.35).abs() < 1e-12);
        assert!((across.excess_m(&Vector2::new(1.0, 0.05), 0.06) - 0.01).abs() < 1e-12);
    }

    #[test]
    fn areas_that_cannot_be_are_named() {
        let bad = [corridor(&[], 0.1), corridor(&[(f64::NAN, 0.0)], 0.1), corridor(&[(0.0, 0.0)], -0.1)];
        for (area, named) in bad.iter().zip(["number of points", "coordinate", "radius_m"]) {
            assert!(area.validate().unwrap_err().to_string().contains(named));
        }
        assert!(corridor(&[(0.0, 0.0); Area::POINTS_MAX + 1], 0.1).validate().is_err());
    }

    proptest! {
        /// The distance is that of the nearest pair of points, found by trying many.
        #[test]
        fn verif_segment_distance_is_the_least_over_all_pairs(
            coordinates in prop::array::uniform8(-1.0..1.0_f64),
        ) {
            let [ax, ay, bx, by, cx, cy, dx, dy] = coordinates;
            let (a, b) = ((Vector2::new(ax, ay), Vector2::new(bx, by)), (Vector2::new(cx, cy), Vector2::new(dx, dy)));
            let at = |(from, to): (Vector2<f64>, Vector2<f64>), i: u32| from + (to - from) * (f64::from(i) / 200.0);
            let tried = (0..=200)
                .flat_map(|i| (0..=200).map(move |j| (at(a, i) - at(b, j)).norm()))
                .fold(f64::INFINITY, f64::min);
            let distance_m = segment_distance_m(a, b);
            // The grid's pieces are at most 3 mm/2 from any point of a segment of up to 2.83 m / 200.
            prop_assert!(distance_m <= tried + 1e-12 && tried <= distance_m + 0.015);
        }
    }
}
