//! What is wrong with a definition, and where.

use std::{fmt, io, path::PathBuf};

use crate::model::TypeName;

/// Why definitions cannot be turned into types.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder of definitions cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file lies among definitions and is none.
    #[error("{}: only .{extension} files belong here", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What a definition's file name ends with in this folder.
        extension: &'static str,
    },
    /// A definition breaks a rule of the language.
    #[error("{}:{line}: {problem}", file.display())]
    Definition {
        /// The definition's file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The rule that is broken.
        problem: Problem,
    },
}

/// What a name stands for, which decides on its form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Named {
    /// A package.
    Package,
    /// A message, service or action.
    Message,
    /// A field.
    Field,
    /// A constant.
    Constant,
}

impl fmt::Display for Named {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Package => "package",
            Self::Message => "message",
            Self::Field => "field",
            Self::Constant => "constant",
        })
    }
}

/// What is wrong with a line of a definition.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// A line that is neither field nor constant.
    #[error("expected a type and a name, found `{0}`")]
    NoName(String),
    /// A name that does not follow the naming rules.
    #[error("`{name}` cannot name a {kind}: {rule}")]
    Name {
        /// What is named.
        kind: Named,
        /// The name found.
        name: String,
        /// What names of this kind look like.
        rule: &'static str,
    },
    /// Text that is not a type.
    #[error("`{0}` is no type: expected a primitive type, `Type` or `package/Type`")]
    Type(String),
    /// A size or bound that is not a positive number.
    #[error("size or bound `{0}` must be a whole number from 1 to 4294967295")]
    Size(String),
    /// A constant or default value that its type cannot hold.
    #[error("`{value}` is no value for {ty}: {rule}")]
    Value {
        /// The value found.
        value: String,
        /// The type as it is written.
        ty: String,
        /// What is allowed.
        rule: String,
    },
    /// A constant of a type that is not primitive.
    #[error("a constant cannot have the type `{0}`: only primitive types are allowed")]
    ConstantType(String),
    /// A default for a field that is a message.
    #[error("a field of type `{0}` cannot have a default value: only primitive types and arrays of them can")]
    DefaultType(String),
    /// A service or action with too few or too many sections.
    #[error("found {found} lines `---`, expected {expected}")]
    Sections {
        /// How many were found.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// Two fields, two constants or two types of one name.
    #[error("`{0}` is defined twice")]
    Duplicate(String),
    /// Two types whose names become one in Rust.
    #[error("{0} and another type would both be called `{1}` in Rust")]
    SameRustName(TypeName, String),
    /// A field of a type that is not among the definitions.
    #[error("type {0} is not defined")]
    Unknown(TypeName),
    /// A type that contains itself.
    #[error("{0} contains itself")]
    Recursive(TypeName),
    /// A wide string, for which there are a hash and a schema, but no Rust type.
    #[error("`wstring` has no wire form that all middlewares share: use `string`, which carries UTF-8")]
    WideString,
}
