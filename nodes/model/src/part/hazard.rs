//! What the shape of a part makes likely that the model of the bulk does not show.

use std::fmt;

use super::PartType;

/// A part whose convex hull it fills by less is likely to tangle or nest.
const SOLIDITY_MIN: f64 = 0.8;

/// A part lower than this share of its width is likely to slide onto or under another.
const FLATNESS_MIN: f64 = 0.2;

/// Something that a part is likely to do in bulk.
#[derive(Clone, Debug, PartialEq)]
pub enum Hazard {
    /// In this pose it tips over sooner than it slides.
    Tips {
        /// Name of the pose.
        pose: String,
        /// Tilt that ends the pose, rad.
        tip_angle_rad: f64,
        /// Angle of static friction, rad.
        friction_angle_rad: f64,
    },
    /// In this pose it rolls.
    Rolls {
        /// Name of the pose.
        pose: String,
    },
    /// Its hollows are large enough for others to hook or nest in.
    Nests {
        /// Share of its convex hull that it fills.
        solidity: f64,
    },
    /// In this pose it is so low that it slides onto or under others.
    Shingles {
        /// Name of the pose.
        pose: String,
        /// Height over least width.
        flatness: f64,
    },
}

impl fmt::Display for Hazard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tips { pose, tip_angle_rad, friction_angle_rad } => write!(
                f,
                "tips over in pose {pose} before it slides: a tilt of {:.0}° ends the pose, friction holds to {:.0}°",
                tip_angle_rad.to_degrees(),
                friction_angle_rad.to_degrees()
            ),
            Self::Rolls { pose } => write!(f, "rolls in pose {pose}, where the model lets it slide"),
            Self::Nests { solidity } => {
                write!(f, "may nest or tangle: it fills {:.0} % of its convex hull", 100.0 * solidity)
            }
            Self::Shingles { pose, flatness } => {
                write!(f, "may slide onto others in pose {pose}: its height is {:.0} % of its width", 100.0 * flatness)
            }
        }
    }
}

impl PartType {
    /// What the geometry makes likely and the bulk leaves out.
    #[must_use]
    pub fn hazards(&self) -> Vec<Hazard> {
        let mut hazards = Vec::new();
        let friction_angle_rad = self.friction.static_coefficient().atan();
        for pose in &self.poses {
            let (name, tip_angle_rad) = (|| pose.name.clone(), pose.tip_angle_rad);
            if tip_angle_rad < friction_angle_rad {
                hazards.push(Hazard::Tips { pose: name(), tip_angle_rad, friction_angle_rad });
            }
            if pose.rolls {
                hazards.push(Hazard::Rolls { pose: name() });
            }
            let flatness = pose.height_m / pose.outline.width_range_m().0;
            if flatness < FLATNESS_MIN {
                hazards.push(Hazard::Shingles { pose: name(), flatness });
            }
        }
        let solidity = self.mesh.solidity();
        if solidity < SOLIDITY_MIN {
            hazards.push(Hazard::Nests { solidity });
        }
        hazards
    }
}
