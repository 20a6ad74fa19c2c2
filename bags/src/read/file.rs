//! One MCAP file: where its messages lie, and what describes them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use mcap::records::{self, Channel, Record, op};

use super::chunk::{MESSAGE_HEAD_BYTES, MessageHead, RECORD_HEAD_BYTES, record_head, records as records_in, unpack};
use super::schema::Schema;
use super::window::FileWindow;
use super::{
    CHUNK_BYTES_MAX, DESCRIPTION_BYTES_MAX, PARTS_MAX, PROBLEMS_MAX, PROBLEMS_PER_CHUNK, RECORD_BYTES_MAX, Topic,
    summary,
};
use crate::error::BagError;

/// Messages outside of chunks are read in pieces of about this size.
const PLAIN_BYTES: u64 = 1 << 20;
/// What of a chunk's record tells its times and how it is packed.
const CHUNK_HEAD_BYTES: usize = 8 + 8 + 8 + 4 + 4 + 4 + 8;

/// A part of a file that holds messages: a chunk, or records outside of chunks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FileSegment {
    pub(super) offset: u64,
    pub(super) length: u64,
    pub(super) start_ns: u64,
    pub(super) end_ns: u64,
    pub(super) is_chunk: bool,
}

#[derive(Debug)]
pub(crate) struct McapFile {
    pub(super) path: PathBuf,
    file: File,
    pub(super) length: u64,
    pub(super) profile: String,
    pub(super) library: String,
    schemas: BTreeMap<u16, Schema>,
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) counts: BTreeMap<u16, u64>,
    pub(super) segments: Vec<FileSegment>,
    pub(super) compressions: BTreeSet<String>,
    /// Name, and where the record begins.
    pub(super) attachments: Vec<(String, u64)>,
    pub(super) metadata: Vec<records::Metadata>,
    pub(super) is_complete: bool,
    pub(super) is_indexed: bool,
    /// Bytes of what describes the messages, so far.
    description_bytes: usize,
    /// Times of all messages as the summary has them.
    summary_bounds_ns: Option<(u64, u64)>,
}

impl McapFile {
    pub(super) fn open(path: &Path, problems: &mut Vec<BagError>) -> Result<Self, BagError> {
        let file = File::open(path).map_err(BagError::io(path))?;
        let length = file.metadata().map_err(BagError::io(path))?.len();
        if length == 0 {
            return Err(BagError::damaged(path, 0, "the file is empty"));
        }
        let mut opened = Self {
            path: path.to_owned(),
            length,
            profile: String::new(),
            library: String::new(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            counts: BTreeMap::new(),
            segments: Vec::new(),
            compressions: BTreeSet::new(),
            attachments: Vec::new(),
            metadata: Vec::new(),
            is_complete: false,
            is_indexed: false,
            description_bytes: 0,
            summary_bounds_ns: None,
            file,
        };
        opened.check_magic()?;
        let summary = summary::read(&opened.file, length).unwrap_or_else(|(at, reason)| {
            problems.push(BagError::damaged(path, at, reason));
            None
        });
        opened.is_complete = summary.is_some();
        let summary = summary.unwrap_or_default();
        let whole = opened.walk(&summary, problems)?;
        opened.is_indexed = !summary.chunks.is_empty()
            && summary
                .chunks
                .iter()
                .all(|chunk| chunk.message_index_length > 0 || chunk.message_index_offsets.is_empty());
        let statistics = summary.statistics.filter(|told| told.channel_count as usize == summary.channels.len());
        match statistics {
            Some(statistics) if whole => {
                opened.schemas.extend(summary.schemas);
                opened.channels.extend(summary.channels);
                opened.counts = statistics.channel_message_counts;
                let bounds = (statistics.message_start_time, statistics.message_end_time);
                let makes_sense = statistics.message_count > 0 && bounds.0 <= bounds.1;
                opened.summary_bounds_ns = makes_sense.then_some(bounds);
            }
            _ => opened.read_everything(problems),
        }
        if opened.profile != "ros2" {
            let reason = format!("the profile is {:?}, in bags of ROS 2 it is \"ros2\"", opened.profile);
            problems.push(BagError::damaged(path, 8, reason));
        }
        Ok(opened)
    }

    pub(super) fn bounds_ns(&self) -> Option<(u64, u64)> {
        let bounds = self.segments.iter().filter(|segment| !segment.is_chunk || segment.end_ns > 0);
        // What is damaged may end before it begins.
        let seen = bounds.map(|segment| (segment.start_ns, segment.end_ns)).filter(|(start, end)| start <= end);
        self.summary_bounds_ns.or_else(|| seen.reduce(|(start, end), (from, to)| (start.min(from), end.max(to))))
    }

    pub(super) fn ros_type(&self, channel: &Channel) -> &str {
        self.schemas.get(&channel.schema_id).map_or("", |schema| schema.name.as_str())
    }

    pub(super) fn topic(&self, id: u16, channel: &Channel, problems: &mut Vec<BagError>) -> Topic {
        let schema = self.schemas.get(&channel.schema_id);
        if schema.is_none() {
            let reason = format!("channel {} has schema {}, which is not there", channel.topic, channel.schema_id);
            problems.push(BagError::invalid(&self.path, reason));
        }
        let of_metadata = |key: &str| channel.metadata.get(key).cloned().unwrap_or_default();
        Topic {
            name: channel.topic.clone(),
            ros_type: self.ros_type(channel).to_owned(),
            message_encoding: channel.message_encoding.clone(),
            schema_encoding: schema.map(|schema| schema.encoding.clone()).unwrap_or_default(),
            schema: schema.map(|schema| schema.text.clone()).unwrap_or_default(),
            qos: of_metadata("offered_qos_profiles"),
            type_hash: of_metadata("topic_type_hash"),
            count: self.counts.get(&id).copied().unwrap_or_default(),
        }
    }

    pub(super) fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>, BagError> {
        let Some((_, offset)) = self.attachments.iter().find(|(known, _)| known == name) else { return Ok(None) };
        let content = self.content_at(*offset, RECORD_BYTES_MAX)?;
        let fail = |reason: String| BagError::damaged(&self.path, *offset, reason);
        // The parser does not expect records without room for the checksum; see `attachment_name`.
        match mcap::parse_record(op::ATTACHMENT, &content).map_err(|error| fail(error.to_string()))? {
            Record::Attachment { data, .. } => Ok(Some(data.into_owned())),
            _ => Err(fail("no attachment".to_owned())),
        }
    }

    /// The records of a segment; those of a chunk are unpacked.
    pub(super) fn unpacked(&self, segment: &FileSegment) -> Result<Bytes, BagError> {
        if segment.is_chunk {
            let content = self.content_at(segment.offset, CHUNK_BYTES_MAX)?;
            unpack(&content).map_err(|reason| BagError::damaged(&self.path, segment.offset, reason))
        } else {
            self.bytes_at(segment.offset, segment.length).map(Bytes::from)
        }
    }

    /// The content of the record that begins at `offset`.
    fn content_at(&self, offset: u64, bytes_max: u64) -> Result<Vec<u8>, BagError> {
        let head = self.bytes_at(offset, RECORD_HEAD_BYTES as u64)?;
        let (_, length) = record_head(&head).unwrap_or_default();
        if length > bytes_max {
            return Err(BagError::damaged(
                &self.path,
                offset,
                format!("a record of {length} bytes, at most {bytes_max}"),
            ));
        }
        self.bytes_at(offset + RECORD_HEAD_BYTES as u64, length)
    }

    fn bytes_at(&self, offset: u64, length: u64) -> Result<Vec<u8>, BagError> {
        let available = self.length.saturating_sub(offset);
        let count = usize::try_from(length).ok().filter(|_| length <= available).ok_or_else(|| {
            BagError::damaged(&self.path, offset, format!("{length} bytes are missing, the file has {available} more"))
        })?;
        let mut bytes = vec![0; count];
        self.file.read_exact_at(&mut bytes, offset).map_err(BagError::io(&self.path))?;
        Ok(bytes)
    }

    fn check_magic(&self) -> Result<(), BagError> {
        let magic = self.bytes_at(0, self.length.min(mcap::MAGIC.len() as u64))?;
        if magic == mcap::MAGIC {
            return Ok(());
        }
        let version =
            mcap::MAGIC.len() == magic.len() && magic[..5] == mcap::MAGIC[..5] && magic[6..] == mcap::MAGIC[6..];
        let reason = if version {
            format!("MCAP version {:?} cannot be read, only '0'", char::from(magic[5]))
        } else {
            "no MCAP file: the magic bytes are missing".to_owned()
        };
        Err(BagError::damaged(&self.path, 0, reason))
    }

    /// Walks from record to record and notes where things lie. Says whether the whole file could be walked through.
    fn walk(&mut self, summary: &summary::FileSummary, problems: &mut Vec<BagError>) -> Result<bool, BagError> {
        let file = self.file.try_clone().map_err(BagError::io(&self.path))?;
        let mut window = FileWindow::new(&file, self.length);
        let mut at = mcap::MAGIC.len() as u64;
        let mut whole = true;
        while at < self.length {
            let head = window.at(at, RECORD_HEAD_BYTES).map_err(BagError::io(&self.path))?;
            let found = record_head(head).filter(|(opcode, _)| *opcode != 0).and_then(|(opcode, length)| {
                let end = (at + RECORD_HEAD_BYTES as u64).checked_add(length).filter(|end| *end <= self.length)?;
                Some((opcode, length, end))
            });
            let noted = match found {
                None => Err("a record reaches beyond the end of the file, or is none".to_owned()),
                Some((op::DATA_END | op::FOOTER, ..)) => break,
                Some((opcode, length, end)) => self.note(opcode, at, length, &mut window).map(|()| end),
            };
            at = match noted {
                Ok(end) => end,
                Err(reason) => {
                    whole = false;
                    problems.push(BagError::damaged(&self.path, at, reason));
                    if problems.len() > PROBLEMS_MAX {
                        break;
                    }
                    match self.next_chunk(at, summary, &mut window).map_err(BagError::io(&self.path))? {
                        Some(next) => next,
                        None => break,
                    }
                }
            };
        }
        if !self.is_complete {
            whole = false;
            let reason = "the file ends without a summary: it was not closed and must be recovered";
            problems.push(BagError::damaged(&self.path, self.length, reason));
        }
        Ok(whole)
    }

    /// Notes a record whose content has `length` bytes, all within the file.
    fn note(&mut self, opcode: u8, at: u64, length: u64, window: &mut FileWindow<'_>) -> Result<(), String> {
        let content_at = at + RECORD_HEAD_BYTES as u64;
        let io = |error: std::io::Error| error.to_string();
        if self.segments.len() + self.attachments.len() + self.metadata.len() > PARTS_MAX {
            return Err(format!("the file has more than {PARTS_MAX} parts"));
        }
        match opcode {
            op::CHUNK => {
                let head = window.at(content_at, CHUNK_HEAD_BYTES + 8).map_err(io)?;
                let (start_ns, end_ns, compression) =
                    chunk_head(head).ok_or("a chunk that is too short for its header")?;
                self.compressions.insert(compression);
                let (offset, length) = (at, RECORD_HEAD_BYTES as u64 + length);
                self.segments.push(FileSegment { offset, length, start_ns, end_ns, is_chunk: true });
            }
            op::MESSAGE => {
                let head = MessageHead::parse(window.at(content_at, MESSAGE_HEAD_BYTES).map_err(io)?);
                let fits = length >= MESSAGE_HEAD_BYTES as u64;
                let head = head.filter(|_| fits).ok_or("a message that is too short for its header")?;
                self.note_plain(at, RECORD_HEAD_BYTES as u64 + length, head.log_ns);
            }
            op::ATTACHMENT => {
                let head =
                    window.at(content_at, usize::try_from(length).unwrap_or(usize::MAX).min(4096)).map_err(io)?;
                let name = attachment_name(head, length).ok_or("an attachment that is too short for its header")?;
                self.attachments.push((name, at));
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => {
                let size = usize::try_from(length).ok().filter(|_| length <= RECORD_BYTES_MAX);
                let size = size.ok_or_else(|| format!("a record of {length} bytes, at most {RECORD_BYTES_MAX}"))?;
                let content = window.at(content_at, size).map_err(io)?.to_vec();
                self.describe(opcode, &content)?;
            }
            // Indexes are not needed, and what later versions add is to be skipped.
            _ => {}
        }
        Ok(())
    }

    fn note_plain(&mut self, offset: u64, length: u64, log_ns: u64) {
        match self.segments.last_mut() {
            Some(last) if !last.is_chunk && last.offset + last.length == offset && last.length < PLAIN_BYTES => {
                last.length += length;
                last.start_ns = last.start_ns.min(log_ns);
                last.end_ns = last.end_ns.max(log_ns);
            }
            _ => {
                let (start_ns, end_ns) = (log_ns, log_ns);
                self.segments.push(FileSegment { offset, length, start_ns, end_ns, is_chunk: false });
            }
        }
    }

    /// Takes in a record that describes others.
    fn describe(&mut self, opcode: u8, content: &[u8]) -> Result<(), String> {
        self.description_bytes += content.len();
        if self.description_bytes > DESCRIPTION_BYTES_MAX {
            return Err(format!("what describes the messages takes more than {DESCRIPTION_BYTES_MAX} bytes"));
        }
        match mcap::parse_record(opcode, content).map_err(|error| error.to_string())? {
            Record::Header(header) => (self.profile, self.library) = (header.profile, header.library),
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, Schema::new(header, &data));
            }
            Record::Channel(channel) => {
                self.channels.insert(channel.id, channel);
            }
            Record::Metadata(metadata) => self.metadata.push(metadata),
            _ => {}
        }
        Ok(())
    }

    /// Where the next chunk after a damaged place begins: by the summary, else by what packed chunks look like.
    fn next_chunk(
        &self,
        after: u64,
        summary: &summary::FileSummary,
        window: &mut FileWindow<'_>,
    ) -> std::io::Result<Option<u64>> {
        let mut known: Vec<u64> = summary.chunks.iter().map(|chunk| chunk.chunk_start_offset).collect();
        known.sort_unstable();
        if let Some(next) = known.into_iter().find(|offset| *offset > after) {
            return Ok(Some(next));
        }
        const STEP: usize = 32 * 1024;
        const MARKS: [&[u8]; 2] = [b"\x04\0\0\0zstd", b"\x03\0\0\0lz4"];
        // The mark stands behind opcode, length, times, size and checksum.
        const BEFORE: u64 = RECORD_HEAD_BYTES as u64 + 8 + 8 + 8 + 4;
        let mut at = after + 1;
        while at < self.length {
            let bytes = window.at(at, STEP + 16)?;
            let marks = (0..bytes.len().min(STEP)).filter(|i| MARKS.iter().any(|mark| bytes[*i..].starts_with(mark)));
            let starts: Vec<u64> = marks.filter_map(|i| (at + i as u64).checked_sub(BEFORE)).collect();
            for start in starts.into_iter().filter(|start| *start > after) {
                let head = record_head(window.at(start, RECORD_HEAD_BYTES)?);
                let end =
                    head.filter(|(opcode, _)| *opcode == op::CHUNK).and_then(|(_, length)| start.checked_add(length));
                if end.is_some_and(|end| end <= self.length) {
                    return Ok(Some(start));
                }
            }
            at += STEP as u64;
        }
        Ok(None)
    }

    /// Reads all messages to learn what the summary would tell. Parts that cannot be read are problems.
    fn read_everything(&mut self, problems: &mut Vec<BagError>) {
        let mut counts = BTreeMap::new();
        for segment in self.segments.clone() {
            let bytes = match self.unpacked(&segment) {
                Ok(bytes) => bytes,
                Err(error) => {
                    problems.push(error);
                    continue;
                }
            };
            let mut faults = 0;
            for record in records_in(&bytes) {
                let noted = record.and_then(|(opcode, range)| match opcode {
                    op::SCHEMA | op::CHANNEL => {
                        self.describe(opcode, &bytes[range.clone()]).map_err(|reason| (range.start, reason))
                    }
                    op::MESSAGE => {
                        let head = MessageHead::parse(&bytes[range.clone()]);
                        let head =
                            head.ok_or((range.start, "a message that is too short for its header".to_owned()))?;
                        *counts.entry(head.channel).or_default() += 1;
                        Ok(())
                    }
                    _ => Ok(()),
                });
                if let Err((within, reason)) = noted {
                    faults += 1;
                    if faults > PROBLEMS_PER_CHUNK {
                        break;
                    }
                    let reason = format!("{reason} (byte {within} of the records there)");
                    problems.push(BagError::damaged(&self.path, segment.offset, reason));
                }
            }
        }
        self.counts = counts;
    }
}

/// First and last time and compression of a chunk, from the start of its content.
fn chunk_head(content: &[u8]) -> Option<(u64, u64, String)> {
    let (start, rest) = content.split_first_chunk()?;
    let (end, rest) = rest.split_first_chunk()?;
    let length = usize::try_from(u32::from_le_bytes(*rest.get(12..16)?.first_chunk()?)).ok()?;
    let compression = rest.get(16..16_usize.checked_add(length)?)?;
    Some((u64::from_le_bytes(*start), u64::from_le_bytes(*end), String::from_utf8_lossy(compression).into_owned()))
}

/// The name of an attachment, from the start of its content of `length` bytes, if all its parts have room.
fn attachment_name(content: &[u8], length: u64) -> Option<String> {
    let text = |at: usize| {
        let length = usize::try_from(u32::from_le_bytes(*content.get(at..)?.first_chunk()?)).ok()?;
        let end = (at + 4).checked_add(length)?;
        Some((content.get(at + 4..end)?, end))
    };
    // Log time and creation time, name, media type, data with their length, checksum.
    let (name, end) = text(16)?;
    let (_, end) = text(end)?;
    let room = length.checked_sub(end as u64 + 8 + 4)?;
    let data = u64::from_le_bytes(*content.get(end..)?.first_chunk()?);
    (data <= room).then(|| String::from_utf8_lossy(name).into_owned())
}
