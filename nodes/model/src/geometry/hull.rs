//! The convex hull of a part as flat faces with the neighbours across their edges.

use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use thiserror::Error;

use super::PartMesh;
use super::outline::{Outline, distance_to_line, edges};

/// How far a vertex may be from the plane of a face, as a share of the part's radius, to lie on it.
const FLATNESS: f64 = 1e-4;

/// Why a part has no hull.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("no convex hull: {0}")]
pub struct HullError(String);

impl HullError {
    pub(super) fn from_text(reason: &impl ToString) -> Self {
        Self(reason.to_string())
    }
}

/// A flat face of a hull, seen as the floor the part lies on.
#[derive(Clone, Debug)]
pub(super) struct Face {
    /// Outward normal in the part frame.
    pub(super) normal: Vector3<f64>,
    /// Height of the centre of mass above the face, m.
    pub(super) height_m: f64,
    /// Share of the directions from the centre of mass that meet the face.
    pub(super) share: f64,
    /// Corners, counter-clockwise seen from above with the part lying on the face, m.
    pub(super) corners_m: Vec<Point2<f64>>,
    pub(super) edges: Vec<Edge>,
}

/// An edge of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    /// Distance of the centre of mass from the edge, seen from above, m; negative if it stands beyond.
    pub(super) margin_m: f64,
    /// Index of the face on the other side.
    pub(super) neighbour: usize,
}

impl Face {
    /// By how much the part must be tilted to go over the edge, rad; negative if it goes over by itself.
    pub(super) fn tip_angle_rad(&self, edge: Edge) -> f64 {
        edge.margin_m.atan2(self.height_m)
    }
}

/// The rotation, no longer than it must be, that lays a part on the face with this outward normal.
pub(super) fn laid_on(normal: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(normal, &-Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

/// The faces of a part's convex hull.
pub(super) fn faces(mesh: &PartMesh) -> Result<Vec<Face>, HullError> {
    let points: Vec<Vector> = mesh.vertices().iter().map(|point| Vector::new(point.x, point.y, point.z)).collect();
    let (corners, triangles) = try_convex_hull(&points).map_err(|error| HullError::from_text(&error))?;
    let corners: Vec<Point3<f64>> = corners.iter().map(|corner| Point3::new(corner.x, corner.y, corner.z)).collect();
    let slack_m = FLATNESS * mesh.radius_m();
    let mut faces: Vec<Face> = Vec::new();
    for triangle in &triangles {
        let [a, b, c] = triangle.map(|index| corners[index as usize]);
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
            continue;
        };
        let height_m = normal.dot(&a.coords);
        // Slivers have no direction to speak of, and the faces around them hold all of their corners.
        let sliver = (b - a).cross(&(c - a)).norm() < slack_m * slack_m;
        let known = faces.iter().any(|face| {
            [a, b, c].iter().all(|corner| (face.normal.dot(&corner.coords) - face.height_m).abs() < slack_m)
        });
        if sliver || known {
            continue;
        }
        let down = laid_on(&normal);
        let on_face = corners.iter().filter(|corner| normal.dot(&corner.coords) > height_m - slack_m);
        let outline = Outline::around(on_face.map(|corner| (down * corner).xy()));
        let share = share_of_directions(&outline.corners_m, height_m);
        faces.push(Face { normal, height_m, share, corners_m: outline.corners_m, edges: Vec::new() });
    }
    let normals: Vec<Vector3<f64>> = faces.iter().map(|face| face.normal).collect();
    let heights: Vec<f64> = faces.iter().map(|face| face.height_m).collect();
    for (index, face) in faces.iter_mut().enumerate() {
        let up = laid_on(&face.normal).inverse();
        let neighbour = |from: Point2<f64>, to: Point2<f64>| {
            // The other face that holds both ends, best in the middle of the edge.
            let gap = |other: usize| {
                let apart = |end: Point2<f64>| {
                    let end = up * Point3::new(end.x, end.y, -heights[index]);
                    (normals[other].dot(&end.coords) - heights[other]).abs()
                };
                apart(from).max(apart(to))
            };
            let others = (0..normals.len()).filter(|&other| other != index);
            others.min_by(|&a, &b| gap(a).total_cmp(&gap(b))).unwrap_or(index)
        };
        face.edges = edges(&face.corners_m)
            .map(|(from, to)| Edge { margin_m: distance_to_line(from, to), neighbour: neighbour(from, to) })
            .collect();
    }
    if faces.len() < 4 { Err(HullError(format!("{} faces", faces.len()))) } else { Ok(faces) }
}

/// Share of the full solid angle under which a polygon is seen from `height_m` above the origin of its plane.
fn share_of_directions(corners: &[Point2<f64>], height_m: f64) -> f64 {
    let seen = |corner: Point2<f64>| Vector3::new(corner.x, corner.y, -height_m).normalize();
    let fan = (1..corners.len().saturating_sub(1)).map(|index| {
        let (a, b, c) = (seen(corners[0]), seen(corners[index]), seen(corners[index + 1]));
        // Van Oosterom and Strackee (1983).
        2.0 * a.dot(&b.cross(&c)).abs().atan2(1.0 + a.dot(&b) + b.dot(&c) + c.dot(&a))
    });
    fan.sum::<f64>() / (4.0 * std::f64::consts::PI)
}
