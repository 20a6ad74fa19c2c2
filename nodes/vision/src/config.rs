//! What a scenario says about the selector.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PoseHistoryConfig, TrackerConfig};
use feeder_model::range::OutOfRange;

/// What the selector is asked for and how sure it must be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SelectorConfig {
    /// Resting poses in which parts are handed over unless a goal or a recipe asks for others. What may be picked does not
    /// depend on them.
    #[serde(skip)]
    pub wanted_poses: Vec<usize>,
    /// Confidence over frames from which a part may be picked, 0 to 1.
    pub confidence_min: f64,
    /// Free gap the gripper needs round a part to the next thing on the plateau, m.
    pub part_clearance_m: f64,
    /// Free gap the gripper needs between a part and the walls, m; below 0 parts at the wall are welcome.
    pub wall_clearance_m: f64,
    /// Grey levels by which something must differ from the plateau to be seen.
    pub contrast_min_levels: f64,
    /// Mean square miss, in the template's standard deviations, up to which something is a part.
    pub miss_max: f64,
    /// By how much, per texel, the evidence for a pose must be stronger than that for another in the same place.
    pub evidence_lead_min: f64,
    /// Following parts from frame to frame.
    pub tracker: TrackerConfig,
    /// Where the tray stood when an image was taken.
    pub odometry: PoseHistoryConfig,
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
        let confidence = self.confidence_min;
        OutOfRange::unless((0.0..=1.0).contains(&confidence), "selector.confidence_min", confidence, "0 to 1")?;
        for (field, value) in
            [("selector.miss_max", self.miss_max), ("selector.evidence_lead_min", self.evidence_lead_min)]
        {
            OutOfRange::unless((0.01..=16.0).contains(&value), field, value, "0.01 to 16")?;
        }
        for (field, value) in
            [("selector.part_clearance_m", self.part_clearance_m), ("selector.wall_clearance_m", self.wall_clearance_m)]
        {
            OutOfRange::unless((-0.1..=0.1).contains(&value), field, value, "-0.1 to 0.1 m")?;
        }
        let contrast = self.contrast_min_levels;
        OutOfRange::unless((2.0..=128.0).contains(&contrast), "selector.contrast_min_levels", contrast, "2 to 128")?;
        self.odometry.validate()?;
        self.tracker.validate()
    }
}
