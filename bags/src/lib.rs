//! ROS 2 bags in MCAP files: the folder that rosbag2 writes and reads, with `metadata.yaml` beside the files.
//!
//! - [`BagWriter`] writes so that a crash or a full disk costs at most the last second; [`Bag`] reads, also what is
//!   damaged.
//! - [`cdr`] takes messages apart by the definitions that the bag itself carries, so no types need to be installed.

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
