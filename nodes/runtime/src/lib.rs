//! What every node of the feeder stands on.
//!
//! This crate alone knows the DDS library; its public items speak of topics, bytes and plain
//! types only. Nodes run on plain threads: nothing here asks for an async runtime.

pub mod action;
pub mod cdr;
pub mod dds;
pub mod digest;
pub mod launch;
pub mod lockstep;
pub mod node;
mod program;
mod public;
pub mod service;
pub mod testing;
mod wall_clock;

pub use program::{log_to_stderr, main, main_with};
