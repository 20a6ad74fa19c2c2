//! Checks of numbers against the range in which they mean something: the one way in which a number out of range is told.

use std::borrow::Cow;
use std::fmt;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

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

/// Checks the numbers of a struct, and those in its lists, against the ranges that its fields state with
/// `#[schemars(range(..))]`. Structs within it check themselves. `prefix` goes before the fields' names.
///
/// # Errors
///
/// The first field out of its range; NaN for infinity, which JSON does not know either.
pub fn check_ranges<T: Serialize + JsonSchema>(prefix: &str, values: &T) -> Result<(), OutOfRange> {
    let schema = schemars::schema_for!(T);
    let fields = schema.get("properties").and_then(Value::as_object);
    let Ok(values) = serde_json::to_value(values) else { return Ok(()) };
    for (name, schema) in fields.into_iter().flatten() {
        let value = &values[name.as_str()];
        check_in_schema(&format!("{prefix}{name}"), value, schema)?;
        for value in value.as_array().into_iter().flatten() {
            check_in_schema(&format!("{prefix}{name}"), value, &schema["items"])?;
        }
    }
    Ok(())
}

fn check_in_schema(name: &str, value: &Value, schema: &Value) -> Result<(), OutOfRange> {
    match (schema["minimum"].as_f64(), schema["maximum"].as_f64()) {
        (Some(min), Some(max)) => check_range(name.to_owned(), value.as_f64().unwrap_or(f64::NAN), min, max),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize, JsonSchema)]
    struct Sizes {
        #[schemars(range(min = 0.5, max = 2.0))]
        width_m: f64,
        #[schemars(inner(range(min = -1.0, max = 1.0)))]
        offsets_m: [f64; 2],
        #[schemars(range(min = 1, max = 4))]
        count: u32,
        free: f64,
    }

    #[test]
    fn ranges_of_fields_are_those_of_the_schema() {
        let good = || Sizes { width_m: 0.5, offsets_m: [-1.0, 1.0], count: 4, free: f64::NAN };
        assert_eq!(check_ranges("sizes.", &good()), Ok(()));
        for (sizes, says) in [
            (Sizes { width_m: 2.5, ..good() }, "sizes.width_m = 2.5 is outside its range: 0.5 to 2"),
            (Sizes { width_m: f64::NAN, ..good() }, "sizes.width_m = NaN is outside its range: 0.5 to 2"),
            (Sizes { offsets_m: [0.0, 1.5], ..good() }, "sizes.offsets_m = 1.5 is outside its range: -1 to 1"),
            (Sizes { count: 0, ..good() }, "sizes.count = 0 is outside its range: 1 to 4"),
        ] {
            assert_eq!(check_ranges("sizes.", &sizes).unwrap_err().to_string(), says);
        }
    }

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
