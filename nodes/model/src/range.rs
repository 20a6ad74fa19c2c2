//! Checks of numbers against the range in which they mean something: the one way in which a number out of range is told.

use std::borrow::Cow;
use std::fmt;

/// A parameter outside its allowed range. NaN and infinity lie outside every range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} = {value} is outside its range: {allowed}")]
pub struct OutOfRange {
    /// Name of the parameter, as whoever gave the value knows it.
    pub parameter: Cow<'static, str>,
    /// The value refused.
    pub value: f64,
    /// The allowed range in words or symbols, with its unit.
    pub allowed: String,
}

impl OutOfRange {
    /// The complaint that `value` of `parameter` is not what is `allowed`.
    pub fn new(parameter: impl Into<Cow<'static, str>>, value: f64, allowed: impl fmt::Display) -> Self {
        Self { parameter: parameter.into(), value, allowed: allowed.to_string() }
    }

    /// Passes if `inside` holds and `value` is finite.
    ///
    /// `inside` must be written so that NaN makes it false, as every comparison with NaN is.
    ///
    /// # Errors
    ///
    /// The parameter, its value and `allowed`, otherwise.
    pub fn unless(
        inside: bool,
        parameter: impl Into<Cow<'static, str>>,
        value: f64,
        allowed: impl fmt::Display,
    ) -> Result<(), Self> {
        if inside && value.is_finite() { Ok(()) } else { Err(Self::new(parameter, value, allowed)) }
    }

    /// Passes if `value` is positive and finite.
    ///
    /// # Errors
    ///
    /// The parameter and its value, if it is not.
    pub fn unless_positive(parameter: impl Into<Cow<'static, str>>, value: f64) -> Result<(), Self> {
        Self::unless(value > 0.0, parameter, value, "above 0 and finite")
    }

    /// The same complaint in the words of whoever gave the value: `parameter` instead of the name it has inside.
    #[must_use]
    pub fn named(self, parameter: impl Into<Cow<'static, str>>) -> Self {
        Self { parameter: parameter.into(), ..self }
    }
}

/// Checks that `value` is finite and within `min..=max`.
///
/// # Errors
///
/// The parameter, its value and both ends of the range, if it is not.
pub fn check_range(parameter: impl Into<Cow<'static, str>>, value: f64, min: f64, max: f64) -> Result<(), OutOfRange> {
    OutOfRange::unless((min..=max).contains(&value), parameter, value, format_args!("{min} to {max}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_complaint_names_parameter_value_and_range() {
        let error = check_range(format!("poses[{}].height_m", 3), 0.2, 0.0, 0.1).unwrap_err();
        assert_eq!(error.to_string(), "poses[3].height_m = 0.2 is outside its range: 0 to 0.1");
        let error = OutOfRange::unless_positive("friction", 0.0).unwrap_err().named("part.friction_static");
        assert_eq!(error.to_string(), "part.friction_static = 0 is outside its range: above 0 and finite");
    }

    #[test]
    fn what_is_no_number_is_in_no_range() {
        check_range("friction", 0.2, 0.0, 1.0).unwrap();
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(check_range("friction", value, f64::NEG_INFINITY, f64::INFINITY).is_err(), "{value} passed");
        }
    }
}
