//! Values of parameters, from and to messages and YAML.

use std::fmt;

use minifactory_msgs::rcl_interfaces::msg::{ParameterType, ParameterValue};
use serde::{
    Deserialize, Deserializer,
    de::{Error, SeqAccess, Visitor},
};

/// What kind of value a parameter holds. The numbers are those of `rcl_interfaces/msg/ParameterType`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Kind {
    /// True or false.
    Bool = ParameterType::PARAMETER_BOOL,
    /// A whole number.
    Integer = ParameterType::PARAMETER_INTEGER,
    /// A number.
    Double = ParameterType::PARAMETER_DOUBLE,
    /// Text.
    Text = ParameterType::PARAMETER_STRING,
    /// Bytes.
    Bytes = ParameterType::PARAMETER_BYTE_ARRAY,
    /// Several of true and false.
    Bools = ParameterType::PARAMETER_BOOL_ARRAY,
    /// Whole numbers.
    Integers = ParameterType::PARAMETER_INTEGER_ARRAY,
    /// Numbers.
    Doubles = ParameterType::PARAMETER_DOUBLE_ARRAY,
    /// Texts.
    Texts = ParameterType::PARAMETER_STRING_ARRAY,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bool => "a bool",
            Self::Integer => "an integer",
            Self::Double => "a double (write 1.0, not 1)",
            Self::Text => "a string",
            Self::Bytes => "bytes",
            Self::Bools => "an array of bools",
            Self::Integers => "an array of integers",
            Self::Doubles => "an array of doubles (write 1.0, not 1)",
            Self::Texts => "an array of strings",
        })
    }
}

/// The value of a parameter.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the variants are those of Kind")]
pub enum Value {
    Bool(bool),
    Integer(i64),
    Double(f64),
    Text(String),
    Bytes(Vec<u8>),
    Bools(Vec<bool>),
    Integers(Vec<i64>),
    Doubles(Vec<f64>),
    Texts(Vec<String>),
}

impl Value {
    /// What kind of value this is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Bool(_) => Kind::Bool,
            Self::Integer(_) => Kind::Integer,
            Self::Double(_) => Kind::Double,
            Self::Text(_) => Kind::Text,
            Self::Bytes(_) => Kind::Bytes,
            Self::Bools(_) => Kind::Bools,
            Self::Integers(_) => Kind::Integers,
            Self::Doubles(_) => Kind::Doubles,
            Self::Texts(_) => Kind::Texts,
        }
    }

    /// The value a message holds; `None` when it holds none or one of an unknown type.
    #[must_use]
    pub fn from_message(message: ParameterValue) -> Option<Self> {
        Some(match message.r#type {
            ParameterType::PARAMETER_BOOL => Self::Bool(message.bool_value),
            ParameterType::PARAMETER_INTEGER => Self::Integer(message.integer_value),
            ParameterType::PARAMETER_DOUBLE => Self::Double(message.double_value),
            ParameterType::PARAMETER_STRING => Self::Text(message.string_value),
            ParameterType::PARAMETER_BYTE_ARRAY => Self::Bytes(message.byte_array_value),
            ParameterType::PARAMETER_BOOL_ARRAY => Self::Bools(message.bool_array_value),
            ParameterType::PARAMETER_INTEGER_ARRAY => Self::Integers(message.integer_array_value),
            ParameterType::PARAMETER_DOUBLE_ARRAY => Self::Doubles(message.double_array_value),
            ParameterType::PARAMETER_STRING_ARRAY => Self::Texts(message.string_array_value),
            _ => return None,
        })
    }

    /// The value as a message.
    #[must_use]
    pub fn to_message(&self) -> ParameterValue {
        let mut message = ParameterValue { r#type: self.kind() as u8, ..Default::default() };
        match self.clone() {
            Self::Bool(value) => message.bool_value = value,
            Self::Integer(value) => message.integer_value = value,
            Self::Double(value) => message.double_value = value,
            Self::Text(value) => message.string_value = value,
            Self::Bytes(value) => message.byte_array_value = value,
            Self::Bools(value) => message.bool_array_value = value,
            Self::Integers(value) => message.integer_array_value = value,
            Self::Doubles(value) => message.double_array_value = value,
            Self::Texts(value) => message.string_array_value = value,
        }
        message
    }

    /// The value as an empty array of a kind, where that is what it can mean: text files cannot tell
    /// empty arrays apart.
    pub(super) fn fit_empty_array(self, kind: Kind) -> Self {
        match (&self, kind) {
            (Self::Texts(texts), _) if !texts.is_empty() => self,
            (Self::Texts(_), Kind::Bytes) => Self::Bytes(Vec::new()),
            (Self::Texts(_), Kind::Bools) => Self::Bools(Vec::new()),
            (Self::Texts(_), Kind::Integers) => Self::Integers(Vec::new()),
            (Self::Texts(_), Kind::Doubles) => Self::Doubles(Vec::new()),
            _ => self,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            // Debug keeps the point: 1.0, not 1.
            Self::Double(value) => write!(f, "{value:?}"),
            Self::Text(value) => write!(f, "{value:?}"),
            Self::Bytes(value) => write!(f, "{value:?}"),
            Self::Bools(value) => write!(f, "{value:?}"),
            Self::Integers(value) => write!(f, "{value:?}"),
            Self::Doubles(value) => write!(f, "{value:?}"),
            Self::Texts(value) => write!(f, "{value:?}"),
        }
    }
}

/// As YAML writes it: scalars, and arrays of scalars of one type.
impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Scalars;

        impl<'de> Visitor<'de> for Scalars {
            type Value = Value;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a bool, a number, a string, or an array of one of these")
            }

            fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
                Ok(Value::Bool(value))
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
                Ok(Value::Integer(value))
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
                let value = i64::try_from(value).map_err(|_| E::custom(format!("{value} exceeds {}", i64::MAX)))?;
                Ok(Value::Integer(value))
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
                Ok(Value::Double(value))
            }

            fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
                Ok(Value::Text(value.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Value, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = elements.next_element::<Value>()? {
                    values.push(value);
                }
                array(values).ok_or_else(|| A::Error::custom("an array holds values of one type, and no arrays"))
            }
        }

        deserializer.deserialize_any(Scalars)
    }
}

fn array(values: Vec<Value>) -> Option<Value> {
    fn all<T>(values: Vec<Value>, of: impl Fn(Value) -> Option<T>) -> Option<Vec<T>> {
        values.into_iter().map(of).collect()
    }
    Some(match values.first().map(Value::kind) {
        None => Value::Texts(Vec::new()),
        Some(Kind::Bool) => {
            Value::Bools(all(values, |value| if let Value::Bool(value) = value { Some(value) } else { None })?)
        }
        Some(Kind::Integer) => {
            Value::Integers(all(values, |value| if let Value::Integer(value) = value { Some(value) } else { None })?)
        }
        Some(Kind::Double) => {
            Value::Doubles(all(values, |value| if let Value::Double(value) = value { Some(value) } else { None })?)
        }
        Some(Kind::Text) => {
            Value::Texts(all(values, |value| if let Value::Text(value) = value { Some(value) } else { None })?)
        }
        Some(_) => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of each kind, by its name.
    fn values() -> [(Value, &'static str); 9] {
        [
            (Value::Bool(true), "a bool"),
            (Value::Integer(-7), "an integer"),
            (Value::Double(0.5), "a double (write 1.0, not 1)"),
            (Value::Text("tray".to_owned()), "a string"),
            (Value::Bytes(vec![1, 255]), "bytes"),
            (Value::Bools(vec![true, false]), "an array of bools"),
            (Value::Integers(vec![3, -4]), "an array of integers"),
            (Value::Doubles(vec![1.0, -0.25]), "an array of doubles (write 1.0, not 1)"),
            (Value::Texts(vec!["a".to_owned(), String::new()]), "an array of strings"),
        ]
    }

    #[test]
    fn every_kind_of_value_comes_back_from_its_message_and_has_a_name() {
        for (number, (value, name)) in (1..).zip(values()) {
            let message = value.to_message();
            assert_eq!((message.r#type, value.kind().to_string()), (number, name.to_owned()));
            assert_eq!(Value::from_message(message), Some(value));
        }
        for number in [0, 10] {
            assert_eq!(Value::from_message(ParameterValue { r#type: number, ..Default::default() }), None);
        }
    }

    #[test]
    fn only_an_empty_array_of_a_text_file_may_be_one_of_any_kind() {
        for (value, _) in values() {
            let kind = value.kind();
            let fitted = Value::Texts(Vec::new()).fit_empty_array(kind);
            let is_array = matches!(kind, Kind::Bytes | Kind::Bools | Kind::Integers | Kind::Doubles);
            assert_eq!(fitted.kind(), if is_array { kind } else { Kind::Texts }, "{kind}");
            for (other, _) in values() {
                assert_eq!(other.clone().fit_empty_array(kind), other, "{kind}");
            }
        }
    }

    #[test]
    fn a_value_is_read_as_yaml_writes_it() {
        let read = |text: &str| serde_saphyr::from_str::<Value>(text);
        for (text, value) in [
            ("true", Value::Bool(true)),
            ("-7", Value::Integer(-7)),
            ("9223372036854775807", Value::Integer(i64::MAX)),
            ("1.0", Value::Double(1.0)),
            ("tray", Value::Text("tray".to_owned())),
            ("[]", Value::Texts(Vec::new())),
            ("[true, false]", Value::Bools(vec![true, false])),
            ("[3, -4]", Value::Integers(vec![3, -4])),
            ("[1.0, -0.25]", Value::Doubles(vec![1.0, -0.25])),
            ("[a, 'b']", Value::Texts(vec!["a".to_owned(), "b".to_owned()])),
        ] {
            assert_eq!(read(text).unwrap(), value, "{text}");
        }
        for (text, reason) in [
            ("9223372036854775808", "9223372036854775808 exceeds 9223372036854775807"),
            ("[1, 1.0]", "an array holds values of one type, and no arrays"),
            ("[[1]]", "an array holds values of one type, and no arrays"),
            ("{a: 1}", "a bool, a number, a string, or an array of one of these"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
