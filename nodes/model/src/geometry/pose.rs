//! The poses in which a part can lie still, and how often it comes to lie in each.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use super::hull::{self, Edge, Face, HullError};
use super::symmetry::Symmetry;
use super::{Outline, PartMesh};

/// A tilt that what remains of a part's motion gives it as it comes to rest, rad. A pose that a smaller tilt ends does
/// not last. Goldberg, Mirtich, Zhuang, Craig, Carlisle, Canny (1999), "Part pose statistics: estimators and
/// experiments", use 20° for parts dropped on a flat floor.
pub const PERTURBATION_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// Faces whose heights differ by less than this share are level: a part rolls from one to the other without rising.
const LEVEL: f64 = 0.01;

/// A face is lower than another if it is so by this share. A circle's sides are equally high but for rounding.
const DESCENT: f64 = 1e-4;

/// Edges whose tilts differ by less are equally easy to go over, rad.
const TIE_RAD: f64 = 1e-6;

/// A pose in which a part lies still. Poses that the part's symmetry makes the same are one.
#[derive(Clone, Debug, PartialEq)]
pub struct StablePose {
    /// Name of the pose.
    pub name: String,
    /// From the part frame to the part as it lies at yaw 0: z up, origin at the centre of mass. Of all turns that lay
    /// the part so, the shortest.
    pub orientation: UnitQuaternion<f64>,
    /// Height of the centre of mass above the floor, m.
    pub com_height_m: f64,
    /// Height of the part, m.
    pub height_m: f64,
    /// Share of parts dropped on a flat floor that come to lie like this, 0 to 1.
    pub probability: f64,
    /// Convex silhouette seen from above, relative to the centre of mass.
    pub outline: Outline,
    /// How often the part looks the same during a full turn about the vertical; 0 if all the time.
    pub yaw_symmetry: u32,
    /// Least tilt that ends the pose, rad.
    pub tip_angle_rad: f64,
    /// If the part can roll in this pose.
    pub rolls: bool,
    /// The directions, in the part frame, one of which is up in this pose: more than one where symmetry makes them the
    /// same. The first is up in `orientation`.
    pub up: Vec<Vector3<f64>>,
}

/// Why a part has no stable poses.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PoseError {
    /// The convex hull could not be found.
    #[error(transparent)]
    Hull(#[from] HullError),
    /// A ball, or nearly one.
    #[error("no stable pose: the part rolls in every direction")]
    RollsEverywhere,
}

/// The stable poses of a part, the likeliest first, named `pose_1`, `pose_2` and so on.
///
/// The part starts in a random orientation, meets the floor with the face of its convex hull below its centre of mass,
/// and rolls from face to face, over the edge that takes least, until it lies on one above which the centre of mass
/// stands and which a tilt by [`PERTURBATION_RAD`] does not end (the perturbed quasi-static estimate of Goldberg et al.).
///
/// # Errors
/// If there is no hull, or the part is a ball.
pub fn stable_poses(mesh: &PartMesh) -> Result<Vec<StablePose>, PoseError> {
    let faces = hull::faces(mesh)?;
    let symmetry = Symmetry::new(mesh)?;
    let probabilities = settle(&faces);
    let classes = classes(&faces, &probabilities, &symmetry);
    let kept: f64 = (0..faces.len()).filter(|&face| classes[face].is_some()).map(|face| probabilities[face]).sum();
    let mut poses = Vec::new();
    for class in (0..faces.len()).filter(|&face| classes[face] == Some(face)) {
        let members: Vec<usize> = (0..faces.len()).filter(|&face| classes[face] == Some(class)).collect();
        let probability = members.iter().map(|&face| probabilities[face]).sum::<f64>() / kept;
        poses.push(pose(mesh, &faces, &classes, &symmetry, &members, probability));
    }
    if poses.is_empty() {
        return Err(PoseError::RollsEverywhere);
    }
    poses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    for (index, pose) in poses.iter_mut().enumerate() {
        pose.name = format!("pose_{}", index + 1);
    }
    Ok(poses)
}

/// For each face on which the part stays, the first face which it is the same to lie on. A part does not stay on a face
/// from which it rolls on every side without rising.
fn classes(faces: &[Face], probabilities: &[f64], symmetry: &Symmetry<'_>) -> Vec<Option<usize>> {
    let mut classes: Vec<Option<usize>> = vec![None; faces.len()];
    for (index, face) in faces.iter().enumerate() {
        let rolls_over = |edge: &Edge| {
            let level = (faces[edge.neighbour].height_m / face.height_m - 1.0).abs() < LEVEL;
            level && face.tip_angle_rad(*edge) < PERTURBATION_RAD
        };
        if probabilities[index] > 0.0 && !face.edges.iter().all(rolls_over) {
            let same = |&other: &usize| classes[other] == Some(other) && symmetry.same_lie(&faces[other], face);
            classes[index] = Some((0..index).find(same).unwrap_or(index));
        }
    }
    classes
}

/// Where the part ends up, by face.
fn settle(faces: &[Face]) -> Vec<f64> {
    let mut probabilities: Vec<f64> = faces.iter().map(|face| face.share).collect();
    let total: f64 = probabilities.iter().sum();
    let mut order: Vec<usize> = (0..faces.len()).collect();
    order.sort_by(|&a, &b| faces[b].height_m.total_cmp(&faces[a].height_m));
    for &index in &order {
        let next = next_faces(index, faces);
        if !next.is_empty() {
            let each = std::mem::take(&mut probabilities[index]) / next.len() as f64;
            next.iter().for_each(|&next| probabilities[next] += each);
        }
    }
    probabilities.iter().map(|probability| probability / total).collect()
}

/// The lower faces to which a part rolls on, if it does not stay: more than one where several edges take the same.
fn next_faces(index: usize, faces: &[Face]) -> Vec<usize> {
    let face = &faces[index];
    let leads_down = |edge: &&Edge| faces[edge.neighbour].height_m < (1.0 - DESCENT) * face.height_m;
    let exits = face.edges.iter().filter(leads_down).map(|edge| (face.tip_angle_rad(*edge), edge.neighbour));
    let easiest_rad = exits.clone().map(|(angle_rad, _)| angle_rad).fold(PERTURBATION_RAD, f64::min);
    exits
        .filter(|(angle_rad, _)| *angle_rad < easiest_rad.min(PERTURBATION_RAD - TIE_RAD) + TIE_RAD)
        .map(|(_, neighbour)| neighbour)
        .collect()
}

fn pose(
    mesh: &PartMesh,
    faces: &[Face],
    classes: &[Option<usize>],
    symmetry: &Symmetry<'_>,
    members: &[usize],
    probability: f64,
) -> StablePose {
    // Of equal faces the one that needs the shortest turn, so that the yaw means something to whoever drew the part.
    let turn = |face: &usize| hull::laid_on(&faces[*face].normal).angle();
    let first = members.iter().min_by(|a, b| turn(a).total_cmp(&turn(b))).copied().unwrap_or_default();
    let face = &faces[first];
    let same = |neighbour: usize| classes[neighbour] == classes[first];
    let exits = face.edges.iter().filter(|edge| !same(edge.neighbour)).map(|edge| face.tip_angle_rad(*edge));
    let tip_angle_rad = exits.fold(f64::INFINITY, f64::min);
    let rolls = face.edges.iter().any(|edge| same(edge.neighbour) && face.tip_angle_rad(*edge) < PERTURBATION_RAD);
    let orientation = hull::laid_on(&face.normal);
    let heights = mesh.vertices().iter().map(|vertex| (orientation * vertex).z);
    StablePose {
        name: String::new(),
        orientation,
        com_height_m: face.height_m,
        height_m: face.height_m + heights.fold(0.0, f64::max),
        probability,
        outline: Outline::around(mesh.vertices().iter().map(|vertex| (orientation * vertex).xy())),
        yaw_symmetry: symmetry.order_about(&face.normal),
        tip_angle_rad: if tip_angle_rad.is_finite() {
            tip_angle_rad
        } else {
            face.edges.iter().map(|edge| face.tip_angle_rad(*edge)).fold(f64::INFINITY, f64::min)
        },
        rolls,
        up: [first]
            .iter()
            .chain(members.iter().filter(|&&member| member != first))
            .map(|&member| -faces[member].normal)
            .collect(),
    }
}
