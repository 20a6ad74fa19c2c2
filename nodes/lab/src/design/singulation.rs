//! How far apart parts travel on the plateau that came up the ramp one behind the other.
//!
//! On the ramp all parts of one kind at one radius move alike, so their spacing stays what it was when they were loaded.
//! At the crest each speeds up in turn; on the plateau they move alike again, and their spacing stays what it is once they
//! have settled. Counted is the smaller of that and the spacing one hop past the crest. It depends on where in its hop the
//! first part passes the crest: with large hops much more than the ratio of the mean speeds says. Parts are points that do
//! not touch.

use feeder_model::mechanics::slope::{Drive, MotionPhase, Steady};

/// Periods after which a part on the plateau is taken to have settled at the latest.
const PERIODS_MAX: usize = 400;
/// Difference to the steady speed, over the fastest of the two steady motions, at which it is taken to have settled.
const SETTLED: f64 = 1e-7;

/// A part slower than this does not move on.
const STANDSTILL_M_S: f64 = 1e-6;
/// The spacing on the ramp is taken to be off by up to this part of a hop, either way.
const INEXACT_PART_OF_HOP: usize = 100;

/// The passage from ramp to plateau at one radius.
#[derive(Clone, Debug)]
pub(super) struct Crest<'a> {
    ramp: &'a Drive,
    plateau: &'a Drive,
    ramp_steady: Steady,
    plateau_steady: Steady,
    /// cos φ of the ramp.
    cos: f64,
}

/// The ways over the crest of parts that start at evenly spaced places of a hop before it.
#[derive(Clone, Debug)]
pub(super) struct RampPassage {
    /// Ways of parts that start a period whole hops and `i/n` of a hop before the crest, i = 1…n.
    ways: Vec<Way>,
    /// Hop on the ramp and on the plateau: arc covered in a period, m.
    ramp_hop_m: f64,
    plateau_hop_m: f64,
}

/// The way of one part over the crest.
#[derive(Clone, Debug)]
struct Way {
    /// Position past the crest at the end of each period until it has settled, m.
    positions_m: Vec<f64>,
    /// Which of them is one hop past the crest.
    one_hop_past: usize,
}

impl<'a> Crest<'a> {
    /// `None` unless parts climb the ramp and move on along the plateau.
    pub(super) fn new(ramp: &'a Drive, plateau: &'a Drive, slope_rad: f64) -> Option<Self> {
        let (ramp_steady, plateau_steady) = (ramp.steady()?, plateau.steady()?);
        let moves = ramp_steady.feed_m_s > STANDSTILL_M_S && plateau_steady.feed_m_s > STANDSTILL_M_S;
        moves.then(|| Self { ramp, plateau, ramp_steady, plateau_steady, cos: slope_rad.cos() })
    }

    /// Mean arc speed on the ramp, m/s.
    pub(super) fn ramp_m_s(&self) -> f64 {
        self.ramp_steady.feed_m_s * self.cos
    }

    /// Mean speed on the plateau, m/s.
    pub(super) fn plateau_m_s(&self) -> f64 {
        self.plateau_steady.feed_m_s
    }

    pub(super) fn passage(&self, places: u32) -> RampPassage {
        let ramp_hop_m = self.ramp_m_s() * self.ramp.period_s();
        let plateau_hop_m = self.plateau_m_s() * self.plateau.period_s();
        // From here on back, a part is still on the ramp throughout the period before.
        let hop_m = self.ramp_steady.feed_m_s * self.ramp.period_s();
        let clear_m = (self.farthest_m() / hop_m).ceil() * hop_m;
        let ways = (1..=places).map(|i| self.way(clear_m + hop_m * f64::from(i) / f64::from(places))).collect();
        RampPassage { ways, ramp_hop_m, plateau_hop_m }
    }

    /// How far a part on the ramp gets from where it starts a period, at most, m.
    fn farthest_m(&self) -> f64 {
        let (mut s_m, mut farthest_m) = (0.0_f64, 0.0_f64);
        self.ramp.run(self.ramp_steady.start_m_s, |phase| {
            s_m += phase.distance_m();
            farthest_m = farthest_m.max(s_m);
        });
        farthest_m
    }

    /// The way of a part that begins a period `before_m` before the crest.
    fn way(&self, before_m: f64) -> Way {
        let fast = self.ramp_steady.feed_m_s.max(self.plateau_steady.feed_m_s);
        let mut part = TrayPlace { s_m: -before_m, w_m_s: self.ramp_steady.start_m_s, on_plateau: false };
        let mut way = Way { positions_m: Vec::new(), one_hop_past: 0 };
        while way.positions_m.len() < PERIODS_MAX {
            if !part.on_plateau {
                way.one_hop_past = way.positions_m.len() + 1;
            }
            part = self.run(part);
            way.positions_m.push(part.s_m);
            let settled = (part.w_m_s - self.plateau_steady.start_m_s).abs() <= SETTLED * fast;
            if settled && way.positions_m.len() > way.one_hop_past {
                break;
            }
        }
        way
    }

    /// One period of a part near the crest.
    fn run(&self, mut part: TrayPlace) -> TrayPlace {
        for (ramp, plateau) in self.ramp.legs().iter().zip(self.plateau.legs()) {
            let mut left_s = ramp.duration_s;
            while left_s > 0.0 {
                let leg = if part.on_plateau { plateau } else { ramp };
                let phase = leg.next_phase(part.w_m_s, left_s);
                let end_m = part.s_m + phase.distance_m();
                let leaves = if part.on_plateau { end_m < 0.0 } else { end_m > 0.0 };
                if leaves {
                    let (duration_s, w_m_s) = reach(&phase, -part.s_m);
                    part = TrayPlace { s_m: 0.0, w_m_s, on_plateau: !part.on_plateau };
                    left_s -= duration_s;
                } else {
                    part = TrayPlace { s_m: end_m, w_m_s: phase.to_m_s, ..part };
                    left_s -= phase.duration_s;
                }
            }
        }
        part
    }
}

/// A part near the crest: position along the track, uphill positive, and speed.
#[derive(Clone, Copy, Debug)]
struct TrayPlace {
    s_m: f64,
    w_m_s: f64,
    on_plateau: bool,
}

/// Time and speed at which a phase that covers more has covered `distance_m`.
fn reach(phase: &MotionPhase, distance_m: f64) -> (f64, f64) {
    let acceleration = (phase.to_m_s - phase.from_m_s) / phase.duration_s;
    let square = phase.from_m_s * phase.from_m_s + 2.0 * acceleration * distance_m;
    let w_m_s = square.max(0.0).sqrt().copysign(phase.from_m_s + phase.to_m_s);
    let duration_s = 2.0 * distance_m / (phase.from_m_s + w_m_s);
    if duration_s.is_finite() { (duration_s.clamp(0.0, phase.duration_s), w_m_s) } else { (0.0, w_m_s) }
}

impl RampPassage {
    /// The smallest spacing on the plateau, over all places of entry, of parts about `ramp_steps`/n of a hop apart on the
    /// ramp, m. Places of entry have a finite step, and no loading is exact: a spacing of so many whole hops, at which
    /// all parts would pass the crest alike, must not rest on that.
    fn least_spacing_m(&self, ramp_steps: usize) -> f64 {
        let inexact = (self.ways.len() / INEXACT_PART_OF_HOP).max(1);
        [ramp_steps.saturating_sub(inexact), ramp_steps, ramp_steps + inexact]
            .into_iter()
            .map(|steps| self.least_spacing_at_m(steps))
            .fold(f64::INFINITY, f64::min)
    }

    fn least_spacing_at_m(&self, ramp_steps: usize) -> f64 {
        let n = self.ways.len();
        let (hops, rest) = (ramp_steps / n, ramp_steps % n);
        let spacing = |first: usize| {
            let (later, second) = (hops + (first + rest) / n, &self.ways[(first + rest) % n]);
            let first = &self.ways[first];
            let after = |periods: usize| self.position_m(first, periods + later) - self.position_m(second, periods);
            after(second.one_hop_past).min(after(second.positions_m.len() + first.positions_m.len()))
        };
        (0..n).map(spacing).fold(f64::INFINITY, f64::min)
    }

    /// Position after a number of periods; a part that has settled goes on hop by hop.
    fn position_m(&self, way: &Way, periods: usize) -> f64 {
        let last = way.positions_m.len() - 1;
        way.positions_m[periods.min(last)] + self.plateau_hop_m * as_f64(periods.saturating_sub(last))
    }

    /// The smallest spacing on the plateau of parts that are at least `ramp_m` apart on the ramp, arc lengths in m.
    pub(super) fn spacing_m(&self, ramp_m: f64) -> f64 {
        self.least_spacing_m(self.steps(ramp_m))
    }

    /// The smallest spacing on the ramp from `ramp_least_m` on that keeps parts `plateau_m` apart on the plateau.
    pub(super) fn ramp_spacing_m(&self, ramp_least_m: f64, plateau_m: f64) -> f64 {
        // Within a plateau hop of what the mean speeds say: start there.
        let sure_m = (plateau_m - self.plateau_hop_m) / self.plateau_hop_m * self.ramp_hop_m;
        let mut steps = self.steps(ramp_least_m.max(sure_m));
        while self.least_spacing_m(steps) < plateau_m {
            steps += 1;
        }
        self.ramp_hop_m * as_f64(steps) / as_f64(self.ways.len())
    }

    fn steps(&self, ramp_m: f64) -> usize {
        let steps = (ramp_m / self.ramp_hop_m * as_f64(self.ways.len()) - 1e-9).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a range that fits")]
        let steps = steps.clamp(0.0, 1e9) as usize;
        steps
    }
}

fn as_f64(n: usize) -> f64 {
    f64::from(u32::try_from(n).unwrap_or(u32::MAX))
}
