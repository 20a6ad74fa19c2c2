//! What a manipulator is set up with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::AxisSpeed;
use feeder_model::range::{OutOfRange, check_ranges};

/// A manipulator and how it works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ManipulatorConfig {
    /// Requests that it keeps open, the one whose part it puts away among them: with several the feeder can bring parts on
    /// one trip, and the next while one is put away.
    #[schemars(range(min = 1, max = 20))]
    pub goals_open: u32,
    /// Height of the open gripper above the plateau while it waits, m.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub travel_height_m: f64,
    /// The vertical axis.
    pub z: AxisSpeed,
    /// The rotation.
    pub theta: AxisSpeed,
    /// Time the gripper takes to close, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub grip_s: f64,
    /// Time it takes to put a part away before it can take the next, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub place_s: f64,
    /// Largest offset of a presented part from the axis that it still picks, m.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub tolerance_m: f64,
    /// How long it waits for a part before it asks anew, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub timeout_s: f64,
    /// How far the gripper closes from where it was told to, along each of x and y: standard deviation, m.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub pick_error_m: f64,
    /// Share of picks that fail: the gripper loses the part again before it is lifted.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub pick_failure_probability: f64,
    /// A fault to test with: after so many picks it never says anything again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub silent_after: Option<u32>,
}

impl Default for ManipulatorConfig {
    fn default() -> Self {
        Self {
            goals_open: 1,
            travel_height_m: 0.030,
            z: AxisSpeed { speed_max: 0.3, acceleration_max: 5.0 },
            theta: AxisSpeed { speed_max: 10.0, acceleration_max: 200.0 },
            grip_s: 0.05,
            place_s: 1.0,
            tolerance_m: 0.0005,
            timeout_s: 60.0,
            pick_error_m: 0.0,
            pick_failure_probability: 0.0,
            silent_after: None,
        }
    }
}

impl ManipulatorConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("", self)?;
        check_ranges("z.", &self.z)?;
        check_ranges("theta.", &self.theta)
    }
}
