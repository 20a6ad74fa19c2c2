//! How hard the courier may accelerate before friction lets go of a part.

use nalgebra::Vector2;

use feeder_model::tray::{Surface, TrayGeometry};

/// Largest courier acceleration along the unit vector `direction_in_tray` at which a part at rest at `part_in_tray` (m)
/// stays at rest, m/s²; nothing if it slides even on a courier at rest.
///
/// The sticking forces of Quaid Eqs 24, 28, 29 (corrected) with an acceleration a of the courier and no rotation ask for
/// (a u_r)² + (a u_ψ cos φ + g sin φ)² ≤ μ² (g cos φ − a u_ψ sin φ)². That is quadratic in a; along the slope its
/// solution is g tan(φ_f − φ) uphill and g tan(φ_f + φ) downhill, across it g cos φ √(μ² − tan² φ), on the plateau μ g.
/// The part is a point.
#[must_use]
pub fn holding_acceleration_m_s2(
    tray: &TrayGeometry,
    part_in_tray: &Vector2<f64>,
    direction_in_tray: &Vector2<f64>,
    friction: f64,
    gravity_m_s2: f64,
) -> Option<f64> {
    let angle_rad = part_in_tray.y.atan2(part_in_tray.x);
    let slope_rad = match tray.surface(angle_rad) {
        Surface::Ramp => tray.ramp_slope_rad(part_in_tray.norm()),
        Surface::Plateau => 0.0,
    };
    let (sin_angle, cos_angle) = angle_rad.sin_cos();
    let radial = direction_in_tray.dot(&Vector2::new(cos_angle, sin_angle));
    let along = direction_in_tray.dot(&Vector2::new(-sin_angle, cos_angle));
    let (sin, cos) = slope_rad.sin_cos();
    let square = radial * radial + along * along * (cos * cos - friction * friction * sin * sin);
    let linear = 2.0 * gravity_m_s2 * along * sin * cos * (1.0 + friction * friction);
    let constant = gravity_m_s2 * gravity_m_s2 * (sin * sin - friction * friction * cos * cos);
    if constant > 0.0 {
        return None;
    }
    // The smallest positive root of square a² + linear a + constant, in the form without cancellation.
    let discriminant = linear * linear - 4.0 * square * constant;
    let denominator = linear + discriminant.max(0.0).sqrt();
    let bounded = discriminant >= 0.0 && denominator > 0.0;
    Some(if bounded { -2.0 * constant / denominator } else { f64::INFINITY })
}

/// Points spread over the ramp at one radius, to stand for parts that cannot be seen there. Steeper is harder to hold, so
/// parts farther out are held if these are.
#[must_use]
pub fn ramp_parts(tray: &TrayGeometry, radius_m: f64) -> Vec<Vector2<f64>> {
    const INTERVALS: u32 = 36;
    (0..INTERVALS)
        .map(|index| {
            let angle_rad = tray.ramp_angle_rad * (f64::from(index) + 0.5) / f64::from(INTERVALS);
            Vector2::new(angle_rad.cos(), angle_rad.sin()) * radius_m
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: f64 = 9.81;

    #[test]
    fn verif_the_limits_along_and_across_the_slope_are_the_textbook_ones() {
        // Half way up the ramp, at ψ = 90°, uphill is -x.
        let tray = TrayGeometry::PAPER;
        for (radius_m, friction) in [(0.09_f64, 0.2_f64), (0.06, 0.15), (0.075, 0.3)] {
            let part = Vector2::new(0.0, radius_m);
            let slope_rad = tray.ramp_slope_rad(radius_m);
            let friction_rad = friction.atan();
            let held = |x, y| holding_acceleration_m_s2(&tray, &part, &Vector2::new(x, y), friction, G).unwrap();
            assert!((held(-1.0, 0.0) - G * (friction_rad - slope_rad).tan()).abs() < 1e-12);
            assert!((held(1.0, 0.0) - G * (friction_rad + slope_rad).tan()).abs() < 1e-12);
            let across = G * slope_rad.cos() * (friction.powi(2) - slope_rad.tan().powi(2)).sqrt();
            assert!((held(0.0, 1.0) - across).abs() < 1e-12);
            let part = Vector2::new(0.0, -radius_m);
            let flat = holding_acceleration_m_s2(&tray, &part, &Vector2::new(0.6, 0.8), friction, G).unwrap();
            assert!((flat - friction * G).abs() < 1e-12);
        }
    }

    #[test]
    fn verif_nothing_holds_a_part_inside_31_8_mm_at_friction_0_2() {
        let tray = TrayGeometry::PAPER;
        let held =
            |radius_m| holding_acceleration_m_s2(&tray, &Vector2::new(0.0, radius_m), &Vector2::x(), 0.2, G).is_some();
        assert!(!held(0.0318) && held(0.0319));
    }

    #[test]
    fn the_outermost_parts_are_held_best() {
        let tray = TrayGeometry::PAPER;
        let weakest = |radius_m| {
            ramp_parts(&tray, radius_m)
                .iter()
                .filter_map(|part| holding_acceleration_m_s2(&tray, part, &Vector2::y(), 0.2, G))
                .fold(f64::INFINITY, f64::min)
        };
        assert!(weakest(0.05) < weakest(0.07) && weakest(0.07) < weakest(0.09));
    }
}
