//! Checks of numbers against the range in which they mean something.

use std::fmt;

/// A parameter outside its allowed range. NaN lies outside every range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} = {value} is outside its range: {allowed}")]
pub struct OutOfRange {
    /// Name of the parameter, with its unit.
    pub parameter: &'static str,
    /// The value refused.
    pub value: f64,
    /// The allowed range in words or symbols.
    pub allowed: String,
}

impl OutOfRange {
    /// Passes `value` on if `inside` holds.
    ///
    /// `inside` must be written so that NaN makes it false, as every comparison with NaN is.
    ///
    /// # Errors
    ///
    /// The parameter, its value and `allowed`, if `inside` is false or the value is infinite.
    pub fn unless(inside: bool, parameter: &'static str, value: f64, allowed: impl fmt::Display) -> Result<f64, Self> {
        if inside && value.is_finite() {
            Ok(value)
        } else {
            Err(Self { parameter, value, allowed: allowed.to_string() })
        }
    }

    /// Passes on a positive, finite value.
    ///
    /// # Errors
    ///
    /// The parameter and its value, if it is not.
    pub fn unless_positive(parameter: &'static str, value: f64) -> Result<f64, Self> {
        Self::unless(value > 0.0, parameter, value, "greater than 0 and finite")
    }
}

/// Checks that `value` is finite and within `min..=max`.
pub fn check_range(parameter: &'static str, value: f64, min: f64, max: f64) -> Result<(), OutOfRange> {
    OutOfRange::unless((min..=max).contains(&value), parameter, value, format_args!("{min} to {max}")).map(|_| ())
}
