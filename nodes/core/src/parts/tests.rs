//! Tests of the bulk that need to see inside it.

use super::*;

/// A disc with two equally likely faces and one coefficient of friction.
pub(super) fn disc(diameter_m: f64, friction: f64) -> PartType {
    let pose = |name: &str| RestingPose {
        name: name.to_owned(),
        probability: 0.5,
    };
    PartType::try_from(PartSpec {
        name: "disc".to_owned(),
        diameter_m,
        thickness_m: 0.001,
        mass_kg: 2e-4,
        friction_static: friction,
        friction_kinetic: friction,
        wanted_pose: "up".to_owned(),
        resting_poses: vec![pose("up"), pose("down")],
        dropoff_transition: vec![vec![0.5, 0.5]; 2],
    })
    .unwrap()
}
