//! Convex outlines, counter-clockwise: how far they are apart.

use nalgebra::{Point2, Vector2};

/// Free gap between two convex outlines, m; 0 where they overlap.
#[must_use]
pub fn gap_m(a: &[Point2<f64>], b: &[Point2<f64>]) -> f64 {
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
#[must_use]
pub fn distance_m(outline: &[Point2<f64>], point: &Point2<f64>) -> f64 {
    signed_distance_m(outline, point).max(0.0)
}

/// Distance of a point from a convex outline, m; inside it how far from its edge, below 0.
#[must_use]
pub fn signed_distance_m(outline: &[Point2<f64>], point: &Point2<f64>) -> f64 {
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
    if outside { nearest_m } else { -nearest_m }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A regular polygon, squeezed along y.
    fn outline(corners: u32, size: f64, squeeze: f64, middle: Point2<f64>) -> Vec<Point2<f64>> {
        let corner = |index: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(index) / f64::from(corners)).sin_cos();
            middle + Vector2::new(cos, squeeze * sin) * size
        };
        (0..corners).map(corner).collect()
    }

    proptest! {
        #[test]
        fn no_two_points_of_the_outlines_are_nearer_than_the_gap(
            corners in 3_u32..12, others in 3_u32..12, squeeze in 0.2..1.0_f64, x in 2.1..4.0_f64, y in -1.0..1.0_f64,
            share in 0.0..1.0_f64,
        ) {
            let a = outline(corners, 1.0, squeeze, Point2::origin());
            let b = outline(others, 1.0, 1.0, Point2::new(x, y));
            let gap = gap_m(&a, &b);
            for from in 0..a.len() {
                let on_a = a[from] + (a[(from + 1) % a.len()] - a[from]) * share;
                for to in 0..b.len() {
                    let on_b = b[to] + (b[(to + 1) % b.len()] - b[to]) * share;
                    prop_assert!(gap <= (on_a - on_b).norm() + 1e-12);
                }
            }
            prop_assert!(gap > 0.0 && gap <= x + y.abs());
        }
    }

    #[test]
    fn overlapping_outlines_have_no_gap() {
        let square = |x: f64, half: f64| outline(4, half, 1.0, Point2::new(x, 0.0));
        assert!(gap_m(&square(0.0, 1.0), &square(0.2, 0.1)) <= 0.0);
        assert!(gap_m(&square(0.0, 0.1), &square(0.2, 1.0)) <= 0.0);
        assert!((gap_m(&square(0.0, 1.0), &square(2.5, 1.0)) - 0.5).abs() < 1e-12);
    }
}
