//! Pieces of Rust source that need no other definition: comments, names, values.

use crate::model::{Arity, Constant, Element, Field, Literal};

/// serde and the standard library know arrays up to this length by themselves.
pub(crate) const LARGEST_PLAIN_ARRAY: u32 = 32;

/// Words that cannot be field names as they are.
const KEYWORDS: &[&str] = &[
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate", "do", "dyn", "else",
    "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop", "macro", "match", "mod",
    "move", "mut", "override", "priv", "pub", "ref", "return", "self", "static", "struct", "super", "trait", "true",
    "try", "type", "typeof", "unsafe", "unsized", "use", "virtual", "where", "while", "yield",
];

/// Documentation: a first line, if any, and a comment's lines as a paragraph of their own.
pub(crate) fn docs(first: &str, comment: &[String]) -> String {
    let gap = (!first.is_empty() && !comment.is_empty()).then_some("");
    let first = (!first.is_empty()).then_some(first);
    first
        .into_iter()
        .chain(gap)
        .chain(comment.iter().map(String::as_str))
        .map(|line| format!("/// {}\n", line.replace(char::is_control, " ")))
        .collect()
}

pub(crate) fn ident(name: &str) -> String {
    match name {
        // These three cannot be raw identifiers; CDR does not see the difference.
        "crate" | "self" | "super" => format!("{name}_"),
        _ if KEYWORDS.contains(&name) => format!("r#{name}"),
        _ => name.to_owned(),
    }
}

pub(crate) fn primitive_type(element: &Element) -> &'static str {
    match element {
        Element::Bool => "bool",
        Element::Byte | Element::Char | Element::UInt8 => "u8",
        Element::Float32 => "f32",
        Element::Float64 => "f64",
        Element::Int8 => "i8",
        Element::Int16 => "i16",
        Element::UInt16 => "u16",
        Element::Int32 => "i32",
        Element::UInt32 => "u32",
        Element::Int64 => "i64",
        Element::UInt64 => "u64",
        Element::String { .. } | Element::WString { .. } | Element::Nested(_) => "&str",
    }
}

pub(crate) fn constant(constant: &Constant) -> String {
    let doc =
        if constant.doc.is_empty() { docs(&format!("`{}`", constant.declared), &[]) } else { docs("", &constant.doc) };
    let value = match &constant.value {
        Literal::Text(text) => format!("{text:?}"),
        value => expression(value, Arity::One),
    };
    format!("{doc}pub const {}: {} = {value};\n", constant.name, primitive_type(&constant.element))
}

/// Whether a field's default is another than that of its Rust type, or its Rust type has none.
pub(crate) fn needs_own_default(field: &Field) -> bool {
    let large = matches!(field.ty.arity, Arity::Array(size) if size > LARGEST_PLAIN_ARRAY);
    large || field.default.as_ref().is_some_and(|value| !is_zero(value, field.ty.arity))
}

fn is_zero(value: &Literal, arity: Arity) -> bool {
    match value {
        Literal::Bool(value) => !value,
        Literal::Integer(value) => *value == 0,
        // Not a comparison: -0.0 must stay what it is.
        Literal::Float32(value) => value.to_bits() == 0,
        Literal::Float64(value) => value.to_bits() == 0,
        Literal::Text(text) => text.is_empty(),
        Literal::List(values) => match arity {
            Arity::Sequence { .. } => values.is_empty(),
            Arity::One | Arity::Array(_) => values.iter().all(|value| is_zero(value, Arity::One)),
        },
    }
}

pub(crate) fn default_of(field: &Field) -> String {
    match (&field.default, field.ty.arity) {
        (Some(value), arity) => expression(value, arity),
        (None, Arity::Array(size)) if size > LARGEST_PLAIN_ARRAY => {
            "::core::array::from_fn(|_| ::core::default::Default::default())".to_owned()
        }
        (None, _) => "::core::default::Default::default()".to_owned(),
    }
}

fn expression(value: &Literal, arity: Arity) -> String {
    match value {
        Literal::Bool(value) => value.to_string(),
        Literal::Integer(value) => value.to_string(),
        Literal::Float32(value) => format!("{value:?}"),
        Literal::Float64(value) => format!("{value:?}"),
        Literal::Text(value) => format!("::std::string::String::from({value:?})"),
        Literal::List(values) => {
            let elements: Vec<_> = values.iter().map(|value| expression(value, Arity::One)).collect();
            let elements = elements.join(", ");
            match arity {
                Arity::Sequence { .. } => format!("::std::vec![{elements}]"),
                Arity::One | Arity::Array(_) => format!("[{elements}]"),
            }
        }
    }
}
