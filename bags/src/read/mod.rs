//! Reading bags, damaged ones too, within bounded memory.
//!
//! Nothing a file says is believed before it is checked: lengths against the file and the limits below, chunks against
//! their checksums, positions by walking through the file. What cannot be read is a [problem](Bag::problems) with its
//! place, and the rest is read all the same.

mod chunk;
mod file;
mod messages;
mod schema;
mod summary;
mod window;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub use messages::{Messages, Query, RecordedMessage};

use crate::error::BagError;
use crate::metadata::Metadata;
use file::McapFile;

/// A chunk that is larger, packed or unpacked, is not read.
pub const CHUNK_BYTES_MAX: u64 = 256 << 20;
/// Of the other records, larger ones are not read.
pub const RECORD_BYTES_MAX: u64 = 64 << 20;
/// Schemas and metadata records of a file that are kept, bytes.
const DESCRIPTION_BYTES_MAX: usize = 256 << 20;
/// Chunks, attachments and the like of a file that are noted.
const PARTS_MAX: usize = 4 << 20;
/// Problems within one chunk that are told apart.
const PROBLEMS_PER_CHUNK: usize = 3;
/// Problems of one bag that are kept; more are counted as one.
const PROBLEMS_MAX: usize = 1000;

/// A bag: a folder with `metadata.yaml` and MCAP files, or a single MCAP file.
#[derive(Debug)]
pub struct Bag {
    path: PathBuf,
    metadata: Option<Metadata>,
    files: Vec<McapFile>,
    topics: Vec<Topic>,
    /// (file, channel) → topic.
    channels: BTreeMap<(usize, u16), usize>,
    problems: Vec<BagError>,
}

/// A topic of a bag, as the files' channels describe it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Its type, `package/msg/Name`.
    pub ros_type: String,
    /// How messages are written; `cdr` in ROS 2.
    pub message_encoding: String,
    /// Language of the definition: `ros2msg`, `ros2idl`, or nothing.
    pub schema_encoding: String,
    /// The definition.
    pub schema: String,
    /// What its publishers offered, as YAML.
    pub qos: String,
    /// Hash of its type; empty when the recorder did not know it.
    pub type_hash: String,
    /// Number of messages.
    pub count: u64,
}

impl Bag {
    /// Opens the bag at `path`, a folder or an MCAP file, and finds out what is in it. Of a file that was closed well this
    /// reads the structure only; of another one, everything.
    ///
    /// # Errors
    /// When there is nothing to read at all. Whatever else is wrong is among the [problems](Self::problems).
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let mut problems = Vec::new();
        let about = std::fs::metadata(path).map_err(BagError::io(path))?;
        let (metadata, paths) = if about.is_dir() {
            let metadata = match Metadata::read(path) {
                Ok(Some(metadata)) => Some(metadata),
                Ok(None) => {
                    problems.push(BagError::invalid(path, "metadata.yaml is missing and must be recovered"));
                    None
                }
                Err(error) => {
                    problems.push(error);
                    None
                }
            };
            let paths = files_of(path, metadata.as_ref(), &mut problems)?;
            (metadata, paths)
        } else {
            (None, vec![path.to_owned()])
        };
        let mut files = Vec::new();
        for path in &paths {
            match McapFile::open(path, &mut problems) {
                Ok(file) => files.push(file),
                Err(error) => problems.push(error),
            }
        }
        if files.is_empty() {
            // Of several reasons the last is about a file.
            return Err(problems.pop().unwrap_or_else(|| BagError::invalid(path, "no MCAP file in this folder")));
        }
        let mut bag = Self {
            path: path.to_owned(),
            metadata,
            files,
            topics: Vec::new(),
            channels: BTreeMap::new(),
            problems: Vec::new(),
        };
        bag.gather_topics(&mut problems);
        if problems.len() > PROBLEMS_MAX {
            let more = problems.split_off(PROBLEMS_MAX).len();
            problems.push(BagError::invalid(path, format!("{more} more problems")));
        }
        bag.problems = problems;
        Ok(bag)
    }

    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What `metadata.yaml` says, if there is one that can be read.
    #[must_use]
    pub fn metadata(&self) -> Option<&Metadata> {
        self.metadata.as_ref()
    }

    /// Its topics, by name.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// What was found wrong when it was opened; [`messages`](Self::messages) may find more.
    #[must_use]
    pub fn problems(&self) -> &[BagError] {
        &self.problems
    }

    /// Its files, in order.
    pub fn files(&self) -> impl Iterator<Item = BagFile<'_>> {
        self.files.iter().map(BagFile)
    }

    /// Time of the first and of the last message, ns; none of an empty bag.
    #[must_use]
    pub fn bounds_ns(&self) -> Option<(u64, u64)> {
        let bounds = self.files.iter().filter_map(McapFile::bounds_ns);
        bounds.reduce(|(start, end), (from, to)| (start.min(from), end.max(to)))
    }

    /// Number of messages.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.count).sum()
    }

    /// Size of its files, bytes.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.files.iter().map(|file| file.length).sum()
    }

    /// Its messages in the order of their times, of equal ones in the order of the files. A part that cannot be read is an
    /// error among them, after which the rest follows.
    #[must_use]
    pub fn messages(&self, query: &Query) -> Messages<'_> {
        Messages::new(self, query)
    }

    /// The attachment of this name: the first that can be read.
    ///
    /// # Errors
    /// When there is one, and it cannot be read.
    pub fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>, BagError> {
        for file in &self.files {
            if let Some(found) = file.attachment(name)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// All metadata records of this name, in order.
    pub fn records(&self, name: &str) -> impl Iterator<Item = &BTreeMap<String, String>> {
        let records = self.files.iter().flat_map(|file| &file.metadata);
        records.filter(move |record| record.name == name).map(|record| &record.metadata)
    }

    /// Names of the attachments and of the metadata records, of all files.
    #[must_use]
    pub fn extras(&self) -> (BTreeSet<&str>, BTreeSet<&str>) {
        let attachments = self.files.iter().flat_map(|file| &file.attachments).map(|(name, _)| name.as_str());
        let records = self.files.iter().flat_map(|file| &file.metadata).map(|record| record.name.as_str());
        (attachments.collect(), records.collect())
    }

    fn gather_topics(&mut self, problems: &mut Vec<BagError>) {
        let mut topics: BTreeMap<String, Topic> = BTreeMap::new();
        for file in &self.files {
            for (id, channel) in &file.channels {
                let topic = file.topic(*id, channel, problems);
                let Some(known) = topics.get_mut(&topic.name) else {
                    topics.insert(topic.name.clone(), topic);
                    continue;
                };
                if known.ros_type != topic.ros_type || known.message_encoding != topic.message_encoding {
                    let reason = format!(
                        "topic {} is there twice, as {} and as {}; messages of the second are left out",
                        topic.name, known.ros_type, topic.ros_type
                    );
                    problems.push(BagError::invalid(&file.path, reason));
                    continue;
                }
                known.count += topic.count;
                for (known, also) in [(&mut known.qos, topic.qos), (&mut known.type_hash, topic.type_hash)] {
                    if known.is_empty() {
                        *known = also;
                    }
                }
            }
        }
        self.topics = topics.into_values().collect();
        for (index, file) in self.files.iter().enumerate() {
            for (id, channel) in &file.channels {
                let fits = |topic: &Topic| topic.name == channel.topic && topic.ros_type == file.ros_type(channel);
                if let Some(topic) = self.topics.iter().position(fits) {
                    self.channels.insert((index, *id), topic);
                }
            }
        }
    }
}

/// A file of a bag.
#[derive(Debug, Clone, Copy)]
pub struct BagFile<'a>(&'a McapFile);

impl<'a> BagFile<'a> {
    /// Where it lies.
    #[must_use]
    pub fn path(self) -> &'a Path {
        &self.0.path
    }

    /// Profile of its header; `ros2` in bags of ROS 2.
    #[must_use]
    pub fn profile(self) -> &'a str {
        &self.0.profile
    }

    /// What wrote it.
    #[must_use]
    pub fn library(self) -> &'a str {
        &self.0.library
    }

    /// Time of its first and of its last message, ns.
    #[must_use]
    pub fn bounds_ns(self) -> Option<(u64, u64)> {
        self.0.bounds_ns()
    }

    /// Number of its messages.
    #[must_use]
    pub fn message_count(self) -> u64 {
        self.0.counts.values().sum()
    }

    /// Whether it was closed well: with a summary and the magic bytes at its end.
    #[must_use]
    pub fn is_complete(self) -> bool {
        self.0.is_complete
    }

    /// Number of messages in chunks, and outside of them, as parts of the file.
    #[must_use]
    pub fn chunks(self) -> usize {
        self.0.segments.iter().filter(|segment| segment.is_chunk).count()
    }

    /// How its chunks are packed; several when they differ.
    #[must_use]
    pub fn compressions(self) -> &'a BTreeSet<String> {
        &self.0.compressions
    }

    /// Whether its messages can be found by time without reading it all.
    #[must_use]
    pub fn is_indexed(self) -> bool {
        self.0.is_indexed
    }
}

/// The MCAP files of a folder: those the metadata name, else all, in the order of their numbers.
fn files_of(
    folder: &Path,
    metadata: Option<&Metadata>,
    problems: &mut Vec<BagError>,
) -> Result<Vec<PathBuf>, BagError> {
    if let Some(metadata) = metadata {
        // Only files of this folder: a name may not lead elsewhere.
        let names = metadata.files.iter().filter_map(|file| Path::new(&file.path).file_name());
        let (found, missing): (Vec<_>, Vec<_>) = names.map(|name| folder.join(name)).partition(|path| path.is_file());
        for path in missing {
            problems.push(BagError::invalid(&path, "metadata.yaml names this file, but it is not there"));
        }
        if !found.is_empty() {
            return Ok(found);
        }
    }
    let entries = std::fs::read_dir(folder).and_then(|entries| {
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, std::io::Error>>()
    });
    let mut paths = entries.map_err(BagError::io(folder))?;
    paths.retain(|path| path.is_file() && path.extension().is_some_and(|extension| extension == "mcap"));
    paths.sort_by_key(|path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let number = stem.rsplit_once('_').and_then(|(_, number)| number.parse::<u64>().ok());
        (number.unwrap_or(u64::MAX), stem)
    });
    Ok(paths)
}
