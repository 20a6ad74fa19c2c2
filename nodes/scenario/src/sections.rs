//! The sections of a scenario that are values alone: run, time, world, beliefs, camera and stations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_control::manipulator::ManipulatorConfig;
use feeder_model::camera::CameraModel;
use feeder_model::range::OutOfRange;
use feeder_sim::camera::{LightModel, SensorModel, TrayAppearance};

use crate::MotorSource;
use crate::differences::Differences;
use crate::error::{ScenarioError, check_count, check_tick, invalid};
use crate::gripper::Gripper;

/// The longest run, s: 24 hours.
const DURATION_S_MAX: f64 = 86_400.0;

/// The simulated world, as far as it is not what control believes. Light, sensor and the tray's look are those under which the
/// part is taught.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WorldSection {
    /// The motor: `ideal`, `assumed`, the name of a file with its values, or its values.
    pub motor: MotorSource,
    /// How tray and platen look.
    pub tray: TrayAppearance,
    /// The light.
    pub light: LightModel,
    /// The camera's sensor.
    pub sensor: SensorModel,
    /// How all this, the camera and the part differ from what control was told of them.
    pub differences: Differences,
}

/// What control believes where that is not so, to see what comes of it. What is left out is as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BelievedSection {
    /// Coefficient of friction between part and tray, in place of the part's own; it is taken to be as uncertain as that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part_friction: Option<f64>,
}

/// When a run ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunSection {
    /// Simulated time after which the run ends, s.
    pub duration_s: f64,
    /// Parts delivered after which it ends earlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_delivered: Option<u32>,
}

impl RunSection {
    pub(crate) fn check(&self) -> Result<(), ScenarioError> {
        let in_range = self.duration_s > 0.0 && self.duration_s <= DURATION_S_MAX;
        let allowed = format_args!("above 0, at most {DURATION_S_MAX}");
        OutOfRange::unless(in_range, "duration_s", self.duration_s, allowed).map_err(|error| invalid("run", &error))?;
        Ok(())
    }
}

/// Ticks of simulated time, and how late one node hears another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TimeSection {
    /// Length of a tick, ms.
    pub tick_ms: u64,
    /// Delay from cause to effect, ticks.
    pub forward_delay_ticks: u64,
    /// Delay from what is seen to what is done about it, ticks: the latency that decisions have in a real cell.
    pub feedback_delay_ticks: u64,
    /// How far nodes may run ahead of each other, ticks. It changes no result.
    pub window_ticks: u64,
}

impl Default for TimeSection {
    fn default() -> Self {
        Self { tick_ms: 10, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 32 }
    }
}

impl TimeSection {
    /// Length of a tick, ns.
    #[must_use]
    pub fn tick_ns(&self) -> u64 {
        self.tick_ms * 1_000_000
    }

    pub(crate) fn check(&self) -> Result<(), ScenarioError> {
        check_tick(self.tick_ms)?;
        check_count("time", "forward_delay_ticks", self.forward_delay_ticks, 1, 20)?;
        check_count("time", "feedback_delay_ticks", self.feedback_delay_ticks, 1, 40)?;
        let largest = self.forward_delay_ticks.max(self.feedback_delay_ticks);
        check_count("time", "window_ticks", self.window_ticks, 4, 56 - largest)
    }

    /// Length of a tick, s.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        std::time::Duration::from_millis(self.tick_ms).as_secs_f64()
    }
}

/// The camera above the feeding place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSection {
    /// Time between frames, ms; a whole number of ticks, 500 at most: seen less often, parts that are fed are not known again.
    pub period_ms: u64,
    /// Quality of the compressed image, 1 to 100.
    pub jpeg_quality: u8,
    /// Optics, size and place, as calibrated.
    pub model: CameraModel,
}

/// A place where a manipulator takes parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Name of the station; its manipulator lives in the namespace of this name.
    pub name: String,
    /// The tool axis on the platen, x, m.
    pub x_m: f64,
    /// The tool axis on the platen, y, m.
    pub y_m: f64,
    /// The feeders that the manipulator asks for parts, in turn; empty: the first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub feeders: Vec<String>,
    /// Somebody outside the run works here: no manipulator is started.
    #[serde(default)]
    pub external: bool,
    /// The gripper.
    #[serde(default)]
    pub gripper: Gripper,
    /// The manipulator.
    #[serde(default)]
    pub manipulator: ManipulatorConfig,
}
