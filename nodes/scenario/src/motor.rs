//! The motors that come with the feeder, and how a scenario names its own.

use feeder_control::courier::{CourierConfig, Driver};
use feeder_model::range::OutOfRange;
use feeder_sim::motor::{MotorParameters, SimulatedMotor};

use crate::Source;
use crate::error::yaml_problem;

/// The assumed motor as it stands in a file, each value marked as published or assumed.
const ASSUMED: &str = include_str!("../../../launch_configs/plants/assumed.yaml");

/// The simulated motor as a scenario states it: `ideal`, `assumed`, or its values.
pub type MotorSource = Source<MotorParameters>;

impl Default for MotorSource {
    fn default() -> Self {
        Self::Name("ideal".to_owned())
    }
}

impl MotorSource {
    /// Reads the file with the motor's values, if it is the name of one; `read` returns its content, or why there is none.
    pub(crate) fn load(&mut self, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<(), String> {
        let Self::Name(name) = self else { return Ok(()) };
        if ["ideal", "assumed"].contains(&name.as_str()) {
            return Ok(());
        }
        let problem = |problem: String| {
            format!(
                "motor = {name:?}, allowed are ideal, assumed, the values of a motor, or a file with them: {problem}"
            )
        };
        let text = String::from_utf8(read(name).map_err(problem)?).map_err(|error| problem(error.to_string()))?;
        let values = serde_saphyr::from_str(&text).map_err(|error| problem(yaml_problem(&error)))?;
        *self = Self::Here(Box::new(values));
        Ok(())
    }

    /// The values.
    ///
    /// # Errors
    /// A name that is none of a known motor.
    pub fn parameters(&self) -> Result<MotorParameters, String> {
        match self {
            Self::Here(parameters) => Ok(**parameters),
            Self::Name(name) => match name.as_str() {
                "ideal" => Ok(MotorParameters::IDEAL),
                "assumed" => Ok(assumed_motor()),
                _ => Err(format!("motor = {name:?}, allowed are ideal, assumed, or the values of a motor")),
            },
        }
    }
}

/// The assumed motor, `launch_configs/plants/assumed.yaml`.
#[must_use]
pub fn assumed_motor() -> MotorParameters {
    #[expect(clippy::expect_used, reason = "part of this crate, and a test parses it")]
    serde_saphyr::from_str(ASSUMED).expect("the assumed motor is valid")
}

/// The driver of a simulated motor.
pub type SimulatedDriver = Driver<SimulatedMotor>;

/// A courier's driver with the motor that stands in for the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulatedCourier {
    /// What the driver is set up with.
    pub config: CourierConfig,
    /// The motor, which the driver does not know.
    pub motor: MotorParameters,
}

impl SimulatedCourier {
    /// The motor at the courier's start, with the load that the driver reckons with on the tray; the sensor's noise is drawn
    /// from `seed`.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn simulated_motor(&self, seed: u64) -> Result<SimulatedMotor, OutOfRange> {
        self.config.validate()?;
        let mut motor = SimulatedMotor::new(self.motor, self.config.start, seed)?;
        motor.set_load(&self.config.load);
        Ok(motor)
    }

    /// The driver of that motor.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn driver(&self, seed: u64) -> Result<SimulatedDriver, OutOfRange> {
        Driver::with_motor(self.config, self.simulated_motor(seed)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_assumed_motor_gives_every_value_but_the_faults() {
        let given: serde_json::Value = serde_saphyr::from_str(ASSUMED).unwrap();
        let all = serde_json::to_value(assumed_motor()).unwrap();
        let missing: Vec<_> = all.as_object().unwrap().keys().filter(|key| given.get(key).is_none()).collect();
        assert_eq!(missing, ["faults"]);
        assert_eq!(assumed_motor().validate(), Ok(()));
    }
}
