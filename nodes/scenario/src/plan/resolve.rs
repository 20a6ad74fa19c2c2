//! From a scenario to the plan of its run.

use feeder_model::area::PLATEN_NAMESPACE;
use feeder_model::part::PartType;

use super::nodes::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, PartSimulatorConfig, PlannedConfig,
    PlannedRecipe, PlannedStation, PlatenArbiterConfig, RunMonitorConfig, ServedFeeder, SimulatedCamera,
    VisionSelectorConfig, WaveformGeneratorConfig,
};
use super::{PlannedNode, Provenance, RunPlan};
use crate::{Scenario, ScenarioError, Source, Station, check_taught, invalid};

impl Scenario {
    /// The plan of the run. `text` is the scenario as somebody wrote it, for the record.
    ///
    /// # Errors
    /// A scenario that cannot run, for example because its part was never taught.
    pub fn resolve(&self, text: &str) -> Result<RunPlan, ScenarioError> {
        self.validate()?;
        let part = self.part_type()?;
        let feeders = self.of_each_feeder();
        let mut nodes = Vec::new();
        let mut place =
            |namespace: &str, node: PlannedConfig| nodes.push(PlannedNode { namespace: namespace.to_owned(), node });
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::WaveformGenerator(Box::new(feeder.waveform_generator()?)));
        }
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::CourierDriver(Box::new(feeder.courier_driver()?)));
        }
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::PartSimulator(Box::new(feeder.part_simulator(&part)?)));
        }
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::VisionSelector(Box::new(feeder.vision_selector(&part)?)));
        }
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::DeliveryPlanner(Box::new(feeder.delivery_planner(&part)?)));
        }
        for station in self.stations.iter().filter(|station| !station.external) {
            let config = self.overhead_manipulator(station, &part);
            place(&format!("/{}", station.name), PlannedConfig::OverheadManipulator(Box::new(config)));
        }
        let tick_ms = self.time.tick_ms;
        if self.is_arbitrated() {
            place(PLATEN_NAMESPACE, PlannedConfig::PlatenArbiter(Box::new(PlatenArbiterConfig { tick_ms })));
        }
        place(&self.namespace(), PlannedConfig::RunMonitor(Box::new(self.run_monitor()?)));
        let provenance =
            Provenance { version: env!("CARGO_PKG_VERSION").to_owned(), seed: self.seed, scenario: text.to_owned() };
        Ok(RunPlan { provenance, run: self.run, time: self.time, nodes })
    }

    /// The plan of the run, with the scenario spelled out for the record.
    ///
    /// # Errors
    /// As [`resolve`](Self::resolve).
    pub fn plan(&self) -> Result<RunPlan, ScenarioError> {
        self.resolve(&self.to_yaml()?)
    }

    fn waveform_generator(&self) -> Result<WaveformGeneratorConfig, ScenarioError> {
        Ok(WaveformGeneratorConfig {
            tick_ms: self.time.tick_ms,
            name: self.waveform.name().to_owned(),
            waveform: self.waveform()?,
            envelope: self.courier.waveform_envelope(),
        })
    }

    fn courier_driver(&self) -> Result<CourierDriverConfig, ScenarioError> {
        Ok(CourierDriverConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            seed: self.seed,
            tray_floor_height_m: self.tray.floor_height_m,
            courier: self.courier,
            motor: self.world.motor.parameters().map_err(|problem| invalid("world", &problem))?,
        })
    }

    fn part_simulator(&self, part: &PartType) -> Result<PartSimulatorConfig, ScenarioError> {
        let calling = self.stations.iter().filter(|station| self.feeders_of(station).contains(&self.feeder));
        Ok(PartSimulatorConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            seed: self.seed,
            part: self.part.spec().map_err(|error| invalid("part", &error))?,
            tray: self.tray,
            tray_start: self.courier.start,
            bulk: self.bulk_settings(part)?,
            parts_loaded: self.parts_loaded,
            parts_placed: self.parts_placed.clone(),
            refill_below: self.refill_below,
            hopper_m: self.delivery.feeding_place.xy(),
            pick_namespaces: calling.map(|station| self.pick_namespace(&station.name, &self.feeder)).collect(),
            camera: self.simulated_camera(),
        })
    }

    /// The friction that moves reckon with: the part's own, unless the scenario says that control believes another.
    #[must_use]
    pub fn believed_friction(&self, part: &PartType) -> f64 {
        self.believed.part_friction.unwrap_or(part.friction.static_coefficient())
    }

    /// The camera as it is simulated.
    #[must_use]
    pub fn simulated_camera(&self) -> SimulatedCamera {
        SimulatedCamera {
            period_ms: self.camera.period_ms,
            jpeg_quality: self.camera.jpeg_quality,
            model: self.camera.model.clone(),
            tray: self.world.tray,
            light: self.world.light,
            sensor: self.world.sensor,
        }
    }

    fn vision_selector(&self, part: &PartType) -> Result<VisionSelectorConfig, ScenarioError> {
        let Some(Source::Here(model)) = &self.part_model else {
            let problem =
                "missing: print what `feeder teach --scenario FILE` teaches to a file, and name that".to_owned();
            return Err(ScenarioError::Invalid { section: "part_model", problem });
        };
        check_taught(model, part)?;
        Ok(VisionSelectorConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            part_class: part.name.clone(),
            poses: part.poses.iter().map(|pose| pose.name.clone()).collect(),
            wanted_poses: part.wanted_poses.clone(),
            selector: self.selector.clone(),
            camera_period_ms: self.camera.period_ms,
            camera: self.camera.model.clone(),
            tray: self.tray,
            part_model: (**model).clone(),
        })
    }

    fn delivery_planner(&self, part: &PartType) -> Result<DeliveryPlannerConfig, ScenarioError> {
        let rechecked = self.rechecked_stations(part);
        let stations = self.stations.iter().map(|station| PlannedStation {
            name: station.name.clone(),
            x_m: station.x_m,
            y_m: station.y_m,
            rechecked: rechecked.contains(&station.name),
        });
        let recipes = self.recipes(part).into_iter().map(|recipe| {
            let waveform = recipe
                .waveform
                .map(|waveform| waveform.design(&self.tray.geometry, self.believed_friction(part)))
                .transpose();
            let waveform = waveform.map_err(|error| invalid("recipes", &error))?;
            Ok(PlannedRecipe { name: recipe.name, pose_classes: recipe.pose_classes, waveform })
        });
        Ok(DeliveryPlannerConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            seed: self.seed,
            part_class: part.name.clone(),
            part_diameter_m: 2.0 * part.outline_radius_m(),
            part_height_m: part.height_max_m(),
            part_friction: self.believed_friction(part),
            recipes: recipes.collect::<Result<_, ScenarioError>>()?,
            tray: self.tray,
            limits: self.courier.limits,
            load: self.courier.load,
            delivery: self.delivery.clone(),
            stations: stations.collect(),
            keep_out: self.platen.keep_out.iter().cloned().chain(self.parked_areas()).collect(),
            arbitrated: self.is_arbitrated(),
        })
    }

    /// The pose that the manipulators ask for: the first wanted one that the recipe in force at the start has, or else the
    /// first that it has.
    fn asked_pose(&self, part: &PartType) -> String {
        let recipes = self.recipes(part);
        let poses = recipes.first().map_or(&[][..], |recipe| &recipe.pose_classes);
        let wanted = part.wanted_pose_names().find(|wanted| poses.iter().any(|pose| pose == wanted));
        wanted.or(poses.first().map(String::as_str)).unwrap_or_default().to_owned()
    }

    fn overhead_manipulator(&self, station: &Station, part: &PartType) -> OverheadManipulatorConfig {
        let feeders = self
            .feeders_of(station)
            .into_iter()
            .map(|name| ServedFeeder { pick_namespace: self.pick_namespace(&station.name, &name), name });
        OverheadManipulatorConfig {
            tick_ms: self.time.tick_ms,
            station: station.name.clone(),
            x_m: station.x_m,
            y_m: station.y_m,
            plateau_height_m: self.tray.plateau_height_m(),
            seed: self.seed,
            feeders: feeders.collect(),
            part_class: part.name.clone(),
            pose_class: self.asked_pose(part),
            manipulator: station.manipulator,
        }
    }

    fn run_monitor(&self) -> Result<RunMonitorConfig, ScenarioError> {
        Ok(RunMonitorConfig {
            tick_ms: self.time.tick_ms,
            feeders: self.feeder_names().map(str::to_owned).collect(),
            tray: self.tray.geometry,
            part: self.part.spec().map_err(|error| invalid("part", &error))?,
            footprint_radius_m: self.delivery.footprint_radius_m,
            arbitrated: self.is_arbitrated(),
        })
    }
}
