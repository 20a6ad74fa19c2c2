//! Meshes from STL files, ASCII or binary.

use std::io::Cursor;

use thiserror::Error;

use super::RawMesh;

/// Why bytes are no STL file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("not an STL file: {0}")]
pub struct StlError(String);

/// Triangles of an STL file whose unit of length is `unit_m`. Vertices with the same coordinates become one; triangles
/// without an area are left out. The normals in the file are not used: the order of the corners tells which side is out.
pub(super) fn read(bytes: &[u8], unit_m: f64) -> Result<RawMesh, StlError> {
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|error| StlError(error.to_string()))?;
    let vertices_m = mesh.vertices.iter().map(|vertex| [0, 1, 2].map(|axis| f64::from(vertex[axis]) * unit_m));
    let index = |index: usize| u32::try_from(index).map_err(|_| StlError("too many vertices".to_owned()));
    let mut triangles = Vec::with_capacity(mesh.faces.len());
    for face in &mesh.faces {
        let [a, b, c] = face.vertices;
        if a != b && b != c && c != a {
            triangles.push([index(a)?, index(b)?, index(c)?]);
        }
    }
    Ok(RawMesh { vertices_m: vertices_m.collect(), triangles })
}
