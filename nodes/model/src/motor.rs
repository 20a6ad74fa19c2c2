//! What a driver and a motor must agree on: the command, the measurement, and what the tray carries.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::{OutOfRange, check_range};

/// Force along x and y (N) and torque about z (N m).
pub type Wrench = Vector3<f64>;

/// The hardware side of the servo loop: all that a driver can do to a motor, and all that it can know of it.
pub trait PlanarMotor {
    /// Applies `command` for `duration_s`, the time to the next servo tick.
    fn step(&mut self, command: Wrench, duration_s: f64);

    /// Reads the position sensor: x, y (m) and yaw (rad), not finite when there is nothing to read. Called at every
    /// servo tick.
    fn measure(&mut self) -> Vector3<f64>;

    /// Switches the air of the bearings. Without air the courier's magnets clamp it to the platen.
    fn set_air(&mut self, on: bool);
}

/// What the tray carries, added to the courier's own mass and inertia.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Load {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the tray's centre, kg m².
    pub inertia_kg_m2: f64,
}

impl Load {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("load.mass_kg", self.mass_kg, 0.0, 20.0)?;
        check_range("load.inertia_kg_m2", self.inertia_kg_m2, 0.0, 1.0)
    }
}
