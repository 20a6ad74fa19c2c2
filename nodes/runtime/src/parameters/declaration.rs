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
