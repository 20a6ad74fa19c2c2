//! The shape of a part as its file states it.

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::shape_error::ShapeError;
use super::solids::Soup;
use super::stl;
use super::{PartMesh, Solid};
use crate::range::OutOfRange;

/// The shape of a part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShapeSpec {
    /// Solids that touch but do not overlap.
    Solids(Vec<Solid>),
    /// A mesh in an STL file.
    Stl {
        /// Name of the file, relative to the file that names it.
        file: String,
        /// Length of the file's unit, m. STL files do not say; most mean millimetres.
        #[serde(default = "millimetre")]
        unit_m: f64,
    },
    /// A mesh spelled out, as a mesh that was read is handed on.
    Mesh(RawMesh),
}

fn millimetre() -> f64 {
    1e-3
}

/// Triangles not yet checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawMesh {
    /// Vertices, m.
    pub vertices_m: Vec<[f64; 3]>,
    /// Indices of the vertices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl ShapeSpec {
    /// Name of the file this shape still has to be read from, if any.
    #[must_use]
    pub fn file(&self) -> Option<&str> {
        match self {
            Self::Stl { file, .. } => Some(file),
            Self::Solids(_) | Self::Mesh(_) => None,
        }
    }

    /// Puts the content of the STL file in the place of its name.
    ///
    /// # Errors
    /// If the content is no STL file, or the unit is no length.
    pub fn read_stl(&mut self, bytes: &[u8]) -> Result<(), ShapeError> {
        if let Self::Stl { unit_m, .. } = self {
            OutOfRange::unless_positive("unit_m", *unit_m)?;
            *self = Self::Mesh(stl::read(bytes, *unit_m)?);
        }
        Ok(())
    }

    /// The part. `reflectance` is the share of light that comes back where no solid has its own.
    ///
    /// # Errors
    /// If a number is out of range, a file is still to be read, or the triangles do not enclose a body.
    pub fn mesh(&self, reflectance: f64) -> Result<PartMesh, ShapeError> {
        match self {
            Self::Solids(solids) => {
                let mut soup = Soup::default();
                let mut shares = Vec::new();
                for solid in solids {
                    solid.add_to(&mut soup)?;
                    shares.resize(soup.triangles.len(), solid.reflectance().unwrap_or(reflectance));
                }
                Ok(PartMesh::new(soup.vertices, soup.triangles, shares)?)
            }
            Self::Stl { file, .. } => Err(ShapeError::NotRead { file: file.clone() }),
            Self::Mesh(raw) => {
                let vertices = raw.vertices_m.iter().copied().map(Point3::from).collect();
                let shares = vec![reflectance; raw.triangles.len()];
                Ok(PartMesh::new(vertices, raw.triangles.clone(), shares)?)
            }
        }
    }
}
