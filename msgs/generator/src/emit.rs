//! Rust source of the definitions.
//!
//! The source is meant for `include!` at the root of a crate that has the traits `Message`, `Service`, `Action` and
//! `MessageVisitor`, the structs `TypeInfo` and `FieldInfo`, and the dependencies `serde`, `serde_bytes` and `serde-big-array`. Paths into
//! `std` are written out because types such as `std_msgs/String` hide the names of the prelude.

use crate::{
    catalogue::Catalogue,
    error::{Error, Problem},
    hash::{DescribedType, describe},
    model::{Arity, Element, Field, FieldType, Role, Structure, TypeName},
    rust::{LARGEST_PLAIN_ARRAY, constant, default_of, docs, ident, needs_own_default, primitive_type},
};

/// Emits the Rust source of all definitions; those of the package `own` lie at the root, others in their packages' modules.
///
/// # Errors
/// [`Error::Definition`] for a field that has no Rust type: a wide string.
pub fn emit(catalogue: &Catalogue, own: &str) -> Result<String, Error> {
    let emitter = Emitter { catalogue, own };
    let structures: Vec<_> = catalogue.structures().filter(|structure| structure.role != Role::Event).collect();
    let mut source = String::new();
    for package in structures.chunk_by(|a, b| a.name.package == b.name.package) {
        let name = &package[0].name.package;
        let modules = emitter.package(package)?;
        source += &if name == own {
            modules
        } else {
            let module = ident(name);
            format!("/// Definitions of `{name}`.\npub mod {module} {{\n{modules}}}\n")
        };
    }
    source += &emitter.registry(&structures);
    source += &emitter.descriptions();
    Ok(source)
}

struct Emitter<'a> {
    catalogue: &'a Catalogue,
    own: &'a str,
}

impl Emitter<'_> {
    fn package(&self, structures: &[&Structure]) -> Result<String, Error> {
        let mut source = String::new();
        for module in structures.chunk_by(|a, b| a.name.namespace == b.name.namespace) {
            let name = &module[0].name;
            let (folder, package) = (name.namespace.as_str(), &name.package);
            source += &format!("/// Definitions in the folder `{folder}` of `{package}`.\npub mod {folder} {{\n");
            for structure in module {
                source += &match structure.role {
                    Role::Service => self.service(structure),
                    Role::Action => self.action(structure),
                    Role::Message | Role::Wrapper | Role::Event => self.message(structure)?,
                };
            }
            source += "}\n";
        }
        Ok(source)
    }

    fn message(&self, structure: &Structure) -> Result<String, Error> {
        let name = structure.name.rust_name();
        let body = &structure.body;
        let mut fields = String::new();
        for field in &body.fields {
            fields += &self.field(field).map_err(|problem| Error::Definition {
                file: structure.file.clone(),
                line: field.line,
                problem,
            })?;
        }
        let own_default = body.fields.iter().any(needs_own_default);
        let default = if own_default { "" } else { "Default, " };
        let copy = if self.is_copy(structure) { "Copy, " } else { "" };
        let mut source = format!(
            "{}#[derive(Clone, {copy}Debug, {default}PartialEq, ::serde::Serialize, ::serde::Deserialize)]\n\
             pub struct {name} {{\n{fields}}}\n",
            docs(&summary(structure), &body.doc)
        );
        if own_default {
            let values: String =
                body.fields.iter().map(|field| format!("{}: {},\n", ident(&field.name), default_of(field))).collect();
            source += &format!(
                "impl ::core::default::Default for {name} {{\nfn default() -> Self {{\nSelf {{\n{values}}}\n}}\n}}\n"
            );
        }
        if !body.constants.is_empty() {
            let constants: String = body.constants.iter().map(constant).collect();
            source += &format!("impl {name} {{\n{constants}}}\n");
        }
        if structure.role == Role::Wrapper {
            source += &self.parts(structure);
        }
        source += &format!("impl crate::Message for {name} {{\n{}}}\n", self.info(structure));
        Ok(source)
    }

    /// Whether all of a message lies in place, without strings and sequences.
    fn is_copy(&self, structure: &Structure) -> bool {
        structure.body.fields.iter().all(|field| {
            let in_place = match &field.ty.element {
                Element::String { .. } | Element::WString { .. } => false,
                Element::Nested(name) => self.catalogue.get(name).is_some_and(|nested| self.is_copy(nested)),
                _ => true,
            };
            in_place && !matches!(field.ty.arity, Arity::Sequence { .. })
        })
    }

    fn field(&self, field: &Field) -> Result<String, Problem> {
        let attribute = match (&field.ty.element, field.ty.arity) {
            (Element::Byte | Element::Char | Element::UInt8, Arity::Sequence { .. }) => {
                "#[serde(with = \"serde_bytes\")]\n"
            }
            (_, Arity::Array(size)) if size > LARGEST_PLAIN_ARRAY => "#[serde(with = \"serde_big_array::BigArray\")]\n",
            _ => "",
        };
        let doc = if field.doc.is_empty() {
            docs(&format!("`{} {}`", field.declared, field.name), &[])
        } else {
            docs("", &field.doc)
        };
        Ok(format!("{doc}{attribute}pub {}: {},\n", ident(&field.name), self.field_type(&field.ty)?))
    }

    fn field_type(&self, ty: &FieldType) -> Result<String, Problem> {
        let element = match &ty.element {
            Element::String { .. } => "::std::string::String".to_owned(),
            Element::WString { .. } => return Err(Problem::WideString),
            Element::Nested(name) => self.path(name),
            primitive => primitive_type(primitive).to_owned(),
        };
        Ok(match ty.arity {
            Arity::One => element,
            Arity::Array(size) => format!("[{element}; {size}]"),
            Arity::Sequence { .. } => format!("::std::vec::Vec<{element}>"),
        })
    }

    /// Conversions between a wrapper and its fields, for code that is generic over actions.
    fn parts(&self, structure: &Structure) -> String {
        let name = structure.name.rust_name();
        let fields = &structure.body.fields;
        let names: Vec<_> = fields.iter().map(|field| ident(&field.name)).collect();
        let types: Vec<_> = fields.iter().filter_map(|field| self.field_type(&field.ty).ok()).collect();
        let tuple = |items: &[String]| match items {
            [one] => one.clone(),
            many => format!("({})", many.join(", ")),
        };
        let (pattern, parts) = (tuple(&names), tuple(&types));
        let braces = names.join(", ");
        let values: Vec<_> = names.iter().map(|name| format!("value.{name}")).collect();
        let values = tuple(&values);
        format!(
            "impl ::core::convert::From<{parts}> for {name} {{\nfn from({pattern}: {parts}) -> Self {{\nSelf {{ {braces} }}\n}}\n}}\n\
             impl ::core::convert::From<{name}> for {parts} {{\nfn from(value: {name}) -> Self {{\n{values}\n}}\n}}\n"
        )
    }

    fn service(&self, structure: &Structure) -> String {
        let name = structure.name.rust_name();
        let request = structure.name.with_suffix("_Request");
        let doc = self.catalogue.get(&request).map_or(&[][..], |request| &request.body.doc);
        format!(
            "{}#[derive(Clone, Copy, Debug)]\npub enum {name} {{}}\nimpl crate::Service for {name} {{\n\
             type Request = {};\ntype Response = {};\n{}}}\n",
            docs(&format!("`{}`", structure.name), doc),
            self.path(&request),
            self.path(&structure.name.with_suffix("_Response")),
            self.info(structure)
        )
    }

    fn action(&self, structure: &Structure) -> String {
        let name = structure.name.rust_name();
        let goal = structure.name.with_suffix("_Goal");
        let doc = self.catalogue.get(&goal).map_or(&[][..], |goal| &goal.body.doc);
        let parts: String = [
            ("Goal", "_Goal"),
            ("Result", "_Result"),
            ("Feedback", "_Feedback"),
            ("SendGoalRequest", "_SendGoal_Request"),
            ("SendGoalResponse", "_SendGoal_Response"),
            ("SendGoal", "_SendGoal"),
            ("GetResultRequest", "_GetResult_Request"),
            ("GetResultResponse", "_GetResult_Response"),
            ("GetResult", "_GetResult"),
            ("FeedbackMessage", "_FeedbackMessage"),
        ]
        .iter()
        .map(|(part, suffix)| format!("type {part} = {};\n", self.path(&structure.name.with_suffix(suffix))))
        .collect();
        format!(
            "{}#[derive(Clone, Copy, Debug)]\npub enum {name} {{}}\nimpl crate::Action for {name} {{\n{parts}{}}}\n",
            docs(&format!("`{}`", structure.name), doc),
            self.info(structure)
        )
    }

    fn info(&self, structure: &Structure) -> String {
        let name = &structure.name;
        format!(
            "const INFO: crate::TypeInfo = crate::TypeInfo {{\npackage: {:?},\nnamespace: {:?},\nname: {:?},\n\
             definition: {:?},\ntype_hash: {:?},\nreferences: &{:?},\n}};\n",
            name.package,
            name.namespace.as_str(),
            name.name,
            self.catalogue.schema(structure),
            self.catalogue.type_hash(structure),
            self.catalogue.references(name).into_iter().map(TypeName::to_string).collect::<Vec<_>>()
        )
    }

    /// The fields of every type, for those who ask at run time what a type consists of.
    fn descriptions(&self) -> String {
        let described = |field: &Field| {
            let DescribedType { id, capacity, string_capacity, nested } = describe(&field.ty);
            format!(
                "crate::FieldInfo {{ name: {:?}, type_id: {id}, capacity: {capacity}, string_capacity: \
                 {string_capacity}, nested_type_name: {nested:?} }}",
                field.name
            )
        };
        let structures = self.catalogue.structures().map(|structure| {
            let fields: Vec<_> = structure.body.fields.iter().map(described).collect();
            format!("({:?}, &[{}]),\n", structure.name.to_string(), fields.join(", "))
        });
        let structures: String = structures.collect();
        format!("static FIELDS: &[(&str, &[crate::FieldInfo])] = &[\n{structures}];\n")
    }

    /// What finds a type by its name at run time.
    fn registry(&self, structures: &[&Structure]) -> String {
        let mut infos = String::new();
        let mut visits = String::new();
        for structure in structures {
            let path = self.path(&structure.name);
            let kind = match structure.role {
                Role::Service => "Service",
                Role::Action => "Action",
                Role::Message | Role::Wrapper | Role::Event => "Message",
            };
            infos += &format!("<{path} as crate::{kind}>::INFO,\n");
            if kind == "Message" {
                visits += &format!("visitor.visit::<{path}>();\n");
            }
        }
        format!(
            "/// All messages, services and actions, by name.\n\
             pub static TYPES: &[crate::TypeInfo] = &[\n{infos}];\n\
             /// Shows every message type to a visitor, by name.\n\
             pub fn visit_messages(visitor: &mut impl crate::MessageVisitor) {{\n{visits}}}\n"
        )
    }

    fn path(&self, name: &TypeName) -> String {
        let (folder, rust_name) = (name.namespace.as_str(), name.rust_name());
        if name.package == self.own {
            format!("crate::{folder}::{rust_name}")
        } else {
            format!("crate::{}::{folder}::{rust_name}", ident(&name.package))
        }
    }
}

/// First line of a message's documentation.
fn summary(structure: &Structure) -> String {
    match structure.name.name.rsplit_once('_') {
        Some((owner, part)) => format!("{part} of [`{}`].", owner.replace('_', "")),
        None => format!("`{}`", structure.name),
    }
}
