//! A rest-to-rest move of one axis with trapezoidal speed.

/// What an axis can do: lengths in m or rad.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisSpeed {
    /// Largest speed, m/s or rad/s.
    pub speed_max: f64,
    /// Largest acceleration, m/s² or rad/s².
    pub acceleration_max: f64,
}

/// A move that starts and ends at rest, as fast as speed and acceleration allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RestToRest {
    from: f64,
    to: f64,
    start_s: f64,
    ramp_s: f64,
    cruise_s: f64,
    acceleration: f64,
}

impl RestToRest {
    /// The move from `from` to `to`, starting at `start_s`.
    pub(super) fn new(from: f64, to: f64, start_s: f64, limits: AxisSpeed) -> Self {
        let distance = (to - from).abs();
        let acceleration = limits.acceleration_max;
        let ramp_s = (distance / acceleration).sqrt().min(limits.speed_max / acceleration);
        let speed = acceleration * ramp_s;
        let cruise_s = if speed > 0.0 { (distance - speed * ramp_s) / speed } else { 0.0 };
        Self { from, to, start_s, ramp_s, cruise_s, acceleration }
    }

    /// When it ends, s.
    pub(super) fn end_s(&self) -> f64 {
        self.start_s + 2.0 * self.ramp_s + self.cruise_s
    }

    /// Position and velocity at `time_s`.
    pub(super) fn at(&self, time_s: f64) -> (f64, f64) {
        let Self { from, to, ramp_s, cruise_s, acceleration, .. } = *self;
        let forward = (to - from).signum();
        let t = time_s - self.start_s;
        let left = self.end_s() - time_s;
        if t <= 0.0 {
            (from, 0.0)
        } else if left <= 0.0 {
            (to, 0.0)
        } else if t < ramp_s {
            (from + forward * 0.5 * acceleration * t * t, forward * acceleration * t)
        } else if t < ramp_s + cruise_s {
            let speed = acceleration * ramp_s;
            (from + forward * speed * (t - 0.5 * ramp_s), forward * speed)
        } else {
            (to - forward * 0.5 * acceleration * left * left, forward * acceleration * left)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn verif_short_and_long_moves_take_the_textbook_time() {
        let limits = AxisSpeed { speed_max: 0.5, acceleration_max: 5.0 };
        // Below v²/a = 50 mm the axis never cruises: 2 √(d/a). Above, d/v + v/a.
        assert!((RestToRest::new(0.0, 0.02, 0.0, limits).end_s() - 2.0 * (0.02_f64 / 5.0).sqrt()).abs() < 1e-12);
        assert!((RestToRest::new(0.1, -0.1, 3.0, limits).end_s() - (3.0 + 0.2 / 0.5 + 0.5 / 5.0)).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn position_is_the_integral_of_velocity_within_limits(
            from in -1.0..1.0_f64, to in -1.0..1.0_f64, start_s in 0.0..9.0_f64,
        ) {
            let limits = AxisSpeed { speed_max: 0.7, acceleration_max: 4.0 };
            let path = RestToRest::new(from, to, start_s, limits);
            let (steps, mut position) = (2000, from);
            let dt = (path.end_s() - start_s) / f64::from(steps);
            for step in 0..steps {
                let (_, v0) = path.at(start_s + f64::from(step) * dt);
                let (there, v1) = path.at(start_s + f64::from(step + 1) * dt);
                prop_assert!(v1.abs() <= limits.speed_max * (1.0 + 1e-9));
                prop_assert!((v1 - v0).abs() <= limits.acceleration_max * dt * (1.0 + 1e-6) + 1e-12);
                position += 0.5 * (v0 + v1) * dt;
                prop_assert!((position - there).abs() < 1e-5);
            }
            prop_assert!((position - to).abs() < 1e-5);
            prop_assert_eq!(path.at(path.end_s() + 1.0), (to, 0.0));
        }
    }
}
