//! Why a description of a shape gives no mesh.

use thiserror::Error;

use super::MeshError;
use super::stl::StlError;
use crate::range::OutOfRange;

/// Why a shape is no body.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ShapeError {
    /// A number of a solid lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The STL file has not been read.
    #[error("the STL file {file:?} was not found or not read")]
    NotRead {
        /// Its name.
        file: String,
    },
    /// The STL file is none.
    #[error(transparent)]
    Stl(#[from] StlError),
    /// The triangles are no body.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
