//! Values of constants and defaults.

use crate::{
    error::Problem,
    model::{Arity, Element, FieldType, Literal},
};

/// Parses the default value of a field.
pub(crate) fn parse_default(ty: &FieldType, declared: &str, text: &str) -> Result<Literal, Problem> {
    let problem = |rule: String| Problem::Value { value: text.to_owned(), ty: declared.to_owned(), rule };
    if matches!(ty.element, Element::Nested(_)) {
        return Err(Problem::DefaultType(declared.to_owned()));
    }
    let (least, most) = match ty.arity {
        Arity::One => return parse_element(&ty.element, text).map_err(problem),
        Arity::Array(size) => (size, size),
        Arity::Sequence { bound } => (0, bound.unwrap_or(u32::MAX)),
    };
    let elements = text
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .ok_or_else(|| problem("expected `[`, elements with commas between them, `]`".to_owned()))?;
    let values = split(elements)
        .into_iter()
        .map(|element| parse_element(&ty.element, element))
        .collect::<Result<Vec<_>, _>>()
        .map_err(problem)?;
    match u32::try_from(values.len()) {
        Ok(found) if (least..=most).contains(&found) => Ok(Literal::List(values)),
        _ => Err(problem(format!("expected {least} to {most} elements, found {}", values.len()))),
    }
}

/// Parses the value of a constant or of one element of a default; an error is the rule that is broken.
pub(crate) fn parse_element(element: &Element, text: &str) -> Result<Literal, String> {
    match element {
        Element::Bool => match text.to_ascii_lowercase().as_str() {
            "true" | "1" => Ok(Literal::Bool(true)),
            "false" | "0" => Ok(Literal::Bool(false)),
            _ => Err("expected true, false, 1 or 0".to_owned()),
        },
        Element::Float32 => match text.parse::<f32>() {
            Ok(value) if value.is_finite() => Ok(Literal::Float32(value)),
            _ => Err(format!("expected a finite number from {:e} to {:e}", f32::MIN, f32::MAX)),
        },
        Element::Float64 => match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Literal::Float64(value)),
            _ => Err(format!("expected a finite number from {:e} to {:e}", f64::MIN, f64::MAX)),
        },
        Element::Byte | Element::Char | Element::UInt8 => integer(text, 0, u8::MAX.into()),
        Element::Int8 => integer(text, i8::MIN.into(), i8::MAX.into()),
        Element::Int16 => integer(text, i16::MIN.into(), i16::MAX.into()),
        Element::UInt16 => integer(text, 0, u16::MAX.into()),
        Element::Int32 => integer(text, i32::MIN.into(), i32::MAX.into()),
        Element::UInt32 => integer(text, 0, u32::MAX.into()),
        Element::Int64 => integer(text, i64::MIN.into(), i64::MAX.into()),
        Element::UInt64 => integer(text, 0, u64::MAX.into()),
        Element::String { bound } | Element::WString { bound } => string(text, *bound),
        Element::Nested(_) => Err("messages have no values".to_owned()),
    }
}

fn integer(text: &str, least: i128, most: i128) -> Result<Literal, String> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let (radix, digits) = match digits.get(..2) {
        Some("0x" | "0X") => (16, &digits[2..]),
        Some("0o" | "0O") => (8, &digits[2..]),
        Some("0b" | "0B") => (2, &digits[2..]),
        _ => (10, digits),
    };
    // from_str_radix takes a sign of its own, which must not stand behind ours or behind a prefix.
    let parsed = if digits.starts_with(['+', '-']) { None } else { i128::from_str_radix(digits, radix).ok() };
    match parsed.map(|value| sign * value) {
        Some(value) if (least..=most).contains(&value) => Ok(Literal::Integer(value)),
        _ => Err(format!("expected a whole number from {least} to {most}")),
    }
}

/// A string may stand in quotes, of either kind; inside, that kind is written with a backslash before it.
fn string(text: &str, bound: Option<u32>) -> Result<Literal, String> {
    let value = match text.chars().next() {
        Some(quote @ ('"' | '\'')) => unquote(text, quote).ok_or("the quotes do not match")?,
        _ => text.to_owned(),
    };
    match bound {
        Some(bound) if value.len() > usize::try_from(bound).unwrap_or(usize::MAX) => {
            Err(format!("expected at most {bound} bytes, found {}", value.len()))
        }
        _ => Ok(Literal::Text(value)),
    }
}

fn unquote(text: &str, quote: char) -> Option<String> {
    let inner = text.strip_prefix(quote)?.strip_suffix(quote)?;
    let escaped = format!("\\{quote}");
    let unescaped = inner.replace(&escaped, "");
    (!unescaped.contains(quote) && !inner.ends_with('\\')).then(|| inner.replace(&escaped, &quote.to_string()))
}

/// Splits at commas outside quotes, and trims.
fn split(elements: &str) -> Vec<&str> {
    if elements.trim().is_empty() {
        return Vec::new();
    }
    let mut parts = Vec::new();
    let (mut start, mut open, mut escaped) = (0, None, false);
    for (at, c) in elements.char_indices() {
        match (open, c) {
            (Some(quote), _) if c == quote && !escaped => open = None,
            (None, '"' | '\'') if elements[start..at].trim().is_empty() => open = Some(c),
            (None, ',') => {
                parts.push(elements[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
        escaped = c == '\\' && !escaped;
    }
    parts.push(elements[start..].trim());
    parts
}
