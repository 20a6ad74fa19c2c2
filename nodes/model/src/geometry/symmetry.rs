//! Whether a part looks the same after a turn.

use std::f64::consts::TAU;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQuery, PointQueryWithLocation};
use parry3d_f64::shape::TriMesh;

use super::PartMesh;
use super::hull::{Face, HullError, laid_on};
use super::solids::CIRCLE_SIDES;

/// How far a turned point may lie from the surface, as a share of the part's radius, for the two to be the same. A
/// circle drawn with 64 sides deviates by 0.12 %.
const TOLERANCE: f64 = 0.01;

/// How near a piece of the part must be to another for the surface between them not to show, as a share of the radius.
const COVERED: f64 = 1e-4;

/// Two surfaces look the same if their reflectances differ by no more than this.
const REFLECTANCE_TOLERANCE: f64 = 0.02;

/// Highest order of symmetry told from full rotational symmetry: a circle is drawn with so many sides.
const ORDER_MAX: u32 = CIRCLE_SIDES;

/// Most points compared: of larger meshes every so-manieth.
const PROBES_MAX: usize = 400;

/// Tells which turns leave a part as it was.
pub(super) struct Symmetry<'a> {
    mesh: &'a PartMesh,
    surface: TriMesh,
    tolerance_m: f64,
    /// Corners and centres of triangles, the latter with their triangle.
    probes: Vec<(Point3<f64>, Option<usize>)>,
}

impl<'a> Symmetry<'a> {
    pub(super) fn new(mesh: &'a PartMesh) -> Result<Self, HullError> {
        let vertices = mesh.vertices().iter().map(vector).collect();
        let surface =
            TriMesh::new(vertices, mesh.triangles().to_vec()).map_err(|error| HullError::from_text(&error))?;
        let corners = mesh.vertices().iter().map(|corner| (*corner, None));
        let centres = mesh.triangles().iter().enumerate().filter_map(|(index, triangle)| {
            let [a, b, c] = mesh.corners(*triangle);
            let centre = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            let covered = is_covered(&surface, index, &centre, COVERED * mesh.radius_m());
            (!covered).then_some((centre, Some(index)))
        });
        let mut probes: Vec<_> = corners.chain(centres).collect();
        // What sticks out farthest tells soonest.
        probes.sort_by(|a, b| b.0.coords.norm().total_cmp(&a.0.coords.norm()));
        let step = probes.len().div_ceil(PROBES_MAX);
        let probes = probes.into_iter().step_by(step).collect();
        Ok(Self { mesh, surface, tolerance_m: TOLERANCE * mesh.radius_m(), probes })
    }

    /// Whether the part looks the same after `turn`.
    pub(super) fn holds(&self, turn: &UnitQuaternion<f64>) -> bool {
        self.probes.iter().all(|(point, triangle)| {
            let turned = vector(&(turn * point));
            match triangle {
                None => self.surface.project_local_point(turned, false).point.distance(turned) <= self.tolerance_m,
                Some(index) => {
                    let (projection, (met, _)) = self.surface.project_local_point_and_get_location(turned, false);
                    let shares = self.mesh.reflectance();
                    let alike = (shares[*index] - shares[met as usize]).abs() <= REFLECTANCE_TOLERANCE;
                    projection.point.distance(turned) <= self.tolerance_m && alike
                }
            }
        })
    }

    /// How often a part looks the same during a turn about an axis of its frame: 0 if all the time.
    pub(super) fn order_about(&self, axis: &Vector3<f64>) -> u32 {
        let axis = nalgebra::Unit::new_normalize(*axis);
        let holds = |angle_rad: f64| self.holds(&UnitQuaternion::from_axis_angle(&axis, angle_rad));
        if holds(1.0) && holds(0.4) {
            return 0;
        }
        // A small turn moves no point far, whatever the shape: all its multiples must hold as well.
        let repeats = |order: u32| (1..=order / 2).all(|steps| holds(TAU * f64::from(steps) / f64::from(order)));
        (2..=ORDER_MAX).rev().find(|&order| repeats(order)).unwrap_or(1)
    }

    /// Whether lying on one face is the same as lying on the other, but for yaw.
    pub(super) fn same_lie(&self, one: &Face, other: &Face) -> bool {
        let alike = |a: f64, b: f64| (a - b).abs() <= self.tolerance_m;
        if !alike(one.height_m, other.height_m) {
            return false;
        }
        let far = |face: &Face| face.corners_m.iter().map(|corner| corner.coords.norm()).fold(0.0, f64::max);
        let Some(mark) = one.corners_m.iter().max_by(|a, b| a.coords.norm().total_cmp(&b.coords.norm())) else {
            return false;
        };
        if !alike(far(one), far(other)) {
            return false;
        }
        let (down_one, down_other) = (laid_on(&one.normal), laid_on(&other.normal));
        let candidates = other.corners_m.iter().filter(|corner| alike(corner.coords.norm(), mark.coords.norm()));
        candidates.into_iter().any(|corner| {
            let yaw_rad = corner.y.atan2(corner.x) - mark.y.atan2(mark.x);
            let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
            self.holds(&(down_other.inverse() * yaw * down_one))
        })
    }
}

/// Whether the surface at the centre of a triangle is inside the part, where two of its pieces touch.
fn is_covered(surface: &TriMesh, index: usize, centre: &Point3<f64>, slack_m: f64) -> bool {
    let centre = vector(centre);
    let own = surface.triangle(u32::try_from(index).unwrap_or(u32::MAX)).normal();
    let around = Aabb::from_half_extents(centre, Vector::splat(slack_m));
    surface.bvh().intersect_aabb(&around).any(|other| {
        let other = surface.triangle(other);
        let opposed = own.zip(other.normal()).is_some_and(|(own, other)| own.dot(other) < -0.999);
        opposed && other.distance_to_local_point(centre, false) < slack_m
    })
}

fn vector(point: &Point3<f64>) -> Vector {
    Vector::new(point.x, point.y, point.z)
}
