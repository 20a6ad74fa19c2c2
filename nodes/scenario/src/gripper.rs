//! The gripper at a station, and the room it needs beside a part.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::geometry::Outline;
use feeder_model::range::{OutOfRange, check_range, check_ranges};

/// How far a part may lie beside the middle of an opening that nobody stated, m (assumed).
const PLAY_M: f64 = 0.5e-3;

/// A gripper with two parallel jaws, which closes across the narrowest width of a part in the pose that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Gripper {
    /// Width between the open jaws, m; left out: the part's narrowest width in the pose asked for, and half a
    /// millimetre on either side.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 0.5), extend("exclusiveMinimum" = 0.0))]
    pub opening_m: Option<f64>,
    /// Thickness of a jaw, m (assumed).
    #[schemars(range(min = 0.0, max = 0.05))]
    pub jaw_thickness_m: f64,
}

impl Default for Gripper {
    fn default() -> Self {
        Self { opening_m: None, jaw_thickness_m: 0.5e-3 }
    }
}

impl Gripper {
    /// Checks the values, and that the jaws open wider than a part with this outline.
    pub(crate) fn check(&self, part: &Outline) -> Result<(), OutOfRange> {
        check_ranges("gripper.", self)?;
        check_range("gripper.opening_m", self.opening_m(part), part.narrowest().0, 0.5)?;
        check_range("gripper.opening_m (for the room beside the part)", self.room_m(part), 0.0, 0.1)
    }

    /// Width between the open jaws for a part with this outline, m.
    #[must_use]
    pub fn opening_m(&self, part: &Outline) -> f64 {
        self.opening_m.unwrap_or(part.narrowest().0 + 2.0 * PLAY_M)
    }

    /// Free gap that the open jaws need between a part with this outline and whatever is next to it, m.
    #[must_use]
    pub fn room_m(&self, part: &Outline) -> f64 {
        0.5 * (self.opening_m(part) - part.narrowest().0) + self.jaw_thickness_m
    }
}
