//! The language of definitions: one field or constant a line, comments after `#`.
//!
//! It follows ROS 2's own parser, down to a `#` starting a comment even inside quotes.

use std::mem;

use crate::{
    error::{Named, Problem},
    model::{Arity, Constant, Element, Field, FieldType, MessageBody, TypeName},
    value,
};

/// A problem and the line it is in, from 1.
#[derive(Debug, PartialEq)]
pub(crate) struct LineProblem {
    pub(crate) line: usize,
    pub(crate) problem: Problem,
}

/// A part of a file, between separators.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Section {
    /// Number of the section's first line in the file, from 1.
    pub(crate) first_line: usize,
    /// Text, ending with a line feed unless empty.
    pub(crate) text: String,
}

/// Cuts a file at its `---` lines into as many sections as its kind of interface has.
pub(crate) fn sections<const N: usize>(text: &str) -> Result<[Section; N], LineProblem> {
    let mut sections = vec![Section { first_line: 1, text: String::new() }];
    for (index, line) in text.lines().enumerate() {
        if line == "---" && N > 1 {
            sections.push(Section { first_line: index + 2, text: String::new() });
        } else if let Some(section) = sections.last_mut() {
            section.text.push_str(line);
            section.text.push('\n');
        }
    }
    let found = sections.len() - 1;
    sections.try_into().map_err(|_| LineProblem { line: 1, problem: Problem::Sections { found, expected: N - 1 } })
}

/// Parses the fields and constants of a section; `package` is where types without a package are looked for.
pub(crate) fn parse(section: &Section, package: &str) -> Result<MessageBody, LineProblem> {
    let mut body = MessageBody::default();
    let mut items: Vec<Item> = Vec::new();
    let mut comments = Vec::new();
    let mut in_header = true;
    for (line, text) in (section.first_line..).zip(section.text.lines()) {
        let (code, comment) = match text.split_once('#') {
            Some((code, comment)) => (code, Some(clean(comment))),
            None => (text, None),
        };
        let is_blank = code.trim().is_empty();
        in_header &= text.starts_with('#');
        if let Some(comment) = comment {
            // An indented comment goes on with what is above it.
            let is_indented = is_blank && !code.is_empty();
            let doc = match items.last_mut() {
                _ if in_header => &mut body.doc,
                Some(above) if is_indented => above.doc_mut(),
                _ => &mut comments,
            };
            doc.push(comment);
        }
        if is_blank {
            continue;
        }
        let code = code.replace('\t', " ");
        let problem = match parse_line(code.trim_end(), package, line, mem::take(&mut comments)) {
            Ok(item) if items.iter().all(|earlier| earlier.name() != item.name()) => {
                items.push(item);
                continue;
            }
            Ok(item) => Problem::Duplicate(item.name().to_owned()),
            Err(problem) => problem,
        };
        return Err(LineProblem { line, problem });
    }
    trim_blank(&mut body.doc);
    for mut item in items {
        trim_blank(item.doc_mut());
        match item {
            Item::Field(field) => body.fields.push(field),
            Item::Constant(constant) => body.constants.push(constant),
        }
    }
    Ok(body)
}

enum Item {
    Field(Field),
    Constant(Constant),
}

impl Item {
    fn name(&self) -> &str {
        match self {
            Self::Field(field) => &field.name,
            Self::Constant(constant) => &constant.name,
        }
    }

    fn doc_mut(&mut self) -> &mut Vec<String> {
        match self {
            Self::Field(field) => &mut field.doc,
            Self::Constant(constant) => &mut constant.doc,
        }
    }
}

fn parse_line(code: &str, package: &str, line: usize, doc: Vec<String>) -> Result<Item, Problem> {
    let (declared, rest) = code
        .split_once(' ')
        .filter(|(declared, rest)| !declared.is_empty() && !rest.trim().is_empty())
        .ok_or_else(|| Problem::NoName(code.to_owned()))?;
    let rest = rest.trim_start();
    if let Some((name, text)) = rest.split_once('=') {
        let (name, text) = (name.trim_end(), text.trim_start());
        check_name(Named::Constant, name)?;
        let ty = parse_type(declared, package)?;
        if ty.arity != Arity::One || matches!(ty.element, Element::Nested(_)) {
            return Err(Problem::ConstantType(declared.to_owned()));
        }
        let value = value::parse_element(&ty.element, text).map_err(|rule| Problem::Value {
            value: text.to_owned(),
            ty: declared.to_owned(),
            rule,
        })?;
        return Ok(Item::Constant(Constant {
            element: ty.element,
            name: name.to_owned(),
            value,
            declared: format!("{declared} {name}={text}"),
            doc,
        }));
    }
    let (name, default) = rest.split_once(' ').unwrap_or((rest, ""));
    check_name(Named::Field, name)?;
    let ty = parse_type(declared, package)?;
    let default = match default.trim() {
        "" => None,
        text => Some(value::parse_default(&ty, declared, text)?),
    };
    Ok(Item::Field(Field { ty, name: name.to_owned(), default, declared: declared.to_owned(), doc, line }))
}

fn parse_type(declared: &str, package: &str) -> Result<FieldType, Problem> {
    let (element, arity) = match declared.strip_suffix(']').map(|rest| rest.rsplit_once('[')) {
        None => (declared, Arity::One),
        Some(None) => return Err(Problem::Type(declared.to_owned())),
        Some(Some((element, ""))) => (element, Arity::Sequence { bound: None }),
        Some(Some((element, size))) => match size.strip_prefix("<=") {
            Some(bound) => (element, Arity::Sequence { bound: Some(parse_size(bound)?) }),
            None => (element, Arity::Array(parse_size(size)?)),
        },
    };
    Ok(FieldType { element: parse_element(element, package)?, arity })
}

fn parse_element(text: &str, package: &str) -> Result<Element, Problem> {
    Ok(match text {
        "bool" => Element::Bool,
        "byte" => Element::Byte,
        "char" => Element::Char,
        "float32" => Element::Float32,
        "float64" => Element::Float64,
        "int8" => Element::Int8,
        "uint8" => Element::UInt8,
        "int16" => Element::Int16,
        "uint16" => Element::UInt16,
        "int32" => Element::Int32,
        "uint32" => Element::UInt32,
        "int64" => Element::Int64,
        "uint64" => Element::UInt64,
        "string" => Element::String { bound: None },
        "wstring" => Element::WString { bound: None },
        _ => {
            if let Some(bound) = text.strip_prefix("string<=") {
                let bound = Some(parse_size(bound)?);
                return Ok(Element::String { bound });
            }
            if let Some(bound) = text.strip_prefix("wstring<=") {
                let bound = Some(parse_size(bound)?);
                return Ok(Element::WString { bound });
            }
            let (package, name) = text.split_once('/').unwrap_or((package, text));
            check_name(Named::Package, package).map_err(|_| Problem::Type(text.to_owned()))?;
            check_name(Named::Message, without_suffix(name)).map_err(|_| Problem::Type(text.to_owned()))?;
            Element::Nested(TypeName::message(package, name))
        }
    })
}

/// The name of the service or action that a derived message belongs to; other names as they are.
pub(crate) fn without_suffix(name: &str) -> &str {
    const DERIVED: [&str; 11] = [
        "_Request",
        "_Response",
        "_Event",
        "_Goal",
        "_Result",
        "_Feedback",
        "_FeedbackMessage",
        "_SendGoal_Request",
        "_SendGoal_Response",
        "_GetResult_Request",
        "_GetResult_Response",
    ];
    name.split_once('_').filter(|(base, _)| DERIVED.contains(&&name[base.len()..])).map_or(name, |(base, _)| base)
}

fn parse_size(text: &str) -> Result<u32, Problem> {
    match text.parse() {
        Ok(size) if size > 0 && !text.starts_with('+') => Ok(size),
        _ => Err(Problem::Size(text.to_owned())),
    }
}

/// Checks a name against ROS 2's rules.
pub(crate) fn check_name(kind: Named, name: &str) -> Result<(), Problem> {
    let parts = |allowed: fn(char) -> bool| name.split('_').all(|part| !part.is_empty() && part.chars().all(allowed));
    let starts = |allowed: fn(char) -> bool| name.starts_with(allowed);
    let lower = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
    let upper = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit();
    let (valid, rule) = match kind {
        Named::Message => (
            starts(|c| c.is_ascii_uppercase()) && name.chars().all(|c| c.is_ascii_alphanumeric()),
            "letters and digits, a capital first",
        ),
        Named::Constant => (
            starts(|c| c.is_ascii_uppercase()) && parts(upper),
            "capitals, digits and single underscores between them, a capital first",
        ),
        Named::Package | Named::Field => (
            starts(|c| c.is_ascii_lowercase()) && parts(lower),
            "small letters, digits and single underscores between them, a letter first",
        ),
    };
    if valid {
        return Ok(());
    }
    Err(Problem::Name { kind, name: name.to_owned(), rule })
}

/// A comment's text without what marks it as one.
fn clean(comment: &str) -> String {
    let text = comment.trim_start_matches('#');
    text.strip_prefix(' ').unwrap_or(text).trim_end().to_owned()
}

fn trim_blank(doc: &mut Vec<String>) {
    while doc.last().is_some_and(String::is_empty) {
        doc.pop();
    }
    let blank = doc.iter().take_while(|line| line.is_empty()).count();
    doc.drain(..blank);
}
