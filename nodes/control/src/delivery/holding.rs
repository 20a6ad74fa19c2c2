//! How hard the courier may accelerate before friction lets go of a part.

use nalgebra::Vector2;

use feeder_model::mechanics::friction::{Affine, held_up_to_m_s2};
use feeder_model::mechanics::tray_forces::Incline;
use feeder_model::tray::{Surface, TrayGeometry};

/// Largest courier acceleration along the unit vector `direction_in_tray` at which a part at rest at `part_in_tray` (m)
/// stays at rest, m/s²; nothing if it slides even on a courier at rest.
///
/// Along the slope that is g tan(φ_f − φ) uphill and g tan(φ_f + φ) downhill, across it g cos φ √(μ² − tan² φ), on the
/// plateau μ g (from Quaid Eqs 24, 28, 29, corrected, with an acceleration of the courier and no rotation).
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
    let radius_m = part_in_tray.norm();
    let incline = match tray.surface(angle_rad) {
        Surface::Ramp => Incline::helix(tray.pitch_m_per_rad(), radius_m),
        Surface::Plateau => Incline::LEVEL,
    };
    let (sin_angle, cos_angle) = angle_rad.sin_cos();
    let outward = direction_in_tray.dot(&Vector2::new(cos_angle, sin_angle));
    let around = direction_in_tray.dot(&Vector2::new(-sin_angle, cos_angle));
    let (still, carried) = (incline.load(0.0, gravity_m_s2), incline.load(around, gravity_m_s2));
    let drive =
        Affine { at_zero: [0.0, still.along_m_s2], per_m_s2: [-outward, carried.along_m_s2 - still.along_m_s2] };
    let normal = Affine { at_zero: still.normal_m_s2, per_m_s2: carried.normal_m_s2 - still.normal_m_s2 };
    held_up_to_m_s2(friction, &drive, &normal)
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
