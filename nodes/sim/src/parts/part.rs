//! One part on the tray, as the rest of the feeder may see it.

use std::f64::consts::TAU;

use feeder_model::tray::Place;
use nalgebra::Vector2;

/// State of one part in the tray frame. Velocities are horizontal and relative to the tray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Identity, unique within a bulk and never used twice.
    pub id: u32,
    /// Where it is.
    pub place: Place,
    /// Index into the stable poses of its type.
    pub pose: usize,
    /// Centre of mass along the tray's x, m.
    pub x_m: f64,
    /// Centre of mass along the tray's y, m.
    pub y_m: f64,
    /// Heading in the tray frame, rad.
    pub yaw_rad: f64,
    /// Velocity along the tray's x, m/s.
    pub velocity_x_m_s: f64,
    /// Velocity along the tray's y, m/s.
    pub velocity_y_m_s: f64,
    /// Turning rate relative to the tray, counter-clockwise positive, rad/s.
    pub yaw_rate_rad_s: f64,
    /// On the ramp, outside the critical radius, and kept from climbing by others.
    pub blocked: bool,
    /// On the ramp, inside the critical radius, and not climbing.
    pub stranded: bool,
    /// Whether this lap's entry to the plateau has been counted.
    pub(super) fed: bool,
    /// While falling: time until it looks for a place to land, s.
    pub(super) landing_in_s: f64,
    /// While falling: how long it has waited for room to land, s.
    pub(super) waited_s: f64,
    /// Angle ψ when its climbing was last judged, rad.
    pub(super) judged_angle_rad: f64,
}

impl Part {
    /// A part at rest, not yet anywhere.
    pub(super) fn at_rest(place: Place, pose: usize, yaw_rad: f64) -> Self {
        Self {
            id: 0,
            place,
            pose,
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad,
            velocity_x_m_s: 0.0,
            velocity_y_m_s: 0.0,
            yaw_rate_rad_s: 0.0,
            blocked: false,
            stranded: false,
            fed: false,
            landing_in_s: 0.0,
            waited_s: 0.0,
            judged_angle_rad: 0.0,
        }
    }

    /// Centre in the tray frame, m.
    #[must_use]
    pub fn position_m(&self) -> Vector2<f64> {
        Vector2::new(self.x_m, self.y_m)
    }

    /// Horizontal velocity relative to the tray, in tray axes, m/s.
    #[must_use]
    pub fn velocity_m_s(&self) -> Vector2<f64> {
        Vector2::new(self.velocity_x_m_s, self.velocity_y_m_s)
    }

    /// Distance r of the centre from the tray's axis, m.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.position_m().norm()
    }

    /// Angle ψ of the centre, counter-clockwise from the foot of the ramp, in \[0, 2π).
    #[must_use]
    pub fn angle_rad(&self) -> f64 {
        let angle_rad = self.y_m.atan2(self.x_m).rem_euclid(TAU);
        // rem_euclid of a tiny negative angle rounds to 2π itself.
        if angle_rad < TAU { angle_rad } else { 0.0 }
    }

    /// Velocity ṙ away from the tray's axis, m/s.
    #[must_use]
    pub fn radial_velocity_m_s(&self) -> f64 {
        self.velocity_m_s().dot(&self.position_m()) / self.radius_m()
    }

    /// Horizontal velocity r ψ̇ around the tray's axis, counter-clockwise positive, m/s.
    #[must_use]
    pub fn tangential_velocity_m_s(&self) -> f64 {
        self.position_m().perp(&self.velocity_m_s()) / self.radius_m()
    }

    /// Whether the part rests on the tray without sliding: its relative velocity is exactly zero.
    #[must_use]
    pub fn is_sticking(&self) -> bool {
        self.place != Place::Falling && !self.is_moving()
    }

    pub(super) fn is_moving(&self) -> bool {
        self.velocity_x_m_s != 0.0 || self.velocity_y_m_s != 0.0 || self.yaw_rate_rad_s != 0.0
    }

    pub(super) fn squared_distance_m2(&self, x_m: f64, y_m: f64) -> f64 {
        (self.x_m - x_m).powi(2) + (self.y_m - y_m).powi(2)
    }
}

/// A part that has been taken off the tray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PickedPart {
    /// Its identity.
    pub id: u32,
    /// Index into the stable poses of its type.
    pub pose: usize,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::tests::part_at;

    #[test]
    fn polar_view_agrees_with_cartesian() {
        let part = Part { velocity_x_m_s: 0.03, velocity_y_m_s: -0.04, ..part_at(Place::Plateau, 0.0, -0.08) };
        assert!((part.radius_m() - 0.08).abs() < 1e-15);
        assert!((part.angle_rad() - 1.5 * std::f64::consts::PI).abs() < 1e-15);
        assert!((part.radial_velocity_m_s() - 0.04).abs() < 1e-15);
        assert!((part.tangential_velocity_m_s() - 0.03).abs() < 1e-15);
        assert!(!part.is_sticking());
    }

    #[test]
    fn the_angle_stays_below_a_full_turn() {
        assert!(part_at(Place::Plateau, 0.08, -1e-19).angle_rad() < TAU);
    }
}
