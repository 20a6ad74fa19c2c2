//! Type hashes after REP-2011: SHA-256 over the JSON form of a type's description and of all it refers to.

use sha2::{Digest, Sha256};

use crate::{
    catalogue::Catalogue,
    model::{Arity, Element, FieldType, Structure},
};

impl Catalogue {
    /// Hash of a type as ROS 2 gives it in discovery and bags: `RIHS01_` and 64 hexadecimal digits.
    #[must_use]
    pub fn type_hash(&self, structure: &Structure) -> String {
        let referenced: Vec<_> = self
            .references(&structure.name)
            .into_iter()
            .filter_map(|reference| self.get(reference))
            .map(description)
            .collect();
        let json = format!(
            r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
            description(structure),
            referenced.join(", ")
        );
        let digest: String = Sha256::digest(json).iter().map(|byte| format!("{byte:02x}")).collect();
        format!("RIHS01_{digest}")
    }
}

/// Names consist of ASCII letters, digits, underscores and slashes, so that JSON needs no escapes.
fn description(structure: &Structure) -> String {
    let fields: Vec<_> = structure
        .body
        .fields
        .iter()
        .map(|field| format!(r#"{{"name": "{}", "type": {}}}"#, field.name, field_type(&field.ty)))
        .collect();
    format!(r#"{{"type_name": "{}", "fields": [{}]}}"#, structure.name, fields.join(", "))
}

fn field_type(ty: &FieldType) -> String {
    let DescribedType { id, capacity, string_capacity, nested } = describe(ty);
    format!(
        r#"{{"type_id": {id}, "capacity": {capacity}, "string_capacity": {string_capacity}, "nested_type_name": "{nested}"}}"#
    )
}

/// A field's type in the terms of `type_description_interfaces/msg/FieldType`.
pub(crate) struct DescribedType {
    pub(crate) id: u32,
    pub(crate) capacity: u32,
    pub(crate) string_capacity: u32,
    pub(crate) nested: String,
}

pub(crate) fn describe(ty: &FieldType) -> DescribedType {
    let (offset, capacity) = match ty.arity {
        Arity::One => (0, 0),
        Arity::Array(size) => (48, size),
        Arity::Sequence { bound: Some(bound) } => (96, bound),
        Arity::Sequence { bound: None } => (144, 0),
    };
    let string_capacity = match ty.element {
        Element::String { bound } | Element::WString { bound } => bound.unwrap_or(0),
        _ => 0,
    };
    let nested = match &ty.element {
        Element::Nested(name) => name.to_string(),
        _ => String::new(),
    };
    DescribedType { id: offset + element_id(&ty.element), capacity, string_capacity, nested }
}

/// The constants of `type_description_interfaces/msg/FieldType`.
fn element_id(element: &Element) -> u32 {
    match element {
        Element::Nested(_) => 1,
        Element::Int8 => 2,
        Element::UInt8 | Element::Char => 3,
        Element::Int16 => 4,
        Element::UInt16 => 5,
        Element::Int32 => 6,
        Element::UInt32 => 7,
        Element::Int64 => 8,
        Element::UInt64 => 9,
        Element::Float32 => 10,
        Element::Float64 => 11,
        Element::Bool => 15,
        Element::Byte => 16,
        Element::String { bound: None } => 17,
        Element::WString { bound: None } => 18,
        Element::String { bound: Some(_) } => 21,
        Element::WString { bound: Some(_) } => 22,
    }
}
