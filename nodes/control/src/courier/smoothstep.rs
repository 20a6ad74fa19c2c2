//! How what grows or fades begins and ends without a jump.

/// The smoothstep 10 x³ − 15 x⁴ + 6 x⁵ of x = `time_s` / `duration_s`, 0 before and 1 after, and its derivative, 1/s.
/// `duration_s` is above 0.
#[must_use]
pub fn smoothstep(time_s: f64, duration_s: f64) -> (f64, f64) {
    let x = (time_s / duration_s).clamp(0.0, 1.0);
    (x * x * x * (10.0 + x * (6.0 * x - 15.0)), 30.0 * (x * (1.0 - x)).powi(2) / duration_s)
}
