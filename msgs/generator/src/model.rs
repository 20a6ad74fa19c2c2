//! Definitions after parsing.

use std::{fmt, path::PathBuf};

/// The folder of a package that a definition lies in. The order is the alphabetical one of the folders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PackageFolder {
    /// `action`
    Action,
    /// `msg`
    Msg,
    /// `srv`
    Srv,
}

impl PackageFolder {
    /// All namespaces.
    pub const ALL: [Self; 3] = [Self::Action, Self::Msg, Self::Srv];

    /// Name of the folder, and what the names of the files in it end with.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Action => "action",
            Self::Msg => "msg",
            Self::Srv => "srv",
        }
    }
}

/// Full name of a type; orders as its text does.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct TypeName {
    /// Package, such as `sensor_msgs`.
    pub package: String,
    /// Folder within the package.
    pub namespace: PackageFolder,
    /// Name, such as `Image` or `SetBool_Request`.
    pub name: String,
}

impl TypeName {
    /// The type `package/msg/name`.
    #[must_use]
    pub fn message(package: &str, name: &str) -> Self {
        Self { package: package.to_owned(), namespace: PackageFolder::Msg, name: name.to_owned() }
    }

    /// The type whose name is this one's with `suffix` behind it.
    #[must_use]
    pub fn with_suffix(&self, suffix: &str) -> Self {
        Self { name: format!("{}{suffix}", self.name), ..self.clone() }
    }

    /// The form `package/Name` that definitions use.
    #[must_use]
    pub fn short(&self) -> String {
        format!("{}/{}", self.package, self.name)
    }

    /// Name of the Rust type: without underscores.
    #[must_use]
    pub fn rust_name(&self) -> String {
        self.name.replace('_', "")
    }
}

impl fmt::Display for TypeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let namespace = self.namespace.as_str();
        write!(f, "{}/{namespace}/{}", self.package, self.name)
    }
}

/// What a field consists of, be it one or many.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Element {
    /// `bool`
    Bool,
    /// `byte`
    Byte,
    /// `char`, which is a `uint8` in ROS 2
    Char,
    /// `float32`
    Float32,
    /// `float64`
    Float64,
    /// `int8`
    Int8,
    /// `uint8`
    UInt8,
    /// `int16`
    Int16,
    /// `uint16`
    UInt16,
    /// `int32`
    Int32,
    /// `uint32`
    UInt32,
    /// `int64`
    Int64,
    /// `uint64`
    UInt64,
    /// `string` or `string<=bound`
    String {
        /// Largest number of bytes.
        bound: Option<u32>,
    },
    /// `wstring` or `wstring<=bound`
    WString {
        /// Largest number of UTF-16 units.
        bound: Option<u32>,
    },
    /// A message.
    Nested(TypeName),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// Exactly one.
    One,
    /// `[n]`
    Array(u32),
    /// `[]` or `[<=n]`
    Sequence {
        /// Largest number of elements.
        bound: Option<u32>,
    },
}

/// Type of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    /// Type of each element.
    pub element: Element,
    /// Number of elements.
    pub arity: Arity,
}

/// Value of a constant or default.
#[derive(Debug, Clone, PartialEq)]
pub enum Literal {
    /// Of a `bool`.
    Bool(bool),
    /// Of any integer.
    Integer(i128),
    /// Of a `float32`.
    Float32(f32),
    /// Of a `float64`.
    Float64(f64),
    /// Of a string.
    Text(String),
    /// Of an array or sequence.
    List(Vec<Literal>),
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Type.
    pub ty: FieldType,
    /// Name, which may be a Rust keyword.
    pub name: String,
    /// Value of a new message's field, unless zero, false or empty.
    pub default: Option<Literal>,
    /// Type as the definition writes it.
    pub declared: String,
    /// Comment, line by line.
    pub doc: Vec<String>,
    /// Line in the file, from 1.
    pub line: usize,
}

/// A constant of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// Type, never [`Element::Nested`].
    pub element: Element,
    /// Name.
    pub name: String,
    /// Value.
    pub value: Literal,
    /// Type and value as the definition writes them.
    pub declared: String,
    /// Comment, line by line.
    pub doc: Vec<String>,
}

/// Fields and constants of a message.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MessageBody {
    /// Comment at the head, line by line.
    pub doc: Vec<String>,
    /// Fields in order.
    pub fields: Vec<Field>,
    /// Constants in order.
    pub constants: Vec<Constant>,
}

/// What a structure is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A message, or a message that a service or action is written with.
    Message,
    /// A message that ROS 2 wraps around an action's goal, result or feedback.
    Wrapper,
    /// A service's introspection event, which counts for hashes only.
    Event,
    /// A service, seen as a structure of its messages.
    Service,
    /// An action, seen as a structure of its messages and services.
    Action,
}

/// Anything that has a type hash.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Full name.
    pub name: TypeName,
    /// Purpose.
    pub role: Role,
    /// Fields and constants. An empty message has the one field that ROS 2 gives it.
    pub body: MessageBody,
    /// Definition as written, or as it would be, ending with a line feed unless empty.
    pub text: String,
    /// File that the definition comes from.
    pub file: PathBuf,
}
