//! What a part is: its body, its friction on the tray and the ways it can lie.

use nalgebra::Vector3;
use thiserror::Error;

use super::{DropTable, PartSpec};
use crate::geometry::{PartMesh, PoseError, ShapeError, StablePose, stable_poses};
use crate::mechanics::Friction;
use crate::range::{OutOfRange, check_range};

/// How far a set of probabilities may be from summing to one.
const PROBABILITY_TOLERANCE: f64 = 1e-6;

/// Largest angle between the direction a pose's name gives and the pose's own, rad.
const NAME_ANGLE_MAX_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// A checked part with what follows from its shape.
#[derive(Clone, Debug, PartialEq)]
pub struct PartType {
    /// Name of the part type.
    pub name: String,
    /// The body.
    pub mesh: PartMesh,
    /// Mass, kg. All parts of a bulk are alike, so no motion depends on it.
    pub mass_kg: f64,
    /// Friction between part and tray.
    pub friction: Friction,
    /// How far its coefficients may be from that, either way, over that.
    pub friction_uncertainty_ratio: f64,
    /// The stable poses: first those with names of their own, in the order of the file, then by probability.
    pub poses: Vec<StablePose>,
    /// Indices of the poses in which the part is wanted.
    pub wanted_poses: Vec<usize>,
    /// Probability of each pose after a part was poured onto the tray.
    pub poured: Vec<f64>,
    /// `dropoff[i][j]`: probability that a part which falls off the plateau in pose i lands in pose j.
    pub dropoff: Vec<Vec<f64>>,
}

/// Why a [`PartSpec`] describes no part.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("part {part:?}: {problem}")]
pub struct PartTypeError {
    /// Name of the part type.
    pub part: String,
    /// What is wrong with it.
    pub problem: PartProblem,
}

/// What is wrong with a part.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PartProblem {
    /// A number lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The shape is no body.
    #[error("shape: {0}")]
    Shape(#[from] ShapeError),
    /// The body cannot lie still.
    #[error("shape: {0}")]
    Pose(#[from] PoseError),
    /// Two poses share a name, or a pose has two.
    #[error("poses: {name:?} names a pose that has a name already, allowed is one name for each")]
    DuplicatePose {
        /// The name.
        name: String,
    },
    /// A name for a pose that the part does not have.
    #[error("poses: {name:?} with up = {up:?} is no stable pose, the nearest has up = {nearest:?}")]
    NoSuchPose {
        /// The name.
        name: String,
        /// Its direction.
        up: [f64; 3],
        /// The upward direction of the pose that comes nearest.
        nearest: [f64; 3],
    },
    /// The wanted pose is none of the stable poses, or there is none.
    #[error("wanted_poses = {wanted:?}, allowed are one or more of {known:?}")]
    UnknownWantedPose {
        /// The names asked for.
        wanted: Vec<String>,
        /// The names there are.
        known: Vec<String>,
    },
    /// Drop data of another part, or of this one before it was changed.
    #[error("drops: {what} do not belong to this part as it is now; make them anew with `feeder-lab drop`")]
    StaleDrops {
        /// What does not fit.
        what: &'static str,
    },
    /// Probabilities do not add up to one.
    #[error("{key} adds up to {sum}, allowed is 1 within {PROBABILITY_TOLERANCE}")]
    NotNormalised {
        /// The key whose entries were summed.
        key: String,
        /// Their sum.
        sum: f64,
    },
}

impl PartType {
    /// Checks a part and finds its stable poses.
    ///
    /// # Errors
    /// [`PartTypeError`] that names the part, the key and the allowed range.
    pub fn new(spec: &PartSpec) -> Result<Self, PartTypeError> {
        Self::build(spec).map_err(|problem| PartTypeError { part: spec.name.clone(), problem })
    }

    fn build(spec: &PartSpec) -> Result<Self, PartProblem> {
        OutOfRange::unless_positive("density_kg_m3", spec.density_kg_m3)?;
        check_range("reflectance", spec.reflectance, 0.0, 1.0)?;
        let friction = Friction::new(spec.friction_static, spec.friction_kinetic)?;
        check_range("friction_uncertainty_ratio", spec.friction_uncertainty_ratio, 0.0, 0.5)?;
        let mesh = spec.shape.mesh(spec.reflectance)?;
        let poses = named(stable_poses(&mesh)?, spec)?;
        let find = |name: &String| poses.iter().position(|pose| pose.name == *name);
        let wanted: Option<Vec<usize>> = spec.wanted_poses.iter().map(find).collect();
        let Some(wanted_poses) = wanted.filter(|wanted| !wanted.is_empty()) else {
            return Err(PartProblem::UnknownWantedPose {
                wanted: spec.wanted_poses.clone(),
                known: poses.iter().map(|pose| pose.name.clone()).collect(),
            });
        };
        let estimate: Vec<f64> = poses.iter().map(|pose| pose.probability).collect();
        let mut part = Self {
            name: spec.name.clone(),
            mass_kg: spec.density_kg_m3 * mesh.volume_m3(),
            mesh,
            friction,
            friction_uncertainty_ratio: spec.friction_uncertainty_ratio,
            dropoff: vec![estimate.clone(); poses.len()],
            poured: estimate,
            poses,
            wanted_poses,
        };
        if let Some(drops) = &spec.drops {
            part.check_drops(drops)?;
            part.poured.clone_from(&drops.poured);
            part.dropoff.clone_from(&drops.dropoff);
        }
        Ok(part)
    }

    /// Names of the poses in which the part is wanted.
    pub fn wanted_pose_names(&self) -> impl Iterator<Item = &str> {
        self.wanted_poses.iter().map(|&pose| self.poses[pose].name.as_str())
    }

    /// Largest distance of a point of the part from its centre of mass, seen from above in any pose, m.
    #[must_use]
    pub fn outline_radius_m(&self) -> f64 {
        self.poses.iter().map(|pose| pose.outline.radius_m).fold(0.0, f64::max)
    }

    /// Least width of the part seen from above in any pose, m.
    #[must_use]
    pub fn width_min_m(&self) -> f64 {
        self.poses.iter().map(|pose| pose.outline.width_range_m().0).fold(f64::INFINITY, f64::min)
    }

    /// Height of the part in its highest pose, m.
    #[must_use]
    pub fn height_max_m(&self) -> f64 {
        self.poses.iter().map(|pose| pose.height_m).fold(0.0, f64::max)
    }

    /// A number that changes with whatever the outcome of a drop depends on: the body, its friction, and the names and
    /// order of its poses.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let (at_rest, sliding) = (self.friction.static_coefficient(), self.friction.kinetic_coefficient());
        let mut text = format!("{:.6e} {:.6e} {:.6e}", self.mass_kg, at_rest, sliding);
        for pose in &self.poses {
            let up = pose.up[0];
            text += &format!(
                " {} {:.6e} {:.6e} {:.4} {:.4} {:.4}",
                pose.name,
                pose.height_m,
                pose.outline.area_m2(),
                up.x + 0.0,
                up.y + 0.0,
                up.z + 0.0
            );
        }
        format!("{:016x}", crate::seed::seed_for(self.mesh.triangles().len() as u64, &text))
    }

    fn check_drops(&self, drops: &DropTable) -> Result<(), PartProblem> {
        let stale = |what| PartProblem::StaleDrops { what };
        let names = self.poses.iter().map(|pose| &pose.name);
        if !drops.poses.iter().eq(names) {
            return Err(stale("poses"));
        }
        if drops.fingerprint != self.fingerprint() {
            return Err(stale("fingerprint"));
        }
        let count = self.poses.len();
        if drops.dropoff.len() != count || drops.dropoff.iter().any(|row| row.len() != count) {
            return Err(stale("rows and columns"));
        }
        check_distribution("drops.poured", &drops.poured)?;
        for (index, row) in drops.dropoff.iter().enumerate() {
            check_distribution(&format!("drops.dropoff[{index}]"), row)?;
        }
        Ok(())
    }
}

/// Gives the poses the names of the file and sorts these to the front.
fn named(mut poses: Vec<StablePose>, spec: &PartSpec) -> Result<Vec<StablePose>, PartProblem> {
    let mut sorted = Vec::with_capacity(poses.len());
    for name in &spec.poses {
        let up = Vector3::from(name.up);
        let angle_rad = |pose: &StablePose| pose.up.iter().map(|own| own.angle(&up)).fold(f64::INFINITY, f64::min);
        let duplicate = || PartProblem::DuplicatePose { name: name.name.clone() };
        if sorted.iter().any(|pose: &StablePose| pose.name == name.name || angle_rad(pose) < NAME_ANGLE_MAX_RAD) {
            return Err(duplicate());
        }
        let nearest = (0..poses.len()).min_by(|&a, &b| angle_rad(&poses[a]).total_cmp(&angle_rad(&poses[b])));
        let nearest = nearest.ok_or_else(duplicate)?;
        // Written so that a direction of length 0, which has no angle, is refused.
        if !(up.norm() > 0.0 && angle_rad(&poses[nearest]) < NAME_ANGLE_MAX_RAD) {
            let nearest = poses[nearest].up[0];
            let nearest = [nearest.x, nearest.y, nearest.z];
            return Err(PartProblem::NoSuchPose { name: name.name.clone(), up: name.up, nearest });
        }
        let pose = poses.remove(nearest);
        sorted.push(StablePose { name: name.name.clone(), ..pose });
    }
    for (index, pose) in poses.into_iter().enumerate() {
        sorted.push(StablePose { name: format!("pose_{}", index + 1), ..pose });
    }
    Ok(sorted)
}

fn check_distribution(key: &str, probabilities: &[f64]) -> Result<(), PartProblem> {
    for (index, &value) in probabilities.iter().enumerate() {
        check_range("", value, 0.0, 1.0).map_err(|error| error.named(format!("{key}[{index}]")))?;
    }
    let sum: f64 = probabilities.iter().sum();
    if (sum - 1.0).abs() > PROBABILITY_TOLERANCE {
        return Err(PartProblem::NotNormalised { key: key.to_owned(), sum });
    }
    Ok(())
}
