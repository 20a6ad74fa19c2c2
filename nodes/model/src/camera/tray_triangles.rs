//! The tray as triangles, for whoever draws it.

use std::f64::consts::TAU;

use nalgebra::Point3;

use super::MountedTray;

/// Steps up the ramp, and as many along the plateau.
const STEPS: u32 = 36;

impl MountedTray {
    /// Running surface, drop-off, the outer wall up to the surface and the hub, in the tray's frame, m; each triangle
    /// counter-clockwise seen from outside. The outer wall above the running surface is left out: it would hide the ramp.
    #[must_use]
    pub fn triangles(&self) -> Vec<[Point3<f64>; 3]> {
        let g = self.geometry;
        let (hub_m, rim_m) = (g.inner_radius_m, g.outer_radius_m + self.wall_thickness_m);
        let top_m = g.rise_m + self.lip_m;
        let mut triangles = Vec::new();
        for surface in [(0.0, g.ramp_angle_rad, 0.0), (g.ramp_angle_rad, TAU, g.rise_m)] {
            let (start_rad, end_rad, start_m) = surface;
            for step in 0..STEPS {
                let share = |step: u32| f64::from(step) / f64::from(STEPS);
                let angle_rad = |step| start_rad + share(step) * (end_rad - start_rad);
                let height_m = |step| start_m + share(step) * (g.rise_m - start_m);
                let [(from, low_m), (to, high_m)] = [step, step + 1].map(|step| (angle_rad(step), height_m(step)));
                let track =
                    [at(hub_m, from, low_m), at(rim_m, from, low_m), at(rim_m, to, high_m), at(hub_m, to, high_m)];
                let wall = [at(rim_m, from, 0.0), at(rim_m, to, 0.0), at(rim_m, to, high_m), at(rim_m, from, low_m)];
                let hub = [at(hub_m, from, low_m), at(hub_m, to, high_m), at(hub_m, to, top_m), at(hub_m, from, top_m)];
                triangles.extend([track, wall, hub].into_iter().flat_map(halves));
                triangles.push([Point3::new(0.0, 0.0, top_m), at(hub_m, from, top_m), at(hub_m, to, top_m)]);
            }
        }
        let drop_off = [at(rim_m, 0.0, 0.0), at(hub_m, 0.0, 0.0), at(hub_m, 0.0, g.rise_m), at(rim_m, 0.0, g.rise_m)];
        triangles.extend(halves(drop_off));
        // The wall begins without height.
        triangles.retain(|[a, b, c]| (b - a).cross(&(c - a)).norm() > 0.0);
        triangles
    }
}

fn at(radius_m: f64, angle_rad: f64, height_m: f64) -> Point3<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Point3::new(radius_m * cos, radius_m * sin, height_m)
}

fn halves([a, b, c, d]: [Point3<f64>; 4]) -> [[Point3<f64>; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tray::TrayGeometry;

    #[test]
    fn the_triangles_lie_on_the_tray_and_look_outwards() {
        let tray = MountedTray::new(TrayGeometry::PAPER);
        let (g, top_m) = (tray.geometry, tray.geometry.rise_m + tray.lip_m);
        let mut track_m2 = 0.0;
        for [a, b, c] in tray.triangles() {
            let normal = (b - a).cross(&(c - a));
            let middle = (a.coords + b.coords + c.coords) / 3.0;
            let is_track = normal.z > 0.5 * normal.norm() && middle.z < g.rise_m + 1e-9;
            let outwards = normal.x * middle.x + normal.y * middle.y;
            let is_drop_off = middle.y.abs() < 1e-9 && normal.y > 0.99 * normal.norm();
            assert!(is_track || middle.z > top_m - 1e-9 && normal.z > 0.0 || outwards > 0.0 || is_drop_off, "{middle}");
            for corner in [a, b, c].iter().filter(|_| is_track) {
                let surface_m = g.height_m(corner.y.atan2(corner.x).rem_euclid(TAU));
                let at_drop_off = corner.y.abs() < 1e-9 && corner.x > 0.0;
                assert!(at_drop_off || (corner.z - surface_m).abs() < 1e-6, "{corner}");
            }
            track_m2 += if is_track { 0.5 * normal.z } else { 0.0 };
        }
        let rim_m = g.outer_radius_m + tray.wall_thickness_m;
        let ring_m2 = std::f64::consts::PI * (rim_m.powi(2) - g.inner_radius_m.powi(2));
        // A polygon of 72 corners covers 0.13 % less than its circle.
        assert!((track_m2 / ring_m2 - 1.0).abs() < 2e-3, "{track_m2} m² instead of {ring_m2} m²");
    }
}
