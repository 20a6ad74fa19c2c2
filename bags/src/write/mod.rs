//! Writing bags so that a crash costs at most the last second.
//!
//! Messages are packed into chunks, and a chunk is handed to the system, whole and with its index, when it is full or its
//! messages span a fifth of a second, and in a [live](WriteSettings::live) recording when it is half a second old. What the system has survives the end of this process, also by kill −9; it survives a power cut when the
//! system has written it to the disk, which is asked for at the end of each file. A reserve of space is kept in the
//! bag's folder: when the medium is full it is given up, and what it held is enough to close the bag.

mod sink;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mcap::records::{MessageHeader, Metadata as MetadataRecord};
use mcap::{Attachment, Compression as McapCompression, McapError, WriteOptions};

use crate::distribution::Distribution;
use crate::error::BagError;
use crate::metadata::{FILE_NAME, FileInfo, Metadata, TopicInfo};
use crate::qos::{QosProfile, to_text};
use sink::Sink;

/// Uncompressed size at which a chunk is closed, bytes.
const CHUNK_BYTES: usize = 1 << 20;
/// Time, by the messages', that it holds at most, ns.
const CHUNK_SPAN_NS: u64 = 200_000_000;
/// Age at which it is closed: less than a second, so that with the time to write it no more is lost.
const CHUNK_AGE: Duration = Duration::from_millis(500);

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4: little work.
    Lz4,
    /// Zstandard at its fastest level: small, and still faster than most disks.
    #[default]
    Zstd,
}

/// How a bag is written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WriteSettings {
    /// Whose tools are to read it.
    pub distribution: Distribution,
    /// How chunks are packed.
    pub compression: Compression,
    /// Messages are written as they happen: what the clock says ends chunks too, so that a crash costs at most the last
    /// second, however slowly messages come. Otherwise the same messages make the same bytes.
    pub live: bool,
    /// Size at which a new file is begun, bytes.
    pub split_bytes: Option<u64>,
    /// Time, by the messages', after which a new file is begun, ns.
    pub split_ns: Option<u64>,
    /// Free pairs for the metadata.
    pub custom_data: BTreeMap<String, String>,
}

/// A topic to be written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NewTopic {
    /// Its name.
    pub name: String,
    /// Its type, `package/msg/Name`.
    pub ros_type: String,
    /// Language of the definition; empty when there is none.
    pub schema_encoding: String,
    /// The definition.
    pub schema: String,
    /// What its publishers offer.
    pub qos: Vec<QosProfile>,
    /// Hash of its type; empty when not known.
    pub type_hash: String,
}

/// A file that goes into the bag beside the messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewAttachment {
    /// Its name.
    pub name: String,
    /// What it is, such as `application/yaml`.
    pub media_type: String,
    /// Its content.
    pub data: Vec<u8>,
}

/// A bag being written.
pub struct BagWriter {
    folder: PathBuf,
    settings: WriteSettings,
    /// What every file of the bag begins with.
    attachments: Vec<NewAttachment>,
    records: Vec<MetadataRecord>,
    topics: Vec<TopicState>,
    file: OpenFile,
    metadata: Metadata,
}

struct TopicState {
    new: NewTopic,
    count: u64,
    /// Its channel in the open file.
    channel: Option<u16>,
}

struct OpenFile {
    path: PathBuf,
    writer: mcap::Writer<Sink>,
    sink: Sink,
    bounds_ns: Option<(u64, u64)>,
    count: u64,
    /// Bytes in the open chunk, the time of its first message, and since when there are some.
    chunk_bytes: usize,
    chunk_from_ns: Option<u64>,
    /// Nothing where the clock plays no part.
    chunk_since: Option<Instant>,
    live: bool,
}

impl BagWriter {
    /// Begins a bag in `folder`, which must not exist yet, or be empty.
    ///
    /// # Errors
    /// When the folder is in use, or cannot be written to.
    pub fn create(folder: &Path, settings: WriteSettings) -> Result<Self, BagError> {
        if folder.read_dir().is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(BagError::invalid(folder, "the folder exists and is not empty; nothing is overwritten"));
        }
        std::fs::create_dir_all(folder).map_err(BagError::io(folder))?;
        let file = OpenFile::create(folder, 0, &settings)?;
        let metadata = Metadata::empty(settings.distribution);
        let folder = folder.to_owned();
        let metadata = Metadata { custom_data: settings.custom_data.clone(), ..metadata };
        Ok(Self { folder, settings, attachments: Vec::new(), records: Vec::new(), topics: Vec::new(), file, metadata })
    }

    /// Where the bag lies.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Attaches a file, to every file of the bag.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn attach(&mut self, attachment: NewAttachment) -> Result<(), BagError> {
        self.file.attach(&attachment)?;
        self.attachments.push(attachment);
        Ok(())
    }

    /// Adds named texts, to every file of the bag.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn add_record(&mut self, name: &str, texts: BTreeMap<String, String>) -> Result<(), BagError> {
        let record = MetadataRecord { name: name.to_owned(), metadata: texts };
        self.file.record(&record)?;
        self.records.push(record);
        Ok(())
    }

    /// Adds a topic; the result stands for it in [`write`](Self::write). A topic that is there already gets what is new in
    /// the quality of service.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add_topic(&mut self, topic: NewTopic) -> Result<usize, BagError> {
        if let Some(at) = self.topics.iter().position(|known| known.new.name == topic.name) {
            let known = &mut self.topics[at].new;
            known.qos.extend(topic.qos);
            known.qos.sort();
            known.qos.dedup();
            return Ok(at);
        }
        self.topics.push(TopicState { new: topic, count: 0, channel: None });
        Ok(self.topics.len() - 1)
    }

    /// Writes a message: CDR with its encapsulation header.
    ///
    /// # Errors
    /// [`BagError::Full`] when there is no more space: this message is in the bag or not, nothing more can be, and
    /// [`finish`](Self::finish) makes a valid bag of it.
    pub fn write(&mut self, topic: usize, log_ns: u64, publish_ns: u64, data: &[u8]) -> Result<(), BagError> {
        if self.is_split_due(log_ns) {
            self.split()?;
        }
        let state = &mut self.topics[topic];
        let channel = match state.channel {
            Some(channel) => channel,
            None => {
                let channel = self.file.add_channel(&state.new, self.metadata.version)?;
                state.channel = Some(channel);
                channel
            }
        };
        let sequence = u32::try_from(state.count & u64::from(u32::MAX)).unwrap_or_default();
        state.count += 1;
        let header = MessageHeader { channel_id: channel, sequence, log_time: log_ns, publish_time: publish_ns };
        self.file.write(&header, data)?;
        self.check_room()
    }

    /// Hands over to the system what is old enough in a live recording. To be called at least twice a second while nothing is written.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn flush_if_due(&mut self) -> Result<(), BagError> {
        self.file.flush_if_old()?;
        self.check_room()
    }

    fn check_room(&self) -> Result<(), BagError> {
        if self.file.sink.is_full() {
            let end_ns = self.file.bounds_ns.map_or(0, |(_, end)| end);
            return Err(BagError::Full { path: self.file.path.clone(), end_ns });
        }
        Ok(())
    }

    /// Messages written so far.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.count).sum()
    }

    /// Size of the files so far, bytes.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.metadata
            .files
            .iter()
            .map(|file| self.folder.join(&file.path))
            .chain([self.file.path.clone()])
            .filter_map(|path| path.metadata().ok())
            .map(|about| about.len())
            .sum()
    }

    /// Closes the bag: index and summary, then `metadata.yaml`, all of it on the disk.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self) -> Result<Metadata, BagError> {
        self.close_file()?;
        let path = self.folder.join(FILE_NAME);
        let text = self.metadata.to_yaml().map_err(|reason| BagError::invalid(&path, reason))?;
        self.file.sink.give_up_reserve();
        std::fs::write(&path, text).map_err(BagError::io(&path))?;
        std::fs::File::open(&path).and_then(|file| file.sync_all()).map_err(BagError::io(&path))?;
        std::fs::File::open(&self.folder).and_then(|folder| folder.sync_all()).map_err(BagError::io(&self.folder))?;
        Ok(self.metadata)
    }

    fn is_split_due(&self, log_ns: u64) -> bool {
        let by_size = self.settings.split_bytes.is_some_and(|most| self.file.sink.position() >= most);
        let by_time = self
            .settings
            .split_ns
            .zip(self.file.bounds_ns)
            .is_some_and(|(most, (start, _))| log_ns.saturating_sub(start) >= most);
        self.file.count > 0 && (by_size || by_time)
    }

    fn split(&mut self) -> Result<(), BagError> {
        self.close_file()?;
        self.file = OpenFile::create(&self.folder, self.metadata.files.len(), &self.settings)?;
        for topic in &mut self.topics {
            topic.channel = None;
        }
        for attachment in &self.attachments {
            self.file.attach(attachment)?;
        }
        for record in &self.records {
            self.file.record(record)?;
        }
        Ok(())
    }

    fn close_file(&mut self) -> Result<(), BagError> {
        // Also a topic without messages belongs to the bag, if it has not been in another file.
        let version = self.metadata.version;
        for topic in self.topics.iter_mut().filter(|topic| topic.channel.is_none() && topic.count == 0) {
            topic.channel = Some(self.file.add_channel(&topic.new, version)?);
        }
        let (start_ns, end_ns) = self.file.bounds_ns.unwrap_or_default();
        let name = self.file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let files = &mut self.metadata.files;
        files.push(FileInfo { path: name, start_ns, duration_ns: end_ns - start_ns, message_count: self.file.count });
        let used = files.iter().filter(|file| file.message_count > 0);
        let bounds = used.map(|file| (file.start_ns, file.start_ns + file.duration_ns));
        let bounds = bounds.reduce(|(start, end), (from, to)| (start.min(from), end.max(to)));
        let (start_ns, end_ns) = bounds.unwrap_or_default();
        self.metadata.start_ns = start_ns;
        self.metadata.duration_ns = end_ns - start_ns;
        self.metadata.message_count = self.topics.iter().map(|topic| topic.count).sum();
        self.metadata.topics = self.topics.iter().map(TopicState::info).collect();
        self.metadata.topics.sort_by(|a, b| a.name.cmp(&b.name));
        let invalid = |reason| BagError::invalid(&self.folder, reason);
        let mut texts = BTreeMap::new();
        if version >= 8 {
            texts.insert("serialized_metadata".to_owned(), self.metadata.to_serialized().map_err(invalid)?);
        } else {
            texts.insert("ROS_DISTRO".to_owned(), self.settings.distribution.name().to_owned());
        }
        self.file.record(&MetadataRecord { name: "rosbag2".to_owned(), metadata: texts })?;
        self.file.close()
    }
}

impl TopicState {
    fn info(&self) -> TopicInfo {
        TopicInfo {
            name: self.new.name.clone(),
            ros_type: self.new.ros_type.clone(),
            serialization_format: "cdr".to_owned(),
            qos: self.new.qos.clone(),
            type_hash: self.new.type_hash.clone(),
            message_count: self.count,
        }
    }
}

impl OpenFile {
    fn create(folder: &Path, number: usize, settings: &WriteSettings) -> Result<Self, BagError> {
        let absolute = std::path::absolute(folder).map_err(BagError::io(folder))?;
        let name = absolute.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let path = folder.join(format!("{name}_{number}.mcap"));
        let sink = Sink::create(&path).map_err(BagError::io(&path))?;
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("ros2_bags ", env!("CARGO_PKG_VERSION")))
            .compression(match settings.compression {
                Compression::None => None,
                Compression::Lz4 => Some(McapCompression::Lz4),
                Compression::Zstd => Some(McapCompression::Zstd),
            })
            .compression_level(1)
            // In this thread: others are started anew for every chunk.
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true);
        let writer = options.create(sink.clone()).map_err(|error| mcap_error(&path, 0, error))?;
        let mut file = Self {
            path,
            writer,
            sink,
            bounds_ns: None,
            count: 0,
            chunk_bytes: 0,
            chunk_from_ns: None,
            chunk_since: None,
            live: settings.live,
        };
        file.flush()?;
        Ok(file)
    }

    fn attach(&mut self, attachment: &NewAttachment) -> Result<(), BagError> {
        let NewAttachment { name, media_type, data } = attachment;
        let (name, media_type) = (name.clone(), media_type.clone());
        let attachment = Attachment { log_time: 0, create_time: 0, name, media_type, data: data.into() };
        let done = self.writer.attach(&attachment);
        self.checked(done)?;
        self.flush()
    }

    fn record(&mut self, record: &MetadataRecord) -> Result<(), BagError> {
        let done = self.writer.write_metadata(record);
        self.checked(done)?;
        self.flush()
    }

    fn add_channel(&mut self, topic: &NewTopic, version: u32) -> Result<u16, BagError> {
        let qos = to_text(&topic.qos, version).map_err(|reason| BagError::invalid(&self.path, reason))?;
        let metadata = [("offered_qos_profiles", qos), ("topic_type_hash", topic.type_hash.clone())];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value)).into_iter().collect();
        let schema = self.writer.add_schema(&topic.ros_type, &topic.schema_encoding, topic.schema.as_bytes());
        let schema = self.checked(schema)?;
        let channel = self.writer.add_channel(schema, &topic.name, "cdr", &metadata);
        self.begin_chunk();
        self.checked(channel)
    }

    fn write(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), BagError> {
        let done = self.writer.write_to_known_channel(header, data);
        self.checked(done)?;
        let (start, end) = self.bounds_ns.unwrap_or((header.log_time, header.log_time));
        self.bounds_ns = Some((start.min(header.log_time), end.max(header.log_time)));
        self.count += 1;
        self.chunk_bytes += data.len();
        let from_ns = *self.chunk_from_ns.get_or_insert(header.log_time);
        self.begin_chunk();
        let is_full = self.chunk_bytes >= CHUNK_BYTES || header.log_time.saturating_sub(from_ns) >= CHUNK_SPAN_NS;
        if is_full { self.flush() } else { self.flush_if_old() }
    }

    fn begin_chunk(&mut self) {
        if self.live {
            self.chunk_since.get_or_insert_with(Instant::now);
        }
    }

    fn flush_if_old(&mut self) -> Result<(), BagError> {
        if self.chunk_since.is_some_and(|since| since.elapsed() >= CHUNK_AGE) { self.flush() } else { Ok(()) }
    }

    /// Closes the chunk and hands it to the system.
    fn flush(&mut self) -> Result<(), BagError> {
        self.chunk_bytes = 0;
        self.chunk_from_ns = None;
        self.chunk_since = None;
        let done = self.writer.flush();
        self.checked(done)
    }

    /// Writes index and summary.
    fn close(&mut self) -> Result<(), BagError> {
        let done = self.writer.finish();
        self.checked(done)?;
        self.sink.finish().map_err(BagError::io(&self.path))
    }

    fn checked<T>(&self, result: Result<T, McapError>) -> Result<T, BagError> {
        result.map_err(|error| mcap_error(&self.path, self.sink.position(), error))
    }
}

fn mcap_error(path: &Path, offset: u64, error: McapError) -> BagError {
    match error {
        McapError::Io(source) => BagError::Io { path: path.to_owned(), source },
        error => BagError::damaged(path, offset, error),
    }
}
