//! Checks of numbers against the range in which they mean something: the one way in which a number out of range is told.

use std::any::TypeId;
use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

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
/// `#[schemars(range(..))]` and `#[schemars(extend("exclusiveMinimum" = ..))]`. Structs within it check themselves, and
/// what may be left out may be missing. `prefix` goes before the fields' names.
///
/// # Errors
///
/// The first field out of its range; NaN for infinity, which JSON does not know either.
pub fn check_ranges<T: Serialize + JsonSchema + 'static>(prefix: &str, values: &T) -> Result<(), OutOfRange> {
    let Ok(values) = serde_json::to_value(values) else { return Ok(()) };
    for FieldRange { field, range, may_be_missing } in stated_ranges::<T>().iter() {
        let value = &values[field.as_str()];
        if *may_be_missing && value.is_null() {
            continue;
        }
        let numbers = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
        for number in numbers {
            range.check(format!("{prefix}{field}"), number.as_f64().unwrap_or(f64::NAN))?;
        }
    }
    Ok(())
}

/// The range that a field states.
struct FieldRange {
    field: String,
    range: StatedRange,
    may_be_missing: bool,
}

#[derive(Clone, Copy, Default, PartialEq)]
struct StatedRange {
    min: Option<f64>,
    above: Option<f64>,
    max: Option<f64>,
}

impl StatedRange {
    fn of(schema: &Value) -> Option<Self> {
        let bound = |name: &str| schema[name].as_f64();
        let range = Self { min: bound("minimum"), above: bound("exclusiveMinimum"), max: bound("maximum") };
        (range != Self::default()).then_some(range)
    }

    fn check(self, name: String, value: f64) -> Result<(), OutOfRange> {
        let inside = self.min.is_none_or(|min| value >= min)
            && self.above.is_none_or(|above| value > above)
            && self.max.is_none_or(|max| value <= max);
        OutOfRange::unless(inside, name, value, self)
    }
}

impl fmt::Display for StatedRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.min, self.above, self.max) {
            (Some(min), _, Some(max)) => write!(f, "{min} to {max}"),
            (Some(min), _, None) => write!(f, "at least {min}"),
            (None, Some(above), Some(max)) => write!(f, "above {above}, at most {max}"),
            (None, Some(above), None) => write!(f, "above {above} and finite"),
            (None, None, max) => write!(f, "at most {}", max.unwrap_or(f64::INFINITY)),
        }
    }
}

/// The ranges that the fields of a type state. Its schema is made once: some are checked at every move.
fn stated_ranges<T: JsonSchema + 'static>() -> Arc<[FieldRange]> {
    static KNOWN: LazyLock<Mutex<HashMap<TypeId, Arc<[FieldRange]>>>> = LazyLock::new(Mutex::default);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let ranges = known.entry(TypeId::of::<T>()).or_insert_with(|| {
        let schema = schemars::schema_for!(T);
        let fields = schema.get("properties").and_then(Value::as_object);
        let ranges = fields.into_iter().flatten().filter_map(|(field, schema)| {
            let range = StatedRange::of(schema).or_else(|| StatedRange::of(&schema["items"]))?;
            let may_be_missing =
                schema["type"].as_array().is_some_and(|types| types.iter().any(|allowed| allowed == "null"));
            Some(FieldRange { field: field.clone(), range, may_be_missing })
        });
        ranges.collect()
    });
    Arc::clone(ranges)
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
        #[schemars(extend("exclusiveMinimum" = 0.0))]
        period_s: f64,
        #[schemars(range(min = 0.0))]
        radius_m: Option<f64>,
        free: f64,
    }

    #[test]
    fn ranges_of_fields_are_those_of_the_schema() {
        let good =
            || Sizes { width_m: 0.5, offsets_m: [-1.0, 1.0], count: 4, period_s: 0.1, radius_m: None, free: f64::NAN };
        assert_eq!(check_ranges("sizes.", &good()), Ok(()));
        for (sizes, says) in [
            (Sizes { width_m: 2.5, ..good() }, "sizes.width_m = 2.5 is outside its range: 0.5 to 2"),
            (Sizes { width_m: f64::NAN, ..good() }, "sizes.width_m = NaN is outside its range: 0.5 to 2"),
            (Sizes { offsets_m: [0.0, 1.5], ..good() }, "sizes.offsets_m = 1.5 is outside its range: -1 to 1"),
            (Sizes { period_s: 0.0, ..good() }, "sizes.period_s = 0 is outside its range: above 0 and finite"),
            (Sizes { radius_m: Some(-1.0), ..good() }, "sizes.radius_m = -1 is outside its range: at least 0"),
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
