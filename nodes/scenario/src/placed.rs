//! Parts at stated places, for runs that must begin with just these.

use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;
use feeder_sim::parts::{BulkSettings, PartBulk};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ScenarioError, invalid};

/// A part that lies at a stated place at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacedPart {
    /// Its resting pose, as the part names it.
    pub pose: String,
    /// Distance of its centre of mass from the tray's axis, m.
    pub radius_m: f64,
    /// Angle of its centre of mass about the tray's axis from the ramp's foot, rad.
    pub angle_rad: f64,
    /// How it is turned in the tray frame, rad.
    pub yaw_rad: f64,
}

/// The parts in bulk, with those placed.
///
/// # Errors
/// Settings out of range, a part placed in a pose it does not have, or where there is no room for it.
pub(crate) fn bulk_with(
    placed: &[PlacedPart],
    tray: TrayGeometry,
    part: PartType,
    settings: BulkSettings,
    seed: u64,
) -> Result<PartBulk, ScenarioError> {
    let poses: Vec<String> = part.poses.iter().map(|pose| pose.name.clone()).collect();
    let bulk = PartBulk::new(tray, part, settings, seed);
    let mut bulk = bulk.map_err(|error| invalid("bulk", &error))?;
    for placed in placed {
        let Some(pose) = poses.iter().position(|pose| *pose == placed.pose) else {
            let problem = format!("pose = {:?}, allowed are {poses:?}", placed.pose);
            return Err(ScenarioError::Invalid { section: "parts_placed", problem });
        };
        bulk.put(placed.radius_m, placed.angle_rad, placed.yaw_rad, pose)
            .map_err(|error| invalid("parts_placed", &error))?;
    }
    Ok(bulk)
}
