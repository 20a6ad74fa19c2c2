//! The simulated world: what stands in for hardware, parts and light.
//!
//! [`motor`] is the planar motor with its sensor, [`parts`] are parts in bulk on the tray, [`camera`] takes pictures of
//! both. Everything here is a function of its inputs and a seed.

pub mod camera;
pub mod motor;
pub mod parts;
