//! All definitions, together with the types that ROS 2 derives from services and actions.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use crate::{
    error::{Error, Named, Problem},
    model::{Arity, Element, Field, FieldType, MessageBody, PackageFolder, Role, Structure, TypeName},
    parse::{self, LineProblem, Section},
    source::DefinitionFile,
    text,
};

/// Definitions that are complete: every type that a field has is among them.
#[derive(Debug, Clone, PartialEq)]
pub struct Catalogue {
    structures: BTreeMap<TypeName, Structure>,
}

impl Catalogue {
    /// Parses definitions and derives the messages of services and actions.
    ///
    /// # Errors
    /// [`Error::Definition`] for the first definition that breaks a rule, has a field of a type not among `sources`,
    /// or contains itself. Services need `service_msgs/ServiceEventInfo`, actions `unique_identifier_msgs/UUID` and
    /// `builtin_interfaces/Time` too.
    pub fn new(sources: &[DefinitionFile]) -> Result<Self, Error> {
        let mut catalogue = Self { structures: BTreeMap::new() };
        for source in sources {
            catalogue.add(source).map_err(|LineProblem { line, problem }| Error::Definition {
                file: source.file.clone(),
                line,
                problem,
            })?;
        }
        catalogue.check_names()?;
        catalogue.check_references()?;
        Ok(catalogue)
    }

    /// Parses the schema of a message as bags carry it (`ros2msg`): its definition, then those of the types it refers
    /// to, each after a line of at least ten `=` and a line `MSG: package/Name`. Here all of them are messages, also
    /// those that ROS 2 derives from services and actions.
    ///
    /// # Errors
    /// [`Error::Definition`] as for [`Catalogue::new`], with the name of the message in place of a file.
    pub fn of_schema(name: &TypeName, schema: &str) -> Result<Self, Error> {
        let mut catalogue = Self { structures: BTreeMap::new() };
        let file = PathBuf::from(name.to_string());
        for (first_line, heading, text) in text::sections(schema) {
            let fail = |problem| Error::Definition { file: file.clone(), line: first_line.max(2) - 1, problem };
            let name = match heading {
                None => TypeName { namespace: PackageFolder::Msg, ..name.clone() },
                Some(heading) => {
                    let (package, name) = heading
                        .split_once('/')
                        .map(|(package, name)| (package, name.strip_prefix("msg/").unwrap_or(name)))
                        .ok_or_else(|| fail(Problem::Type(heading.to_owned())))?;
                    parse::check_name(Named::Package, package).map_err(fail)?;
                    parse::check_name(Named::Message, parse::without_suffix(name)).map_err(fail)?;
                    TypeName::message(package, name)
                }
            };
            // Some writers repeat a type.
            if catalogue.structures.contains_key(&name) {
                continue;
            }
            let source = DefinitionFile {
                package: name.package.clone(),
                namespace: PackageFolder::Msg,
                name: name.name.clone(),
                file: file.clone(),
                text: String::new(),
            };
            catalogue
                .add_message(&source, name, Section { first_line, text })
                .map_err(|LineProblem { line, problem }| Error::Definition { file: file.clone(), line, problem })?;
        }
        catalogue.check_references()?;
        Ok(catalogue)
    }

    /// Everything with a type hash, by name.
    pub fn structures(&self) -> impl Iterator<Item = &Structure> {
        self.structures.values()
    }

    /// The structure of this name.
    #[must_use]
    pub fn get(&self, name: &TypeName) -> Option<&Structure> {
        self.structures.get(name)
    }

    /// All types that a type's fields refer to, directly or not.
    pub(crate) fn references(&self, name: &TypeName) -> BTreeSet<&TypeName> {
        let mut found = BTreeSet::new();
        let mut open = vec![name];
        while let Some(name) = open.pop() {
            for (_, nested) in self.structures.get(name).into_iter().flat_map(nested) {
                if found.insert(nested) {
                    open.push(nested);
                }
            }
        }
        found
    }

    fn add(&mut self, source: &DefinitionFile) -> Result<(), LineProblem> {
        let name = TypeName { package: source.package.clone(), namespace: source.namespace, name: source.name.clone() };
        parse::check_name(Named::Package, &name.package)
            .and_then(|()| parse::check_name(Named::Message, &name.name))
            .map_err(|problem| LineProblem { line: 1, problem })?;
        match source.namespace {
            PackageFolder::Msg => {
                let [message] = parse::sections(&source.text)?;
                self.add_message(source, name, message)
            }
            PackageFolder::Srv => {
                let [request, response] = parse::sections(&source.text)?;
                self.add_message(source, name.with_suffix("_Request"), request)?;
                self.add_message(source, name.with_suffix("_Response"), response)?;
                self.add_service(source, &name)
            }
            PackageFolder::Action => {
                let [goal, result, feedback] = parse::sections(&source.text)?;
                self.add_message(source, name.with_suffix("_Goal"), goal)?;
                self.add_message(source, name.with_suffix("_Result"), result)?;
                self.add_message(source, name.with_suffix("_Feedback"), feedback)?;
                self.add_action(source, &name)
            }
        }
    }

    fn add_message(&mut self, source: &DefinitionFile, name: TypeName, section: Section) -> Result<(), LineProblem> {
        let mut body = parse::parse(&section, &source.package)?;
        if body.fields.is_empty() {
            let doc = "Carries nothing: CDR has no empty structures.";
            let mut field = field("structure_needs_at_least_one_member", Element::UInt8, Arity::One);
            field.doc.push(doc.to_owned());
            body.fields.push(field);
        }
        self.insert(source, Role::Message, name, body, section.text)
    }

    /// Adds the event and the service itself; request and response are there already.
    fn add_service(&mut self, source: &DefinitionFile, name: &TypeName) -> Result<(), LineProblem> {
        let part = |suffix| Element::Nested(name.with_suffix(suffix));
        let at_most_one = Arity::Sequence { bound: Some(1) };
        let event_info = Element::Nested(TypeName::message("service_msgs", "ServiceEventInfo"));
        let event = vec![
            field("info", event_info, Arity::One),
            field("request", part("_Request"), at_most_one),
            field("response", part("_Response"), at_most_one),
        ];
        let service = vec![
            field("request_message", part("_Request"), Arity::One),
            field("response_message", part("_Response"), Arity::One),
            field("event_message", part("_Event"), Arity::One),
        ];
        let text = ["_Request", "_Response"].map(|suffix| self.text_of(&name.with_suffix(suffix))).join("---\n");
        self.insert_derived(source, Role::Event, name.with_suffix("_Event"), event)?;
        self.insert(source, Role::Service, name.clone(), body_of(service), text)
    }

    /// Adds what ROS 2 wraps around goal, result and feedback, and the action itself.
    fn add_action(&mut self, source: &DefinitionFile, name: &TypeName) -> Result<(), LineProblem> {
        let part = |suffix| Element::Nested(name.with_suffix(suffix));
        let goal_id = || {
            let uuid = TypeName::message("unique_identifier_msgs", "UUID");
            field("goal_id", Element::Nested(uuid), Arity::One)
        };
        let time = Element::Nested(TypeName::message("builtin_interfaces", "Time"));
        let wrappers = [
            ("_SendGoal_Request", vec![goal_id(), field("goal", part("_Goal"), Arity::One)]),
            (
                "_SendGoal_Response",
                vec![field("accepted", Element::Bool, Arity::One), field("stamp", time, Arity::One)],
            ),
            ("_GetResult_Request", vec![goal_id()]),
            (
                "_GetResult_Response",
                vec![field("status", Element::Int8, Arity::One), field("result", part("_Result"), Arity::One)],
            ),
            ("_FeedbackMessage", vec![goal_id(), field("feedback", part("_Feedback"), Arity::One)]),
        ];
        for (suffix, fields) in wrappers {
            self.insert_derived(source, Role::Wrapper, name.with_suffix(suffix), fields)?;
        }
        self.add_service(source, &name.with_suffix("_SendGoal"))?;
        self.add_service(source, &name.with_suffix("_GetResult"))?;
        let action = vec![
            field("goal", part("_Goal"), Arity::One),
            field("result", part("_Result"), Arity::One),
            field("feedback", part("_Feedback"), Arity::One),
            field("send_goal_service", part("_SendGoal"), Arity::One),
            field("get_result_service", part("_GetResult"), Arity::One),
            field("feedback_message", part("_FeedbackMessage"), Arity::One),
        ];
        let text =
            ["_Goal", "_Result", "_Feedback"].map(|suffix| self.text_of(&name.with_suffix(suffix))).join("---\n");
        self.insert(source, Role::Action, name.clone(), body_of(action), text)
    }

    fn text_of(&self, name: &TypeName) -> String {
        self.structures.get(name).map(|structure| structure.text.clone()).unwrap_or_default()
    }

    fn insert_derived(
        &mut self,
        source: &DefinitionFile,
        role: Role,
        name: TypeName,
        fields: Vec<Field>,
    ) -> Result<(), LineProblem> {
        let text = fields.iter().map(|field| format!("{} {}\n", field.declared, field.name)).collect();
        self.insert(source, role, name, body_of(fields), text)
    }

    fn insert(
        &mut self,
        source: &DefinitionFile,
        role: Role,
        name: TypeName,
        body: MessageBody,
        text: String,
    ) -> Result<(), LineProblem> {
        let structure = Structure { name: name.clone(), role, body, text, file: source.file.clone() };
        match self.structures.insert(name, structure) {
            None => Ok(()),
            Some(earlier) => Err(LineProblem { line: 1, problem: Problem::Duplicate(earlier.name.to_string()) }),
        }
    }

    fn check_names(&self) -> Result<(), Error> {
        let mut taken = BTreeSet::new();
        for structure in self.structures() {
            let name = &structure.name;
            if !taken.insert((&name.package, name.namespace, name.rust_name())) {
                return Err(Error::Definition {
                    file: structure.file.clone(),
                    line: 1,
                    problem: Problem::SameRustName(name.clone(), name.rust_name()),
                });
            }
        }
        Ok(())
    }

    fn check_references(&self) -> Result<(), Error> {
        for structure in self.structures() {
            for (line, nested) in nested(structure) {
                let problem = if !self.structures.contains_key(nested) {
                    Problem::Unknown(nested.clone())
                } else if nested == &structure.name || self.references(nested).contains(&structure.name) {
                    Problem::Recursive(structure.name.clone())
                } else {
                    continue;
                };
                let file = structure.file.clone();
                return Err(Error::Definition { file, line, problem });
            }
        }
        Ok(())
    }
}

/// The messages among a structure's fields, with the lines of the fields.
fn nested(structure: &Structure) -> impl Iterator<Item = (usize, &TypeName)> {
    structure.body.fields.iter().filter_map(|field| match &field.ty.element {
        Element::Nested(name) => Some((field.line, name)),
        _ => None,
    })
}

fn body_of(fields: Vec<Field>) -> MessageBody {
    MessageBody { fields, ..MessageBody::default() }
}

/// A field that no file states.
fn field(name: &str, element: Element, arity: Arity) -> Field {
    let ty = FieldType { element, arity };
    Field { declared: text::declared(&ty), ty, name: name.to_owned(), default: None, doc: Vec::new(), line: 1 }
}
