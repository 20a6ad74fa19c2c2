//! A scenario: everything a run depends on, in one YAML file.

mod catalogue;
mod cell;
mod derived;
mod differences;
mod error;
mod gripper;
mod loading;
mod motor;
mod moved;
mod placed;
pub mod plan;
mod sections;
mod source;
mod validate;
mod waveform;

use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use catalogue::{PartSource, PartSourceError, catalogue_names};
pub use cell::{FurtherFeeder, PlatenSection, Recipe};
pub use differences::Differences;
pub use error::ScenarioError;
use error::{invalid, yaml_problem};
use feeder_control::courier::CourierConfig;
use feeder_control::delivery::DeliveryConfig;
use feeder_model::camera::MountedTray;
use feeder_model::part::PartType;
use feeder_sim::parts::BulkSettings;
use feeder_vision::{PartModel, SelectorConfig};
pub use gripper::Gripper;
pub use motor::{MotorSource, SimulatedCourier, SimulatedDriver, assumed_motor};
pub use placed::PlacedPart;
pub use sections::{BelievedSection, CameraSection, RunSection, Station, TimeSection, WorldSection};
pub use source::Source;
pub use waveform::{DesignBasis, WaveformSpec};

/// The scenario that runs when none is named.
pub const BUILT_IN: &str = include_str!("../../../launch_configs/default.yaml");

/// The model of the part that comes with the feeder, by the name it has beside the built-in scenario.
const MODEL_FILE: (&str, &str) = ("models/grommet.yaml", include_str!("../../../launch_configs/models/grommet.yaml"));

/// Everything a run depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Name of the feeder; its nodes live in the namespace of this name.
    pub feeder: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// When the run ends, and when it may end early.
    pub run: RunSection,
    /// Ticks and delays of the simulated loop.
    #[serde(default)]
    pub time: TimeSection,
    /// The tray and how it sits on the courier.
    pub tray: MountedTray,
    /// The vibration that feeds.
    pub waveform: WaveformSpec,
    /// What is simulated, and what control does not know.
    #[serde(default)]
    pub world: WorldSection,
    /// What control believes where that is not so.
    #[serde(default)]
    pub believed: BelievedSection,
    /// The courier and its driver.
    #[serde(default)]
    pub courier: CourierConfig,
    /// The parts: the name of a part of the catalogue, a part file, or a part.
    pub part: PartSource,
    /// How the parts behave in bulk. Where the radii are left out they follow from waveform, tray and friction.
    #[serde(default)]
    pub bulk: BulkSettings,
    /// Parts that lie at stated places at the start; others are loaded round them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts_placed: Vec<PlacedPart>,
    /// How many parts are loaded at random at the start.
    pub parts_loaded: u32,
    /// A hopper at the feeding place adds parts, one at a time, while fewer than this are in the feeder; 0: there is none.
    #[serde(default)]
    pub refill_below: u32,
    /// The camera.
    pub camera: CameraSection,
    /// The vision selector. The wanted pose is the part's.
    #[serde(default)]
    pub selector: SelectorConfig,
    /// What the selector was taught of the part: what `feeder teach` printed, or the file that it was printed to. Nothing
    /// can run without, but a part can be taught.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_model: Option<Source<PartModel>>,
    /// The delivery planner. Its stations are those of `stations`.
    #[serde(default)]
    pub delivery: DeliveryConfig,
    /// Where parts are delivered to, and who takes them there.
    pub stations: Vec<Station>,
    /// What can be fed; without any, the part in all its poses. The first is in force at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recipes: Vec<Recipe>,
    /// What couriers share.
    #[serde(default)]
    pub platen: PlatenSection,
    /// Feeders of the same kind on the same platen.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub further_feeders: Vec<FurtherFeeder>,
}

impl Default for Scenario {
    /// The built-in scenario.
    fn default() -> Self {
        #[expect(clippy::expect_used, reason = "part of this crate, and a test parses it")]
        BUILT_IN.parse().expect("the built-in scenario is valid")
    }
}

impl FromStr for Scenario {
    type Err = ScenarioError;

    /// Reads a scenario from YAML and checks it. Its part must be one of the catalogue or spelled out.
    fn from_str(yaml: &str) -> Result<Self, ScenarioError> {
        Self::read(yaml, &mut |_| Err("not found in the catalogue, and no file was read".to_owned()))
    }
}

impl Scenario {
    /// Reads a scenario from YAML and checks it. `read` returns the content of a file the scenario names, or why there
    /// is none.
    ///
    /// # Errors
    /// A text that is no scenario, a value out of range, or a file that cannot be read.
    pub fn read(yaml: &str, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Self, ScenarioError> {
        let mut scenario = Self::parse(yaml)?;
        if let Some(Source::Name(name)) = &scenario.part_model {
            scenario.part_model = Some(Source::Here(Box::new(read_model(name, read)?)));
        }
        scenario.load_and_check(read)
    }

    /// As [`read`](Self::read), but without what the selector was taught: that is about to be made anew.
    ///
    /// # Errors
    /// As those of [`read`](Self::read).
    pub fn read_untaught(
        yaml: &str,
        read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, ScenarioError> {
        Self { part_model: None, ..Self::parse(yaml)? }.load_and_check(read)
    }

    /// Takes over what `feeder teach` printed in place of what the selector was taught.
    ///
    /// # Errors
    /// A text that is no such model, or one of another part.
    pub fn teach(&mut self, model: &str) -> Result<(), ScenarioError> {
        let model = serde_saphyr::from_str(model).map_err(|error| invalid("part_model", &yaml_problem(&error)))?;
        self.part_model = Some(Source::Here(Box::new(model)));
        self.validate()
    }

    fn parse(yaml: &str) -> Result<Self, ScenarioError> {
        moved::check(yaml)?;
        serde_saphyr::from_str(yaml).map_err(|error| ScenarioError::Yaml(yaml_problem(&error)))
    }

    fn load_and_check(mut self, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Self, ScenarioError> {
        self.world.motor.load(read).map_err(|problem| invalid("world", &problem))?;
        self.part.load(read).map_err(|error| invalid("part", &error))?;
        self.validate()?;
        Ok(self)
    }

    /// The part, with its stable poses.
    ///
    /// # Errors
    /// A part that is neither in the catalogue nor spelled out, or is none.
    pub fn part_type(&self) -> Result<PartType, ScenarioError> {
        self.part.part_type().map_err(|error| invalid("part", &error))
    }

    /// The same scenario with another duration.
    ///
    /// # Errors
    /// A duration that is not positive, or longer than a day.
    pub fn with_duration_s(mut self, duration_s: f64) -> Result<Self, ScenarioError> {
        self.run.duration_s = duration_s;
        self.run.check()?;
        Ok(self)
    }

    /// As YAML, every value spelled out.
    ///
    /// # Errors
    /// A value that YAML cannot hold.
    pub fn to_yaml(&self) -> Result<String, ScenarioError> {
        serde_saphyr::to_string(self).map_err(|error| ScenarioError::Yaml(error.to_string()))
    }

    /// Namespace of the feeder's nodes.
    #[must_use]
    pub fn namespace(&self) -> String {
        format!("/{}", self.feeder)
    }
}

fn read_model(name: &str, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<PartModel, ScenarioError> {
    let refused =
        |problem: String| ScenarioError::Invalid { section: "part_model", problem: format!("{name}: {problem}") };
    let text = match read(name) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(_) if name == MODEL_FILE.0 => MODEL_FILE.1.to_owned(),
        Err(problem) => return Err(refused(problem)),
    };
    serde_saphyr::from_str(&text).map_err(|error| refused(yaml_problem(&error)))
}
