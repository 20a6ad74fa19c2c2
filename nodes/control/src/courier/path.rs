//! A trajectory under way, which can be brought to rest on its own path.

use nalgebra::Vector3;

use super::trajectory::{Spline, State};
use crate::courier::limits::{CourierLimits, Extent, LimitViolation};
use feeder_model::motor::Load;

/// What a motion is checked against: the envelope, the vibration about it, and what is carried.
pub(crate) struct Check<'a> {
    pub(crate) limits: &'a CourierLimits,
    pub(crate) vibration: Extent,
    pub(crate) load: &'a Load,
}

/// A slowing of the path's clock from full rate to nothing.
#[derive(Clone, Copy, Debug)]
struct Stop {
    start_s: f64,
    duration_s: f64,
}

/// A spline followed by a clock that runs with the servo ticks until a stop slows it down.
///
/// Stopping slows the clock rather than leaving the path, so that a stop stays inside the bounds wherever it comes.
#[derive(Clone, Debug)]
pub(crate) struct Path {
    spline: Spline,
    start_tick: u64,
    period_s: f64,
    stop: Option<Stop>,
}

impl Path {
    pub(crate) fn new(spline: Spline, start_tick: u64, period_s: f64) -> Self {
        Self { spline, start_tick, period_s, stop: None }
    }

    fn elapsed_s(&self, tick: u64) -> f64 {
        tick.saturating_sub(self.start_tick) as f64 * self.period_s
    }

    /// Time at which the motion ends, since the start of the path, s.
    fn end_s(&self) -> f64 {
        let stop_s = self.stop.map_or(f64::INFINITY, |stop| stop.start_s + stop.duration_s);
        // A slowed clock may never reach the spline's end, and need not.
        if self.stop.is_some() { stop_s } else { self.spline.end_s() }
    }

    pub(crate) fn ended(&self, tick: u64) -> bool {
        self.elapsed_s(tick) >= self.end_s()
    }

    /// Position, velocity and acceleration at a servo tick.
    pub(crate) fn at(&self, tick: u64) -> State {
        let time_s = self.elapsed_s(tick);
        let Some(Stop { start_s, duration_s }) = self.stop.filter(|stop| time_s > stop.start_s) else {
            return self.spline.at(time_s);
        };
        // The clock's rate falls as 1 - S(x), S the smoothstep; its reading is the integral of that.
        let x = ((time_s - start_s) / duration_s).min(1.0);
        let rate = 1.0 - x * x * x * (10.0 + x * (6.0 * x - 15.0));
        let rate_per_s = -30.0 * (x * (1.0 - x)).powi(2) / duration_s;
        let reading_s = start_s + duration_s * (x - x.powi(4) * (2.5 + x * (x - 3.0)));
        let state = self.spline.at(reading_s);
        State {
            position: state.position,
            velocity: state.velocity * rate,
            acceleration: state.acceleration * (rate * rate) + state.velocity * rate_per_s,
        }
    }

    /// Checks every servo tick from `tick` to the end, coming from a mean acceleration of `acceleration`.
    pub(crate) fn check(&self, check: &Check, tick: u64, acceleration: Vector3<f64>) -> Result<(), LimitViolation> {
        let jerk_m_s3_max = check.limits.jerk_m_s3_max * (1.0 + 1e-9);
        let (mut tick, mut before, mut state) = (tick, acceleration, self.at(tick));
        loop {
            let next = self.at(tick + 1);
            let acceleration = (next.velocity - state.velocity) / self.period_s;
            let motion = Extent { position: state.position, velocity: state.velocity, acceleration };
            let time_s = self.elapsed_s(tick);
            check.limits.check(&motion, &check.vibration, check.load, time_s)?;
            let jerk_m_s3 = (acceleration - before).xy().norm() / self.period_s;
            if jerk_m_s3 > jerk_m_s3_max {
                let allowed = check.limits.jerk_m_s3_max;
                return Err(LimitViolation { quantity: "jerk (m/s³)", value: jerk_m_s3, allowed, time_s });
            }
            if self.ended(tick) {
                return Ok(());
            }
            (tick, before, state) = (tick + 1, acceleration, next);
        }
    }

    /// Brings the motion to rest on its path as fast as the envelope allows from `tick` on. Where braking harder than
    /// the path itself does is not possible, the path is followed to its end.
    pub(crate) fn stop(&mut self, check: &Check, tick: u64, acceleration: Vector3<f64>) {
        if self.stop.is_some() {
            return;
        }
        let start_s = self.elapsed_s(tick);
        let remaining_s = self.spline.end_s() - start_s;
        let mut duration_s = 10.0 * self.period_s;
        // The slowed clock covers half of the time it takes: any longer stop would pass the end.
        while duration_s < 2.0 * remaining_s {
            self.stop = Some(Stop { start_s, duration_s });
            if self.check(check, tick, acceleration).is_ok() {
                return;
            }
            duration_s *= 1.2;
        }
        self.stop = None;
    }
}
