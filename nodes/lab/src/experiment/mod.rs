//! Experiments on the simulated courier: how well it feeds, what the paper's rig shows, and what happens when it fails.

pub mod faults;
pub mod feed;
pub mod motors;
pub mod rig;
