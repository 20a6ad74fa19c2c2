//! The walls of the tray and the face of the drop-off: what they stop, parts do not pass.

use std::ops::RangeInclusive;

use super::body::Body;
use super::impulse::{ContactLaw, bounce};
use super::touch::{Scratch, touch_fixed_disc};
use crate::parts::{BulkSettings, Part, Place};
use feeder_model::tray::TrayGeometry;

/// Rounds in which a part is kept off walls and face: courier motions call for two, whatever is far beyond both for more.
const CONFINING_ROUNDS: usize = 32;

/// The two walls, and the face of the drop-off between them.
#[derive(Clone, Debug)]
pub(super) struct Walls {
    inner_m: f64,
    outer_m: f64,
    law: ContactLaw,
}

impl Walls {
    pub(super) fn new(tray: &TrayGeometry, settings: &BulkSettings) -> Self {
        Self {
            inner_m: tray.inner_radius_m,
            outer_m: tray.outer_radius_m,
            law: ContactLaw { restitution: settings.wall_restitution, friction: settings.wall_friction },
        }
    }

    /// Distances from the tray's axis at which the centre of a body may be whichever way it is turned, m.
    pub(super) fn centres_m(&self, body: &Body) -> RangeInclusive<f64> {
        self.inner_m + body.radius_m..=self.outer_m - body.radius_m
    }

    /// Keeps a part between the walls and, on the ramp, in front of the drop-off's face.
    pub(super) fn confine(&self, part: &mut Part, body: &Body, scratch: &mut Scratch) {
        for _ in 0..CONFINING_ROUNDS {
            self.keep_between_the_walls(part, body, scratch);
            let near_the_face = part.place == Place::Ramp && part.x_m > 0.0 && part.y_m < body.radius_m;
            // Where the face meets a wall, moving a part off one moves it a little into the other.
            if !(near_the_face && self.keep_off_the_face(part, body)) {
                return;
            }
        }
    }

    fn keep_between_the_walls(&self, part: &mut Part, body: &Body, scratch: &mut Scratch) {
        let squared = part.x_m * part.x_m + part.y_m * part.y_m;
        let (outermost_m, innermost_m) = (self.outer_m - body.radius_m, self.inner_m + body.radius_m);
        if squared > outermost_m * outermost_m {
            self.keep_inside_the_outer_wall(part, body);
        } else if squared < innermost_m * innermost_m {
            self.keep_outside_the_inner_wall(part, body, scratch);
        }
    }

    /// Tells whether the part was moved.
    fn keep_off_the_face(&self, part: &mut Part, body: &Body) -> bool {
        let corners = corners(body, part);
        let lowest = corners.min_by(|a, b| a[1].total_cmp(&b[1])).unwrap_or([part.x_m, part.y_m - body.radius_m]);
        if lowest[1] >= 0.0 {
            return false;
        }
        part.y_m -= lowest[1];
        bounce(body, part, [0.0, 1.0], [lowest[0], 0.0], self.law);
        true
    }

    fn keep_inside_the_outer_wall(&self, part: &mut Part, body: &Body) {
        if body.is_round() {
            let r = part.radius_m();
            let (out_x, out_y) = (part.x_m / r, part.y_m / r);
            let outermost_m = self.outer_m - body.radius_m;
            (part.x_m, part.y_m) = (out_x * outermost_m, out_y * outermost_m);
            let point = [out_x * self.outer_m, out_y * self.outer_m];
            bounce(body, part, [-out_x, -out_y], point, self.law);
            return;
        }
        // Once for each corner that may be beyond; moving the part in over one corner may move another out.
        for _ in 0..body.corners.len() {
            let squared = |corner: &[f64; 2]| corner[0] * corner[0] + corner[1] * corner[1];
            let farthest = corners(body, part).max_by(|a, b| squared(a).total_cmp(&squared(b)));
            let Some(corner) = farthest.filter(|corner| squared(corner) > self.outer_m * self.outer_m) else {
                return;
            };
            let r = squared(&corner).sqrt();
            let out = [corner[0] / r, corner[1] / r];
            part.x_m -= (r - self.outer_m) * out[0];
            part.y_m -= (r - self.outer_m) * out[1];
            let point = [out[0] * self.outer_m, out[1] * self.outer_m];
            bounce(body, part, [-out[0], -out[1]], point, self.law);
        }
    }

    fn keep_outside_the_inner_wall(&self, part: &mut Part, body: &Body, scratch: &mut Scratch) {
        if body.is_round() {
            let r = part.radius_m();
            let (out_x, out_y) = if r > 0.0 { (part.x_m / r, part.y_m / r) } else { (1.0, 0.0) };
            let innermost_m = self.inner_m + body.radius_m;
            (part.x_m, part.y_m) = (out_x * innermost_m, out_y * innermost_m);
            let point = [out_x * self.inner_m, out_y * self.inner_m];
            bounce(body, part, [out_x, out_y], point, self.law);
        } else if let Some(touch) = touch_fixed_disc((body, part), [0.0, 0.0], self.inner_m, scratch) {
            let out = touch.normal.map(|component| -component);
            part.x_m += touch.depth_m * out[0];
            part.y_m += touch.depth_m * out[1];
            for &point in touch.points() {
                bounce(body, part, out, point, self.law);
            }
        }
    }
}

/// The corners of a part where it is, m.
fn corners<'a>(body: &'a Body, part: &Part) -> impl Iterator<Item = [f64; 2]> + use<'a> {
    let (sin, cos) = part.yaw_rad.sin_cos();
    let (x, y) = (part.x_m, part.y_m);
    body.corners
        .iter()
        .map(move |corner| [x + cos * corner[0] - sin * corner[1], y + sin * corner[0] + cos * corner[1]])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::sync::LazyLock;

    use nalgebra::Vector2;
    use proptest::prelude::*;

    use super::*;
    use crate::parts::tests::{block, disc, part_at, track as track_of};
    use crate::parts::track::TrayPath;

    static DISCS: LazyLock<TrayPath> = LazyLock::new(|| track_of(&disc(0.006, 0.2)));
    static BLOCKS: LazyLock<TrayPath> = LazyLock::new(|| track_of(&block(0.006, 0.004, 0.003)));

    #[test]
    fn walls_and_face_stop_parts_with_friction() {
        // wall_restitution 0.1 and wall_friction 0.2: an impact at 1 m/s may take 1.1 × 0.2 m/s off the speed along the
        // wall, but a disc that slides at 0.5 m/s rolls along it at a third less.
        let outward = Part { velocity_x_m_s: 1.0, velocity_y_m_s: -0.5, ..part_at(Place::Plateau, 0.0875, 0.0) };
        let inward = Part { velocity_x_m_s: -1.0, ..part_at(Place::Plateau, 0.0325, 0.0) };
        let against_the_face = Part { velocity_x_m_s: 0.1, velocity_y_m_s: -1.0, ..part_at(Place::Ramp, 0.060, 0.001) };
        for (mut part, x_m, y_m, velocity) in [
            (outward, 0.087, 0.0, [-0.1, -1.0 / 3.0]),
            (inward, 0.033, 0.0, [0.1, 0.0]),
            (against_the_face, 0.060, 0.003, [0.2 / 3.0, 0.1]),
        ] {
            DISCS.confine(&mut part, &mut Scratch::default());
            assert!((part.position_m() - Vector2::new(x_m, y_m)).norm() < 1e-12);
            let left = part.velocity_m_s() - Vector2::from(velocity);
            // A disc is drawn with 64 sides.
            assert!(left.norm() < 5e-4, "{:?}", part.velocity_m_s());
        }
    }

    proptest! {
        #[test]
        fn walls_add_no_energy(
            radius_m in 0.020..0.100_f64,
            angle_rad in 0.0..std::f64::consts::TAU,
            yaw_rad in -PI..PI,
            velocity in prop::array::uniform2(-1.0..1.0_f64),
            yaw_rate_rad_s in -100.0..100.0_f64,
            round in any::<bool>(),
        ) {
            let track: &TrayPath = if round { &DISCS } else { &BLOCKS };
            let place = Place::from(TrayGeometry::PAPER.surface(angle_rad));
            let mut part = Part {
                yaw_rad,
                velocity_x_m_s: velocity[0],
                velocity_y_m_s: velocity[1],
                yaw_rate_rad_s,
                ..part_at(place, radius_m * angle_rad.cos(), radius_m * angle_rad.sin())
            };
            let gyration_m = track.body(&part).gyration_m;
            let energy = |part: &Part| part.velocity_m_s().norm_squared() + (gyration_m * part.yaw_rate_rad_s).powi(2);
            let before = energy(&part);
            track.confine(&mut part, &mut Scratch::default());
            prop_assert!(energy(&part) <= before + 1e-14);
            // What is confined is confined.
            prop_assert!(track.is_inside(&part, 1e-5), "{part:?}");
        }
    }
}
