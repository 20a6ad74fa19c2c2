//! Rigid-body drops of a part: poured onto a floor, and over the drop-off.
//!
//! Lengths are in millimetres in here, the unit in which the engine's tolerances suit parts of a few millimetres.

use anyhow::{Context as _, Result};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::part::{DropTable, PartSpec, PartType};
use feeder_model::range::{OutOfRange, check_range};
use feeder_model::seed::generator;
use feeder_model::tray::TrayGeometry;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::RngExt as _;
use rapier3d_f64::math::{Pose, Rotation, Vector};
use rapier3d_f64::prelude::{
    ColliderBuilder, MassProperties, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, SharedShape,
};

/// Version of the engine, as the workspace pins it.
const ENGINE: &str = "rapier3d-f64 0.36.1";

const MM: f64 = 1e3;
const STEP_S: f64 = 5e-4;

/// A drop ends when the part has been at rest for this long, or after the longest time, s.
const REST_S: f64 = 0.03;
const LONGEST_S: f64 = 1.5;

/// At rest a part moves by less than this, mm/s and rad/s.
const REST_MM_S: f64 = 2.0;
const REST_RAD_S: f64 = 0.5;

/// A part lies in a pose if its upward direction is that of the pose within this angle, rad.
const POSE_ANGLE_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Half the size of the floors, mm.
const FLOOR_MM: f64 = 500.0;

/// Drops a part and tells how it came to lie.
/// Drop a part as a rigid body and print the `drops` section for its file (YAML).
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Name of a part of the catalogue, or a part file (YAML)
    part: String,
    /// Drops for each pose
    #[arg(long, default_value_t = 400)]
    drops: u32,
    /// Seed of orientations and speeds
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Height of the drop-off, m
    #[arg(long, default_value_t = 0.02)]
    height: f64,
    /// Largest speed at which the part leaves the plateau, m/s
    #[arg(long, default_value_t = 0.05)]
    speed: f64,
    /// Coefficient of restitution
    #[arg(long, default_value_t = 0.2)]
    restitution: f64,
}

/// Prints the drop table.
pub(crate) fn run(args: &Args) -> Result<()> {
    // Drop data that are there already may belong to an earlier shape.
    let part = PartType::new(&PartSpec { drops: None, ..feeder::part::load(&args.part)? })?;
    let table = drop_table(&part, args)?;
    print!("{}", serde_saphyr::to_string(&serde_json::json!({ "drops": table }))?);
    Ok(())
}

fn drop_table(part: &PartType, args: &Args) -> Result<DropTable> {
    check_range("--drops", args.drops.into(), 1.0, 1e5)?;
    let height_ok = args.height > 2.0 * part.mesh.radius_m() && args.height <= 0.5;
    OutOfRange::unless(height_ok, "--height", args.height, "above the part's size, up to 0.5 m")?;
    check_range("--speed", args.speed, 0.0, 1.0)?;
    check_range("--restitution", args.restitution, 0.0, 1.0)?;
    let shape = hull(part)?;
    let mut tried = 0_u32;
    let mut unsettled = 0_u32;
    let mut row = |purpose: &str, from: Option<usize>| {
        let mut random = generator(args.seed, purpose);
        let mut counts = vec![0_u32; part.poses.len()];
        for _ in 0..args.drops {
            let start = match from {
                None => Start::poured(args, &mut random),
                Some(pose) => Start::over_the_edge(part, pose, args, &mut random),
            };
            tried += 1;
            match drop_once(part, &shape, &start, args) {
                Some(pose) => counts[pose] += 1,
                None => unsettled += 1,
            }
        }
        shares(&counts).with_context(|| format!("part {}: no drop ended in a stable pose", part.name))
    };
    let poured = row("poured", None)?;
    let dropoff =
        (0..part.poses.len()).map(|pose| row(&part.poses[pose].name, Some(pose))).collect::<Result<Vec<_>>>()?;
    Ok(DropTable {
        engine: ENGINE.to_owned(),
        seed: args.seed,
        drops: args.drops,
        height_m: args.height,
        speed_m_s: args.speed,
        restitution: args.restitution,
        fingerprint: part.fingerprint(),
        poses: part.poses.iter().map(|pose| pose.name.clone()).collect(),
        unsettled: f64::from(unsettled) / f64::from(tried),
        poured,
        dropoff,
    })
}

/// Shares of a total of one, to six digits; `None` of nothing.
fn shares(counts: &[u32]) -> Option<Vec<f64>> {
    let total: u32 = counts.iter().sum();
    let mut shares: Vec<f64> =
        counts.iter().map(|&count| (1e6 * f64::from(count) / f64::from(total)).round() / 1e6).collect();
    let largest = (0..counts.len()).max_by_key(|&index| counts[index])?;
    let others: f64 = shares.iter().enumerate().filter(|(index, _)| *index != largest).map(|(_, share)| share).sum();
    shares[largest] = (1e6 * (1.0 - others)).round() / 1e6;
    (total > 0).then_some(shares)
}

/// How a drop begins, in mm; and whether over the edge of a plateau onto the ramp, or onto a level floor.
struct Start {
    position_mm: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
    velocity_mm_s: Vector3<f64>,
    turning_rad_s: Vector3<f64>,
    over_the_edge: bool,
}

impl Start {
    /// In a random orientation from the height of the drop-off, tumbling slowly.
    fn poured(args: &Args, random: &mut impl rand::Rng) -> Self {
        let mut symmetric = || 2.0 * random.random::<f64>() - 1.0;
        // Uniform over all orientations: a uniform direction in four dimensions.
        let orientation = loop {
            let q = Quaternion::new(symmetric(), symmetric(), symmetric(), symmetric());
            if (0.01..=1.0).contains(&q.norm_squared()) {
                break UnitQuaternion::from_quaternion(q);
            }
        };
        Self {
            position_mm: Vector3::new(0.0, 0.0, args.height * MM),
            orientation,
            velocity_mm_s: Vector3::new(symmetric(), symmetric(), 0.0) * (args.speed * MM),
            turning_rad_s: Vector3::new(symmetric(), symmetric(), symmetric()) * 5.0,
            over_the_edge: false,
        }
    }

    /// Lying in a pose at any yaw on the plateau, with the centre of mass just beyond its edge, and sliding on.
    fn over_the_edge(part: &PartType, pose: usize, args: &Args, random: &mut impl rand::Rng) -> Self {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU * random.random::<f64>());
        let lying = &part.poses[pose];
        // How far a part goes within a step of the vibration before it begins to tip.
        let beyond_mm = 0.05 + 0.2 * random.random::<f64>();
        let forward_mm_s = args.speed * MM * random.random::<f64>();
        Self {
            position_mm: Vector3::new(beyond_mm, 0.0, (args.height + lying.com_height_m) * MM + 0.01),
            orientation: yaw * lying.orientation,
            velocity_mm_s: Vector3::new(forward_mm_s, 0.0, 0.0),
            turning_rad_s: Vector3::zeros(),
            over_the_edge: true,
        }
    }
}

fn hull(part: &PartType) -> Result<SharedShape> {
    let points: Vec<Vector> =
        part.mesh.vertices().iter().map(|point| Vector::new(point.x, point.y, point.z) * MM).collect();
    SharedShape::convex_hull(&points).with_context(|| format!("part {}: no convex hull", part.name))
}

/// The part as a body that touches as its convex hull does and weighs what it weighs.
pub(crate) fn mass_properties(part: &PartType) -> MassProperties {
    // In g and mm, so that numbers stay near one.
    let grams = part.mass_kg * 1e3;
    let inertia = part.mesh.inertia_per_density_m5() * (grams / part.mesh.volume_m3() * MM * MM);
    let columns: [[f64; 3]; 3] = inertia.into();
    let inertia = rapier3d_f64::math::Matrix::from_cols_array_2d(&columns);
    MassProperties::with_inertia_matrix(Vector::ZERO, grams, inertia)
}

/// The pose in which the part comes to lie, if any.
fn drop_once(part: &PartType, shape: &SharedShape, start: &Start, args: &Args) -> Option<usize> {
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, 0.0, -STANDARD_GRAVITY_M_S2 * MM);
    world.integration_parameters.dt = STEP_S;
    let up = floors(&mut world, part, start.over_the_edge, args);
    let body = insert(&mut world, part, shape, start, args);
    let mut rest_s = 0.0;
    let mut time_s = 0.0;
    while time_s < LONGEST_S && rest_s < REST_S {
        world.step();
        time_s += STEP_S;
        let body = &world.bodies[body];
        let still = body.linvel().length() < REST_MM_S && body.angvel().length() < REST_RAD_S;
        // In the air a part may stand still for a moment.
        rest_s = if still && time_s > 0.05 { rest_s + STEP_S } else { 0.0 };
    }
    let turned = world.bodies[body].rotation();
    let orientation = UnitQuaternion::from_quaternion(Quaternion::new(turned.w, turned.x, turned.y, turned.z));
    let up = orientation.inverse() * up;
    let angle_rad = |pose: &usize| {
        let ups = part.poses[*pose].up.iter();
        ups.map(|own| own.angle(&up)).fold(f64::INFINITY, f64::min)
    };
    let nearest = (0..part.poses.len()).min_by(|a, b| angle_rad(a).total_cmp(&angle_rad(b)))?;
    (angle_rad(&nearest) < POSE_ANGLE_RAD).then_some(nearest)
}

/// Puts the floors into the world and returns the upward normal of the one on which the part ends.
fn floors(world: &mut PhysicsWorld, part: &PartType, edge: bool, args: &Args) -> Vector3<f64> {
    let material = |collider: ColliderBuilder| {
        collider.friction(part.friction.kinetic_coefficient()).restitution(args.restitution)
    };
    let half = Vector::new(FLOOR_MM, FLOOR_MM, FLOOR_MM);
    let block = || material(ColliderBuilder::cuboid(half.x, half.y, half.z));
    if !edge {
        world.insert_collider(block().translation(Vector::new(0.0, 0.0, -FLOOR_MM)), None);
        return Vector3::z();
    }
    world.insert_collider(block().translation(Vector::new(-FLOOR_MM, 0.0, args.height * MM - FLOOR_MM)), None);
    // The foot of the paper's ramp under the outer lane rises away from the drop-off.
    let slope_rad = TrayGeometry::PAPER.ramp_slope_rad(0.085);
    let up = Vector3::new(-slope_rad.sin(), 0.0, slope_rad.cos());
    let ramp =
        block().translation(Vector::new(-up.x, 0.0, -up.z) * FLOOR_MM).rotation(Vector::new(0.0, -slope_rad, 0.0));
    world.insert_collider(ramp, None);
    up
}

fn insert(
    world: &mut PhysicsWorld,
    part: &PartType,
    shape: &SharedShape,
    start: &Start,
    args: &Args,
) -> RigidBodyHandle {
    let q = start.orientation.coords;
    let pose = Pose { translation: vector(&start.position_mm), rotation: Rotation::from_xyzw(q.x, q.y, q.z, q.w) };
    let body = RigidBodyBuilder::dynamic()
        .pose(pose)
        .linvel(vector(&start.velocity_mm_s))
        .angvel(vector(&start.turning_rad_s))
        .can_sleep(false);
    let collider = ColliderBuilder::new(shape.clone())
        .mass_properties(mass_properties(part))
        .friction(part.friction.kinetic_coefficient())
        .restitution(args.restitution);
    let (body, _) = world.insert(body, collider);
    body
}

fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use feeder_scenario::PartSource;

    use super::*;

    fn args(drops: u32) -> Args {
        Args { part: String::new(), drops, seed: 5, height: 0.02, speed: 0.05, restitution: 0.2 }
    }

    /// Another seed must find the table of the catalogue again, and the quasi-static estimate of the stable poses must be
    /// near what rigid bodies do.
    #[test]
    fn val_drops_agree_with_the_catalogue_and_with_the_estimate() {
        let drops = 120;
        for name in ["block", "hex_nut"] {
            let spec = PartSource::Name(name.to_owned()).spec().unwrap();
            let stored = spec.drops.clone().unwrap();
            let part = PartType::new(&spec).unwrap();
            let table = drop_table(&part, &args(drops)).unwrap();
            assert_eq!((&table.poses, &table.fingerprint), (&stored.poses, &stored.fingerprint));
            let rows = table.dropoff.iter().chain([&table.poured]).zip(stored.dropoff.iter().chain([&stored.poured]));
            for (found, expected) in rows {
                for (found, expected) in found.iter().zip(expected) {
                    // Four standard deviations of both counts, and one drop.
                    let spread = expected * (1.0 - expected) * (1.0 / f64::from(drops) + 1.0 / f64::from(stored.drops));
                    let tolerance = 4.0 * spread.sqrt() + 1.0 / f64::from(drops);
                    assert!((found - expected).abs() <= tolerance, "{name}: {table:?}");
                }
            }
            for (pose, poured) in part.poses.iter().zip(&stored.poured) {
                assert!((pose.probability - poured).abs() < 0.2, "{name}/{}: {poured}", pose.name);
            }
        }
    }

    #[test]
    fn shares_add_up_to_one() {
        let thirds = shares(&[1, 1, 1]).unwrap();
        assert!((thirds.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(shares(&[0, 0]), None);
    }
}
