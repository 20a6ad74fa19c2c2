//! A part on a straight slope under a periodic waveform, solved exactly.
//!
//! y runs along the slope, uphill positive; `a` is the horizontal acceleration of the tray, w the speed of the part
//! relative to the tray along the slope (Quaid Eqs 11–17, corrected):
//!
//! - normal force per mass: N = g cos φ − a sin φ, which must not become negative;
//! - ẇ = −g sin φ − a cos φ, less [`friction`](super::friction).
//!
//! Within a segment of constant a, w is linear until it reaches zero, so every event has a closed form. Speeds are in
//! m/s, whatever the waveform's axis: a yaw waveform acts with a = r θ̈ at radius r.

use super::tray_forces::Incline;
use super::{Friction, MechanicsError, check_slope};
use crate::range::OutOfRange;
use crate::waveform::Waveform;

/// A straight track: slope, friction and gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearTrack {
    friction: Friction,
    gravity_m_s2: f64,
    incline: Incline,
}

impl LinearTrack {
    /// A track rising by `slope_rad` in the feed direction.
    ///
    /// # Errors
    ///
    /// If the slope is not within ±90° or gravity not positive.
    pub fn new(friction: Friction, slope_rad: f64, gravity_m_s2: f64) -> Result<Self, OutOfRange> {
        check_slope(slope_rad, gravity_m_s2)?;
        Ok(Self { friction, gravity_m_s2, incline: Incline::new(slope_rad) })
    }

    /// Normal force over weight at horizontal acceleration `a_m_s2`.
    #[must_use]
    pub fn normal_over_weight(&self, a_m_s2: f64) -> f64 {
        self.incline.load(a_m_s2, self.gravity_m_s2).normal_m_s2 / self.gravity_m_s2
    }

    /// One waveform on this track, ready to be run. Accelerations are multiplied by `lever`: 1 on X and Y, the radius in
    /// m on Yaw.
    ///
    /// # Errors
    ///
    /// If `lever` is not positive, or the part leaves the tray.
    pub fn drive(&self, waveform: &Waveform, lever: f64) -> Result<Drive, MechanicsError> {
        OutOfRange::unless_positive("lever", lever)?;
        let mut min_normal_over_weight = f64::INFINITY;
        let legs = waveform.segments().iter().map(|segment| {
            let acceleration_m_s2 = segment.acceleration * lever;
            let normal_over_weight = self.normal_over_weight(acceleration_m_s2);
            if normal_over_weight < 0.0 {
                return Err(MechanicsError::LosesContact { acceleration_m_s2, normal_over_weight });
            }
            min_normal_over_weight = normal_over_weight.min(min_normal_over_weight);
            Ok(self.leg(segment.duration_s, acceleration_m_s2))
        });
        let legs = legs.collect::<Result<Vec<_>, _>>()?;
        Ok(Drive {
            legs,
            period_s: waveform.period_s(),
            min_normal_over_weight,
            world_rest_m_s: -waveform.start_velocity() * lever * self.incline.cos,
        })
    }

    /// Moves a part by one sample of any tray motion: from w = `w_m_s` under a constant tray acceleration, the new w and
    /// the distance covered relative to the tray, m. The part must stay on the tray.
    #[must_use]
    pub fn step(&self, w_m_s: f64, acceleration_m_s2: f64, duration_s: f64) -> (f64, f64) {
        let (mut w, mut distance_m, mut left_s) = (w_m_s, 0.0, duration_s);
        let leg = self.leg(duration_s, acceleration_m_s2);
        while left_s > 0.0 {
            let phase = leg.next_phase(w, left_s);
            w = phase.to_m_s;
            distance_m += phase.distance_m();
            left_s -= phase.duration_s;
        }
        (w, distance_m)
    }

    fn leg(&self, duration_s: f64, acceleration_m_s2: f64) -> Leg {
        let load = self.incline.load(acceleration_m_s2, self.gravity_m_s2);
        let (grip, drive) = (self.friction.grip(load.normal_m_s2), [load.along_m_s2]);
        let [up] = grip.sliding_m_s2(drive, [1.0]);
        let [down] = grip.sliding_m_s2(drive, [-1.0]);
        let [from_rest] = grip.from_rest_m_s2(drive);
        Leg { duration_s, up, down, from_rest }
    }
}

/// A segment of the waveform as the part feels it; accelerations ẇ in m/s².
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    /// Its duration, s.
    pub duration_s: f64,
    /// ẇ while sliding uphill.
    up: f64,
    /// ẇ while sliding downhill.
    down: f64,
    /// ẇ from rest; 0 where friction holds the part.
    from_rest: f64,
}

impl Leg {
    /// The motion from w = `w_m_s` until it reverses or comes to rest, or until `left_s` have passed.
    pub fn next_phase(&self, w_m_s: f64, left_s: f64) -> MotionPhase {
        if w_m_s == 0.0 {
            let to_m_s = self.from_rest * left_s;
            return MotionPhase { duration_s: left_s, from_m_s: 0.0, to_m_s, at_rest: self.from_rest == 0.0 };
        }
        let acceleration = if w_m_s > 0.0 { self.up } else { self.down };
        let to_m_s = w_m_s + acceleration * left_s;
        // Compared one by one: a product of the two could underflow.
        if (w_m_s > 0.0 && to_m_s >= 0.0) || (w_m_s < 0.0 && to_m_s <= 0.0) {
            return MotionPhase { duration_s: left_s, from_m_s: w_m_s, to_m_s, at_rest: false };
        }
        // Rounding must not carry the stop beyond the end.
        let duration_s = (-w_m_s / acceleration).min(left_s);
        MotionPhase { duration_s, from_m_s: w_m_s, to_m_s: 0.0, at_rest: false }
    }
}

/// A stretch of constant ẇ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionPhase {
    /// How long it lasts, s.
    pub duration_s: f64,
    /// w where it begins, m/s.
    pub from_m_s: f64,
    /// w where it ends, m/s.
    pub to_m_s: f64,
    /// Whether the part rests on the tray throughout.
    pub at_rest: bool,
}

impl MotionPhase {
    /// Distance covered relative to the tray, m.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        (self.from_m_s + self.to_m_s) / 2.0 * self.duration_s
    }
}

/// The steady, periodic motion of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steady {
    /// w at the start of each period, m/s.
    pub start_m_s: f64,
    /// Mean speed relative to the tray along the slope, m/s.
    pub feed_m_s: f64,
    /// Share of the period during which the part rests on the tray.
    pub stick_fraction: f64,
    /// Distance slid downhill in each period, m; not negative.
    pub slip_back_m: f64,
    /// Periods evaluated to find it.
    pub cycles: u32,
}

/// One period of a waveform as a part on a track feels it.
#[derive(Clone, Debug)]
pub struct Drive {
    legs: Vec<Leg>,
    period_s: f64,
    min_normal_over_weight: f64,
    world_rest_m_s: f64,
}

impl Drive {
    /// The smallest normal force of the period over the weight.
    #[must_use]
    pub fn min_normal_over_weight(&self) -> f64 {
        self.min_normal_over_weight
    }

    /// w at the start of the period of a part at rest in the world while the tray already vibrates, m/s.
    #[must_use]
    pub fn world_rest_m_s(&self) -> f64 {
        self.world_rest_m_s
    }

    /// Runs one period from w = `w_m_s`, shows every phase, and gives w at the end of the period.
    pub fn run(&self, w_m_s: f64, mut on_phase: impl FnMut(MotionPhase)) -> f64 {
        let mut w = w_m_s;
        for leg in &self.legs {
            let mut left_s = leg.duration_s;
            while left_s > 0.0 {
                let phase = leg.next_phase(w, left_s);
                on_phase(phase);
                w = phase.to_m_s;
                left_s -= phase.duration_s;
            }
        }
        w
    }

    /// The segments of the waveform as the part feels them.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// The period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Mean speed over each of the first `cycles` periods, starting from w = `w_m_s`, m/s.
    #[must_use]
    pub fn cycle_means_m_s(&self, w_m_s: f64, cycles: usize) -> Vec<f64> {
        let mut w = w_m_s;
        let mut mean = || {
            let mut distance_m = 0.0;
            w = self.run(w, |phase| distance_m += phase.distance_m());
            distance_m / self.period_s
        };
        (0..cycles).map(|_| mean()).collect()
    }

    /// The steady motion, found directly as the fixed point of w over one period; `None` if there is none because the
    /// part slides down for ever (a slope beyond the kinetic friction angle).
    ///
    /// The map of w over a period is piecewise linear, never decreasing and of slope at most 1, so Newton's method kept
    /// within a bracket reaches the fixed point in as many steps as it has pieces in the way. With μ_s = μ_k it is
    /// unique; with μ_s > μ_k a part kicked hard may find another one than this, which is found from rest on the tray.
    #[must_use]
    pub fn steady(&self) -> Option<Steady> {
        // No part this fast turns round within a period.
        let fast = self.legs.iter().map(|leg| leg.duration_s * leg.up.abs().max(leg.down.abs())).sum::<f64>();
        let mut cycles = 1;
        let (mut gain, mut slope) = self.gain(0.0);
        let (mut low, mut high) = if gain > 0.0 { (0.0, fast) } else { (-fast, 0.0) };
        if gain != 0.0 {
            cycles += 1;
            if self.gain(fast.copysign(gain)).0 * gain >= 0.0 {
                return None;
            }
        }
        let mut w = 0.0;
        while gain.abs() > 4.0 * f64::EPSILON * fast && high - low > 2.0 * f64::EPSILON * fast {
            let newton = w + gain / (1.0 - slope);
            w = if newton > low && newton < high { newton } else { f64::midpoint(low, high) };
            (gain, slope) = self.gain(w);
            if gain > 0.0 {
                low = w;
            } else {
                high = w;
            }
            cycles += 1;
        }
        Some(self.steady_from(w, cycles + 1))
    }

    /// Change of w over one period, and the derivative of its final value by its initial one.
    fn gain(&self, w_m_s: f64) -> (f64, f64) {
        let mut slope = 1.0;
        let mut before: Option<f64> = None;
        let end = self.run(w_m_s, |phase| {
            // Passing through rest at time t: dt = −dw/ẇ_before, so the w gained afterwards changes by ẇ_after/ẇ_before.
            let rate = (phase.to_m_s - phase.from_m_s) / phase.duration_s;
            if phase.from_m_s == 0.0 {
                slope *= before.map_or(0.0, |before| rate / before);
            }
            before = (phase.to_m_s == 0.0 && !phase.at_rest).then_some(rate);
        });
        (end - w_m_s, slope)
    }

    fn steady_from(&self, start_m_s: f64, cycles: u32) -> Steady {
        let (mut distance_m, mut slip_back_m, mut rest_s) = (0.0, 0.0, 0.0);
        self.run(start_m_s, |phase| {
            let covered_m = phase.distance_m();
            distance_m += covered_m;
            slip_back_m += (-covered_m).max(0.0);
            if phase.at_rest {
                rest_s += phase.duration_s;
            }
        });
        Steady {
            start_m_s,
            feed_m_s: distance_m / self.period_s,
            stick_fraction: rest_s / self.period_s,
            slip_back_m,
            cycles,
        }
    }
}
