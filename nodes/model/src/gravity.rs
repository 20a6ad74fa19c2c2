//! The acceleration of gravity used wherever none is given.

/// Acceleration of gravity in m/s², the value of the paper and of every table in this project.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.81;
