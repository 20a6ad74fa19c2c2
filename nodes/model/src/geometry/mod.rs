//! What follows from the shape of a part: its mass, the ways it can lie, and its outline as it lies.
//!
//! A part is a closed triangle mesh in its own frame, whose origin is the centre of mass at uniform density. It comes from
//! solids of revolution and extruded polygons given as data ([`ShapeSpec`]), or from an STL file. A part lies on a face of
//! its convex hull; the faces above which its centre of mass stands are its stable poses ([`StablePose`]).

pub mod apart;
mod hull;
mod mesh;
mod outline;
mod pose;
mod shape;
mod shape_error;
mod solids;
mod stl;
mod symmetry;
#[cfg(test)]
mod tests;

pub use hull::HullError;
pub use mesh::{MeshError, PartMesh, TRIANGLES_MAX};
pub use outline::Outline;
pub use pose::{PERTURBATION_RAD, PoseError, StablePose, stable_poses};
pub use shape::{RawMesh, ShapeSpec};
pub use shape_error::ShapeError;
pub use solids::{Loop, Solid};
pub use stl::StlError;
