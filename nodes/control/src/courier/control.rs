//! The servo loop: from a set point and a measurement to a force.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::motor::Wrench;
use feeder_model::range::OutOfRange;
use feeder_model::range::{check_range, check_ranges};

/// Where the courier is to be at a servo tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SetPoint {
    /// Position at the tick.
    pub position: Vector3<f64>,
    /// Velocity at the tick.
    pub velocity: Vector3<f64>,
    /// Mean acceleration from this tick to the next.
    pub acceleration: Vector3<f64>,
}

/// How the servo loop responds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ControlParameters {
    /// Natural frequency of the position loop, Hz. The assumed plant becomes unstable beyond some 60 Hz.
    #[schemars(range(min = 1.0, max = 300.0))]
    pub bandwidth_hz: f64,
    /// Damping ratio of the position loop.
    #[schemars(range(min = 0.1, max = 3.0))]
    pub damping_ratio: f64,
    /// Corner frequency of the filter on the velocity error, Hz.
    #[schemars(range(min = 10.0, max = 1e5))]
    pub velocity_filter_hz: f64,
    /// Time in which the integral of a constant error grows as large as its proportional part, s; 0 for no integral.
    /// It takes up constant forces such as the tether's.
    pub integral_time_s: f64,
    /// Whether the force for the set point's acceleration is added to the feedback.
    pub feed_forward: bool,
}

impl Default for ControlParameters {
    fn default() -> Self {
        Self {
            bandwidth_hz: 20.0,
            damping_ratio: 0.9,
            velocity_filter_hz: 200.0,
            integral_time_s: 0.08,
            feed_forward: true,
        }
    }
}

impl ControlParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("control.", self)?;
        // Faster than this it would destabilise the loop.
        let shortest_s = 4.0 / (TAU * self.bandwidth_hz);
        let integral_time_s = if self.integral_time_s == 0.0 { shortest_s } else { self.integral_time_s };
        check_range("control.integral_time_s", integral_time_s, shortest_s, 10.0)
    }

    /// Growth of the integral's part per proportional part, 1/s.
    pub(super) fn integral_per_s(&self) -> f64 {
        if self.integral_time_s > 0.0 { self.integral_time_s.recip() } else { 0.0 }
    }
}

/// Proportional-derivative feedback, with an integral and feed-forward of the acceleration if wanted, each axis by itself.
///
/// F = M (a + ω² (e + ∫e dt/T_i) + 2 ζ ω ė), with the error e = set point − measurement and ė its difference quotient, low-passed. The
/// derivative is taken of the error, not of the measurement, so that a perfectly followed set point asks for no feedback
/// however fast it moves.
#[derive(Clone, Debug)]
pub struct Controller {
    mass: Vector3<f64>,
    stiffness_per_s2: f64,
    integral_per_s: f64,
    damping_per_s: f64,
    feed_forward: f64,
    filter_gain: f64,
    period_s: f64,
    last_error: Option<Vector3<f64>>,
    error_rate: Vector3<f64>,
    error_integral: Vector3<f64>,
    integrating: bool,
}

impl Controller {
    /// A controller for a servo period of `period_s` and the nominal mass, mass and inertia of the three axes.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(parameters: &ControlParameters, mass: Vector3<f64>, period_s: f64) -> Result<Self, OutOfRange> {
        parameters.validate()?;
        let natural_rad_s = TAU * parameters.bandwidth_hz;
        Ok(Self {
            mass,
            stiffness_per_s2: natural_rad_s * natural_rad_s,
            integral_per_s: parameters.integral_per_s(),
            damping_per_s: 2.0 * parameters.damping_ratio * natural_rad_s,
            feed_forward: if parameters.feed_forward { 1.0 } else { 0.0 },
            filter_gain: 1.0 - (-TAU * parameters.velocity_filter_hz * period_s).exp(),
            period_s,
            last_error: None,
            error_rate: Vector3::zeros(),
            error_integral: Vector3::zeros(),
            integrating: true,
        })
    }

    /// Sets the mass, mass and inertia that turn acceleration into force.
    pub fn set_mass(&mut self, mass: Vector3<f64>) {
        self.mass = mass;
    }

    /// Says whether what was last commanded was given in full. When not, the integral waits.
    pub fn note_given(&mut self, in_full: bool) {
        self.integrating = in_full;
    }

    /// Forgets the error's history, for a set point that is placed anew.
    pub fn reset(&mut self) {
        self.last_error = None;
        self.error_rate = Vector3::zeros();
        self.error_integral = Vector3::zeros();
    }

    /// The wrench where there is no measurement: for the set point's acceleration, and against the constant forces that
    /// the integral has found.
    #[must_use]
    pub fn blind_command(&self, set_point: &SetPoint) -> Wrench {
        let constant = self.error_integral * (self.integral_per_s * self.stiffness_per_s2);
        self.mass.component_mul(&(set_point.acceleration + constant))
    }

    /// The wrench for this servo tick, not yet limited.
    pub fn command(&mut self, set_point: &SetPoint, measured: &Vector3<f64>) -> Wrench {
        let error = set_point.position - measured;
        let rate = self.last_error.map_or_else(Vector3::zeros, |last| (error - last) / self.period_s);
        self.last_error = Some(error);
        self.error_rate += (rate - self.error_rate) * self.filter_gain;
        if self.integrating {
            self.error_integral += error * self.period_s;
        }
        let acceleration = set_point.acceleration * self.feed_forward
            + (error + self.error_integral * self.integral_per_s) * self.stiffness_per_s2
            + self.error_rate * self.damping_per_s;
        self.mass.component_mul(&acceleration)
    }
}
