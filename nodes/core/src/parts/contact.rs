//! Contact between parts: which pairs may touch, and what happens to those that do.

use super::track::Track;
use super::{Part, Place};

/// Overlap, as a share of the diameter, that is left uncorrected so that parts at rest against each other stay put.
const TOLERATED_OVERLAP: f64 = 0.002;

/// Overlap, as a share of the diameter, that no pair may exceed at the end of a block.
const LARGEST_OVERLAP: f64 = 0.01;

/// Sweeps over the touching pairs in one step.
const SWEEPS_PER_STEP: usize = 4;

/// Sweeps spent at the end of a block to push the last parts apart.
const SWEEPS_PER_BLOCK: usize = 100;

/// Distance, as a share of the diameter, up to which pairs are kept on the list beyond touching.
const LIST_MARGIN: f64 = 0.5;

/// How two parts touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactLaw {
    pub(super) restitution: f64,
    pub(super) friction: f64,
}

/// The pairs of parts that may touch. Storage is kept between steps, so that a step allocates nothing.
#[derive(Clone, Debug)]
pub(super) struct Contacts {
    law: ContactLaw,
    diameter_m: f64,
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
    pub(super) fn new(law: ContactLaw, diameter_m: f64) -> Self {
        Self { law, diameter_m, order: Vec::new(), near: Vec::new(), touching: Vec::new(), travel_m: f64::INFINITY }
    }

    /// Voids the list: parts came, went or changed place.
    pub(super) fn invalidate(&mut self) {
        self.travel_m = f64::INFINITY;
    }

    /// Resolves all contacts after a step in which no part moved by more than `travel_m`. Returns whether any part was
    /// shifted or hit.
    pub(super) fn resolve(&mut self, parts: &mut [Part], track: &Track, travel_m: f64) -> bool {
        self.travel_m += travel_m;
        self.find_touching(parts);
        let mut touched = false;
        for _ in 0..SWEEPS_PER_STEP {
            let sweep = self.sweep(parts, track, 0.5);
            if !sweep.collided && sweep.overlap_m <= TOLERATED_OVERLAP * self.diameter_m {
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
    pub(super) fn separate(&mut self, parts: &mut [Part], track: &Track) {
        for sweep_index in 0..SWEEPS_PER_BLOCK {
            self.find_touching(parts);
            let share_behind = if sweep_index % 2 == 0 { 0.5 } else { 0.0 };
            let sweep = self.sweep(parts, track, share_behind);
            if sweep.overlap_m <= LARGEST_OVERLAP * self.diameter_m {
                break;
            }
        }
    }

    fn find_touching(&mut self, parts: &[Part]) {
        self.refresh(parts);
        let touching_m2 = self.diameter_m * self.diameter_m;
        let touch = |&(behind, ahead): &(usize, usize)| {
            let other: &Part = &parts[ahead];
            parts[behind].squared_distance_m2(other.x_m, other.y_m) < touching_m2
        };
        self.touching.clear();
        self.touching.extend(self.near.iter().copied().filter(touch));
    }

    /// Resolves every touching pair once. Of the way two parts are pushed apart, the one behind takes `share_behind`.
    fn sweep(&mut self, parts: &mut [Part], track: &Track, share_behind: f64) -> Sweep {
        let mut sweep = Sweep::default();
        let tolerated_m = TOLERATED_OVERLAP * self.diameter_m;
        for &(behind, ahead) in &self.touching {
            let Ok([behind, ahead]) = parts.get_disjoint_mut([behind, ahead]) else {
                continue;
            };
            let (normal, distance_m) = line_of_centres(behind, ahead);
            let overlap_m = self.diameter_m - distance_m;
            if overlap_m <= 0.0 {
                continue;
            }
            sweep.collided |= collide(behind, ahead, normal, self.law);
            sweep.overlap_m = sweep.overlap_m.max(overlap_m);
            if overlap_m > tolerated_m {
                // To the middle of what is tolerated, lest rounding call for another shift.
                let shift_m = overlap_m - 0.5 * tolerated_m;
                let (back_m, on_m) = (share_behind * shift_m, (1.0 - share_behind) * shift_m);
                behind.x_m -= back_m * normal[0];
                behind.y_m -= back_m * normal[1];
                ahead.x_m += on_m * normal[0];
                ahead.y_m += on_m * normal[1];
                track.confine(behind);
                track.confine(ahead);
            }
        }
        // A part squeezed from several sides may be shifted more than once.
        self.travel_m += 2.0 * sweep.overlap_m;
        sweep
    }

    /// Makes the list anew if parts may have moved into touch unnoticed.
    fn refresh(&mut self, parts: &[Part]) {
        if 2.0 * self.travel_m < LIST_MARGIN * self.diameter_m {
            return;
        }
        let reach_m = (1.0 + LIST_MARGIN) * self.diameter_m;
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

/// Unit vector from the centre of one part to that of the other, and their distance, m.
fn line_of_centres(from: &Part, to: &Part) -> ([f64; 2], f64) {
    let apart = [to.x_m - from.x_m, to.y_m - from.y_m];
    let distance_m = (apart[0] * apart[0] + apart[1] * apart[1]).sqrt();
    let normal = if distance_m > 0.0 { apart.map(|component| component / distance_m) } else { [1.0, 0.0] };
    (normal, distance_m)
}

/// Impact of two equal masses with friction between them. Returns whether they approached each other.
fn collide(first: &mut Part, second: &mut Part, normal: [f64; 2], law: ContactLaw) -> bool {
    let relative = [second.velocity_x_m_s - first.velocity_x_m_s, second.velocity_y_m_s - first.velocity_y_m_s];
    let approach = -(relative[0] * normal[0] + relative[1] * normal[1]);
    if approach <= 0.0 {
        return false;
    }
    let along = relative[1] * normal[0] - relative[0] * normal[1];
    let impulse = 0.5 * (1.0 + law.restitution) * approach;
    let grip = law.friction * impulse;
    let lost = (0.5 * along).clamp(-grip, grip);
    let change = [impulse * normal[0] + lost * normal[1], impulse * normal[1] - lost * normal[0]];
    first.velocity_x_m_s -= change[0];
    first.velocity_y_m_s -= change[1];
    second.velocity_x_m_s += change[0];
    second.velocity_y_m_s += change[1];
    true
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::parts::tests::part_at;

    fn law(restitution: f64, friction: f64) -> ContactLaw {
        ContactLaw { restitution, friction }
    }

    fn moving(x_m: f64, y_m: f64, velocity: [f64; 2]) -> Part {
        Part { velocity_x_m_s: velocity[0], velocity_y_m_s: velocity[1], ..part_at(Place::Plateau, x_m, y_m) }
    }

    #[test]
    fn an_inelastic_impact_shares_the_velocity_along_the_line_of_centres() {
        let mut behind = moving(0.0, 0.0, [0.2, 0.1]);
        let mut ahead = moving(0.005, 0.0, [0.0, 0.0]);
        assert!(collide(&mut behind, &mut ahead, [1.0, 0.0], law(0.0, 0.0)));
        assert_eq!((behind.velocity_x_m_s, ahead.velocity_x_m_s), (0.1, 0.1));
        assert_eq!((behind.velocity_y_m_s, ahead.velocity_y_m_s), (0.1, 0.0));
        assert!(!collide(&mut behind, &mut ahead, [1.0, 0.0], law(0.0, 0.0)));
    }

    #[test]
    fn friction_between_parts_is_bounded_by_what_presses_them() {
        let mut behind = moving(0.0, 0.0, [0.2, 0.5]);
        let mut ahead = moving(0.005, 0.0, [0.0, 0.0]);
        collide(&mut behind, &mut ahead, [1.0, 0.0], law(0.0, 0.3));
        assert!((ahead.velocity_y_m_s - 0.3 * 0.1).abs() < 1e-15);
        // Great friction ends the sliding but does not reverse it.
        let mut behind = moving(0.0, 0.0, [0.2, 0.05]);
        let mut ahead = moving(0.005, 0.0, [0.0, 0.0]);
        collide(&mut behind, &mut ahead, [1.0, 0.0], law(0.0, 9.0));
        assert!((ahead.velocity_y_m_s - behind.velocity_y_m_s).abs() < 1e-15);
    }

    #[test]
    fn parts_above_each_other_at_the_drop_off_do_not_touch() {
        let mut contacts = Contacts::new(law(0.0, 0.0), 0.005);
        let below = part_at(Place::Ramp, 0.080, 0.0025);
        let above = part_at(Place::Plateau, 0.080, -0.001);
        contacts.find_touching(&[below, above]);
        assert!(contacts.touching.is_empty());
        let beside = part_at(Place::Ramp, 0.080, 0.007);
        contacts.invalidate();
        contacts.find_touching(&[beside, above, below]);
        assert_eq!(contacts.touching, [(2, 0)]);
    }

    proptest! {
        #[test]
        fn an_impact_keeps_momentum_and_adds_no_energy(
            velocities in prop::array::uniform4(-1.0..1.0_f64),
            angle in 0.0..std::f64::consts::TAU,
            restitution in 0.0..=1.0_f64,
            friction in 0.0..2.0_f64,
        ) {
            let [a, b, c, d] = velocities;
            let mut behind = moving(0.0, 0.0, [a, b]);
            let mut ahead = moving(0.0, 0.0, [c, d]);
            let total = |one: &Part, other: &Part| one.velocity_m_s() + other.velocity_m_s();
            let energy = |one: &Part, other: &Part| {
                one.velocity_m_s().norm_squared() + other.velocity_m_s().norm_squared()
            };
            let (momentum, before) = (total(&behind, &ahead), energy(&behind, &ahead));
            let normal = [angle.cos(), angle.sin()];
            collide(&mut behind, &mut ahead, normal, law(restitution, friction));
            prop_assert!((total(&behind, &ahead) - momentum).norm() < 1e-14);
            prop_assert!(energy(&behind, &ahead) <= before + 1e-14);
        }
    }
}
