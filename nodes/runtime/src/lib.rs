//! What every node of the feeder stands on.
//!
//! This crate alone knows the DDS library; its public items speak of topics, bytes and plain
//! types only. Nodes run on plain threads: nothing here asks for an async runtime.

pub mod action;
pub mod args;
pub mod cdr;
pub mod clock;
mod configuration;
pub mod dds;
pub mod digest;
#[doc(hidden)]
pub mod fuzzing;
mod health;
mod housekeeping;
pub mod launch;
pub mod lockstep;
mod logging;
pub mod memory;
pub mod node;
pub mod parameters;
pub mod patience;
mod program;
mod public;
pub mod recording;
pub mod rosout;
mod schema;
pub mod service;
pub mod testing;
mod type_description;
mod wall_clock;

pub use logging::{LogSettings, start_logging};
pub use program::{LoadConfig, main, main_with};
