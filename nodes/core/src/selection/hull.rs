//! Convex outlines: which points make one, and how far two are apart.

use nalgebra::{Point2, Vector2};

/// The convex hull, counter-clockwise (Andrew's monotone chain).
pub(super) fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = &Point2<f64>>| {
        let mut chain: Vec<Point2<f64>> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp(&(point - b)) <= 0.0
            {
                chain.pop();
            }
            chain.push(*point);
        }
        // The last point begins the other half.
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter());
    hull.extend(half(&mut points.iter().rev()));
    hull
}

/// Free gap between two convex outlines, m; 0 where they overlap.
pub(super) fn gap_m(a: &[Point2<f64>], b: &[Point2<f64>]) -> f64 {
    let inside = |outline: &[Point2<f64>], points: &[Point2<f64>]| {
        points.first().is_some_and(|point| distance_m(outline, point) <= 0.0)
    };
    if inside(a, b) || inside(b, a) {
        return 0.0;
    }
    let to_corners = |outline: &[Point2<f64>], corners: &[Point2<f64>]| {
        corners.iter().map(|corner| distance_m(outline, corner)).fold(f64::INFINITY, f64::min)
    };
    to_corners(a, b).min(to_corners(b, a)).max(0.0)
}

/// Distance of a point from a convex outline, m; 0 inside.
pub(super) fn distance_m(outline: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    let mut outside = outline.len() < 3;
    let mut nearest_m = f64::INFINITY;
    for (index, from) in outline.iter().enumerate() {
        let to = outline[(index + 1) % outline.len()];
        let (along, beside): (Vector2<f64>, Vector2<f64>) = (to - from, point - from);
        outside |= along.perp(&beside) < 0.0;
        let square = along.norm_squared();
        let share = if square > 0.0 { (along.dot(&beside) / square).clamp(0.0, 1.0) } else { 0.0 };
        nearest_m = nearest_m.min((beside - along * share).norm());
    }
    if outside { nearest_m } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points() -> impl Strategy<Value = Vec<Point2<f64>>> {
        proptest::collection::vec((-1.0..1.0, -1.0..1.0).prop_map(|(x, y)| Point2::new(x, y)), 3..30)
    }

    proptest! {
        #[test]
        fn the_hull_holds_every_point_and_turns_left(points in points()) {
            let hull = convex_hull(points.clone());
            for point in &points {
                prop_assert!(distance_m(&hull, point) < 1e-12);
            }
            for index in 0..hull.len() {
                let at = |offset: usize| hull[(index + offset) % hull.len()];
                prop_assert!((at(1) - at(0)).perp(&(at(2) - at(1))) > 0.0);
            }
        }

        #[test]
        fn gaps_are_those_between_points_on_the_edges(points in points(), shift in 2.5..4.0_f64, share in 0.0..1.0_f64) {
            let a = convex_hull(points.clone());
            let b: Vec<_> = a.iter().map(|corner| corner + Vector2::new(shift, 0.3)).collect();
            let gap = gap_m(&a, &b);
            // No two points, one of either outline, are nearer.
            for from in 0..a.len() {
                let on_a = a[from] + (a[(from + 1) % a.len()] - a[from]) * share;
                for to in 0..b.len() {
                    let on_b = b[to] + (b[(to + 1) % b.len()] - b[to]) * share;
                    prop_assert!(gap <= (on_a - on_b).norm() + 1e-12);
                }
            }
            prop_assert!(gap > 0.0 && gap <= shift + 0.3);
        }
    }

    #[test]
    fn overlapping_outlines_have_no_gap() {
        let square = |x: f64, half: f64| {
            convex_hull(vec![
                Point2::new(x - half, -half),
                Point2::new(x + half, -half),
                Point2::new(x + half, half),
                Point2::new(x - half, half),
            ])
        };
        assert_eq!(gap_m(&square(0.0, 1.0), &square(0.2, 0.1)), 0.0);
        assert_eq!(gap_m(&square(0.0, 0.1), &square(0.2, 1.0)), 0.0);
        assert!((gap_m(&square(0.0, 1.0), &square(2.5, 1.0)) - 0.5).abs() < 1e-12);
    }
}
