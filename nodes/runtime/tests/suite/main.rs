//! The runtime over real DDS. Tests that need a peer of another make are ignored unless asked for.

mod actions;
mod common;
mod interop;
mod parameters;
mod rosout;
mod services;
mod topics;
