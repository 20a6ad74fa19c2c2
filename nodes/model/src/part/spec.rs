//! A part as its file states it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ShapeSpec;

/// Content of a part file, not yet checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartSpec {
    /// Name of the part type.
    pub name: String,
    /// Density, the same everywhere, kg/m³.
    pub density_kg_m3: f64,
    /// Coefficient of static friction μ_s between part and tray.
    pub friction_static: f64,
    /// Coefficient of kinetic friction μ_k between part and tray, at most μ_s.
    pub friction_kinetic: f64,
    /// How far both coefficients may be from what is stated, either way, over that: 0.1 is ± 10 %.
    #[serde(default = "PartSpec::default_friction_uncertainty_ratio")]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub friction_uncertainty_ratio: f64,
    /// Share of light that comes back from the surface, 0 to 1, where a solid of the shape has no other.
    pub reflectance: f64,
    /// The shape.
    pub shape: ShapeSpec,
    /// Names for stable poses; the others are called `pose_1`, `pose_2` and so on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub poses: Vec<PoseName>,
    /// Names of the poses in which the part is wanted.
    pub wanted_poses: Vec<String>,
    /// How the part comes to lie, as `feeder-lab drop` found by dropping it; without it, as the quasi-static estimate
    /// of the stable poses says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drops: Option<DropTable>,
}

impl PartSpec {
    /// How uncertain friction is where nobody says.
    const fn default_friction_uncertainty_ratio() -> f64 {
        0.1
    }
}

/// A name for a stable pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseName {
    /// The name.
    pub name: String,
    /// The direction of the shape's axes that is up in this pose, within 10°.
    pub up: [f64; 3],
}

/// How a part came to lie in rigid-body drops, and how they were done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DropTable {
    /// Program and version.
    pub engine: String,
    /// Seed of the random orientations and speeds.
    pub seed: u64,
    /// Drops for each row.
    pub drops: u32,
    /// Height of the drop-off, m.
    pub height_m: f64,
    /// Speed at which the part leaves the plateau, m/s.
    pub speed_m_s: f64,
    /// Coefficient of restitution, 0 to 1.
    pub restitution: f64,
    /// [`super::PartType::fingerprint`] of the part that was dropped.
    pub fingerprint: String,
    /// Names of the poses, in the order of rows and columns.
    pub poses: Vec<String>,
    /// Share of the drops that ended in none of the poses and count in no row.
    pub unsettled: f64,
    /// Probability of each pose after a drop in a random orientation.
    pub poured: Vec<f64>,
    /// `dropoff[i][j]`: probability that a part which goes over the drop-off in pose i comes to lie in pose j.
    pub dropoff: Vec<Vec<f64>>,
}
