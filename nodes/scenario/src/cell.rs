//! Several feeders on one platen, and what they share.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::check_name;
use crate::{Scenario, ScenarioError, Station, WaveformSpec, invalid};
use feeder_control::delivery::DeliverySequencer;
use feeder_control::platen::Area;
use feeder_model::part::PartType;
use feeder_model::range::OutOfRange;
use feeder_model::seed::seed_for;

/// The platen.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PlatenSection {
    /// Agents of others use the platen too: an arbiter runs also when there is but one feeder.
    pub shared: bool,
    /// Areas that no part of a courier may enter.
    pub keep_out: Vec<Area>,
}

/// A feeder of the same kind elsewhere on the same platen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FurtherFeeder {
    /// Its name; its nodes live in the namespace of this name.
    pub name: String,
    /// Where it feeds, x on the platen, m. Its camera and its start lie there as those of the first feeder do about its
    /// own feeding place.
    pub x_m: f64,
    /// Where it feeds, y on the platen, m.
    pub y_m: f64,
}

/// Something that the feeders can feed: resting poses of the part, and the vibration that suits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Its name.
    pub name: String,
    /// Resting poses that agents may ask for; empty: all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pose_classes: Vec<String>,
    /// The vibration; without it the scenario's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waveform: Option<WaveformSpec>,
}

impl Scenario {
    /// The recipes, every pose spelled out; without any in the scenario, one of the part's name with all its poses.
    #[must_use]
    pub fn recipes(&self, part: &PartType) -> Vec<Recipe> {
        let all = || part.poses.iter().map(|pose| pose.name.clone()).collect();
        if self.recipes.is_empty() {
            return vec![Recipe { name: part.name.clone(), pose_classes: all(), waveform: None }];
        }
        let spelled = self.recipes.iter().map(|recipe| {
            let given = recipe.pose_classes.clone();
            Recipe { pose_classes: if given.is_empty() { all() } else { given }, ..recipe.clone() }
        });
        spelled.collect()
    }

    /// Names of all feeders.
    pub fn feeder_names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.feeder.as_str()).chain(self.further_feeders.iter().map(|further| further.name.as_str()))
    }

    /// Whether the feeders share the platen, so that areas must be reserved.
    #[must_use]
    pub fn is_arbitrated(&self) -> bool {
        self.platen.shared || !self.further_feeders.is_empty()
    }

    /// The scenario as each of its feeders sees it: itself first, at its own place and with its own seed, the others as
    /// further feeders.
    #[must_use]
    pub fn of_each_feeder(&self) -> Vec<Self> {
        let stations =
            self.stations.iter().map(|station| Station { feeders: self.feeders_of(station), ..station.clone() });
        let resolved = Self { stations: stations.collect(), ..self.clone() };
        let mut all = vec![resolved.clone()];
        let home = self.delivery.feeding_place;
        let first = FurtherFeeder { name: self.feeder.clone(), x_m: home.x, y_m: home.y };
        for further in &self.further_feeders {
            let others = self.further_feeders.iter().filter(|other| other.name != further.name).cloned();
            let mut seen = resolved.clone();
            seen.seed = seed_for(self.seed, &further.name);
            seen.feeder.clone_from(&further.name);
            seen.further_feeders = std::iter::once(first.clone()).chain(others).collect();
            let shift = Vector3::new(further.x_m - home.x, further.y_m - home.y, 0.0);
            seen.delivery.feeding_place += shift;
            seen.courier.start += shift;
            seen.camera.model = self.camera.model.shifted(shift.x, shift.y);
            all.push(seen);
        }
        all
    }

    /// Names of the feeders that a station's manipulator asks for parts, in turn.
    #[must_use]
    pub fn feeders_of(&self, station: &Station) -> Vec<String> {
        if station.feeders.is_empty() { vec![self.feeder.clone()] } else { station.feeders.clone() }
    }

    /// Where the service lies by which a station's gripper closes on the parts of a feeder.
    #[must_use]
    pub fn pick_namespace(&self, station: &str, feeder: &str) -> String {
        if self.further_feeders.is_empty() { format!("/{station}") } else { format!("/{station}/{feeder}") }
    }

    /// The namespace in which the feeder's parts are asked for as entities of the simulation: none where there is one
    /// feeder, so that scripts for other simulators find them.
    #[must_use]
    pub fn entity_namespace(&self) -> String {
        if self.further_feeders.is_empty() { String::new() } else { self.namespace() }
    }

    /// Stations whose tool axis the feeder's camera sees at the height of the plateau, with the part about it.
    pub(crate) fn rechecked_stations(&self, part: &PartType) -> BTreeSet<String> {
        let model = &self.camera.model;
        let (width_px, height_px) = (f64::from(model.width_px()), f64::from(model.height_px()));
        let is_seen = |x_m: f64, y_m: f64| {
            let pixel = model.project(Point3::new(x_m, y_m, self.tray.plateau_height_m()));
            pixel.is_some_and(|pixel| (0.0..width_px).contains(&pixel.x) && (0.0..height_px).contains(&pixel.y))
        };
        // A part and as much again about it, as tracking it needs.
        let around_m = 4.0 * part.outline_radius_m();
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        let seen = self.stations.iter().filter(|station| {
            corners.iter().all(|(x, y)| is_seen(station.x_m + x * around_m, station.y_m + y * around_m))
        });
        seen.map(|station| station.name.clone()).collect()
    }

    /// Where the other feeders park, and what is beside: areas of trips are wider than the courier by the corners it may
    /// cut, and must not touch those places.
    pub(crate) fn parked_areas(&self) -> impl Iterator<Item = Area> {
        let radius_m = self.delivery.footprint_radius_m + self.delivery.corner_m + DeliverySequencer::TRACKING_M;
        self.further_feeders.iter().map(move |further| Area::disc(Vector2::new(further.x_m, further.y_m), radius_m))
    }

    fn validate_recipes(&self, part: &PartType) -> Result<(), ScenarioError> {
        let refuse = |problem| Err(ScenarioError::Invalid { section: "recipes", problem });
        let poses: Vec<&str> = part.poses.iter().map(|pose| pose.name.as_str()).collect();
        for (index, recipe) in self.recipes.iter().enumerate() {
            if self.recipes[..index].iter().any(|other| other.name == recipe.name) {
                return refuse(format!("name = {:?} is used twice, allowed are distinct names", recipe.name));
            }
            if let Some(pose) = recipe.pose_classes.iter().find(|pose| !poses.contains(&pose.as_str())) {
                return refuse(format!("{}.pose_classes names {pose:?}, allowed are {poses:?}", recipe.name));
            }
            if let Some(waveform) = &recipe.waveform {
                waveform
                    .design(&self.design_basis(part))
                    .map_err(|error| invalid("recipes", &format_args!("{}.waveform: {error}", recipe.name)))?;
            }
        }
        Ok(())
    }

    /// Checks that couriers can stand where they feed.
    fn validate_keep_out(&self) -> Result<(), ScenarioError> {
        let radius_m = self.delivery.footprint_radius_m;
        let first = Area::disc(self.delivery.feeding_place.xy(), radius_m);
        let places = std::iter::once(first).chain(self.parked_areas().map(|area| Area { radius_m, ..area }));
        let places: Vec<(&str, Area)> = self.feeder_names().zip(places).collect();
        for (index, area) in self.platen.keep_out.iter().enumerate() {
            area.validate().map_err(|error| invalid("platen", &format_args!("keep_out: {error}")))?;
            if let Some((name, _)) = places.iter().find(|(_, place)| place.overlaps(area)) {
                let problem = format!(
                    "keep_out[{index}] lies over the place where {name} feeds, allowed is {radius_m} m \
                     (delivery.footprint_radius_m) or more from its middle"
                );
                return Err(ScenarioError::Invalid { section: "platen", problem });
            }
        }
        Ok(())
    }

    pub(super) fn validate_cell(&self, part: &PartType) -> Result<(), ScenarioError> {
        self.validate_recipes(part)?;
        let limits = &self.courier.limits;
        for further in &self.further_feeders {
            for (key, value, min, max) in [
                ("x_m", further.x_m, limits.x_m_min, limits.x_m_max),
                ("y_m", further.y_m, limits.y_m_min, limits.y_m_max),
            ] {
                let allowed = format!("{min} to {max} m (courier.limits)");
                OutOfRange::unless((min..=max).contains(&value), format!("{}.{key}", further.name), value, allowed)
                    .map_err(|error| invalid("further_feeders", &error))?;
            }
        }
        self.validate_keep_out()?;
        let mut names = BTreeSet::from([self.feeder.as_str()]);
        for further in &self.further_feeders {
            check_name("further_feeders", &further.name)?;
            if !names.insert(&further.name) {
                let problem = format!("name = {:?} is used twice, allowed are distinct names", further.name);
                return Err(ScenarioError::Invalid { section: "further_feeders", problem });
            }
        }
        for station in &self.stations {
            if let Some(unknown) = station.feeders.iter().find(|name| !names.contains(name.as_str())) {
                let problem = format!("{}.feeders names {unknown:?}, allowed are {names:?}", station.name);
                return Err(ScenarioError::Invalid { section: "stations", problem });
            }
        }
        let radius_m = self.delivery.footprint_radius_m;
        let places: Vec<Area> = self.parked_areas().map(|area| Area { radius_m, ..area }).collect();
        let first = Area::disc(self.delivery.feeding_place.xy(), self.delivery.footprint_radius_m);
        for (index, place) in places.iter().enumerate() {
            if std::iter::once(&first).chain(&places[..index]).any(|other| other.overlaps(place)) {
                let apart_m = 2.0 * self.delivery.footprint_radius_m;
                let name = &self.further_feeders[index].name;
                let problem = format!("{name} feeds nearer than {apart_m} m to another feeder");
                return Err(ScenarioError::Invalid { section: "further_feeders", problem });
            }
        }
        Ok(())
    }
}
