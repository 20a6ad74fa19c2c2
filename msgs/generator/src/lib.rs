//! Turns ROS 2 interface definitions (`.msg`, `.srv`, `.action`) into Rust source, concatenated schemas and type hashes.
//!
//! ```
//! use ros2_msggen::{Catalogue, PackageFolder, DefinitionFile, TypeName, emit};
//!
//! let source = DefinitionFile {
//!     package: "demo_msgs".into(),
//!     namespace: PackageFolder::Msg,
//!     name: "Spot".into(),
//!     file: "msg/Spot.msg".into(),
//!     text: "float64 x_m\n".into(),
//! };
//! let catalogue = Catalogue::new(&[source])?;
//! assert!(emit(&catalogue, "demo_msgs")?.contains("pub x_m: f64"));
//!
//! let spot = catalogue.get(&TypeName::message("demo_msgs", "Spot")).expect("just defined");
//! assert!(catalogue.type_hash(spot).starts_with("RIHS01_"));
//! # Ok::<(), ros2_msggen::Error>(())
//! ```

mod catalogue;
mod emit;
mod error;
mod hash;
mod model;
mod parse;
mod rust;
mod schema;
mod source;
mod text;
mod value;

pub use catalogue::Catalogue;
pub use emit::emit;
pub use error::{Error, Named, Problem};
pub use model::{
    Arity, Constant, Element, Field, FieldType, Literal, MessageBody, PackageFolder, Role, Structure, TypeName,
};
pub use source::DefinitionFile;

/// The front page's code, which is tried with the documentation's.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct FrontPage;
