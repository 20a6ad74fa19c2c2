//! What a scenario says about the selector.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CalibrationLimits, PoseHistoryConfig, TrackerConfig};
use feeder_model::range::{OutOfRange, check_ranges};

/// What the selector is asked for and how sure it must be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SelectorConfig {
    /// Resting poses in which parts are handed over unless a goal or a recipe asks for others. What may be picked does not
    /// depend on them.
    #[serde(skip)]
    pub wanted_poses: Vec<usize>,
    /// Confidence over frames from which a part may be picked.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub confidence_min: f64,
    /// Free gap the gripper needs round a part to the next thing on the plateau, m.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub part_clearance_m: f64,
    /// Free gap the gripper needs between a part and the walls, m; below 0 parts at the wall are welcome.
    #[schemars(range(min = -0.1, max = 0.1))]
    pub wall_clearance_m: f64,
    /// Grey levels by which something must differ from the plateau to be seen.
    #[schemars(range(min = 2.0, max = 128.0))]
    pub contrast_min_levels: f64,
    /// Mean square miss, in the template's standard deviations, up to which something is a part.
    #[schemars(range(min = 0.01, max = 16.0))]
    pub miss_max: f64,
    /// By how much, per texel, the evidence for a pose must be stronger than that for another in the same place. Any value is
    /// reached where no other fits even roughly. In light that is not the one taught, four parts of a pose or more are held
    /// against each other instead.
    #[schemars(range(min = 0.01, max = 16.0))]
    pub evidence_lead_min: f64,
    /// Following parts from frame to frame.
    pub tracker: TrackerConfig,
    /// Where the tray stood when an image was taken.
    pub odometry: PoseHistoryConfig,
    /// How far the camera's calibration may be off.
    pub calibration: CalibrationLimits,
}

impl Default for SelectorConfig {
    fn default() -> Self {
        Self {
            wanted_poses: vec![0],
            confidence_min: 0.9,
            part_clearance_m: 0.001,
            wall_clearance_m: -0.001,
            contrast_min_levels: 10.0,
            miss_max: 2.5,
            evidence_lead_min: 0.15,
            tracker: TrackerConfig::default(),
            odometry: PoseHistoryConfig::default(),
            calibration: CalibrationLimits::default(),
        }
    }
}

impl SelectorConfig {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("selector.", self)?;
        self.odometry.validate()?;
        self.calibration.validate()?;
        self.tracker.validate()
    }
}
