//! Definitions as text.

use crate::{
    catalogue::Catalogue,
    model::{Arity, Element, FieldType, Role, Structure},
};

/// Length of the line before a heading, at least, as others write it.
const RULE_MIN: usize = 10;

/// The definition of a type, then of each type it refers to, by name, each under a heading.
pub(crate) fn concatenated(catalogue: &Catalogue, structure: &Structure) -> String {
    let name = &structure.name;
    // The text of a service or action states the fields of its parts itself.
    let parts: Vec<_> = match structure.role {
        Role::Service => ["_Request", "_Response"].map(|suffix| name.with_suffix(suffix)).into(),
        Role::Action => ["_Goal", "_Result", "_Feedback"].map(|suffix| name.with_suffix(suffix)).into(),
        Role::Message | Role::Wrapper | Role::Event => vec![name.clone()],
    };
    let mut references: Vec<_> = parts.iter().flat_map(|part| catalogue.references(part)).collect();
    references.sort();
    references.dedup();
    let rule = "=".repeat(80);
    let mut text = structure.text.clone();
    for reference in references.into_iter().filter_map(|reference| catalogue.get(reference)) {
        let heading = format!("{rule}\nMSG: {}\n", reference.name.short());
        text.push_str(&heading);
        text.push_str(&reference.text);
    }
    text
}

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
