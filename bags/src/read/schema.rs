//! The definition of a type as a file carries it.

use mcap::records::SchemaHeader;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Schema {
    pub(super) name: String,
    pub(super) encoding: String,
    pub(super) text: String,
}

impl Schema {
    pub(super) fn new(header: SchemaHeader, data: &[u8]) -> Self {
        Self { name: header.name, encoding: header.encoding, text: String::from_utf8_lossy(data).into_owned() }
    }
}
