//! Why a bag cannot be read or written.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Why a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// The medium is full. What was recorded before is a valid bag.
    #[error("{}: no space is left on the device; the bag ends at {} and is valid up to there", path.display(), Seconds(*end_ns))]
    Full {
        /// The file.
        path: PathBuf,
        /// Time of the last message kept, ns.
        end_ns: u64,
    },
    /// A place of a file cannot be made sense of.
    #[error("{}: at byte {offset}: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the record begins that is wrong.
        offset: u64,
        /// What is wrong.
        reason: String,
    },
    /// A file or folder as a whole is not what it should be.
    #[error("{}: {reason}", path.display())]
    Invalid {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A type's definition cannot be used.
    #[error("type {ros_type}: {reason}")]
    Type {
        /// The type.
        ros_type: String,
        /// What is wrong.
        reason: String,
    },
    /// A message does not fit its type.
    #[error("{topic} at {}: {reason}", Seconds(*log_ns))]
    Message {
        /// The topic.
        topic: String,
        /// Its time in the bag, ns.
        log_ns: u64,
        /// What is wrong.
        reason: String,
    },
}

impl BagError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn damaged(path: &Path, offset: u64, reason: impl fmt::Display) -> Self {
        Self::Damaged { path: path.to_owned(), offset, reason: reason.to_string() }
    }

    pub(crate) fn invalid(path: &Path, reason: impl fmt::Display) -> Self {
        Self::Invalid { path: path.to_owned(), reason: reason.to_string() }
    }

    pub(crate) fn of_type(ros_type: &str, reason: impl fmt::Display) -> Self {
        Self::Type { ros_type: ros_type.to_owned(), reason: reason.to_string() }
    }
}

/// A time or duration in ns, shown in seconds with all its digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seconds(pub u64);

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:09} s", self.0 / 1_000_000_000, self.0 % 1_000_000_000)
    }
}
