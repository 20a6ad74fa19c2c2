//! Where the courier is and how fast it is, as far as its sensor and the commands can tell.
//!
//! Each axis has a Kalman filter of its own over position, velocity and an acceleration that no command explains, such as
//! the tether's pull. It predicts from tick to tick by the commanded acceleration, through the delay and the lag that the
//! loop is believed to have, and corrects itself by what the sensor reads. Where the sensor reads nothing the prediction
//! stands, and its variance grows. An error that the sensor makes again and again in the same place, such as that of its
//! scale, is in the estimate and not in its variance: nobody who has this sensor alone can know it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::response::step_response;
use feeder_model::range::{OutOfRange, check_ranges};

/// What the driver believes of its sensor, and of the forces that it does not command.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorParameters {
    /// Noise of the position sensor along x and y, its resolution included, m rms.
    #[schemars(range(min = 1e-9, max = 1e-3))]
    pub sensor_noise_m_rms: f64,
    /// Noise of the position sensor in yaw, its resolution included, rad rms.
    #[schemars(range(min = 1e-8, max = 1e-2))]
    pub sensor_noise_rad_rms: f64,
    /// Acceleration of translation that nothing explains, anew at every tick, m/s² rms.
    #[schemars(range(min = 1e-4, max = 100.0))]
    pub unexplained_m_s2_rms: f64,
    /// Acceleration of rotation that nothing explains, anew at every tick, rad/s² rms.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub unexplained_rad_s2_rms: f64,
    /// Share of a commanded acceleration that may be off, by ripple of the force or by a mass that is not known well.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub command_error: f64,
    /// By how much a constant acceleration of translation, such as the tether's, may change within a second, m/s² rms.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub drift_m_s2: f64,
    /// By how much a constant acceleration of rotation may change within a second, rad/s² rms.
    #[schemars(range(min = 0.0, max = 1e3))]
    pub drift_rad_s2: f64,
}

impl Default for EstimatorParameters {
    fn default() -> Self {
        Self {
            sensor_noise_m_rms: 0.25e-6,
            sensor_noise_rad_rms: 2.5e-6,
            unexplained_m_s2_rms: 0.05,
            unexplained_rad_s2_rms: 0.2,
            command_error: 0.1,
            drift_m_s2: 0.5,
            drift_rad_s2: 2.0,
        }
    }
}

impl EstimatorParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("estimator.", self)
    }
}

/// Position and velocity of the courier as estimated, and how sure they are. The axes are estimated apart from each other:
/// between them there is no covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimate {
    /// Position, m and rad.
    pub(super) position: Vector3<f64>,
    /// Velocity, m/s and rad/s.
    pub(super) velocity: Vector3<f64>,
    /// Variance of the position, m² and rad².
    pub(super) position_variance: Vector3<f64>,
    /// Variance of the velocity, (m/s)² and (rad/s)².
    pub(super) velocity_variance: Vector3<f64>,
}

/// Estimates the courier's motion, tick by tick.
#[derive(Clone, Debug)]
pub(super) struct Estimator {
    axes: [Axis; 3],
    period_s: f64,
    /// Accelerations commanded of late, the last one first.
    commands: VecDeque<Vector3<f64>>,
    air: bool,
}

impl Estimator {
    /// Longest delay reckoned with, s.
    const DELAY_S_MAX: f64 = 0.02;

    /// An estimator of a courier that rests at `start`.
    pub(super) fn new(parameters: &EstimatorParameters, start: &Vector3<f64>, period_s: f64) -> Self {
        let EstimatorParameters { command_error, .. } = *parameters;
        let axis = |index: usize| {
            let (noise, unexplained, drift) = if index < 2 {
                (parameters.sensor_noise_m_rms, parameters.unexplained_m_s2_rms, parameters.drift_m_s2)
            } else {
                (parameters.sensor_noise_rad_rms, parameters.unexplained_rad_s2_rms, parameters.drift_rad_s2)
            };
            Axis::at_rest(start[index], Noise { sensor: noise, unexplained, command_error, drift })
        };
        Self { axes: [0, 1, 2].map(axis), period_s, commands: VecDeque::new(), air: true }
    }

    /// The estimate for the present tick.
    pub(super) fn estimate(&self) -> Estimate {
        let all = |value: fn(&Axis) -> f64| Vector3::from(self.axes.each_ref().map(value));
        Estimate {
            position: all(|axis| axis.state.x),
            velocity: all(|axis| axis.state.y),
            position_variance: all(|axis| axis.covariance.m11),
            velocity_variance: all(|axis| axis.covariance.m22),
        }
    }

    /// Takes in what the sensor reads at the present tick.
    pub(super) fn observe(&mut self, measured: &Vector3<f64>) {
        for (axis, &measured) in self.axes.iter_mut().zip(measured) {
            axis.observe(measured, self.period_s);
        }
    }

    /// Goes on to the next tick under the acceleration commanded at this one, with commands that take effect after
    /// `delay_s`, with a time constant of `lag_s`.
    pub(super) fn predict(&mut self, acceleration: &Vector3<f64>, delay_s: f64, lag_s: f64) {
        let delay_s = delay_s.clamp(0.0, Self::DELAY_S_MAX);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 20 ms in ticks")]
        let whole_ticks = (delay_s / self.period_s + 1e-9).floor() as usize;
        // The command before that of `whole_ticks` ago acts until the later one arrives.
        let early_s = (delay_s - whole_ticks as f64 * self.period_s).max(0.0);
        self.commands.push_front(*acceleration);
        let of = |ticks: usize| self.commands.get(ticks).copied().unwrap_or_else(Vector3::zeros);
        let (early, late) = (of(whole_ticks + 1), of(whole_ticks));
        for (index, axis) in self.axes.iter_mut().enumerate() {
            if self.air {
                let (early, late) = ((early[index], early_s), (late[index], self.period_s - early_s));
                axis.advance([early, late], lag_s, self.period_s);
            } else {
                axis.stay(self.period_s);
            }
        }
        self.commands.truncate(whole_ticks + 2);
    }

    /// Notes that the air was switched: without it the courier is clamped, and no command moves it.
    pub(super) fn set_air(&mut self, on: bool) {
        if self.air && !on {
            self.axes.iter_mut().for_each(Axis::clamp);
        }
        self.air = on;
    }
}

/// What one axis is reckoned to suffer from.
#[derive(Clone, Copy, Debug)]
struct Noise {
    sensor: f64,
    unexplained: f64,
    command_error: f64,
    drift: f64,
}

/// The filter of one axis.
#[derive(Clone, Debug)]
struct Axis {
    noise: Noise,
    /// Position, velocity, and the acceleration that no command explains.
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Acceleration that the forcers give now.
    given: f64,
    /// By how much the last reading was off, and how many in a row were so to one side by far.
    surprise: f64,
    surprises: u32,
}

impl Axis {
    /// Standard deviation of the place where the courier starts, m and rad, and of its velocity there.
    const START: f64 = 1e-3;
    /// So many readings in a row that are off to one side by more than so many standard deviations are of a motion that is
    /// not in the model, such as that of a courier held fast. One or two may be the sensor's.
    const SURPRISES: u32 = 4;
    const SURPRISE: f64 = 5.0;

    fn at_rest(position: f64, noise: Noise) -> Self {
        let start = Self::START * Self::START;
        Self {
            noise,
            state: Vector3::new(position, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(start, start, noise.drift * noise.drift)),
            given: 0.0,
            surprise: 0.0,
            surprises: 0,
        }
    }

    /// Moves on by `period_s` under two commanded accelerations, each for its time.
    fn advance(&mut self, commands: [(f64, f64); 2], lag_s: f64, period_s: f64) {
        let constant = self.state.z;
        self.state.x += self.state.y * period_s + 0.5 * constant * period_s * period_s;
        let (mut speed, mut largest) = (0.0, 0.0_f64);
        for (wanted, time_s) in commands {
            // What is given tends to what is wanted; the rest of it decays.
            let [risen, gained, moved] = step_response(time_s, lag_s);
            self.state.x += speed * time_s + wanted * moved + self.given * (0.5 * time_s * time_s - moved);
            speed += wanted * gained + self.given * (time_s - gained);
            self.given += (wanted - self.given) * risen;
            largest = largest.max(self.given.abs()).max(wanted.abs());
        }
        self.state.y += speed + constant * period_s;
        let off = self.noise.command_error * largest;
        let variance = self.noise.unexplained * self.noise.unexplained + off * off;
        self.spread(1.0, variance, period_s);
        self.covariance.m33 += self.noise.drift * self.noise.drift * period_s;
    }

    /// Moves on by `period_s` while nothing that is commanded or pulls can move the courier.
    fn stay(&mut self, period_s: f64) {
        self.state.x += self.state.y * period_s;
        self.spread(0.0, self.noise.unexplained * self.noise.unexplained, period_s);
    }

    /// Carries the covariance on over `period_s` of an acceleration of `variance`, while so much of the constant
    /// acceleration acts, 0 or 1.
    fn spread(&mut self, constant: f64, variance: f64, period_s: f64) {
        let moved = 0.5 * period_s * period_s;
        #[rustfmt::skip]
        let transition = Matrix3::new(
            1.0, period_s, constant * moved,
            0.0, 1.0, constant * period_s,
            0.0, 0.0, 1.0,
        );
        let effect = Vector3::new(moved, period_s, 0.0);
        self.covariance =
            transition * self.covariance * transition.transpose() + effect * effect.transpose() * variance;
    }

    fn observe(&mut self, measured: f64, period_s: f64) {
        let sensor = self.noise.sensor * self.noise.sensor;
        let innovation = measured - self.state.x;
        let expected = self.covariance.m11 + sensor;
        let surprising = innovation * innovation > Self::SURPRISE * Self::SURPRISE * expected;
        self.surprises = match (surprising, innovation * self.surprise > 0.0) {
            (true, true) => self.surprises + 1,
            (true, false) => 1,
            (false, _) => 0,
        };
        self.surprise = innovation;
        if self.surprises >= Self::SURPRISES {
            // As if the velocity had jumped when the surprises began.
            let since_s = f64::from(self.surprises) * period_s;
            let jump = Vector3::new(since_s, 1.0, 0.0) * (innovation / since_s);
            self.covariance += jump * jump.transpose();
            self.surprises = 0;
        }
        let gain = self.covariance.column(0) / (self.covariance.m11 + sensor);
        self.state += gain * innovation;
        // Joseph's form keeps the covariance symmetric and positive.
        let mut rest = Matrix3::identity();
        rest.set_column(0, &(Vector3::x() - gain));
        self.covariance = rest * self.covariance * rest.transpose() + gain * gain.transpose() * sensor;
    }

    /// Comes to rest at once, as far as the model goes.
    fn clamp(&mut self) {
        let speed = self.state.y;
        self.given = 0.0;
        self.state.y = 0.0;
        let variances = self.covariance.diagonal() + Vector3::new(0.0, speed * speed, 0.0);
        self.covariance = Matrix3::from_diagonal(&variances);
    }
}
