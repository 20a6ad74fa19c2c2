//! Definitions as text: the parts of a schema, and types in the language of definitions.

use crate::model::{Arity, Element, FieldType};

/// Length of the line before a heading, at least, as others write it.
const RULE_MIN: usize = 10;

/// The parts of a concatenated schema: number of the first line, heading (none for the first part), text.
pub(crate) fn sections(schema: &str) -> Vec<(usize, Option<String>, String)> {
    let is_rule = |line: &str| line.len() >= RULE_MIN && line.bytes().all(|byte| byte == b'=');
    let mut sections = vec![(1, None, String::new())];
    let mut lines = schema.lines().enumerate().peekable();
    while let Some((index, line)) = lines.next() {
        let heading = lines.peek().and_then(|(_, next)| next.strip_prefix("MSG:")).map(|name| name.trim().to_owned());
        if is_rule(line.trim_end()) && heading.is_some() {
            lines.next();
            sections.push((index + 3, heading, String::new()));
        } else if let Some((_, _, text)) = sections.last_mut() {
            text.push_str(line);
            text.push('\n');
        }
    }
    sections
}

/// A type in the language of definitions.
pub(crate) fn declared(ty: &FieldType) -> String {
    let element = match &ty.element {
        Element::Bool => "bool".to_owned(),
        Element::Byte => "byte".to_owned(),
        Element::Char => "char".to_owned(),
        Element::Float32 => "float32".to_owned(),
        Element::Float64 => "float64".to_owned(),
        Element::Int8 => "int8".to_owned(),
        Element::UInt8 => "uint8".to_owned(),
        Element::Int16 => "int16".to_owned(),
        Element::UInt16 => "uint16".to_owned(),
        Element::Int32 => "int32".to_owned(),
        Element::UInt32 => "uint32".to_owned(),
        Element::Int64 => "int64".to_owned(),
        Element::UInt64 => "uint64".to_owned(),
        Element::String { bound: None } => "string".to_owned(),
        Element::String { bound: Some(bound) } => format!("string<={bound}"),
        Element::WString { bound: None } => "wstring".to_owned(),
        Element::WString { bound: Some(bound) } => format!("wstring<={bound}"),
        Element::Nested(name) => name.short(),
    };
    match ty.arity {
        Arity::One => element,
        Arity::Array(size) => format!("{element}[{size}]"),
        Arity::Sequence { bound: None } => format!("{element}[]"),
        Arity::Sequence { bound: Some(bound) } => format!("{element}[<={bound}]"),
    }
}
