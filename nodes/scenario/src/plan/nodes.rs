//! What each kind of node is configured by. A node knows nothing of a run but this.

use feeder_control::courier::{CourierConfig, CourierLimits, WaveformEnvelope};
use feeder_control::delivery::{DeliveryConfig, FeedRate, GentleParameters, Tether};
use feeder_control::manipulator::ManipulatorConfig;
use feeder_control::platen::Area;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::motor::{CarriedParts, Load};
use feeder_model::part::{PartSpec, PartType};
use feeder_model::range::check_ranges;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::Waveform;
use feeder_sim::camera::{LightModel, PartSolid, Scene, SensorModel, TrayAppearance};
use feeder_sim::motor::MotorParameters;
use feeder_sim::parts::{BulkSettings, PartBulk};
use feeder_vision::{PartModel, Selector, SelectorConfig};
use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::check_count;
use crate::placed::bulk_with;
use crate::{Differences, PlacedPart, ScenarioError, SimulatedCourier, invalid};

/// Configuration of the waveform generator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaveformGeneratorConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Name of the waveform, for people.
    pub name: String,
    /// The vibration that feeds.
    pub waveform: Waveform,
    /// What the courier can run: a waveform that its driver would refuse is not published.
    pub envelope: WaveformEnvelope,
}

impl WaveformGeneratorConfig {
    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        self.envelope.validate().map_err(|error| invalid("courier", &error))?;
        self.envelope.check(&self.waveform).map_err(|error| invalid("waveform", &error))
    }
}

/// Configuration of the courier driver, with the motor that stands in for the machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CourierDriverConfig {
    /// Time between steps, ms; a whole number of servo periods.
    pub tick_ms: u64,
    /// Name of the feeder, with which its frames begin.
    pub feeder: String,
    /// Seed of the random numbers of the feeder.
    pub seed: u64,
    /// The tray and how it sits on the courier.
    pub tray: MountedTray,
    /// Radius of the disc about the tray's centre that covers the courier, m.
    pub footprint_radius_m: f64,
    /// What the driver is set up with; its load is that with all parts.
    pub courier: CourierConfig,
    /// The parts on the tray, which become fewer as they are handed over.
    #[serde(default)]
    pub parts: CarriedParts,
    /// The motor that is simulated. The driver does not know it.
    pub motor: MotorParameters,
}

impl CourierDriverConfig {
    /// The driver with its simulated motor.
    #[must_use]
    pub fn simulated_courier(&self) -> SimulatedCourier {
        SimulatedCourier { config: self.courier, motor: self.motor }
    }

    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        self.motor.validate().map_err(|error| invalid("world", &error))?;
        self.courier.validate().map_err(|error| invalid("courier", &error))?;
        self.tray.validate().map_err(|error| invalid("tray", &error))?;
        self.parts.without(&self.courier.load).validate().map_err(|error| invalid("parts", &error))?;
        let servo_ticks = self.tick_ms as f64 * 1e-3 / self.courier.servo_period_s;
        if (servo_ticks - servo_ticks.round()).abs() > 1e-9 {
            let problem = format!("tick_ms = {} holds no whole number of courier.servo_period_s", self.tick_ms);
            return Err(ScenarioError::Invalid { section: "time", problem });
        }
        Ok(())
    }
}

/// The camera as it is simulated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedCamera {
    /// Time between frames, ms.
    pub period_ms: u64,
    /// Quality of the compressed image, 1 to 100.
    pub jpeg_quality: u8,
    /// Optics, size and place as they were calibrated: what everybody is told.
    pub calibrated: CameraModel,
    /// Optics, size and place as they are.
    pub model: CameraModel,
    /// How tray and platen look.
    pub tray: TrayAppearance,
    /// The light.
    pub light: LightModel,
    /// The sensor.
    pub sensor: SensorModel,
}

impl SimulatedCamera {
    /// What the camera sees.
    #[must_use]
    pub fn scene(&self, tray: MountedTray, part: &PartType) -> Scene {
        Scene {
            camera: self.model.clone(),
            tray,
            tray_appearance: self.tray,
            part: PartSolid::new(part.mesh.clone(), &part.poses),
            light: self.light,
            sensor: self.sensor,
        }
    }
}

/// Configuration of the part simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartSimulatorConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Name of the feeder, with which its frames begin.
    pub feeder: String,
    /// Seed of the random numbers of the feeder.
    pub seed: u64,
    /// The parts.
    pub part: PartSpec,
    /// Friction between part and tray over that which the part states.
    pub part_friction_ratio: f64,
    /// The tray and how it sits on the courier.
    pub tray: MountedTray,
    /// Where the tray is at first: x, y (m) and yaw (rad) on the platen.
    #[schemars(with = "[f64; 3]")]
    pub tray_start: Vector3<f64>,
    /// How the parts behave in bulk.
    pub bulk: BulkSettings,
    /// How many parts are loaded at the start.
    pub parts_loaded: u32,
    /// Parts that lie at stated places at the start, beside those.
    pub parts_placed: Vec<PlacedPart>,
    /// The hopper adds parts while fewer than this are in the feeder; 0: there is none.
    pub refill_below: u32,
    /// Where the tray stands under the hopper, x and y on the platen, m.
    #[schemars(with = "[f64; 2]")]
    pub hopper_m: Vector2<f64>,
    /// The namespaces of the services by which grippers close on parts.
    pub pick_namespaces: Vec<String>,
    /// The namespace of the services by which operators look at parts and move them; empty: none.
    #[serde(default)]
    pub entity_namespace: String,
    /// The camera.
    pub camera: SimulatedCamera,
}

impl PartSimulatorConfig {
    /// The part, with the friction that it has.
    ///
    /// # Errors
    /// A part that is none.
    pub fn part_type(&self) -> Result<PartType, ScenarioError> {
        let told = PartType::new(&self.part).map_err(|error| invalid("part", &error))?;
        let differences = Differences { friction_ratio: self.part_friction_ratio, ..Differences::NONE };
        differences.part(&told).map_err(|error| invalid("part", &error))
    }

    /// The parts in bulk, with those placed but none loaded.
    ///
    /// # Errors
    /// Settings out of range, or a part placed where it cannot be.
    pub fn parts_in_bulk(&self, part: PartType, seed: u64) -> Result<PartBulk, ScenarioError> {
        bulk_with(&self.parts_placed, self.tray.geometry, part, self.bulk, seed)
    }

    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        let part = self.part_type()?;
        self.tray.validate().map_err(|error| invalid("tray", &error))?;
        self.parts_in_bulk(part.clone(), self.seed)?;
        check_count("camera", "period_ms", self.camera.period_ms, self.tick_ms, 10_000)?;
        if !self.camera.period_ms.is_multiple_of(self.tick_ms) {
            let problem =
                format!("period_ms = {} is no multiple of time.tick_ms = {}", self.camera.period_ms, self.tick_ms);
            return Err(ScenarioError::Invalid { section: "camera", problem });
        }
        check_count("camera", "jpeg_quality", self.camera.jpeg_quality.into(), 1, 100)?;
        self.camera.scene(self.tray, &part).validate().map_err(|error| invalid("camera", &error))
    }
}

/// How pictures come to the selector, in the words of `image_transport`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImageTransport {
    /// As JPEG or PNG, on `camera/image_raw/compressed`. Simulated runs have nothing else.
    #[default]
    Compressed,
    /// As they are, on `camera/image_raw`.
    Raw,
}

/// Configuration of the vision selector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VisionSelectorConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Name of the feeder, with which its frames begin.
    pub feeder: String,
    /// Name of the part.
    pub part_class: String,
    /// Names of its resting poses, in the order in which they were taught.
    pub poses: Vec<String>,
    /// Which of them are wanted, counted from 0.
    pub wanted_poses: Vec<usize>,
    /// The selector.
    pub selector: SelectorConfig,
    /// Time between frames of the camera, ms.
    pub camera_period_ms: u64,
    /// How pictures come: `compressed`, or `raw` where the camera sends no compressed ones.
    #[serde(default)]
    pub image_transport: ImageTransport,
    /// Optics, size and place of the camera, as calibrated.
    pub camera: CameraModel,
    /// The tray and how it sits on the courier.
    pub tray: MountedTray,
    /// What the selector was taught of the part.
    pub part_model: PartModel,
}

impl VisionSelectorConfig {
    fn selector_config(&self) -> SelectorConfig {
        SelectorConfig { wanted_poses: self.wanted_poses.clone(), ..self.selector.clone() }
    }

    /// The selector.
    ///
    /// # Errors
    /// Values that do not go together.
    pub fn selector(&self) -> Result<Selector, ScenarioError> {
        Selector::new(self.selector_config(), &self.camera, &self.tray, &self.part_model)
            .map_err(|error| invalid("selector", &error))
    }

    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        Selector::check(&self.selector_config(), &self.camera, &self.tray, &self.part_model)
            .map_err(|error| invalid("selector", &error))
    }
}

/// A station as the delivery planner knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedStation {
    /// Its name.
    pub name: String,
    /// Its tool axis on the platen, x, m.
    pub x_m: f64,
    /// Its tool axis on the platen, y, m.
    pub y_m: f64,
    /// Whether the feeder's camera sees it: then parts are looked at again there.
    pub rechecked: bool,
}

/// Something that the feeder can feed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedRecipe {
    /// Its name.
    pub name: String,
    /// Resting poses that agents may ask for.
    pub pose_classes: Vec<String>,
    /// The vibration; without it the generator's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waveform: Option<Waveform>,
    /// How fast the vibration should feed parts on the plateau, by growing radius; nothing: not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plateau_feed: Vec<FeedRate>,
    /// Its period, s; 0: not known.
    #[serde(default)]
    pub period_s: f64,
    /// Share of the parts on the ramp that the vibration should bring up each second, 1/s; nothing: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub climb_per_s: Option<f64>,
}

/// Configuration of the delivery planner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeliveryPlannerConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Name of the feeder, with which its frames begin.
    pub feeder: String,
    /// Seed of the random numbers of the feeder.
    pub seed: u64,
    /// Name of the part.
    pub part_class: String,
    /// Largest width of the part as it lies, m.
    pub part_diameter_m: f64,
    /// Largest height of the part as it lies, m.
    pub part_height_m: f64,
    /// Coefficient of static friction between part and tray that moves reckon with: the least that it may be.
    pub part_friction: f64,
    /// What the feeder can feed; the first is in force at the start.
    pub recipes: Vec<PlannedRecipe>,
    /// The tray and how it sits on the courier.
    pub tray: MountedTray,
    /// The envelope of the courier's moves.
    pub limits: CourierLimits,
    /// What the tray carries with all parts.
    pub load: Load,
    /// The parts on the tray, which become fewer as they are handed over.
    #[serde(default)]
    pub parts: CarriedParts,
    /// How parts are delivered.
    pub delivery: DeliveryConfig,
    /// Where they are delivered to.
    pub stations: Vec<PlannedStation>,
    /// Areas that no part of the courier may enter.
    pub keep_out: Vec<Area>,
    /// Whether areas of the platen must be reserved for every trip.
    pub arbitrated: bool,
}

impl DeliveryPlannerConfig {
    /// The sequencer's parameters, with the part's friction, the courier's tether, the stations and the areas.
    #[must_use]
    pub fn delivery(&self) -> DeliveryConfig {
        let stations = self.stations.iter();
        let rechecked = self.stations.iter().filter(|station| station.rechecked);
        DeliveryConfig {
            stations_m: stations.map(|station| (station.name.clone(), [station.x_m, station.y_m].into())).collect(),
            rechecked_stations: rechecked.map(|station| station.name.clone()).collect(),
            keep_out: self.keep_out.clone(),
            arbitrated: self.arbitrated,
            tether: Some(Tether {
                anchor_m: self.limits.tether_anchor_m.into(),
                length_m: self.limits.tether_length_m,
            }),
            gentle: GentleParameters { friction: self.part_friction, ..self.delivery.gentle },
            ..self.delivery.clone()
        }
    }

    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        self.limits.validate().map_err(|error| invalid("courier", &error))?;
        self.load.validate().map_err(|error| invalid("courier", &error))?;
        self.delivery().validate().map_err(|error| invalid("delivery", &error))
    }
}

/// A feeder as a manipulator knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ServedFeeder {
    /// Its name.
    pub name: String,
    /// The namespace of the service by which the gripper closes on its parts.
    pub pick_namespace: String,
}

/// Configuration of an overhead manipulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OverheadManipulatorConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Name of its station.
    pub station: String,
    /// Its tool axis on the platen, x, m.
    pub x_m: f64,
    /// Its tool axis on the platen, y, m.
    pub y_m: f64,
    /// Top of the plateau above the platen, m.
    pub plateau_height_m: f64,
    /// Seed of the random numbers of the run.
    pub seed: u64,
    /// The feeders it asks for parts, in turn.
    pub feeders: Vec<ServedFeeder>,
    /// Name of the part it asks for.
    pub part_class: String,
    /// Name of the resting pose it asks for.
    pub pose_class: String,
    /// Width of its open gripper, m.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub gripper_opening_m: f64,
    /// Direction across which its jaws close on a part, in the part's own frame, rad.
    pub jaws_yaw_rad: f64,
    /// Free gap that the open gripper needs between a part and the next, m.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub part_gap_m_min: f64,
    /// The manipulator.
    pub manipulator: ManipulatorConfig,
}

impl OverheadManipulatorConfig {
    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        check_ranges("", self).map_err(|error| invalid("stations", &format_args!("{}.{error}", self.station)))?;
        self.manipulator
            .validate()
            .map_err(|error| invalid("stations", &format_args!("{}.manipulator: {error}", self.station)))
    }
}

/// Configuration of the platen arbiter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlatenArbiterConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
}

impl PlatenArbiterConfig {
    #[expect(clippy::unused_self, clippy::unnecessary_wraps, reason = "one signature for all kinds of nodes")]
    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        Ok(())
    }
}

/// A simulated gripper as the run monitor knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WatchedGripper {
    /// Its station.
    pub station: String,
    /// Free gap that it needs, open, between a part and the next, m.
    pub part_gap_m_min: f64,
}

/// Configuration of the run monitor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunMonitorConfig {
    /// Time between steps, ms.
    pub tick_ms: u64,
    /// Names of all feeders.
    pub feeders: Vec<String>,
    /// The tray of each.
    pub tray: TrayGeometry,
    /// The parts.
    pub part: PartSpec,
    /// Free gap that a gripper needs to the next part, m: the least of the stations', or what the selector asks for.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub part_gap_m_min: f64,
    /// The simulated manipulators.
    pub grippers: Vec<WatchedGripper>,
    /// Radius of a disc about a courier's centre that covers courier and tray, m.
    pub footprint_radius_m: f64,
    /// Whether couriers share the platen, so that areas are reserved.
    pub arbitrated: bool,
}

impl RunMonitorConfig {
    pub(super) fn check_values(&self) -> Result<(), ScenarioError> {
        check_ranges("", self).map_err(|error| invalid("run_monitor", &error))?;
        PartType::new(&self.part).map(|_| ()).map_err(|error| invalid("part", &error))
    }
}
