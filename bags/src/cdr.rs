//! Messages of any type, taken apart by the definition that the bag carries.
//!
//! CDR as ROS 2 uses it (XCDR version 1, plain): four bytes of encapsulation header, then the fields in order, each
//! number aligned to its size counted from behind the header; strings with their length and a final zero; sequences with
//! their length.

use ros2_msggen::{Arity, Catalogue, Element, Error, Problem, Structure, TypeName};

use crate::definition::parse_type;
use crate::error::BagError;

/// Encapsulation header before each message.
pub const HEADER_BYTES: usize = 4;
/// Definitions that are longer are not parsed.
const SCHEMA_BYTES_MAX: usize = 4 << 20;
/// Messages nested deeper are not taken apart.
const DEPTH_MAX: usize = 64;
/// What some middlewares append so that a body ends on a multiple of four.
const PADDING_MAX: usize = 3;

/// A type, from its definition.
#[derive(Debug, Clone)]
pub struct MessageType {
    catalogue: Catalogue,
    root: TypeName,
}

/// A value that has no parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leaf<'a> {
    /// A truth value.
    Bool(bool),
    /// A signed number.
    Int(i64),
    /// An unsigned number.
    Uint(u64),
    /// A `float32`.
    Float32(f32),
    /// A `float64`.
    Float64(f64),
    /// A string.
    Text(&'a str),
    /// A sequence or array of bytes.
    Bytes(&'a [u8]),
}

impl Leaf<'_> {
    /// Its value as a number, if it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        #[expect(clippy::cast_precision_loss, reason = "for comparison within a tolerance, and to be shown")]
        match *self {
            Self::Bool(value) => Some(f64::from(u8::from(value))),
            Self::Int(value) => Some(value as f64),
            Self::Uint(value) => Some(value as f64),
            Self::Float32(value) => Some(value.into()),
            Self::Float64(value) => Some(value),
            Self::Text(_) | Self::Bytes(_) => None,
        }
    }
}

impl std::fmt::Display for Leaf<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Int(value) => write!(f, "{value}"),
            Self::Uint(value) => write!(f, "{value}"),
            Self::Float32(value) => write!(f, "{value}"),
            Self::Float64(value) => write!(f, "{value}"),
            Self::Text(text) => write!(f, "{text:?}"),
            Self::Bytes(bytes) => {
                write!(f, "{} bytes", bytes.len())?;
                let shown = &bytes[..bytes.len().min(8)];
                shown.iter().try_for_each(|byte| write!(f, " {byte:02x}"))?;
                f.write_str(if shown.len() < bytes.len() { " …" } else { "" })
            }
        }
    }
}

impl MessageType {
    /// Parses a definition in the language `ros2msg`.
    ///
    /// # Errors
    /// [`BagError::Type`] with the line that breaks a rule.
    pub fn parse(ros_type: &str, schema: &str) -> Result<Self, BagError> {
        let fail = |reason: &dyn std::fmt::Display| BagError::of_type(ros_type, reason);
        if schema.len() > SCHEMA_BYTES_MAX {
            return Err(fail(&format!("a definition of {} bytes, at most {SCHEMA_BYTES_MAX}", schema.len())));
        }
        let name = parse_type(ros_type).ok_or_else(|| fail(&"this is no name of a type"))?;
        let catalogue = Catalogue::of_schema(&name, schema).map_err(|error| match &error {
            Error::Definition { problem: Problem::Unknown(unknown), .. } => {
                fail(&format!("the definition lacks {unknown}, which it refers to"))
            }
            error => fail(error),
        })?;
        let root = TypeName::message(&name.package, &name.name);
        Ok(Self { catalogue, root })
    }

    /// Hash of the type (REP-2011), from its definition; none for messages that ROS derives from services and actions,
    /// whose hash the definition alone does not give.
    #[must_use]
    pub fn type_hash(&self) -> Option<String> {
        let structure = self.catalogue.get(&self.root).filter(|structure| !structure.name.name.contains('_'))?;
        Some(self.catalogue.type_hash(structure))
    }

    /// Calls `visit` for every value of a message, with its path such as `pose.position.x` or `parts[3].id`.
    ///
    /// # Errors
    /// Which byte does not fit the definition, and why.
    pub fn walk(&self, data: &[u8], visit: &mut dyn FnMut(&str, Leaf<'_>)) -> Result<(), String> {
        self.walk_with(data, None, visit)
    }

    /// The message with the other byte order: big endian becomes little endian.
    ///
    /// # Errors
    /// As [`walk`](Self::walk).
    pub fn swapped(&self, data: &[u8]) -> Result<Vec<u8>, String> {
        let mut swapped = data.to_vec();
        let mut numbers = Vec::new();
        self.walk_with(data, Some(&mut numbers), &mut |_, _| ())?;
        for (at, size) in numbers {
            swapped[at..at + size].reverse();
        }
        swapped[1] ^= 1;
        Ok(swapped)
    }

    /// Beside the values notes where the numbers stand that the message is written with: (byte, size).
    fn walk_with(
        &self,
        data: &[u8],
        numbers: Option<&mut Vec<(usize, usize)>>,
        visit: &mut dyn FnMut(&str, Leaf<'_>),
    ) -> Result<(), String> {
        let little_endian = is_little_endian(data)?;
        let structure = self.catalogue.get(&self.root).ok_or("the definition lacks the type itself")?;
        let mut walker = Walker {
            catalogue: &self.catalogue,
            body: &data[HEADER_BYTES..],
            at: 0,
            little_endian,
            path: String::new(),
            numbers,
            visit,
        };
        walker.structure(structure, 0)?;
        let left = walker.body.len() - walker.at;
        if left > PADDING_MAX {
            return Err(format!(
                "{left} bytes are left over behind the last field, at byte {}",
                walker.at + HEADER_BYTES
            ));
        }
        Ok(())
    }
}

/// Whether a message is little endian, by its encapsulation header.
///
/// # Errors
/// When there is none, or one of an encoding other than plain CDR.
pub fn is_little_endian(data: &[u8]) -> Result<bool, String> {
    match data.first_chunk::<HEADER_BYTES>() {
        Some([0, 1, _, _]) => Ok(true),
        Some([0, 0, _, _]) => Ok(false),
        Some([a, b, _, _]) => Err(format!("encapsulation {a:02x} {b:02x} is not plain CDR (00 00 or 00 01)")),
        None => Err(format!("{} bytes are too few for an encapsulation header", data.len())),
    }
}

struct Walker<'a, 'v> {
    catalogue: &'a Catalogue,
    body: &'a [u8],
    at: usize,
    little_endian: bool,
    path: String,
    numbers: Option<&'v mut Vec<(usize, usize)>>,
    visit: &'v mut dyn FnMut(&str, Leaf<'_>),
}

impl<'a> Walker<'a, '_> {
    fn structure(&mut self, structure: &'a Structure, depth: usize) -> Result<(), String> {
        if depth > DEPTH_MAX {
            return Err(format!("{} lies deeper than {DEPTH_MAX} messages", self.path));
        }
        for field in &structure.body.fields {
            let before = self.path.len();
            if before > 0 {
                self.path.push('.');
            }
            self.path.push_str(&field.name);
            match field.ty.arity {
                Arity::One => self.element(&field.ty.element, depth)?,
                Arity::Array(size) => self.elements(&field.ty.element, size, depth)?,
                Arity::Sequence { .. } => {
                    let count = u32::from_le_bytes(self.number::<4>()?);
                    self.elements(&field.ty.element, count, depth)?;
                }
            }
            self.path.truncate(before);
        }
        Ok(())
    }

    fn elements(&mut self, element: &'a Element, count: u32, depth: usize) -> Result<(), String> {
        // Every element takes a byte at least: what does not fit is not begun.
        let left = self.body.len() - self.at;
        let count = usize::try_from(count).ok().filter(|count| *count <= left);
        let count = count.ok_or_else(|| self.fault("is said to have more elements than there are bytes"))?;
        if matches!(element, Element::UInt8 | Element::Byte | Element::Char) {
            let bytes = self.take(count)?;
            (self.visit)(&self.path, Leaf::Bytes(bytes));
            return Ok(());
        }
        let before = self.path.len();
        for index in 0..count {
            self.path.push_str(&format!("[{index}]"));
            self.element(element, depth)?;
            self.path.truncate(before);
        }
        Ok(())
    }

    fn element(&mut self, element: &'a Element, depth: usize) -> Result<(), String> {
        let leaf = match element {
            Element::Bool => match self.number::<1>()? {
                [byte @ (0 | 1)] => Leaf::Bool(byte == 1),
                [byte] => return Err(self.fault(&format!("is a bool of value {byte}"))),
            },
            Element::Byte | Element::Char | Element::UInt8 => Leaf::Uint(self.number::<1>()?[0].into()),
            Element::Int8 => Leaf::Int(i8::from_le_bytes(self.number()?).into()),
            Element::Int16 => Leaf::Int(i16::from_le_bytes(self.number()?).into()),
            Element::UInt16 => Leaf::Uint(u16::from_le_bytes(self.number()?).into()),
            Element::Int32 => Leaf::Int(i32::from_le_bytes(self.number()?).into()),
            Element::UInt32 => Leaf::Uint(u32::from_le_bytes(self.number()?).into()),
            Element::Int64 => Leaf::Int(i64::from_le_bytes(self.number()?)),
            Element::UInt64 => Leaf::Uint(u64::from_le_bytes(self.number()?)),
            Element::Float32 => Leaf::Float32(f32::from_le_bytes(self.number()?)),
            Element::Float64 => Leaf::Float64(f64::from_le_bytes(self.number()?)),
            Element::String { .. } => {
                let length = u32::from_le_bytes(self.number()?) as usize;
                let bytes = self.take(length)?;
                // Some writers leave the zero of an empty string out.
                let text = bytes.strip_suffix(&[0]).or(bytes.is_empty().then_some(bytes));
                let text = text.ok_or_else(|| self.fault("is a string without a zero at its end"))?;
                Leaf::Text(std::str::from_utf8(text).map_err(|_| self.fault("is a string that is not UTF-8"))?)
            }
            Element::WString { .. } => {
                return Err(self.fault("is a wide string, whose form differs from middleware to middleware"));
            }
            Element::Nested(name) => {
                let catalogue = self.catalogue;
                let nested = catalogue.get(name).ok_or_else(|| format!("the definition lacks {name}"))?;
                return self.structure(nested, depth + 1);
            }
        };
        (self.visit)(&self.path, leaf);
        Ok(())
    }

    /// The next number, as little endian.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(N);
        let place = self.at + HEADER_BYTES;
        let bytes: [u8; N] = self.take(N)?.try_into().map_err(|_| self.fault("is cut off"))?;
        if let Some(numbers) = &mut self.numbers {
            numbers.push((place, N));
        }
        Ok(if self.little_endian { bytes } else { std::array::from_fn(|i| bytes[N - 1 - i]) })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.body.len());
        let end = end.ok_or_else(|| self.fault(&format!("needs {count} bytes, but the message ends")))?;
        let bytes = &self.body[self.at..end];
        self.at = end;
        Ok(bytes)
    }

    fn fault(&self, what: &str) -> String {
        format!("{} at byte {} {what}", self.path, self.at + HEADER_BYTES)
    }
}
