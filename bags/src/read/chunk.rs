//! Chunks and the records in them.

use std::io::Read;

use bytes::Bytes;
use mcap::records::{ChunkHeader, Record, op};

use super::CHUNK_BYTES_MAX;

/// Opcode and length before each record.
pub(super) const RECORD_HEAD_BYTES: usize = 9;
/// Channel, sequence, log time and publish time before each message's data.
pub(super) const MESSAGE_HEAD_BYTES: usize = 22;

/// The opcode and the length of the content at the start of `bytes`.
pub(super) fn record_head(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&opcode, rest) = bytes.split_first()?;
    Some((opcode, u64::from_le_bytes(rest.first_chunk().copied()?)))
}

/// What stands before a message's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageHead {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    pub(super) log_ns: u64,
    pub(super) publish_ns: u64,
}

impl MessageHead {
    pub(super) fn parse(content: &[u8]) -> Option<Self> {
        let (channel, rest) = content.split_first_chunk()?;
        let (sequence, rest) = rest.split_first_chunk()?;
        let (log, rest) = rest.split_first_chunk()?;
        Some(Self {
            channel: u16::from_le_bytes(*channel),
            sequence: u32::from_le_bytes(*sequence),
            log_ns: u64::from_le_bytes(*log),
            publish_ns: u64::from_le_bytes(*rest.first_chunk()?),
        })
    }
}

/// The records in a chunk, from the content of its own record.
///
/// # Errors
/// What is wrong with it.
pub(super) fn unpack(content: &[u8]) -> Result<Bytes, String> {
    let Record::Chunk { header, data } = mcap::parse_record(op::CHUNK, content).map_err(|error| error.to_string())?
    else {
        return Err("no chunk".to_owned());
    };
    let ChunkHeader { uncompressed_size, uncompressed_crc, compression, .. } = header;
    if uncompressed_size > CHUNK_BYTES_MAX {
        return Err(format!("a chunk of {uncompressed_size} bytes; at most {CHUNK_BYTES_MAX} are read"));
    }
    let records = match compression.as_str() {
        "" => Ok(data.to_vec()),
        "zstd" => zstd::stream::read::Decoder::with_buffer(&*data).and_then(|from| read(from, uncompressed_size)),
        "lz4" => lz4::Decoder::new(&*data).and_then(|from| read(from, uncompressed_size)),
        other => return Err(format!("compression {other:?} cannot be unpacked, only zstd, lz4 and none")),
    };
    let records = records.map_err(|error| format!("the chunk cannot be unpacked: {error}"))?;
    if records.len() as u64 != uncompressed_size {
        return Err(format!("the chunk holds {} bytes, its header says {uncompressed_size}", records.len()));
    }
    let checksum = crc32fast::hash(&records);
    if uncompressed_crc != 0 && checksum != uncompressed_crc {
        return Err(format!("the chunk's checksum is {checksum:08x}, its header says {uncompressed_crc:08x}"));
    }
    Ok(Bytes::from(records))
}

/// Reads what there is, at most one byte more than expected; memory grows with what comes, not with what is promised.
fn read(from: impl Read, expected: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(expected + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A record within other bytes: opcode, and where its content begins and ends.
pub(super) type Found = (u8, std::ops::Range<usize>);

/// The records in `bytes`, one after the other; an error, with its place, is the last.
pub(super) fn records(bytes: &[u8]) -> impl Iterator<Item = Result<Found, (usize, String)>> + '_ {
    let mut at = 0;
    std::iter::from_fn(move || {
        if at >= bytes.len() {
            return None;
        }
        let start = at;
        let found = record_head(&bytes[at..]).and_then(|(opcode, length)| {
            let from = at + RECORD_HEAD_BYTES;
            let to = from.checked_add(usize::try_from(length).ok()?).filter(|to| *to <= bytes.len())?;
            Some((opcode, from..to))
        });
        at = found.as_ref().map_or(bytes.len(), |(_, range)| range.end);
        Some(found.ok_or_else(|| (start, "a record reaches beyond its chunk".to_owned())))
    })
}
