//! What a scenario must hold to make sense: every value in its range, and values that go with each other.

use feeder_model::part::PartType;
use feeder_model::range::{OutOfRange, check_range};
use feeder_vision::{PartModel, Selector, UNSEEN_MS_MAX};

use crate::error::{ScenarioError, check_count, check_name, invalid};
use crate::{Scenario, Source, placed};

/// Poses that differ by less in height and reach are the same, m.
const SAME_SIZE_M: f64 = 1e-6;

impl Scenario {
    pub(crate) fn validate(&self) -> Result<(), ScenarioError> {
        check_name("feeder", &self.feeder)?;
        self.validate_time()?;
        let geometry = self.tray.validate();
        geometry.map_err(|error| invalid("tray", &error))?;
        self.courier.validate().map_err(|error| invalid("courier", &error))?;
        let part = self.part_type()?;
        self.validate_waveform(&part)?;
        self.world.differences.check().map_err(|error| invalid("world", &error))?;
        let in_run = self.world_part(&part)?;
        let bulk = self.bulk_settings(&in_run)?;
        placed::bulk_with(&self.parts_placed, self.tray.geometry, in_run, bulk, self.seed)?;
        self.validate_camera(&part)?;
        if let Some(Source::Here(model)) = &self.part_model {
            check_taught(model, &part)?;
            Selector::check(&self.selector(&part), &self.camera.model, &self.tray, model)
                .map_err(|error| invalid("selector", &error))?;
        }
        self.delivery.validate().map_err(|error| invalid("delivery", &error))?;
        check_range("part_friction", self.believed_friction_min(&part), 0.01, 5.0)
            .map_err(|error| invalid("believed", &error))?;
        self.validate_held(&part)?;
        self.validate_stations(&part)?;
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

    fn validate_waveform(&self, part: &PartType) -> Result<(), ScenarioError> {
        let waveform = self.waveform()?;
        let motor = self.world.motor.parameters().map_err(|problem| invalid("world", &problem))?;
        motor.validate().map_err(|error| invalid("world", &error))?;
        self.courier(part).waveform_envelope().check(&waveform).map_err(|error| invalid("waveform", &error))
    }

    fn validate_camera(&self, part: &PartType) -> Result<(), ScenarioError> {
        // Seen less often, parts that are fed are not known again from image to image.
        check_count("camera", "period_ms", self.camera.period_ms, self.time.tick_ms, UNSEEN_MS_MAX)?;
        if !self.camera.period_ms.is_multiple_of(self.time.tick_ms) {
            let problem =
                format!("period_ms = {} is no multiple of time.tick_ms = {}", self.camera.period_ms, self.time.tick_ms);
            return Err(ScenarioError::Invalid { section: "camera", problem });
        }
        check_count("camera", "jpeg_quality", self.camera.jpeg_quality.into(), 1, 100)?;
        self.scene(part).validate().map_err(|error| invalid("camera", &error))?;
        self.world_scene(part)?.validate().map_err(|error| invalid("world", &error))
    }

    /// Checks that the tray at rest holds the parts on the ramp that moves must not disturb: else there is no move to any
    /// station, however gentle.
    fn validate_held(&self, part: &PartType) -> Result<(), ScenarioError> {
        let from_m = self.delivery.protected_ramp_radius_m;
        let at_rest = self.delivery.friction_at_rest(&self.tray.geometry);
        let friction_min = self.believed_friction_min(part);
        if self.stations.is_empty() || friction_min > at_rest {
            return Ok(());
        }
        let problem = format!(
            "policy: all holds parts on the ramp from protected_ramp_radius_m = {from_m} on, and those slide there: the least \
             friction of the part is {friction_min:.4}, allowed is above {at_rest:.4}; policy: selected does not hold them"
        );
        Err(ScenarioError::Invalid { section: "delivery", problem })
    }

    fn validate_stations(&self, part: &PartType) -> Result<(), ScenarioError> {
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
            let gripper = self.asked_pose(part).map_or(Ok(()), |pose| station.gripper.check(&pose.outline));
            gripper.map_err(|error| invalid(section, &format_args!("{}.{error}", station.name)))?;
            let checked = station.manipulator.validate();
            checked.map_err(|error| invalid(section, &format_args!("{}.manipulator: {error}", station.name)))?;
            let (tolerance_m, min_m) = (station.manipulator.tolerance_m, self.delivery.tolerance_m_min);
            let allowed = format_args!("delivery.tolerance_m_min = {min_m} and more");
            OutOfRange::unless(tolerance_m >= min_m, "manipulator.tolerance_m", tolerance_m, allowed)
                .map_err(|error| invalid(section, &format_args!("{}.{error}", station.name)))?;
        }
        Ok(())
    }
}

/// Checks that a model was taught the part and no other: its poses are as high and reach as far.
pub(crate) fn check_taught(model: &PartModel, part: &PartType) -> Result<(), ScenarioError> {
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
