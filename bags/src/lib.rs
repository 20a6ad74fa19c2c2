//! What bags are and what can be done with them, as on the front page of this crate:
//!
#![doc = include_str!("../README.md")]

pub mod cdr;
pub mod check;
mod definition;
pub mod diff;
mod distribution;
mod error;
pub mod export;
pub mod info;
pub mod metadata;
pub mod qos;
mod read;
pub mod recover;
mod selection;
mod write;

pub use definition::{Definition, Definitions, dds_type, ros_type};
pub use distribution::Distribution;
pub use error::{BagError, Seconds};
pub use read::{Bag, BagFile, CHUNK_BYTES_MAX, Messages, Query, RECORD_BYTES_MAX, RecordedMessage, Topic};
pub use selection::Selection;
pub use write::{BagWriter, Compression, NewAttachment, NewTopic, WriteSettings};
