//! From a scenario to the plan of its run.

use feeder_model::area::PLATEN_NAMESPACE;
use feeder_model::part::PartType;

use super::kinds::PlannedConfig;
use super::nodes::{
    CourierDriverConfig, DeliveryPlannerConfig, ImageTransport, OverheadManipulatorConfig, PartSimulatorConfig,
    PlannedRecipe, PlannedStation, PlatenArbiterConfig, RunMonitorConfig, ServedFeeder, VisionSelectorConfig,
    WatchedGripper, WaveformGeneratorConfig,
};
use super::{PlannedNode, Provenance, RunPlan};
use crate::validate::check_taught;
use crate::{Scenario, ScenarioError, Source, Station, invalid};

impl Scenario {
    /// The plan of the run of a scenario as it was read, which checks it; one that was changed since is planned by
    /// [`plan`](Self::plan). `text` is the scenario as somebody wrote it, for the record.
    ///
    /// # Errors
    /// A part that was never taught, or a value that cannot be derived.
    pub fn resolve(&self, text: &str) -> Result<RunPlan, ScenarioError> {
        let part = self.part_type()?;
        let feeders = self.of_each_feeder();
        let mut nodes = Vec::new();
        let mut place =
            |namespace: &str, node: PlannedConfig| nodes.push(PlannedNode { namespace: namespace.to_owned(), node });
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::WaveformGenerator(Box::new(feeder.waveform_generator(&part)?)));
        }
        for feeder in &feeders {
            place(&feeder.namespace(), PlannedConfig::CourierDriver(Box::new(feeder.courier_driver(&part)?)));
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
            let config = self.overhead_manipulator(station, &part)?;
            place(&format!("/{}", station.name), PlannedConfig::OverheadManipulator(Box::new(config)));
        }
        let tick_ms = self.time.tick_ms;
        if self.is_arbitrated() {
            place(PLATEN_NAMESPACE, PlannedConfig::PlatenArbiter(Box::new(PlatenArbiterConfig { tick_ms })));
        }
        place(&self.namespace(), PlannedConfig::RunMonitor(Box::new(self.run_monitor(&part)?)));
        let provenance =
            Provenance { version: env!("CARGO_PKG_VERSION").to_owned(), seed: self.seed, scenario: text.to_owned() };
        Ok(RunPlan { provenance, run: self.run, time: self.time, nodes })
    }

    /// Checks the scenario and plans its run, with the scenario spelled out for the record.
    ///
    /// # Errors
    /// A value out of range, and as [`resolve`](Self::resolve).
    pub fn plan(&self) -> Result<RunPlan, ScenarioError> {
        self.validate()?;
        self.resolve(&self.to_yaml()?)
    }

    fn waveform_generator(&self, part: &PartType) -> Result<WaveformGeneratorConfig, ScenarioError> {
        Ok(WaveformGeneratorConfig {
            tick_ms: self.time.tick_ms,
            name: self.waveform.name().to_owned(),
            waveform: self.waveform()?,
            envelope: self.courier(part).waveform_envelope(),
        })
    }

    fn courier_driver(&self, part: &PartType) -> Result<CourierDriverConfig, ScenarioError> {
        Ok(CourierDriverConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            seed: self.seed,
            tray: self.tray,
            footprint_radius_m: self.delivery.footprint_radius_m,
            courier: self.courier(part),
            parts: self.carried_parts(part),
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
            part_friction_ratio: self.world.differences.friction_ratio,
            tray: self.tray,
            tray_start: self.courier.start,
            bulk: self.bulk_settings(&self.world_part(part)?)?,
            parts_loaded: self.parts_loaded,
            parts_placed: self.parts_placed.clone(),
            refill_below: self.refill_below,
            hopper_m: self.delivery.feeding_place.xy(),
            pick_namespaces: calling.map(|station| self.pick_namespace(&station.name, &self.feeder)).collect(),
            entity_namespace: self.entity_namespace(),
            camera: self.simulated_camera()?,
        })
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
            image_transport: ImageTransport::default(),
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
            let waveform = recipe.waveform.map(|waveform| waveform.design(&self.design_basis(part))).transpose();
            let waveform = waveform.map_err(|error| invalid("recipes", &error))?;
            let runs = waveform.clone().map_or_else(|| self.waveform(), Ok)?;
            let plateau_feed = self.plateau_feed(part, &runs)?;
            let climb_per_s = self.climb_per_s(part, &runs)?;
            Ok(PlannedRecipe {
                name: recipe.name,
                pose_classes: recipe.pose_classes,
                waveform,
                plateau_feed,
                period_s: runs.period_s(),
                climb_per_s,
            })
        });
        Ok(DeliveryPlannerConfig {
            tick_ms: self.time.tick_ms,
            feeder: self.feeder.clone(),
            seed: self.seed,
            part_class: part.name.clone(),
            part_diameter_m: 2.0 * part.outline_radius_m(),
            part_height_m: part.height_max_m(),
            part_friction: self.believed_friction_min(part),
            recipes: recipes.collect::<Result<_, ScenarioError>>()?,
            tray: self.tray,
            limits: self.courier.limits,
            load: self.load(part),
            parts: self.carried_parts(part),
            delivery: self.delivery.clone(),
            stations: stations.collect(),
            keep_out: self.platen.keep_out.iter().cloned().chain(self.parked_areas()).collect(),
            arbitrated: self.is_arbitrated(),
        })
    }

    fn overhead_manipulator(
        &self,
        station: &Station,
        part: &PartType,
    ) -> Result<OverheadManipulatorConfig, ScenarioError> {
        let feeders = self
            .feeders_of(station)
            .into_iter()
            .map(|name| ServedFeeder { pick_namespace: self.pick_namespace(&station.name, &name), name });
        let pose = self.asked_pose(part).ok_or_else(|| invalid("recipes", &"the first has no pose of the part"))?;
        let gripper = &station.gripper;
        Ok(OverheadManipulatorConfig {
            tick_ms: self.time.tick_ms,
            station: station.name.clone(),
            x_m: station.x_m,
            y_m: station.y_m,
            plateau_height_m: self.tray.plateau_height_m(),
            seed: self.seed,
            feeders: feeders.collect(),
            part_class: part.name.clone(),
            pose_class: pose.name.clone(),
            gripper_opening_m: gripper.opening_m(&pose.outline),
            jaws_yaw_rad: pose.outline.narrowest().1,
            part_gap_m_min: gripper.room_m(&pose.outline),
            manipulator: station.manipulator,
        })
    }

    fn run_monitor(&self, part: &PartType) -> Result<RunMonitorConfig, ScenarioError> {
        let simulated = self.stations.iter().filter(|station| !station.external);
        let watched = |station: &Station| {
            let part_gap_m_min = station.gripper.room_m(&self.asked_pose(part)?.outline);
            Some(WatchedGripper { station: station.name.clone(), part_gap_m_min })
        };
        Ok(RunMonitorConfig {
            tick_ms: self.time.tick_ms,
            feeders: self.feeder_names().map(str::to_owned).collect(),
            tray: self.tray.geometry,
            part: self.part.spec().map_err(|error| invalid("part", &error))?,
            grippers: simulated.filter_map(watched).collect(),
            part_gap_m_min: self.part_gap_m_min(part),
            footprint_radius_m: self.delivery.footprint_radius_m,
            arbitrated: self.is_arbitrated(),
        })
    }
}
