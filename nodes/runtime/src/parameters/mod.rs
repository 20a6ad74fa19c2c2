//! Parameters: declared with a type, a description and limits, set with reasons for every refusal.
//!
//! [`Store`] holds what is declared and what it is set to, free of I/O; [`ParameterServer`] offers it to
//! `ros2 param` and tells of changes on `/parameter_events`.

mod declaration;
mod server;
mod store;
mod value;

pub use declaration::{Declaration, Range};
pub use server::ParameterServer;
pub use store::{ParameterError, Store};
pub use value::{Kind, Value};
