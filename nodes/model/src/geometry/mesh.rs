//! A part as a closed triangle mesh about its centre of mass.

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use thiserror::Error;

/// Most triangles a part may have. More would not be seen at the camera's resolution.
pub const TRIANGLES_MAX: usize = 50_000;

/// Least share of the cube around a part that its volume must fill, for the part to be a body and not a sheet.
const FILLED_SHARE_MIN: f64 = 1e-6;

/// Largest coordinate, m.
const COORDINATE_MAX_M: f64 = 10.0;

/// A closed triangle mesh with outward normals in the part frame: lengths in m, origin at the centre of mass.
///
/// Separate closed pieces that touch or lie inside one another's cavities are one part; they must not overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct PartMesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    reflectance: Vec<f64>,
    volume_m3: f64,
    inertia_per_density_m5: Matrix3<f64>,
}

/// Why triangles are no body.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// There is nothing, or what there is encloses nothing.
    #[error("the mesh is empty: {triangles} triangles that enclose {volume_m3} m³, allowed is a body of at least 4")]
    Empty {
        /// Triangles found.
        triangles: usize,
        /// What they enclose, m³.
        volume_m3: f64,
    },
    /// More triangles than a part may have.
    #[error("the mesh has {triangles} triangles, allowed are at most {TRIANGLES_MAX}")]
    TooLarge {
        /// Triangles found.
        triangles: usize,
    },
    /// A coordinate that is no number, or an index without a vertex.
    #[error(
        "triangle {triangle} of the mesh names vertex {vertex}, which has no coordinates within {COORDINATE_MAX_M} m"
    )]
    BadVertex {
        /// Index of the triangle.
        triangle: usize,
        /// Index of the vertex.
        vertex: u32,
    },
    /// One reflectance per triangle is needed, each a share.
    #[error("the mesh's reflectance has {found} entries from 0 to 1, allowed are {triangles}, one for each triangle")]
    BadReflectance {
        /// Usable entries found.
        found: usize,
        /// Triangles of the mesh.
        triangles: usize,
    },
    /// An edge with a triangle on one side only.
    #[error("the mesh is open: {edges} edges have no triangle on one side, the first at {at_m:?} m")]
    Open {
        /// How many such edges there are.
        edges: usize,
        /// The middle of one of them, m, in the coordinates given.
        at_m: [f64; 3],
    },
    /// Neighbouring triangles that do not agree about which side is out.
    #[error(
        "the mesh is partly inverted: {edges} edges are run the same way by both triangles, the first at {at_m:?} m"
    )]
    PartlyInverted {
        /// How many such edges there are.
        edges: usize,
        /// The middle of one of them, m, in the coordinates given.
        at_m: [f64; 3],
    },
    /// All normals point inwards.
    #[error("the mesh is inverted: it encloses {volume_m3} m³, allowed are outward normals and a positive volume")]
    Inverted {
        /// The negative volume, m³.
        volume_m3: f64,
    },
}

impl PartMesh {
    /// Makes a part of triangles whose vertices run counter-clockwise as seen from outside, in any frame of the part's
    /// directions (m), and moves the origin to the centre of mass. `reflectance` is the share of light that comes back,
    /// 0 to 1, one for each triangle.
    ///
    /// # Errors
    /// If the triangles are not the closed surface of a body, with their normals outwards.
    pub fn new(
        mut vertices: Vec<Point3<f64>>,
        triangles: Vec<[u32; 3]>,
        reflectance: Vec<f64>,
    ) -> Result<Self, MeshError> {
        if triangles.len() > TRIANGLES_MAX {
            return Err(MeshError::TooLarge { triangles: triangles.len() });
        }
        check_vertices(&vertices, &triangles)?;
        let usable = reflectance.iter().filter(|share| (0.0..=1.0).contains(*share)).count();
        if usable != triangles.len() || reflectance.len() != triangles.len() {
            return Err(MeshError::BadReflectance { found: usable, triangles: triangles.len() });
        }
        check_closed(&vertices, &triangles)?;
        let (volume_m3, centre) = volume_and_centre(&vertices, &triangles);
        let size_m = vertices.iter().map(|vertex| (vertex - centre).norm()).fold(0.0, f64::max);
        if volume_m3.abs() <= FILLED_SHARE_MIN * size_m.powi(3) {
            return Err(MeshError::Empty { triangles: triangles.len(), volume_m3 });
        }
        if volume_m3 < 0.0 {
            return Err(MeshError::Inverted { volume_m3 });
        }
        for vertex in &mut vertices {
            *vertex -= centre.coords;
        }
        let inertia_per_density_m5 = inertia(&vertices, &triangles);
        Ok(Self { vertices, triangles, reflectance, volume_m3, inertia_per_density_m5 })
    }

    /// The vertices, m.
    #[must_use]
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// The triangles as indices of vertices, counter-clockwise as seen from outside.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Share of light that comes back from each triangle, 0 to 1.
    #[must_use]
    pub fn reflectance(&self) -> &[f64] {
        &self.reflectance
    }

    /// Volume, m³.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        self.volume_m3
    }

    /// Inertia tensor about the centre of mass in the part frame, for a density of 1: times kg/m³ gives kg m².
    #[must_use]
    pub fn inertia_per_density_m5(&self) -> &Matrix3<f64> {
        &self.inertia_per_density_m5
    }

    /// Distance of the farthest vertex from the centre of mass, m.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max)
    }

    /// Share of its convex hull that the part fills, 0 to 1; 1 if it has no hull.
    #[must_use]
    pub fn solidity(&self) -> f64 {
        let points: Vec<Vector> = self.vertices.iter().map(|point| Vector::new(point.x, point.y, point.z)).collect();
        let Ok((corners, triangles)) = try_convex_hull(&points) else { return 1.0 };
        let corners: Vec<Point3<f64>> =
            corners.iter().map(|corner| Point3::new(corner.x, corner.y, corner.z)).collect();
        let (hull_m3, _) = volume_and_centre(&corners, &triangles);
        self.volume_m3 / hull_m3
    }

    /// The corners of a triangle, m.
    pub(super) fn corners(&self, triangle: [u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|index| self.vertices[index as usize])
    }
}

fn check_vertices(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    for (triangle, corners) in triangles.iter().enumerate() {
        for &vertex in corners {
            let known = vertices.get(vertex as usize);
            if !known.is_some_and(|point| point.iter().all(|coordinate| coordinate.abs() <= COORDINATE_MAX_M)) {
                return Err(MeshError::BadVertex { triangle, vertex });
            }
        }
    }
    Ok(())
}

/// Every edge must be run equally often both ways.
fn check_closed(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    let mut runs: HashMap<(u32, u32), (i32, usize)> = HashMap::new();
    for (index, &[a, b, c]) in triangles.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (key, step) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            runs.entry(key).or_insert((0, index)).0 += step;
        }
    }
    let unbalanced = |odd: bool| {
        let edges = runs.iter().filter(|(_, (balance, _))| *balance != 0 && (balance % 2 != 0) == odd);
        let count = edges.clone().count();
        let first = edges.min_by_key(|(edge, (_, triangle))| (*triangle, **edge));
        first.map(|(&(a, b), _)| {
            let middle = nalgebra::center(&vertices[a as usize], &vertices[b as usize]);
            (count, [middle.x, middle.y, middle.z])
        })
    };
    if let Some((edges, at_m)) = unbalanced(true) {
        return Err(MeshError::Open { edges, at_m });
    }
    match unbalanced(false) {
        Some((edges, at_m)) => Err(MeshError::PartlyInverted { edges, at_m }),
        None => Ok(()),
    }
}

/// Sums over the tetrahedra between a point near the triangles and each of them.
fn volume_and_centre(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> (f64, Point3<f64>) {
    let origin = vertices.first().copied().unwrap_or_default();
    let mut volume = 0.0;
    let mut moment = Vector3::zeros();
    for corners in triangles {
        let [a, b, c] = corners.map(|index| vertices[index as usize] - origin);
        let part = a.dot(&b.cross(&c)) / 6.0;
        volume += part;
        moment += part * (a + b + c) / 4.0;
    }
    let centre = if volume == 0.0 { Vector3::zeros() } else { moment / volume };
    (volume, origin + centre)
}

/// Inertia tensor about the origin at density 1, from the second moments of the tetrahedra at the origin.
fn inertia(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Matrix3<f64> {
    let mut second = Matrix3::zeros();
    for corners in triangles {
        let [a, b, c] = corners.map(|index| vertices[index as usize].coords);
        let volume = a.dot(&b.cross(&c)) / 6.0;
        let sum = a + b + c;
        let squares = a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose();
        second += squares * (volume / 20.0);
    }
    Matrix3::from_diagonal_element(second.trace()) - second
}
