//! Numbers as they are sent: rounded to what can be seen, so that messages stay small.

use nalgebra::UnitQuaternion;

fn rounded(value: f64, steps: f64) -> f64 {
    // Adding zero turns −0 into 0.
    (value * steps).round() / steps + 0.0
}

/// A length, to 10 µm.
pub(crate) fn metres(value: f64) -> f64 {
    rounded(value, 1e5)
}

/// A length within a part, to 0.1 µm.
pub(crate) fn small(value: f64) -> f64 {
    rounded(value, 1e7)
}

/// An angle, to 0.1 mrad; a velocity of either kind, likewise.
pub(crate) fn radians(value: f64) -> f64 {
    rounded(value, 1e4)
}

/// A time, to 1 µs.
pub(crate) fn seconds(value: f64) -> f64 {
    rounded(value, 1e6)
}

/// A small error, to six decimals.
pub(crate) fn fine(value: f64) -> f64 {
    rounded(value, 1e6)
}

/// A share, a rate or an acceleration, to three decimals.
pub(crate) fn coarse(value: f64) -> f64 {
    rounded(value, 1e3)
}

/// x, y, z, w.
pub(crate) fn quaternion(turn: &UnitQuaternion<f64>) -> [f64; 4] {
    let q = turn.quaternion();
    [q.i, q.j, q.k, q.w].map(radians)
}

/// Nothing for what is no number or unknown without bound.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
