//! A scenario: everything a run depends on, in one YAML file.

mod catalogue;
mod cell;
mod loading;
mod motor;
mod moved;
mod placed;
pub mod plan;
mod source;
mod waveform;

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use catalogue::{PartSource, PartSourceError, catalogue_names};
pub use cell::{FurtherFeeder, PlatenSection, Recipe};
use feeder_control::courier::CourierConfig;
use feeder_control::delivery::DeliveryConfig;
use feeder_control::manipulator::ManipulatorConfig;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::part::PartType;
use feeder_model::range::{OutOfRange, check_range};
use feeder_model::waveform::Waveform;
use feeder_sim::camera::{LightModel, Scene, SensorModel, TrayAppearance};
use feeder_sim::parts::BulkSettings;
use feeder_vision::{PartModel, Selector, SelectorConfig};
pub use motor::{MotorSource, SimulatedCourier, SimulatedDriver, assumed_motor};
pub use placed::PlacedPart;
pub use source::Source;
pub use waveform::WaveformSpec;

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

/// The simulated world, as far as it is not what control believes.
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
}

/// What control believes where that is not so, to see what comes of it. What is left out is as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BelievedSection {
    /// Coefficient of static friction between part and tray with which moves reckon, in place of the part's own.
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
        plan::check_tick(self.tick_ms)?;
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
    /// Time between frames, ms; a whole number of ticks.
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
    /// The manipulator.
    #[serde(default)]
    pub manipulator: ManipulatorConfig,
}

/// Why a scenario cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScenarioError {
    /// The text is not a scenario: an unknown key, a wrong type, a missing value.
    #[error("{0}")]
    Yaml(String),
    /// A value is out of its range, or does not go with others.
    #[error("{section}: {problem}")]
    Invalid {
        /// Top-level key.
        section: &'static str,
        /// Key, value and allowed range.
        problem: String,
    },
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

/// Poses that differ by less in height and reach are the same, m.
const SAME_SIZE_M: f64 = 1e-6;

/// The longest run, s: 24 hours.
const DURATION_S_MAX: f64 = 86_400.0;

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

    fn parse(yaml: &str) -> Result<Self, ScenarioError> {
        moved::check(yaml)?;
        serde_saphyr::from_str(yaml).map_err(|error| ScenarioError::Yaml(error.to_string()))
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
        self.validate()?;
        Ok(self)
    }

    /// As YAML, every value spelled out.
    ///
    /// # Errors
    /// A value that YAML cannot hold.
    pub fn to_yaml(&self) -> Result<String, ScenarioError> {
        serde_saphyr::to_string(self).map_err(|error| ScenarioError::Yaml(error.to_string()))
    }

    /// The waveform that feeds.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn waveform(&self) -> Result<Waveform, ScenarioError> {
        let friction = self.believed_friction(&self.part_type()?);
        self.waveform.design(&self.tray.geometry, friction).map_err(|error| invalid("waveform", &error))
    }

    /// What the camera sees.
    #[must_use]
    pub fn scene(&self, part: &PartType) -> Scene {
        self.simulated_camera().scene(self.tray, part)
    }

    /// The selector's parameters, with the wanted poses of the part.
    #[must_use]
    pub fn selector(&self, part: &PartType) -> SelectorConfig {
        SelectorConfig { wanted_poses: part.wanted_poses.clone(), ..self.selector.clone() }
    }

    /// Namespace of the feeder's nodes.
    #[must_use]
    pub fn namespace(&self) -> String {
        format!("/{}", self.feeder)
    }

    fn validate(&self) -> Result<(), ScenarioError> {
        check_name("feeder", &self.feeder)?;
        self.validate_time()?;
        let geometry = self.tray.validate();
        geometry.map_err(|error| invalid("tray", &error))?;
        self.courier.validate().map_err(|error| invalid("courier", &error))?;
        self.validate_waveform()?;
        let part = self.part_type()?;
        let bulk = self.bulk_settings(&part)?;
        placed::bulk_with(&self.parts_placed, self.tray.geometry, part.clone(), bulk, self.seed)?;
        self.validate_camera(&part)?;
        if let Some(Source::Here(model)) = &self.part_model {
            check_taught(model, &part)?;
            Selector::check(&self.selector(&part), &self.camera.model, &self.tray, model)
                .map_err(|error| invalid("selector", &error))?;
        }
        self.delivery.validate().map_err(|error| invalid("delivery", &error))?;
        check_range("part_friction", self.believed_friction(&part), 0.01, 5.0)
            .map_err(|error| invalid("believed", &error))?;
        self.validate_stations()?;
        self.validate_cell(&part)
    }

    fn validate_time(&self) -> Result<(), ScenarioError> {
        self.run.check()?;
        self.time.check()?;
        let servo_ticks = self.time.tick_s() / self.courier.servo_period_s;
        if (servo_ticks - servo_ticks.round()).abs() > 1e-9 {
            let problem = format!("tick_ms = {} holds no whole number of courier.servo_period_s", self.time.tick_ms);
            return Err(ScenarioError::Invalid { section: "time", problem });
        }
        Ok(())
    }

    fn validate_waveform(&self) -> Result<(), ScenarioError> {
        let waveform = self.waveform()?;
        let motor = self.world.motor.parameters().map_err(|problem| invalid("world", &problem))?;
        motor.validate().map_err(|error| invalid("world", &error))?;
        self.courier.waveform_envelope().check(&waveform).map_err(|error| invalid("waveform", &error))
    }

    fn validate_camera(&self, part: &PartType) -> Result<(), ScenarioError> {
        check_count("camera", "period_ms", self.camera.period_ms, self.time.tick_ms, 10_000)?;
        if !self.camera.period_ms.is_multiple_of(self.time.tick_ms) {
            let problem =
                format!("period_ms = {} is no multiple of time.tick_ms = {}", self.camera.period_ms, self.time.tick_ms);
            return Err(ScenarioError::Invalid { section: "camera", problem });
        }
        check_count("camera", "jpeg_quality", self.camera.jpeg_quality.into(), 1, 100)?;
        self.scene(part).validate().map_err(|error| invalid("camera", &error))
    }

    fn validate_stations(&self) -> Result<(), ScenarioError> {
        let section = "stations";
        for (index, station) in self.stations.iter().enumerate() {
            check_name(section, &station.name)?;
            if self.feeder_names().any(|name| name == station.name)
                || self.stations[..index].iter().any(|other| other.name == station.name)
            {
                let problem = format!("name = {:?} is used twice, allowed are distinct names", station.name);
                return Err(ScenarioError::Invalid { section, problem });
            }
            let limits = &self.courier.limits;
            for (key, value, min, max) in [
                ("x_m", station.x_m, limits.x_m_min, limits.x_m_max),
                ("y_m", station.y_m, limits.y_m_min, limits.y_m_max),
            ] {
                if !(min..=max).contains(&value) {
                    let problem =
                        format!("{}.{key} = {value} lies off the platen, allowed is {min} to {max}", station.name);
                    return Err(ScenarioError::Invalid { section, problem });
                }
            }
            let checked = station.manipulator.validate();
            checked.map_err(|error| invalid(section, &format_args!("{}.manipulator: {error}", station.name)))?;
        }
        Ok(())
    }
}

/// Checks that a model was taught the part and no other: its poses are as high and reach as far.
fn check_taught(model: &PartModel, part: &PartType) -> Result<(), ScenarioError> {
    let same = |a_m: f64, b_m: f64| (a_m - b_m).abs() <= SAME_SIZE_M;
    let are_same = model.poses.len() == part.poses.len()
        && model.poses.iter().zip(&part.poses).all(|(taught, pose)| {
            let reach_m = taught.outline_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
            same(taught.height_m, pose.height_m) && same(reach_m, pose.outline.radius_m)
        });
    if are_same {
        return Ok(());
    }
    let problem = format!("was taught of another part than {}; teach it anew with `feeder teach`", part.name);
    Err(ScenarioError::Invalid { section: "part_model", problem })
}

fn read_model(name: &str, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<PartModel, ScenarioError> {
    let refused =
        |problem: String| ScenarioError::Invalid { section: "part_model", problem: format!("{name}: {problem}") };
    let text = match read(name) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(_) if name == MODEL_FILE.0 => MODEL_FILE.1.to_owned(),
        Err(problem) => return Err(refused(problem)),
    };
    serde_saphyr::from_str(&text).map_err(|error| refused(error.to_string()))
}

fn invalid(section: &'static str, problem: &impl fmt::Display) -> ScenarioError {
    ScenarioError::Invalid { section, problem: problem.to_string() }
}

fn check_count(section: &'static str, key: &str, value: u64, min: u64, max: u64) -> Result<(), ScenarioError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    let problem = format!("{key} = {value} is outside its range: {min} to {max}");
    Err(ScenarioError::Invalid { section, problem })
}

/// ROS names: a letter, then letters, digits and underscores.
fn check_name(section: &'static str, name: &str) -> Result<(), ScenarioError> {
    let mut chars = name.chars();
    let starts = chars.next().is_some_and(|first| first.is_ascii_alphabetic());
    if starts && chars.all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Ok(());
    }
    let problem = format!("name {name:?} is no ROS name, allowed are a letter, then letters, digits and underscores");
    Err(ScenarioError::Invalid { section, problem })
}
