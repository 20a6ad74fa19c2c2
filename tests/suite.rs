//! The feeder from outside: what a user, an operating system or another DDS implementation sees of it.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod analysis;
mod cell;
mod common;
mod cyclone;
mod faults;
mod interop;
mod partner;
mod system;
mod tidy;
mod wall_clock;
