//! What follows from a scenario: each value that several nodes need, derived in one place from the one that owns it.

use feeder_control::courier::CourierConfig;
use feeder_control::delivery::FeedRate;
use feeder_model::geometry::StablePose;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::mechanics::{Friction, MechanicsError};
use feeder_model::motor::{CarriedParts, Load};
use feeder_model::part::PartType;
use feeder_model::tray::Surface;
use feeder_model::waveform::Waveform;
use feeder_sim::camera::{PartSolid, Scene};
use feeder_vision::SelectorConfig;

use crate::loading::LOADING_SPEED_SHARE;
use crate::plan::SimulatedCamera;
use crate::waveform::DesignBasis;
use crate::{Scenario, ScenarioError, invalid};

impl Scenario {
    /// The waveform that feeds.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn waveform(&self) -> Result<Waveform, ScenarioError> {
        // Designed for the part as control knows it, not as it is in a run.
        self.waveform.design(&self.design_basis(&self.part_type()?)).map_err(|error| invalid("waveform", &error))
    }

    /// What waveforms are designed for where they state nothing else.
    #[must_use]
    pub fn design_basis(&self, part: &PartType) -> DesignBasis {
        DesignBasis {
            tray: self.tray.geometry,
            part_friction_min: self.believed_friction_min(part),
            outermost_m: self.outermost_m(part),
            yaw_rad_max: self.courier.limits.yaw_rad_max,
        }
    }

    /// Radius at which the middle of a part rides along the outer wall, m.
    pub(crate) fn outermost_m(&self, part: &PartType) -> f64 {
        self.tray.geometry.outer_radius_m - part.outline_radius_m()
    }

    /// The friction that control believes the part to have: the part's own, unless the scenario says otherwise.
    #[must_use]
    pub fn believed_friction(&self, part: &PartType) -> f64 {
        self.believed.part_friction.unwrap_or(part.friction.static_coefficient())
    }

    /// The least that control believes it may be, as uncertain as it is: with this moves reckon, and for this waveforms are
    /// designed.
    #[must_use]
    pub fn believed_friction_min(&self, part: &PartType) -> f64 {
        self.believed_friction(part) * (1.0 - part.friction_uncertainty_ratio)
    }

    /// The part as it is in a run, with the friction that it has.
    ///
    /// # Errors
    /// A friction that cannot be.
    pub fn world_part(&self, part: &PartType) -> Result<PartType, ScenarioError> {
        self.world.differences.part(part).map_err(|error| invalid("world", &error))
    }

    /// How fast a waveform should feed parts on the plateau from the inner wall to the outer, as far as control knows the
    /// friction.
    ///
    /// # Errors
    /// A waveform that does not turn the tray.
    pub(crate) fn plateau_feed(&self, part: &PartType, waveform: &Waveform) -> Result<Vec<FeedRate>, ScenarioError> {
        /// Radii at which it is worked out, evenly spaced: between them it is all but straight.
        const RADII: u32 = 24;
        let tray = self.tray.geometry;
        let step_m = (tray.outer_radius_m - tray.inner_radius_m) / f64::from(RADII);
        let rates = || -> Result<Vec<Option<FeedRate>>, MechanicsError> {
            let track = self.believed_track(part)?;
            let map = TrayMap::new(&track, waveform)?;
            let feed = |step: u32| {
                let radius_m = (tray.inner_radius_m + step_m * f64::from(step)).min(tray.outer_radius_m);
                let rate_rad_s = map.rate_rad_s(radius_m, Surface::Plateau)?;
                Ok(rate_rad_s.map(|rate_rad_s| FeedRate { radius_m, rate_rad_s }))
            };
            (0..=RADII).map(feed).collect()
        };
        Ok(rates().map_err(|error| invalid("waveform", &error))?.into_iter().flatten().collect())
    }

    /// The tray's track with the friction that control believes in.
    fn believed_track(&self, part: &PartType) -> Result<AnnularTrack, MechanicsError> {
        let friction = self.believed.part_friction.map_or(Ok(part.friction), Friction::uniform)?;
        Ok(AnnularTrack::new(self.tray.geometry, friction, STANDARD_GRAVITY_M_S2)?)
    }

    /// Share of the parts on the ramp that a waveform should bring up each second, 1/s, as far as control knows the friction:
    /// the mean over the radii at which parts climb at half the speed of the outermost or more, spread evenly over the ramp.
    ///
    /// # Errors
    /// A waveform that does not turn the tray.
    pub(crate) fn climb_per_s(&self, part: &PartType, waveform: &Waveform) -> Result<Option<f64>, ScenarioError> {
        /// Radii at which it is worked out, evenly spaced.
        const RADII: u32 = 12;
        let tray = self.tray.geometry;
        let outermost_m = self.outermost_m(part);
        let step_m = (outermost_m - tray.inner_radius_m) / f64::from(RADII);
        let rates = || -> Result<Vec<(f64, f64)>, MechanicsError> {
            let track = self.believed_track(part)?;
            let map = TrayMap::new(&track, waveform)?;
            let climb = |step: u32| {
                let radius_m = tray.inner_radius_m + step_m * f64::from(step);
                Ok((radius_m, map.rate_rad_s(radius_m, Surface::Ramp)?.unwrap_or(0.0)))
            };
            (0..=RADII).map(climb).collect()
        };
        let rates = rates().map_err(|error| invalid("waveform", &error))?;
        let fastest_m_s = rates.last().map_or(0.0, |(radius_m, rate_rad_s)| radius_m * rate_rad_s);
        let climbing: Vec<f64> = rates
            .iter()
            .filter(|(radius_m, rate_rad_s)| radius_m * rate_rad_s >= LOADING_SPEED_SHARE * fastest_m_s)
            .map(|(_, rate_rad_s)| *rate_rad_s)
            .collect();
        let mean_rad_s = climbing.iter().sum::<f64>() / climbing.len().max(1) as f64;
        Ok((fastest_m_s > 0.0).then_some(mean_rad_s / tray.ramp_angle_rad))
    }

    /// What the driver is set up with, with the load that the tray carries.
    #[must_use]
    pub fn courier(&self, part: &PartType) -> CourierConfig {
        CourierConfig { load: self.load(part), ..self.courier }
    }

    /// What the tray carries: the load that the scenario states and the parts, spread evenly over the path. As many are
    /// reckoned with as are there at the start, or as the hopper keeps there.
    #[must_use]
    pub fn load(&self, part: &PartType) -> Load {
        let carried = self.carried_parts(part);
        self.courier.load.with(carried.count_max.into(), &carried.part)
    }

    /// The parts that the tray carries.
    #[must_use]
    pub(crate) fn carried_parts(&self, part: &PartType) -> CarriedParts {
        let placed = u32::try_from(self.parts_placed.len()).unwrap_or(u32::MAX);
        let tray = &self.tray.geometry;
        let gyration_m2 = 0.5 * (tray.inner_radius_m.powi(2) + tray.outer_radius_m.powi(2));
        CarriedParts {
            part: Load { mass_kg: part.mass_kg, inertia_kg_m2: part.mass_kg * gyration_m2 },
            count_max: self.parts_loaded.saturating_add(placed).max(self.refill_below),
            refill_below: self.refill_below,
        }
    }

    /// Free gap to the next part that a part needs to be picked, m: what the selector asks for, or the least that a station's
    /// gripper needs where that is more.
    #[must_use]
    pub fn part_gap_m_min(&self, part: &PartType) -> f64 {
        let outline = self.asked_pose(part).map(|pose| &pose.outline);
        let rooms_m = self.stations.iter().filter_map(|station| Some(station.gripper.room_m(outline?)));
        rooms_m.min_by(f64::total_cmp).unwrap_or(0.0).max(self.selector.part_clearance_m)
    }

    /// The camera as it is simulated in a run.
    ///
    /// # Errors
    /// A camera that cannot be, with the differences that the scenario states.
    pub fn simulated_camera(&self) -> Result<SimulatedCamera, ScenarioError> {
        let differences = &self.world.differences;
        Ok(SimulatedCamera {
            period_ms: self.camera.period_ms,
            jpeg_quality: self.camera.jpeg_quality,
            calibrated: self.camera.model.clone(),
            model: differences.camera(&self.camera.model).map_err(|error| invalid("world", &error))?,
            tray: self.world.tray,
            light: differences.light(self.world.light),
            sensor: differences.sensor(self.world.sensor),
        })
    }

    /// What the camera sees in a run.
    ///
    /// # Errors
    /// As [`simulated_camera`](Self::simulated_camera).
    pub fn world_scene(&self, part: &PartType) -> Result<Scene, ScenarioError> {
        Ok(self.simulated_camera()?.scene(self.tray, part))
    }

    /// What it sees when it is calibrated and the part is taught.
    #[must_use]
    pub fn scene(&self, part: &PartType) -> Scene {
        Scene {
            camera: self.camera.model.clone(),
            tray: self.tray,
            tray_appearance: self.world.tray,
            part: PartSolid::new(part.mesh.clone(), &part.poses),
            light: self.world.light,
            sensor: self.world.sensor,
        }
    }

    /// The selector's parameters, with the wanted poses of the part.
    #[must_use]
    pub fn selector(&self, part: &PartType) -> SelectorConfig {
        SelectorConfig { wanted_poses: part.wanted_poses.clone(), ..self.selector.clone() }
    }

    /// The pose that the manipulators ask for: the first wanted one that the recipe in force at the start has, or else the
    /// first that it has.
    #[must_use]
    pub fn asked_pose<'a>(&self, part: &'a PartType) -> Option<&'a StablePose> {
        let recipes = self.recipes(part);
        let poses = recipes.first().map_or(&[][..], |recipe| &recipe.pose_classes);
        let wanted = part.wanted_pose_names().find(|wanted| poses.iter().any(|pose| pose == wanted));
        let asked = wanted.or(poses.first().map(String::as_str))?;
        part.poses.iter().find(|pose| pose.name == asked)
    }
}
