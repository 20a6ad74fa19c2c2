//! The runtime over real DDS.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod lockstep;
mod parameters;
mod rosout;
mod services;
mod topics;
mod wall_clock;
