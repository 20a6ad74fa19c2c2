//! Periodic vibration of the tray as piecewise-constant acceleration.

use serde::{Deserialize, Serialize};

/// The courier axis a waveform drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Translation along the platen's x; accelerations in m/s².
    X,
    /// Translation along the platen's y; accelerations in m/s².
    Y,
    /// Rotation about the tray's centre; accelerations in rad/s².
    Yaw,
}

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Acceleration: m/s² on X and Y, rad/s² on Yaw.
    pub acceleration: f64,
}

/// One period of a vibration: segments of constant acceleration on one axis, without net change of velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Waveform {
    /// The driven axis.
    pub axis: Axis,
    /// The segments in order; their durations add up to the period.
    pub segments: Vec<Segment>,
}
