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

    /// This load with so many times another one beside it, or without it where `times` is negative.
    #[must_use]
    pub fn with(self, times: f64, other: &Self) -> Self {
        Self {
            mass_kg: self.mass_kg + times * other.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2 + times * other.inertia_kg_m2,
        }
    }
}

/// The parts that a tray carries, as far as it is known how many were put on it and how many were taken away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarriedParts {
    /// What a part adds to the load, on average over the places where parts are.
    pub part: Load,
    /// Parts there at the start, or those that a hopper keeps there, where these are more.
    pub count_max: u32,
    /// Below how many parts a hopper adds some; 0: there is none.
    pub refill_below: u32,
}

impl CarriedParts {
    /// How many parts are there when so many have been taken away.
    #[must_use]
    pub fn left(&self, taken: u32) -> u32 {
        self.count_max.saturating_sub(taken).max(self.refill_below.min(self.count_max))
    }

    /// What the tray carries beside parts, where `full` is what it carries with all of them.
    #[must_use]
    pub fn without(&self, full: &Load) -> Load {
        full.with(-f64::from(self.count_max), &self.part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PART: Load = Load { mass_kg: 2e-3, inertia_kg_m2: 1.4e-5 };

    #[test]
    fn parts_taken_away_are_gone_unless_a_hopper_adds_others() {
        let carried = |refill_below| CarriedParts { part: PART, count_max: 20, refill_below };
        let left = |refill_below| [0, 7, 20, 30].map(|taken| carried(refill_below).left(taken));
        assert_eq!((left(0), left(15), left(20)), ([20, 13, 0, 0], [20, 15, 15, 15], [20; 4]));
    }

    #[test]
    fn verif_a_load_with_its_parts_and_without_them_is_itself() {
        let carried = CarriedParts { part: PART, count_max: 20, refill_below: 0 };
        let full = Load { mass_kg: 0.24, inertia_kg_m2: 1.28e-3 };
        let own = carried.without(&full);
        assert!((own.mass_kg - 0.2).abs() < 1e-12 && (own.inertia_kg_m2 - 1e-3).abs() < 1e-12);
        let again = own.with(20.0, &PART);
        assert!((again.mass_kg - full.mass_kg).abs() < 1e-12);
    }
}
