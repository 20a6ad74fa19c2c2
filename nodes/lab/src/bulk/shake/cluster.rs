//! Clusters of touching parts on the plateau.

use std::f64::consts::{PI, TAU};

use feeder_model::geometry::apart::gap_m;
use feeder_sim::parts::{Part, PartBulk, Place};
use nalgebra::{Isometry2, Matrix2, Vector2};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

/// Parts that are nearer to each other than this touch, m.
pub(super) const TOUCH_M: f64 = 1e-5;

/// Places tried for a whole cluster, and for each of its parts.
const ATTEMPTS: u32 = 200;

/// Where a cluster lies in the tray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cluster {
    /// Mean of the centres, m.
    pub(super) middle_m: Vector2<f64>,
    /// Unit vector along which the centres are spread most.
    pub(super) along: Vector2<f64>,
}

impl Cluster {
    /// Of parts with these centres.
    pub(super) fn of(centres_m: &[Vector2<f64>]) -> Self {
        let middle_m = centres_m.iter().sum::<Vector2<f64>>() / centres_m.len().max(1) as f64;
        let spread: Matrix2<f64> =
            centres_m.iter().map(|centre| (centre - middle_m) * (centre - middle_m).transpose()).sum();
        // The principal axis of a symmetric matrix.
        let angle_rad = 0.5 * (2.0 * spread[(0, 1)]).atan2(spread[(0, 0)] - spread[(1, 1)]);
        Self { middle_m, along: Vector2::new(angle_rad.cos(), angle_rad.sin()) }
    }
}

/// Puts `count` parts that lie in `pose` and touch each other somewhere on the plateau of a tray. Returns whether there was
/// room for them; the tray is as it was if not.
pub(super) fn put(bulk: &mut PartBulk, count: usize, pose: usize, rng: &mut Pcg64Mcg) -> bool {
    (0..ATTEMPTS).any(|_| {
        let mut tried = bulk.clone();
        let whole = put_first(&mut tried, pose, rng) && (1..count).all(|_| put_beside(&mut tried, pose, rng));
        if whole {
            *bulk = tried;
        }
        whole
    })
}

fn put_first(bulk: &mut PartBulk, pose: usize, rng: &mut Pcg64Mcg) -> bool {
    let tray = *bulk.tray();
    let squared = rng.random_range(tray.inner_radius_m.powi(2)..tray.outer_radius_m.powi(2));
    let angle_rad = rng.random_range(tray.ramp_angle_rad..TAU);
    let yaw_rad = rng.random_range(-PI..PI);
    put_wholly_on_the_plateau(bulk, squared.sqrt() * Vector2::new(angle_rad.cos(), angle_rad.sin()), yaw_rad, pose)
}

/// Slides a part towards one of those on the plateau until they touch.
fn put_beside(bulk: &mut PartBulk, pose: usize, rng: &mut Pcg64Mcg) -> bool {
    let outline = bulk.part_type().poses[pose].outline.clone();
    (0..ATTEMPTS).any(|_| {
        let here = bulk.parts()[rng.random_range(0..bulk.parts().len())];
        let direction_rad = rng.random_range(0.0..TAU);
        let yaw_rad = rng.random_range(-PI..PI);
        let direction = Vector2::new(direction_rad.cos(), direction_rad.sin());
        let (mut near_m, mut far_m) = (0.0, 3.0 * outline.radius_m);
        while far_m - near_m > 0.1 * TOUCH_M {
            let distance_m = f64::midpoint(near_m, far_m);
            let mut there = here;
            (there.x_m, there.y_m) = (here.x_m + distance_m * direction.x, here.y_m + distance_m * direction.y);
            there.yaw_rad = yaw_rad;
            if free_m(bulk, &here, &there) > 0.5 * TOUCH_M {
                far_m = distance_m;
            } else {
                near_m = distance_m;
            }
        }
        put_wholly_on_the_plateau(bulk, here.position_m() + far_m * direction, yaw_rad, pose)
    })
}

fn put_wholly_on_the_plateau(bulk: &mut PartBulk, place_m: Vector2<f64>, yaw_rad: f64, pose: usize) -> bool {
    let part = bulk.part_type();
    let tray = bulk.tray();
    let on_plateau = |angle_rad: f64| angle_rad.rem_euclid(TAU) > tray.ramp_angle_rad;
    let corners = part.poses[pose].outline.at(&Isometry2::new(place_m, yaw_rad));
    let angle_rad = place_m.y.atan2(place_m.x).rem_euclid(TAU);
    corners.iter().all(|corner| on_plateau(corner.y.atan2(corner.x)))
        && bulk.put(place_m.norm(), angle_rad, yaw_rad, pose).is_ok()
}

/// Free gap between two parts, m.
pub(super) fn free_m(bulk: &PartBulk, one: &Part, other: &Part) -> f64 {
    let outlines = [one, other].map(|part| &bulk.part_type().poses[part.pose].outline);
    if outlines.iter().all(|outline| outline.round) {
        return (one.position_m() - other.position_m()).norm() - outlines[0].radius_m - outlines[1].radius_m;
    }
    let lies = |part: &Part| Isometry2::new(part.position_m(), part.yaw_rad);
    gap_m(&outlines[0].at(&lies(one)), &outlines[1].at(&lies(other)))
}

/// The two nearest of the parts that lie right on the plateau.
pub(super) fn nearest_pair(bulk: &PartBulk) -> Option<Cluster> {
    let wanted = &bulk.part_type().wanted_poses;
    let right = |part: &&Part| part.place == Place::Plateau && wanted.contains(&part.pose);
    let parts: Vec<&Part> = bulk.parts().iter().filter(right).collect();
    let pairs =
        parts.iter().enumerate().flat_map(|(index, one)| parts[index + 1..].iter().map(move |other| (*one, *other)));
    let apart = pairs.map(|(one, other)| ((one.position_m() - other.position_m()).norm(), one, other));
    let (_, one, other) = apart.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Cluster::of(&[one.position_m(), other.position_m()]))
}

#[cfg(test)]
mod tests {
    use feeder_model::part::PartType;
    use rand::SeedableRng as _;

    use super::*;
    use crate::bulk::shake::testing;
    use crate::bulk::shake::{pickable, right_on_plateau};

    /// How many parts are reached from the first by going on from each to those that it touches.
    fn connected(bulk: &PartBulk) -> usize {
        let parts = bulk.parts();
        let mut reached = vec![0];
        let mut next = 0;
        while next < reached.len() {
            let here = parts[reached[next]];
            let touching = |&index: &usize| free_m(bulk, &here, &parts[index]) < TOUCH_M;
            let found: Vec<usize> =
                (0..parts.len()).filter(|index| !reached.contains(index)).filter(touching).collect();
            reached.extend(found);
            next += 1;
        }
        reached.len()
    }

    #[test]
    fn the_parts_of_a_cluster_touch_lie_right_and_none_can_be_picked() {
        for name in ["grommet", "hex_nut", "block"] {
            let part = PartType::new(&feeder::part::load(name).unwrap()).unwrap();
            let (empty, room_m) = testing::empty(&part);
            let mut rng = Pcg64Mcg::seed_from_u64(3);
            for count in [2, 3, 6, 6, 6] {
                let mut bulk = empty.clone();
                assert!(put(&mut bulk, count, part.wanted_poses[0], &mut rng), "{name}");
                assert_eq!(
                    (bulk.parts().len(), right_on_plateau(&bulk), connected(&bulk)),
                    (count, count, count),
                    "{name}"
                );
                assert!(bulk.overlap_m() <= 0.0 && pickable(&bulk, room_m).is_empty(), "{name}");
            }
        }
    }

    #[test]
    fn a_cluster_lies_along_its_longest_extent() {
        let row: Vec<Vector2<f64>> = (0..3).map(|index| f64::from(index) * Vector2::new(0.003, -0.004)).collect();
        let cluster = Cluster::of(&row);
        assert!((cluster.middle_m - row[1]).norm() < 1e-12);
        assert!(cluster.along.perp(&Vector2::new(0.6, -0.8)).abs() < 1e-12, "{cluster:?}");
    }
}
