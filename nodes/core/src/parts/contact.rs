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

/// Sweeps, of those at the end of a block, that push both parts of a pair alike. In the others the part ahead gives way
/// to the one behind: as pairs are in the order of ψ, a queue jammed against the drop-off's face opens in one sweep
/// instead of as many as the square of its length.
const EVEN_SWEEPS: usize = 10;

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
    pairs: Vec<(usize, usize)>,
    /// How far any part may have moved since the list was made, m; infinite if the list is void.
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
        Self {
            law,
            diameter_m,
            order: Vec::new(),
            pairs: Vec::new(),
            travel_m: f64::INFINITY,
        }
    }

    /// Voids the list: parts came, went or changed place.
    pub(super) fn invalidate(&mut self) {
        self.travel_m = f64::INFINITY;
    }

    /// Resolves all contacts after a step in which no part moved by more than `travel_m`. Returns whether anything was
    /// moved or hit.
    pub(super) fn resolve(&mut self, parts: &mut [Part], track: &Track, travel_m: f64) -> bool {
        self.travel_m += travel_m;
        let mut touched = false;
        for sweep_index in 0..SWEEPS_PER_STEP {
            self.refresh(parts);
            // A bounce is one event; what follows within the step only keeps the parts from approaching.
            let restitution = if sweep_index == 0 {
                self.law.restitution
            } else {
                0.0
            };
            let sweep = self.sweep(parts, track, restitution, 0.5);
            let overlapping = sweep.overlap_m > TOLERATED_OVERLAP * self.diameter_m;
            if !overlapping && !sweep.collided {
                break;
            }
            touched = true;
        }
        touched
    }

    /// Pushes parts apart until no pair overlaps by more than [`LARGEST_OVERLAP`].
    pub(super) fn separate(&mut self, parts: &mut [Part], track: &Track) {
        for sweep_index in 0..SWEEPS_PER_BLOCK {
            self.refresh(parts);
            let share_behind = if sweep_index < EVEN_SWEEPS { 0.5 } else { 0.0 };
            let sweep = self.sweep(parts, track, 0.0, share_behind);
            if sweep.overlap_m <= LARGEST_OVERLAP * self.diameter_m {
                break;
            }
        }
    }

    /// Resolves every touching pair once. Of the way two parts are pushed apart, the one behind takes `share_behind`.
    fn sweep(
        &mut self,
        parts: &mut [Part],
        track: &Track,
        restitution: f64,
        share_behind: f64,
    ) -> Sweep {
        let mut sweep = Sweep::default();
        let touching_m2 = self.diameter_m * self.diameter_m;
        let tolerated_m = TOLERATED_OVERLAP * self.diameter_m;
        for &(i, j) in &self.pairs {
            if parts[i].squared_distance_m2(parts[j].x_m, parts[j].y_m) >= touching_m2 {
                continue;
            }
            let Ok([first, second]) = parts.get_disjoint_mut([i, j]) else {
                continue;
            };
            let (normal, overlap_m) = self.geometry(first, second);
            sweep.collided |= collide(first, second, normal, restitution, self.law.friction);
            sweep.overlap_m = sweep.overlap_m.max(overlap_m);
            if overlap_m > tolerated_m {
                let behind_m = share_behind * (overlap_m - tolerated_m);
                let ahead_m = (1.0 - share_behind) * (overlap_m - tolerated_m);
                first.x_m -= behind_m * normal[0];
                first.y_m -= behind_m * normal[1];
                second.x_m += ahead_m * normal[0];
                second.y_m += ahead_m * normal[1];
                track.confine(first);
                track.confine(second);
            }
        }
        // A part squeezed from several sides may be shifted more than once.
        self.travel_m += 2.0 * sweep.overlap_m;
        sweep
    }

    /// Unit normal from the first part to the second, and how deep they overlap.
    fn geometry(&self, first: &Part, second: &Part) -> ([f64; 2], f64) {
        let apart = [second.x_m - first.x_m, second.y_m - first.y_m];
        let distance_m = (apart[0] * apart[0] + apart[1] * apart[1]).sqrt();
        let normal = if distance_m > 0.0 {
            apart.map(|component| component / distance_m)
        } else {
            [1.0, 0.0]
        };
        (normal, self.diameter_m - distance_m)
    }

    /// Makes the list anew if parts may have moved into touch unnoticed.
    fn refresh(&mut self, parts: &[Part]) {
        if 2.0 * self.travel_m < LIST_MARGIN * self.diameter_m {
            return;
        }
        let reach_m = (1.0 + LIST_MARGIN) * self.diameter_m;
        self.order.clear();
        let on_surface = parts
            .iter()
            .enumerate()
            .filter(|(_, part)| part.place != Place::Falling);
        self.order
            .extend(on_surface.map(|(index, part)| (part.angle_rad(), index)));
        self.order
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.pairs.clear();
        for (position, &(angle_rad, i)) in self.order.iter().enumerate() {
            // Nothing beyond this angle is within reach. The list does not wrap round at 2π, where the drop-off keeps
            // the parts above from those below.
            let radius_m = parts[i].radius_m();
            let window_rad = if reach_m < radius_m {
                (reach_m / radius_m).asin()
            } else {
                f64::INFINITY
            };
            for &(other_rad, j) in &self.order[position + 1..] {
                if other_rad - angle_rad > window_rad {
                    break;
                }
                let squared = parts[i].squared_distance_m2(parts[j].x_m, parts[j].y_m);
                if squared < reach_m * reach_m {
                    self.pairs.push((i, j));
                }
            }
        }
        self.travel_m = 0.0;
    }
}

/// Impact of two equal masses with friction between them. Returns whether they approached each other.
fn collide(
    first: &mut Part,
    second: &mut Part,
    normal: [f64; 2],
    restitution: f64,
    friction: f64,
) -> bool {
    let relative = [
        second.velocity_x_m_s - first.velocity_x_m_s,
        second.velocity_y_m_s - first.velocity_y_m_s,
    ];
    let approach = -(relative[0] * normal[0] + relative[1] * normal[1]);
    if approach <= 0.0 {
        return false;
    }
    let along = relative[1] * normal[0] - relative[0] * normal[1];
    let impulse = 0.5 * (1.0 + restitution) * approach;
    let grip = friction * impulse;
    let lost = (0.5 * along).clamp(-grip, grip);
    let change = [
        impulse * normal[0] + lost * normal[1],
        impulse * normal[1] - lost * normal[0],
    ];
    first.velocity_x_m_s -= change[0];
    first.velocity_y_m_s -= change[1];
    second.velocity_x_m_s += change[0];
    second.velocity_y_m_s += change[1];
    true
}
