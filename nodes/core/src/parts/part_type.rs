//! What a part is: its size, mass, friction on the tray and the ways it can lie.

use std::ops::Deref;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How far a set of probabilities may be from summing to one.
const PROBABILITY_TOLERANCE: f64 = 1e-6;

/// A way in which a part can lie still.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestingPose {
    /// Name of the pose, unique within the part type.
    pub name: String,
    /// Probability that a part dropped in bulk comes to rest like this, 0 to 1.
    pub probability: f64,
}

/// Description of a part as it is written in a catalogue, not yet checked.
///
/// The part is a disc seen from above: a point mass in its dynamics, with a diameter where it meets walls and other
/// parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartSpec {
    /// Name of the part type.
    pub name: String,
    /// Diameter of the disc, m.
    pub diameter_m: f64,
    /// Height of the part as it lies, m.
    pub thickness_m: f64,
    /// Mass, kg. All parts of a bulk are alike, so no motion depends on it.
    pub mass_kg: f64,
    /// Coefficient of static friction μ_s between part and tray.
    pub friction_static: f64,
    /// Coefficient of kinetic friction μ_k between part and tray, at most μ_s.
    pub friction_kinetic: f64,
    /// Name of the resting pose in which the part is wanted.
    pub wanted_pose: String,
    /// The resting poses; their probabilities add up to one.
    pub resting_poses: Vec<RestingPose>,
    /// `dropoff_transition[i][j]`: probability that a part which falls off the plateau in pose i lands in pose j. As
    /// many rows and columns as resting poses; each row adds up to one.
    pub dropoff_transition: Vec<Vec<f64>>,
}

/// A checked [`PartSpec`]. Deserialising one checks it too.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PartSpec", into = "PartSpec")]
pub struct PartType {
    spec: PartSpec,
    wanted_pose_index: usize,
}

/// Why a [`PartSpec`] describes no part.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PartTypeError {
    /// A number lies outside its range.
    #[error("part {part:?}: {key} = {value} is outside the allowed range {allowed}")]
    OutOfRange {
        /// Name of the part type.
        part: String,
        /// The key, with indices where it is a list.
        key: String,
        /// The value found.
        value: f64,
        /// The range allowed.
        allowed: String,
    },
    /// Probabilities do not add up to one.
    #[error("part {part:?}: {key} adds up to {sum}, allowed is 1 within {PROBABILITY_TOLERANCE}")]
    NotNormalised {
        /// Name of the part type.
        part: String,
        /// The key whose entries were summed.
        key: String,
        /// Their sum.
        sum: f64,
    },
    /// The transition matrix does not fit the number of resting poses.
    #[error("part {part:?}: {key} has {found} entries, allowed is {expected}, one for each resting pose")]
    WrongShape {
        /// Name of the part type.
        part: String,
        /// The matrix or its row.
        key: String,
        /// Entries found.
        found: usize,
        /// Entries needed.
        expected: usize,
    },
    /// Two resting poses share a name.
    #[error("part {part:?}: resting_poses holds {pose:?} twice, allowed are distinct names")]
    DuplicatePose {
        /// Name of the part type.
        part: String,
        /// The repeated name.
        pose: String,
    },
    /// The wanted pose is none of the resting poses.
    #[error("part {part:?}: wanted_pose = {wanted:?}, allowed is one of {known:?}")]
    UnknownWantedPose {
        /// Name of the part type.
        part: String,
        /// The name asked for.
        wanted: String,
        /// The names there are.
        known: Vec<String>,
    },
}

impl PartType {
    /// Index into [`PartSpec::resting_poses`] of the wanted pose.
    #[must_use]
    pub fn wanted_pose_index(&self) -> usize {
        self.wanted_pose_index
    }

    /// Radius of the disc, m.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.spec.diameter_m / 2.0
    }
}

impl Deref for PartType {
    type Target = PartSpec;

    fn deref(&self) -> &PartSpec {
        &self.spec
    }
}

impl From<PartType> for PartSpec {
    fn from(part: PartType) -> Self {
        part.spec
    }
}

impl TryFrom<PartSpec> for PartType {
    type Error = PartTypeError;

    fn try_from(spec: PartSpec) -> Result<Self, PartTypeError> {
        spec.check_numbers()?;
        spec.check_probabilities()?;
        let wanted_pose_index = spec.find_wanted_pose()?;
        Ok(Self { spec, wanted_pose_index })
    }
}

impl PartSpec {
    fn check_numbers(&self) -> Result<(), PartTypeError> {
        let positive = [
            ("diameter_m", self.diameter_m),
            ("thickness_m", self.thickness_m),
            ("mass_kg", self.mass_kg),
            ("friction_static", self.friction_static),
            ("friction_kinetic", self.friction_kinetic),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(self.out_of_range(key.to_owned(), value, "(0, ∞)".to_owned()));
            }
        }
        if self.friction_kinetic > self.friction_static {
            return Err(self.out_of_range(
                "friction_kinetic".to_owned(),
                self.friction_kinetic,
                format!("(0, friction_static = {}]", self.friction_static),
            ));
        }
        Ok(())
    }

    fn check_probabilities(&self) -> Result<(), PartTypeError> {
        let poses = self.resting_poses.iter().map(|pose| pose.probability);
        self.check_distribution("resting_poses", poses)?;
        let expected = self.resting_poses.len();
        self.check_length("dropoff_transition", self.dropoff_transition.len(), expected)?;
        for (index, row) in self.dropoff_transition.iter().enumerate() {
            let key = format!("dropoff_transition[{index}]");
            self.check_length(&key, row.len(), expected)?;
            self.check_distribution(&key, row.iter().copied())?;
        }
        Ok(())
    }

    fn check_distribution(&self, key: &str, probabilities: impl Iterator<Item = f64>) -> Result<(), PartTypeError> {
        let mut sum = 0.0;
        for (index, probability) in probabilities.enumerate() {
            if !(0.0..=1.0).contains(&probability) {
                return Err(self.out_of_range(format!("{key}[{index}]"), probability, "[0, 1]".to_owned()));
            }
            sum += probability;
        }
        if (sum - 1.0).abs() > PROBABILITY_TOLERANCE {
            return Err(PartTypeError::NotNormalised { part: self.name.clone(), key: key.to_owned(), sum });
        }
        Ok(())
    }

    fn check_length(&self, key: &str, found: usize, expected: usize) -> Result<(), PartTypeError> {
        if found == expected {
            return Ok(());
        }
        Err(PartTypeError::WrongShape { part: self.name.clone(), key: key.to_owned(), found, expected })
    }

    fn find_wanted_pose(&self) -> Result<usize, PartTypeError> {
        for (index, pose) in self.resting_poses.iter().enumerate() {
            if self.resting_poses[..index].iter().any(|other| other.name == pose.name) {
                return Err(PartTypeError::DuplicatePose { part: self.name.clone(), pose: pose.name.clone() });
            }
        }
        self.resting_poses.iter().position(|pose| pose.name == self.wanted_pose).ok_or_else(|| {
            PartTypeError::UnknownWantedPose {
                part: self.name.clone(),
                wanted: self.wanted_pose.clone(),
                known: self.resting_poses.iter().map(|pose| pose.name.clone()).collect(),
            }
        })
    }

    fn out_of_range(&self, key: String, value: f64, allowed: String) -> PartTypeError {
        PartTypeError::OutOfRange { part: self.name.clone(), key, value, allowed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coin() -> PartSpec {
        PartSpec {
            name: "coin".to_owned(),
            diameter_m: 0.006,
            thickness_m: 0.001,
            mass_kg: 2e-4,
            friction_static: 0.2,
            friction_kinetic: 0.2,
            wanted_pose: "heads".to_owned(),
            resting_poses: vec![
                RestingPose { name: "tails".to_owned(), probability: 0.5 },
                RestingPose { name: "heads".to_owned(), probability: 0.5 },
            ],
            dropoff_transition: vec![vec![0.6, 0.4], vec![0.3, 0.7]],
        }
    }

    fn complaint(change: impl FnOnce(&mut PartSpec)) -> String {
        let mut spec = coin();
        change(&mut spec);
        PartType::try_from(spec).map_or_else(|error| error.to_string(), |_| "accepted".to_owned())
    }

    #[test]
    fn a_sound_part_is_accepted_and_knows_its_wanted_pose() {
        let part = PartType::try_from(coin()).unwrap();
        assert_eq!(part.wanted_pose_index(), 1);
        assert_eq!(part.resting_poses.len(), 2);
    }

    #[test]
    fn errors_name_part_key_value_and_allowed_range() {
        for (message, expected) in [
            (
                complaint(|spec| spec.friction_kinetic = 0.25),
                "part \"coin\": friction_kinetic = 0.25 is outside the allowed range (0, friction_static = 0.2]",
            ),
            (
                complaint(|spec| spec.friction_static = 0.0),
                "part \"coin\": friction_static = 0 is outside the allowed range (0, ∞)",
            ),
            (
                complaint(|spec| spec.diameter_m = f64::NAN),
                "part \"coin\": diameter_m = NaN is outside the allowed range (0, ∞)",
            ),
            (
                complaint(|spec| spec.dropoff_transition[1][0] = -0.3),
                "part \"coin\": dropoff_transition[1][0] = -0.3 is outside the allowed range [0, 1]",
            ),
            (
                complaint(|spec| spec.dropoff_transition[1] = vec![0.5, 0.25]),
                "part \"coin\": dropoff_transition[1] adds up to 0.75, allowed is 1 within 0.000001",
            ),
            (
                complaint(|spec| spec.dropoff_transition.truncate(1)),
                "part \"coin\": dropoff_transition has 1 entries, allowed is 2, one for each resting pose",
            ),
            (
                complaint(|spec| spec.resting_poses.clear()),
                "part \"coin\": resting_poses adds up to 0, allowed is 1 within 0.000001",
            ),
            (
                complaint(|spec| spec.resting_poses[0].name = "heads".to_owned()),
                "part \"coin\": resting_poses holds \"heads\" twice, allowed are distinct names",
            ),
            (
                complaint(|spec| spec.wanted_pose = "edge".to_owned()),
                "part \"coin\": wanted_pose = \"edge\", allowed is one of [\"tails\", \"heads\"]",
            ),
        ] {
            assert_eq!(message, expected);
        }
    }

    #[test]
    fn deserialising_checks_and_refuses_unknown_keys() {
        let text = serde_json::to_string(&PartType::try_from(coin()).unwrap()).unwrap();
        let back: PartType = serde_json::from_str(&text).unwrap();
        assert_eq!(*back, coin());
        let bad = text.replace("\"diameter_m\":0.006", "\"diameter_m\":-1.0");
        let error = serde_json::from_str::<PartType>(&bad).unwrap_err().to_string();
        assert!(error.contains("diameter_m = -1 is outside"), "{error}");
        let unknown = text.replace("\"diameter_m\"", "\"diametre_m\"");
        assert!(serde_json::from_str::<PartType>(&unknown).is_err());
    }
}
