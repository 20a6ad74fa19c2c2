//! The same work in the rigid-body engine rapier3d: the tray as a triangle mesh that turns as the waveform says, the parts
//! as the convex hulls of their shapes. Lengths are in millimetres, masses in grams.

use std::f64::consts::TAU;
use std::time::Instant;

use anyhow::{Context as _, Result};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::Waveform;
use feeder_sim::parts::{BulkSettings, PartBulk};
use nalgebra::{UnitQuaternion, Vector3};
use rapier3d_f64::math::{Pose, Rotation, Vector};
use rapier3d_f64::prelude::{ColliderBuilder, PhysicsWorld, RigidBodyBuilder, SharedShape};

use super::SAMPLE_S;
use crate::drop::mass_properties;

const MM: f64 = 1e3;

/// Sectors of the tray's surfaces, and height of its walls above the plateau, mm.
const SECTORS: u32 = 120;
const WALL_MM: f64 = 10.0;

/// Simulated seconds per wall second with the parts where this project's bulk loads them, at its own servo period.
pub(super) fn speed(
    part: &PartType,
    tray: &TrayGeometry,
    settings: BulkSettings,
    count: usize,
    seed: u64,
    waveform: &Waveform,
    duration_s: f64,
) -> Result<f64> {
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, 0.0, -STANDARD_GRAVITY_M_S2 * MM);
    world.integration_parameters.dt = SAMPLE_S;
    let (vertices, triangles) = surfaces(tray);
    let body = RigidBodyBuilder::kinematic_velocity_based().can_sleep(false);
    let collider = ColliderBuilder::trimesh(vertices, triangles)?.friction(part.friction.kinetic_coefficient());
    let (turntable, _) = world.insert(body, collider);

    let points: Vec<Vector> =
        part.mesh.vertices().iter().map(|point| Vector::new(point.x, point.y, point.z) * MM).collect();
    let hull = SharedShape::convex_hull(&points).context("no convex hull")?;
    let mut bulk = PartBulk::new(*tray, part.clone(), settings, seed)?;
    bulk.load(count);
    for placed in bulk.parts() {
        let lying = &part.poses[placed.pose];
        // Clear of the slope by what it rises under the part.
        let height_m = tray.height_m(placed.angle_rad()) + lying.com_height_m + 0.1 * lying.outline.radius_m;
        let q = (UnitQuaternion::from_axis_angle(&Vector3::z_axis(), placed.yaw_rad) * lying.orientation).coords;
        let pose = Pose {
            translation: Vector::new(placed.x_m, placed.y_m, height_m) * MM,
            rotation: Rotation::from_xyzw(q.x, q.y, q.z, q.w),
        };
        let collider = ColliderBuilder::new(hull.clone())
            .mass_properties(mass_properties(part))
            .friction(part.friction.kinetic_coefficient());
        world.insert(RigidBodyBuilder::dynamic().pose(pose).can_sleep(false), collider);
    }
    let mut run = |seconds: f64| {
        let began = Instant::now();
        let mut time_s = 0.0;
        while time_s < seconds {
            let rate_rad_s = waveform.state_at(time_s % waveform.period_s()).velocity;
            if let Some(turntable) = world.bodies.get_mut(turntable) {
                turntable.set_angvel(Vector::new(0.0, 0.0, rate_rad_s), true);
            }
            world.step();
            time_s += SAMPLE_S;
        }
        time_s / began.elapsed().as_secs_f64()
    };
    // Until the parts have come to lie.
    run(0.1);
    Ok(run(duration_s))
}

/// Ramp, plateau, drop-off and walls as triangles, mm.
fn surfaces(tray: &TrayGeometry) -> (Vec<Vector>, Vec<[u32; 3]>) {
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    let mut quad = |corners: [Vector; 4]| {
        let first = u32::try_from(vertices.len()).unwrap_or(u32::MAX);
        vertices.extend(corners);
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    };
    let at = |radius_m: f64, angle_rad: f64, height_m: f64| {
        Vector::new(radius_m * angle_rad.cos(), radius_m * angle_rad.sin(), height_m) * MM
    };
    let (inner_m, outer_m) = (tray.inner_radius_m, tray.outer_radius_m);
    let top_m = tray.rise_m + WALL_MM / MM;
    for sector in 0..SECTORS {
        let [from_rad, to_rad] = [sector, sector + 1].map(|edge| TAU * f64::from(edge) / f64::from(SECTORS));
        let (low_m, high_m) = (tray.height_m(from_rad), tray.height_m(to_rad - 1e-9));
        quad([
            at(inner_m, from_rad, low_m),
            at(outer_m, from_rad, low_m),
            at(outer_m, to_rad, high_m),
            at(inner_m, to_rad, high_m),
        ]);
        for radius_m in [inner_m, outer_m] {
            quad([
                at(radius_m, from_rad, -0.01),
                at(radius_m, to_rad, -0.01),
                at(radius_m, to_rad, top_m),
                at(radius_m, from_rad, top_m),
            ]);
        }
    }
    quad([at(inner_m, 0.0, 0.0), at(outer_m, 0.0, 0.0), at(outer_m, 0.0, tray.rise_m), at(inner_m, 0.0, tray.rise_m)]);
    (vertices, triangles)
}
