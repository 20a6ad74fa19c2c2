//! Parameters as their node declares them: default, description, range.

use minifactory_msgs::rcl_interfaces::msg::{FloatingPointRange, IntegerRange, ParameterDescriptor};

use super::Value;

/// Values a number may take: from one bound to the other, both included, in steps counted from the
/// lower one (the upper bound is always allowed). A step of 0 means that any value between will do.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "explained above")]
pub enum Range {
    Integer { from: i64, to: i64, step: u64 },
    Double { from: f64, to: f64, step: f64 },
}

impl Range {
    fn check(self, value: &Value) -> Result<(), String> {
        match (self, value) {
            (Self::Integer { from, to, step }, Value::Integer(value)) => {
                let on_step = step == 0 || *value == to || value.abs_diff(from).is_multiple_of(step);
                if (from..=to).contains(value) && on_step {
                    return Ok(());
                }
                Err(format!("{value} is not in {from} … {to}{}", steps(step == 0, &step)))
            }
            (Self::Double { from, to, step }, Value::Double(value)) => {
                // Decimal steps have no exact binary form.
                let nearest = from + ((value - from) / step).round() * step;
                let on_step = step <= 0.0 || value >= &to || (nearest - value).abs() <= 1e-6 * step;
                if (from..=to).contains(value) && on_step {
                    return Ok(());
                }
                Err(format!("{value:?} is not in {from:?} … {to:?}{}", steps(step <= 0.0, &step)))
            }
            _ => Ok(()),
        }
    }
}

fn steps(none: bool, step: &dyn std::fmt::Debug) -> String {
    if none { String::new() } else { format!(" in steps of {step:?}") }
}

/// A parameter as its node declares it.
#[derive(Debug, Clone, PartialEq)]
pub struct Declaration {
    /// Its name; dots make groups.
    pub name: String,
    /// Its value unless set, which also fixes its type.
    pub default: Value,
    /// What it means, and its unit.
    pub description: String,
    /// Values it may take, when it is a number with limits.
    pub range: Option<Range>,
    /// Further rules, in words.
    pub constraints: String,
    /// Whether it can be set at the start only.
    pub read_only: bool,
}

impl Declaration {
    /// A parameter that may take any value of its type at any time.
    #[must_use]
    pub fn new(name: &str, default: Value, description: &str) -> Self {
        Self {
            name: name.to_owned(),
            default,
            description: description.to_owned(),
            range: None,
            constraints: String::new(),
            read_only: false,
        }
    }

    /// Limits a number.
    #[must_use]
    pub fn range(self, range: Range) -> Self {
        Self { range: Some(range), ..self }
    }

    /// States a further rule in words; the node enforces it.
    #[must_use]
    pub fn constraints(self, constraints: &str) -> Self {
        Self { constraints: constraints.to_owned(), ..self }
    }

    /// Allows setting it at the start only.
    #[must_use]
    pub fn read_only(self) -> Self {
        Self { read_only: true, ..self }
    }

    /// Whether the type and the range allow a value; if not, why.
    pub(super) fn check(&self, value: &Value) -> Result<(), String> {
        if value.kind() != self.default.kind() {
            return Err(format!("{value} is not {}", self.default.kind()));
        }
        self.range.map_or(Ok(()), |range| range.check(value))
    }

    pub(super) fn descriptor(&self) -> ParameterDescriptor {
        let (mut floating_point_range, mut integer_range) = (Vec::new(), Vec::new());
        match self.range {
            Some(Range::Double { from, to, step }) => {
                floating_point_range.push(FloatingPointRange { from_value: from, to_value: to, step });
            }
            Some(Range::Integer { from, to, step }) => {
                integer_range.push(IntegerRange { from_value: from, to_value: to, step });
            }
            None => {}
        }
        ParameterDescriptor {
            name: self.name.clone(),
            r#type: self.default.kind() as u8,
            description: self.description.clone(),
            additional_constraints: self.constraints.clone(),
            read_only: self.read_only,
            dynamic_typing: false,
            floating_point_range,
            integer_range,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integer_is_allowed_from_bound_to_bound_on_the_steps_from_the_lower_one_and_on_the_upper_one() {
        let allowed = |step, value| Range::Integer { from: 10, to: 25, step }.check(&Value::Integer(value));
        for (step, values, refused) in
            [(0, [10, 11, 25], [9, 26]), (10, [10, 20, 25], [0, 30]), (10, [10; 3], [11, 24])]
        {
            for value in values {
                assert_eq!(allowed(step, value), Ok(()), "{value} by {step}");
            }
            for value in refused {
                assert!(allowed(step, value).is_err(), "{value} by {step}");
            }
        }
        assert_eq!(allowed(0, 9), Err("9 is not in 10 … 25".to_owned()));
        assert_eq!(allowed(10, 9), Err("9 is not in 10 … 25 in steps of 10".to_owned()));
    }

    #[test]
    fn a_double_is_allowed_likewise_and_a_decimal_step_is_met_as_well_as_binary_numbers_can() {
        let allowed = |step, value| Range::Double { from: 1.0, to: 2.5, step }.check(&Value::Double(value));
        for (step, values, refused) in [
            (0.0, [1.0, 1.234, 2.5], [0.999, 2.501]),
            (1.0, [1.0, 2.0, 2.5], [0.0, 3.0]),
            (1.0, [1.0, 2.0, 2.5], [1.5, 2.1]),
            (0.1, [1.3, 1.1 + 0.1 + 0.1, 2.4], [1.35, 1.300_001]),
        ] {
            for value in values {
                assert_eq!(allowed(step, value), Ok(()), "{value} by {step}");
            }
            for value in refused {
                assert!(allowed(step, value).is_err(), "{value} by {step}");
            }
        }
        assert_eq!(allowed(0.0, 3.0), Err("3.0 is not in 1.0 … 2.5".to_owned()));
        assert_eq!(allowed(0.5, 3.0), Err("3.0 is not in 1.0 … 2.5 in steps of 0.5".to_owned()));
        assert!(allowed(0.0, f64::NAN).is_err());
    }

    #[test]
    fn a_descriptor_says_what_was_declared() {
        let plain = Declaration::new("lens", Value::Text("wide".to_owned()), "Lens").descriptor();
        assert_eq!(
            (&*plain.name, &*plain.description, plain.r#type),
            ("lens", "Lens", Value::Text(String::new()).kind() as u8)
        );
        assert!(!plain.read_only && plain.additional_constraints.is_empty());
        assert!(plain.integer_range.is_empty() && plain.floating_point_range.is_empty());
        let rows = Declaration::new("rows", Value::Integer(480), "Rows of a frame")
            .range(Range::Integer { from: 16, to: 4_096, step: 8 })
            .constraints("as the camera has")
            .read_only()
            .descriptor();
        assert!(rows.read_only && rows.additional_constraints == "as the camera has");
        assert_eq!(rows.integer_range, [IntegerRange { from_value: 16, to_value: 4_096, step: 8 }]);
        let rate = Declaration::new("rate_hz", Value::Double(1.0), "Rate").range(Range::Double {
            from: 0.5,
            to: 4.0,
            step: 0.25,
        });
        assert_eq!(
            rate.descriptor().floating_point_range,
            [FloatingPointRange { from_value: 0.5, to_value: 4.0, step: 0.25 }]
        );
    }
}
