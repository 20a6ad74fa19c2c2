//! Contact between parts: which pairs may touch, and what happens to those that do.

use super::impulse::{ContactLaw, collide};
use super::touch::{Scratch, touch};
use super::track::TrayPath;
use super::{Part, Place};

/// Overlap, as a share of the least width of a part, that is left uncorrected so that parts at rest against each other stay put.
const TOLERATED_OVERLAP: f64 = 0.002;

/// Overlap, as a share of the least width of a part, that no pair may exceed at the end of a block.
const LARGEST_OVERLAP: f64 = 0.01;

/// Sweeps over the touching pairs in one step.
const SWEEPS_PER_STEP: usize = 4;

/// Sweeps spent at the end of a block to push the last parts apart.
const SWEEPS_PER_BLOCK: usize = 400;

/// Distance, as a share of the least width of a part, up to which pairs are kept on the list beyond touching.
const LIST_MARGIN: f64 = 0.5;

/// The pairs of parts that may touch. Storage is kept between steps, so that a step allocates nothing.
#[derive(Clone, Debug)]
pub(super) struct Contacts {
    law: ContactLaw,
    /// Least width of a part, m.
    width_m: f64,
    /// Largest radius of a part, m.
    radius_m: f64,
    scratch: Scratch,
    /// Angle and index of each part on a surface, sorted.
    order: Vec<(f64, usize)>,
    /// Pairs near each other, in the order of ψ: the part behind, the part ahead.
    near: Vec<(usize, usize)>,
    /// Those that touch in this step.
    touching: Vec<(usize, usize)>,
    /// How far any part may have moved since `near` was made, m; infinite if it is void.
    travel_m: f64,
}

/// What a sweep met.
#[derive(Clone, Copy, Debug, Default)]
struct Sweep {
    /// Deepest overlap found, m.
    overlap_m: f64,
    /// Whether any velocity was changed.
    collided: bool,
}

impl Contacts {
    /// For parts of least width `width_m` whose points are at most `radius_m` from their centres.
    pub(super) fn new(law: ContactLaw, width_m: f64, radius_m: f64) -> Self {
        Self {
            law,
            width_m,
            radius_m,
            scratch: Scratch::default(),
            order: Vec::new(),
            near: Vec::new(),
            touching: Vec::new(),
            travel_m: f64::INFINITY,
        }
    }

    /// Voids the list: parts came, went or changed place.
    pub(super) fn invalidate(&mut self) {
        self.travel_m = f64::INFINITY;
    }

    /// Resolves all contacts after a step in which no part moved by more than `travel_m`. Returns whether any part was
    /// shifted or hit.
    pub(super) fn resolve(&mut self, parts: &mut [Part], track: &TrayPath, travel_m: f64) -> bool {
        self.travel_m += travel_m;
        self.find_touching(parts, track);
        let mut touched = false;
        for _ in 0..SWEEPS_PER_STEP {
            let sweep = self.sweep(parts, track, 0.5);
            if !sweep.collided && sweep.overlap_m <= TOLERATED_OVERLAP * self.width_m {
                break;
            }
            touched = true;
        }
        touched
    }

    /// Pushes parts apart until no pair overlaps by more than [`LARGEST_OVERLAP`].
    ///
    /// Every other sweep makes the part ahead give way to the one behind: as the pairs are in the order of ψ, a queue
    /// jammed against the drop-off's face opens in one such sweep, instead of as many as the square of its length.
    pub(super) fn separate(&mut self, parts: &mut [Part], track: &TrayPath) {
        for sweep_index in 0..SWEEPS_PER_BLOCK {
            self.find_touching(parts, track);
            let share_behind = if sweep_index % 2 == 0 { 0.5 } else { 0.0 };
            let sweep = self.sweep(parts, track, share_behind);
            if sweep.overlap_m <= LARGEST_OVERLAP * self.width_m {
                break;
            }
        }
    }

    /// Lists the pairs near enough to touch, whichever way they are turned.
    fn find_touching(&mut self, parts: &[Part], track: &TrayPath) {
        self.refresh(parts);
        let touch = |&(behind, ahead): &(usize, usize)| {
            let (one, other): (&Part, &Part) = (&parts[behind], &parts[ahead]);
            let reach_m = track.body(one).radius_m + track.body(other).radius_m;
            one.squared_distance_m2(other.x_m, other.y_m) < reach_m * reach_m
        };
        self.touching.clear();
        self.touching.extend(self.near.iter().copied().filter(touch));
    }

    /// Resolves every touching pair once. Of the way two parts are pushed apart, the one behind takes `share_behind`.
    fn sweep(&mut self, parts: &mut [Part], track: &TrayPath, share_behind: f64) -> Sweep {
        let mut sweep = Sweep::default();
        let tolerated_m = TOLERATED_OVERLAP * self.width_m;
        for &(behind, ahead) in &self.touching {
            let Ok([behind, ahead]) = parts.get_disjoint_mut([behind, ahead]) else {
                continue;
            };
            let (body_behind, body_ahead) = (track.body(behind), track.body(ahead));
            let Some(touch) = touch((body_behind, behind), (body_ahead, ahead), &mut self.scratch) else {
                continue;
            };
            for &point in touch.points() {
                let (one, other) = ((body_behind, &mut *behind), (body_ahead, &mut *ahead));
                sweep.collided |= collide(one, other, touch.normal, point, self.law);
            }
            sweep.overlap_m = sweep.overlap_m.max(touch.depth_m);
            if touch.depth_m > tolerated_m {
                // To the middle of what is tolerated, lest rounding call for another shift.
                let shift_m = touch.depth_m - 0.5 * tolerated_m;
                let (back_m, on_m) = (share_behind * shift_m, (1.0 - share_behind) * shift_m);
                behind.x_m -= back_m * touch.normal[0];
                behind.y_m -= back_m * touch.normal[1];
                ahead.x_m += on_m * touch.normal[0];
                ahead.y_m += on_m * touch.normal[1];
                track.confine(behind, &mut self.scratch);
                track.confine(ahead, &mut self.scratch);
            }
        }
        // A part squeezed from several sides may be shifted more than once.
        self.travel_m += 2.0 * sweep.overlap_m;
        sweep
    }

    /// Makes the list anew if parts may have moved into touch unnoticed.
    fn refresh(&mut self, parts: &[Part]) {
        if 2.0 * self.travel_m < LIST_MARGIN * self.width_m {
            return;
        }
        let reach_m = 2.0 * self.radius_m + LIST_MARGIN * self.width_m;
        self.order.clear();
        let on_surface = parts.iter().enumerate().filter(|(_, part)| part.place != Place::Falling);
        self.order.extend(on_surface.map(|(index, part)| (part.angle_rad(), index)));
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.near.clear();
        for (position, &(angle_rad, i)) in self.order.iter().enumerate() {
            // Nothing beyond this angle is within reach. The list does not wrap round at 2π, where the drop-off keeps
            // the parts above from those below.
            let radius_m = parts[i].radius_m();
            let window_rad = if reach_m < radius_m { (reach_m / radius_m).asin() } else { f64::INFINITY };
            for &(other_rad, j) in &self.order[position + 1..] {
                if other_rad - angle_rad > window_rad {
                    break;
                }
                let squared = parts[i].squared_distance_m2(parts[j].x_m, parts[j].y_m);
                if squared < reach_m * reach_m {
                    self.near.push((i, j));
                }
            }
        }
        self.travel_m = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::tests::{disc, part_at, track};

    #[test]
    fn parts_above_each_other_at_the_drop_off_do_not_touch() {
        let track = track(&disc(0.005, 0.2));
        let mut contacts = Contacts::new(ContactLaw { restitution: 0.0, friction: 0.0 }, 0.005, 0.0025);
        let below = part_at(Place::Ramp, 0.080, 0.0025);
        let above = part_at(Place::Plateau, 0.080, -0.001);
        contacts.find_touching(&[below, above], &track);
        assert!(contacts.touching.is_empty());
        let beside = part_at(Place::Ramp, 0.080, 0.007);
        contacts.invalidate();
        contacts.find_touching(&[beside, above, below], &track);
        assert_eq!(contacts.touching, [(2, 0)]);
    }
}
