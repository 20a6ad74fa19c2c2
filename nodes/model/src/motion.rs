//! True motion of the tray in the platen frame, as the simulated motor records it and the part simulator consumes it.

use nalgebra::Vector3;

/// One servo-rate sample of the tray's motion in the platen frame. Each vector is (x, y, yaw) in m and rad, m/s and
/// rad/s, m/s² and rad/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionSample {
    /// Position x, y (m) and yaw (rad) at the start of the sample.
    pub position: Vector3<f64>,
    /// Velocity at the start of the sample.
    pub velocity: Vector3<f64>,
    /// Acceleration, constant over the sample period that follows.
    pub acceleration: Vector3<f64>,
}

/// A run of consecutive servo-rate samples: `samples[i]` holds from `i * sample_period_s` after the block's stamp.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionBlock {
    /// Time between samples, s.
    pub sample_period_s: f64,
    /// The samples, in order of time.
    pub samples: Vec<MotionSample>,
}
