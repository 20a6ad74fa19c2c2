//! What a delivery planner is set up with.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::gentle::GentleParameters;
use super::surroundings::{Surroundings, Tether};
use crate::platen::Area;
use feeder_model::range::{OutOfRange, check_range, check_ranges};
use feeder_model::tray::TrayGeometry;

/// Which parts a move must not disturb.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Policy {
    /// The part to be delivered, and with it whatever lies on the plateau.
    #[default]
    Selected,
    /// Every part seen on the plateau, and parts anywhere on the ramp from a given radius outwards.
    All,
}

/// A delivery planner's parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DeliveryConfig {
    /// Where the courier feeds and the camera sees the plateau: x, y (m) and yaw (rad) on the platen.
    #[schemars(with = "[f64; 3]")]
    pub feeding_place: Vector3<f64>,
    /// Where each station's tool axis meets the platen's plane, by the station's name, m; the scenario's.
    #[serde(skip)]
    pub stations_m: BTreeMap<String, Vector2<f64>>,
    /// Stations that the feeder's camera sees: parts are looked at again there.
    #[serde(skip)]
    pub rechecked_stations: BTreeSet<String>,
    /// Areas that no part of the courier may enter; the scenario's.
    #[serde(skip)]
    pub keep_out: Vec<Area>,
    /// Areas of the platen must be reserved for every trip; the scenario says so.
    #[serde(skip)]
    pub arbitrated: bool,
    /// Radius of a disc about the courier's centre that covers courier and tray, m.
    pub footprint_radius_m: f64,
    /// How far the courier may cut the corners of its route, m.
    pub corner_m: f64,
    /// The courier's cable; the scenario states it among the courier's limits.
    #[serde(skip)]
    pub tether: Option<Tether>,
    /// Most stations served on one trip.
    #[schemars(range(min = 1, max = 4))]
    pub stops_max: u32,
    /// How gently parts are carried.
    pub gentle: GentleParameters,
    /// Which parts a move must not disturb.
    pub policy: Policy,
    /// Radius in the tray from which on parts on the ramp are protected by [`Policy::All`], m.
    #[schemars(range(min = 1e-3, max = 1.0))]
    pub protected_ramp_radius_m: f64,
    /// Smallest tolerance of position a request may ask for, m: what vision and courier can promise.
    #[schemars(range(min = 1e-6, max = 0.1))]
    pub tolerance_m_min: f64,
    /// Time for parts to come to rest after the courier has, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub settle_s: f64,
    /// Images of the parts at rest that are looked at before feeding goes on.
    #[schemars(range(min = 1, max = 100))]
    pub looks: u32,
    /// Shortest feeding between two looks, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub feed_s_min: f64,
    /// Feeding without a fitting part after which a warning is given, s; up to four times as long where there are parts that
    /// the waveform has not had the time to bring.
    #[schemars(range(min = 0.1, max = 3600.0))]
    pub starvation_s: f64,
    /// Share by which parts on the plateau may be slower or faster than the waveform should make them before it is said:
    /// neither the friction nor the motion between servo ticks is known better.
    #[schemars(range(min = 0.02, max = 100.0))]
    pub feed_deviation_max: f64,
    /// Longest wait for the courier to come to rest after feeding was switched off, s.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub stop_timeout_s: f64,
    /// Longest wait for an image, s.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub look_timeout_s: f64,
    /// Longest time a move may take beyond its duration, s.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub move_grace_s: f64,
    /// Time between the order to stop and rest during which parts move on as while feeding, s: what the first prediction
    /// takes; later ones take what was seen.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub stop_drift_s: f64,
    /// Longest wait for an area of the platen, s.
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub area_wait_s: f64,
    /// Longest wait for each of the manipulator's reports, s.
    #[schemars(range(min = 0.1, max = 3600.0))]
    pub hand_over_timeout_s: f64,
    /// Wait before a failed return is tried again, s.
    #[schemars(range(min = 0.01, max = 60.0))]
    pub retry_s: f64,
    /// Failed returns after which the planner gives up and waits for a reset.
    #[schemars(range(min = 0, max = 100))]
    pub retries_max: u32,
}

impl Default for DeliveryConfig {
    fn default() -> Self {
        Self {
            feeding_place: Vector3::zeros(),
            stations_m: BTreeMap::new(),
            rechecked_stations: BTreeSet::new(),
            keep_out: Vec::new(),
            arbitrated: false,
            footprint_radius_m: Surroundings::default().footprint_radius_m,
            corner_m: Surroundings::default().corner_m,
            tether: None,
            stops_max: 4,
            gentle: GentleParameters::default(),
            policy: Policy::default(),
            protected_ramp_radius_m: 0.06,
            tolerance_m_min: 0.2e-3,
            settle_s: 0.05,
            looks: 2,
            feed_s_min: 0.5,
            starvation_s: 30.0,
            feed_deviation_max: 0.15,
            stop_timeout_s: 3.0,
            look_timeout_s: 2.0,
            move_grace_s: 2.0,
            stop_drift_s: 0.3,
            area_wait_s: 60.0,
            hand_over_timeout_s: 10.0,
            retry_s: 1.0,
            retries_max: 3,
        }
    }
}

impl DeliveryConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        self.gentle.validate()?;
        for coordinate in &self.feeding_place {
            check_range("feeding_place", *coordinate, -10.0, 10.0)?;
        }
        for coordinate_m in self.stations_m.values().flatten() {
            check_range("stations_m", *coordinate_m, -10.0, 10.0)?;
        }
        self.surroundings().validate()?;
        check_ranges("", self)
    }

    /// What is around the courier.
    #[must_use]
    pub fn surroundings(&self) -> Surroundings {
        Surroundings {
            footprint_radius_m: self.footprint_radius_m,
            corner_m: self.corner_m,
            keep_out: self.keep_out.clone(),
            tether: self.tether,
        }
    }

    /// Coefficient of friction above which a tray at rest holds the parts on the ramp that moves must not disturb.
    #[must_use]
    pub fn friction_at_rest(&self, tray: &TrayGeometry) -> f64 {
        match self.policy {
            Policy::Selected => 0.0,
            Policy::All => tray.ramp_slope_rad(self.protected_ramp_radius_m).tan(),
        }
    }

    pub(super) fn settle(&self) -> Duration {
        Duration::from_secs_f64(self.settle_s)
    }
}
