//! The convex silhouette of a part as it lies, seen from above.

use std::f64::consts::PI;

use nalgebra::{Isometry2, Point2, Vector2};

/// How far a silhouette may deviate from a circle about the centre of mass, as a share of its radius, to count as one.
const ROUNDNESS: f64 = 0.01;

/// A convex silhouette relative to the centre of mass, at yaw 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Corners, counter-clockwise, m.
    pub corners_m: Vec<Point2<f64>>,
    /// Distance of the farthest corner from the centre of mass, m.
    pub radius_m: f64,
    /// If the silhouette is a circle about the centre of mass.
    pub round: bool,
}

impl Outline {
    /// The convex hull of points of the part as it lies.
    #[must_use]
    pub fn around(points: impl Iterator<Item = Point2<f64>>) -> Self {
        let corners_m = convex_hull(points.collect());
        let radius_m = corners_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
        let nearest_m = edges(&corners_m).map(|(from, to)| distance_to_line(from, to)).fold(f64::INFINITY, f64::min);
        let round = corners_m.len() > 8 && nearest_m > (1.0 - ROUNDNESS) * radius_m;
        Self { corners_m, radius_m, round }
    }

    /// Area, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        0.5 * edges(&self.corners_m).map(|(from, to)| from.coords.perp(&to.coords)).sum::<f64>()
    }

    /// Extent along the direction of `angle_rad`, m.
    #[must_use]
    pub fn width_m(&self, angle_rad: f64) -> f64 {
        let direction = Vector2::new(angle_rad.cos(), angle_rad.sin());
        let along = self.corners_m.iter().map(|corner| corner.coords.dot(&direction));
        let (least, most) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), x| (l.min(x), m.max(x)));
        most - least
    }

    /// Least and largest extent over all directions, m.
    #[must_use]
    pub fn width_range_m(&self) -> (f64, f64) {
        // The largest is the distance of two corners.
        let largest = self.corners_m.iter().flat_map(|a| self.corners_m.iter().map(move |b| (a - b).norm()));
        (self.across_edges().map(|(width_m, _)| width_m).fold(f64::INFINITY, f64::min), largest.fold(0.0, f64::max))
    }

    /// Least extent, m, and the direction along which it is that, from -π/2 to π/2 rad. A circle has its diameter along 0.
    #[must_use]
    pub fn narrowest(&self) -> (f64, f64) {
        if self.round {
            return (2.0 * self.radius_m, 0.0);
        }
        let (width_m, angle_rad) =
            self.across_edges().min_by(|(a, _), (b, _)| a.total_cmp(b)).unwrap_or((f64::INFINITY, 0.0));
        (width_m, angle_rad - PI * (angle_rad / PI).round())
    }

    /// Extents along the normals of the edges, m, with their directions, rad. One of them is the least extent.
    fn across_edges(&self) -> impl Iterator<Item = (f64, f64)> {
        edges(&self.corners_m).map(|(from, to)| {
            let along = to - from;
            let angle_rad = along.x.atan2(-along.y);
            (self.width_m(angle_rad), angle_rad)
        })
    }

    /// The corners where the part lies, m: turned and moved so.
    #[must_use]
    pub fn at(&self, lies: &Isometry2<f64>) -> Vec<Point2<f64>> {
        self.corners_m.iter().map(|corner| lies * corner).collect()
    }
}

/// The edges of a closed polygon.
pub(super) fn edges(corners: &[Point2<f64>]) -> impl Iterator<Item = (Point2<f64>, Point2<f64>)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Distance of the origin from the line through two points, positive if the origin lies to its left.
pub(super) fn distance_to_line(from: Point2<f64>, to: Point2<f64>) -> f64 {
    from.coords.perp(&to.coords) / (to - from).norm()
}

/// Convex hull by Andrew's monotone chain, counter-clockwise, without points on its edges.
fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let size = points.iter().map(|point| point.coords.norm()).fold(0.0, f64::max);
    // Corners nearer to the line of their neighbours than this, relative to the size, are none.
    let slack = 1e-9 * size * size;
    let chain = |sorted: &mut dyn Iterator<Item = Point2<f64>>| {
        let mut kept: Vec<Point2<f64>> = Vec::new();
        for point in sorted {
            while let [.., before, last] = kept[..] {
                if (last - before).perp(&(point - last)) > slack {
                    break;
                }
                kept.pop();
            }
            kept.push(point);
        }
        kept.pop();
        kept
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}
