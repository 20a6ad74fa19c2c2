//! The summary at the end of a file that was closed well.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt as _;

use mcap::records::{Channel, ChunkIndex, Footer, Record, Statistics, op};

use super::RECORD_BYTES_MAX;
use super::chunk::{RECORD_HEAD_BYTES, records};
use super::schema::Schema;

/// A footer with its head, and the magic bytes.
const ENDING_BYTES: usize = RECORD_HEAD_BYTES + 20 + mcap::MAGIC.len();

#[derive(Debug, Default)]
pub(super) struct FileSummary {
    pub(super) schemas: BTreeMap<u16, Schema>,
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) statistics: Option<Statistics>,
    pub(super) chunks: Vec<ChunkIndex>,
}

/// Reads the summary of a file of `length` bytes; none when the file does not end with one.
///
/// # Errors
/// The place, and what is wrong there.
pub(super) fn read(file: &File, length: u64) -> Result<Option<FileSummary>, (u64, String)> {
    let Some(footer_at) = length.checked_sub(ENDING_BYTES as u64).filter(|at| *at >= mcap::MAGIC.len() as u64) else {
        return Ok(None);
    };
    let mut ending = [0; ENDING_BYTES];
    file.read_exact_at(&mut ending, footer_at).map_err(|error| (footer_at, error.to_string()))?;
    let content = ending.strip_suffix(mcap::MAGIC).and_then(|footer| footer.strip_prefix(&FOOTER_HEAD));
    let Some(content) = content else { return Ok(None) };
    let Ok(Record::Footer(footer)) = mcap::parse_record(op::FOOTER, content) else { return Ok(None) };
    let Footer { summary_start, summary_crc, .. } = footer;
    if summary_start == 0 {
        return Ok(Some(FileSummary::default()));
    }
    let size = footer_at.checked_sub(summary_start).filter(|size| *size <= RECORD_BYTES_MAX);
    let size = size.and_then(|size| usize::try_from(size).ok()).ok_or_else(|| {
        let reason = format!("the summary is said to begin at byte {summary_start}; it can be at most {RECORD_BYTES_MAX} bytes long and must lie before its footer");
        (footer_at, reason)
    })?;
    let mut bytes = vec![0; size];
    file.read_exact_at(&mut bytes, summary_start).map_err(|error| (summary_start, error.to_string()))?;
    if summary_crc != 0 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&bytes);
        // The footer up to the checksum itself is part of what is summed.
        hasher.update(&ending[..RECORD_HEAD_BYTES + 16]);
        let checksum = hasher.finalize();
        if checksum != summary_crc {
            let reason = format!("the summary's checksum is {checksum:08x}, the footer says {summary_crc:08x}");
            return Err((summary_start, reason));
        }
    }
    let mut summary = FileSummary::default();
    for record in records(&bytes) {
        let (opcode, range) = record.map_err(|(at, reason)| (summary_start + at as u64, reason))?;
        let place = summary_start + range.start as u64;
        // Attachments have no place here, and their parser is not safe against short ones.
        if opcode == op::ATTACHMENT {
            continue;
        }
        match mcap::parse_record(opcode, &bytes[range]).map_err(|error| (place, error.to_string()))? {
            Record::Schema { header, data } => {
                summary.schemas.insert(header.id, Schema::new(header, &data));
            }
            Record::Channel(channel) => {
                summary.channels.insert(channel.id, channel);
            }
            Record::Statistics(statistics) => summary.statistics = Some(statistics),
            Record::ChunkIndex(index) => summary.chunks.push(index),
            _ => {}
        }
    }
    Ok(Some(summary))
}

const FOOTER_HEAD: [u8; RECORD_HEAD_BYTES] = [op::FOOTER, 20, 0, 0, 0, 0, 0, 0, 0];
