//! The messages of a bag in the order of their times.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap, VecDeque};

use bytes::Bytes;
use mcap::records::op;

use super::chunk::{MESSAGE_HEAD_BYTES, MessageHead, records};
use super::file::FileSegment;
use super::{Bag, PROBLEMS_PER_CHUNK};
use crate::error::BagError;

/// Unpacked parts of a bag that overlap in time are kept together, up to this many bytes. Beyond, messages come in the
/// order of the file.
const OPEN_BYTES_MAX: usize = 512 << 20;

/// Which messages are asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Query {
    /// Indices of the topics in [`Bag::topics`]; all when none are named.
    pub topics: Option<BTreeSet<usize>>,
    /// Messages before this time are left out, ns.
    pub start_ns: u64,
    /// Messages after this time are left out, ns.
    pub end_ns: u64,
}

impl Default for Query {
    fn default() -> Self {
        Self { topics: None, start_ns: 0, end_ns: u64::MAX }
    }
}

impl Query {
    /// The messages of one topic.
    #[must_use]
    pub fn topic(index: usize) -> Self {
        Self { topics: Some(BTreeSet::from([index])), ..Self::default() }
    }
}

/// A message of a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedMessage {
    /// Index of its topic in [`Bag::topics`].
    pub topic: usize,
    /// When it was recorded, ns.
    pub log_ns: u64,
    /// When it was published, ns.
    pub publish_ns: u64,
    /// Its number among those of its publisher, or of the topic; zero where the recorder gave none.
    pub sequence: u32,
    /// Its bytes: in CDR, with the encapsulation header.
    pub data: Bytes,
}

/// See [`Bag::messages`].
pub struct Messages<'a> {
    bag: &'a Bag,
    query: Query,
    /// Segments to come, the first at the end: file, and number in the file.
    coming: Vec<(usize, usize)>,
    /// Of each open segment the time of the first message, and where the segment stands in the bag.
    fronts: BinaryHeap<Reverse<(u64, (usize, usize))>>,
    open: BTreeMap<(usize, usize), OpenSegment>,
    open_bytes: usize,
    errors: VecDeque<BagError>,
    order_lost: bool,
}

struct OpenSegment {
    bytes: usize,
    messages: VecDeque<RecordedMessage>,
}

impl<'a> Messages<'a> {
    pub(super) fn new(bag: &'a Bag, query: &Query) -> Self {
        let mut coming: Vec<(usize, usize)> = Vec::new();
        for (file, mcap) in bag.files.iter().enumerate() {
            let wanted = mcap.segments.iter().enumerate().filter(|(_, segment)| {
                // The times of a chunk without messages are zero; nothing is lost by reading it.
                segment.end_ns >= query.start_ns && segment.start_ns <= query.end_ns
            });
            coming.extend(wanted.map(|(segment, _)| (file, segment)));
        }
        coming.sort_by_key(|&(file, segment)| (bag.files[file].segments[segment].start_ns, file, segment));
        coming.reverse();
        Self {
            bag,
            query: query.clone(),
            coming,
            fronts: BinaryHeap::new(),
            open: BTreeMap::new(),
            open_bytes: 0,
            errors: VecDeque::new(),
            order_lost: false,
        }
    }

    fn segment(&self, (file, segment): (usize, usize)) -> &'a FileSegment {
        &self.bag.files[file].segments[segment]
    }

    /// Opens every segment that may have something before the first message known.
    fn open_what_is_due(&mut self) {
        while let Some(&next) = self.coming.last() {
            let first = self.fronts.peek().map(|Reverse((log_ns, _))| *log_ns);
            if first.is_some_and(|first| self.segment(next).start_ns > first) {
                break;
            }
            if first.is_some() && self.open_bytes > OPEN_BYTES_MAX {
                if !self.order_lost {
                    self.order_lost = true;
                    let reason = format!(
                        "more than {OPEN_BYTES_MAX} bytes overlap in time: messages do not come in the order of their times"
                    );
                    self.errors.push_back(BagError::damaged(
                        &self.bag.files[next.0].path,
                        self.segment(next).offset,
                        reason,
                    ));
                }
                break;
            }
            self.coming.pop();
            self.open_segment(next);
        }
    }

    fn open_segment(&mut self, place: (usize, usize)) {
        let file = &self.bag.files[place.0];
        let segment = self.segment(place);
        let bytes = match file.unpacked(segment) {
            Ok(bytes) => bytes,
            Err(error) => return self.errors.push_back(error),
        };
        let mut messages = Vec::new();
        let errors_before = self.errors.len();
        for record in records(&bytes) {
            // A chunk that is full of faults has nothing more to say.
            if self.errors.len() - errors_before >= PROBLEMS_PER_CHUNK {
                break;
            }
            let fail = |within: usize, reason: &str| {
                let reason = format!("{reason} (byte {within} of the records there)");
                BagError::damaged(&file.path, segment.offset, reason)
            };
            let (opcode, range) = match record {
                Ok(found) => found,
                Err((within, reason)) => {
                    self.errors.push_back(fail(within, &reason));
                    continue;
                }
            };
            if opcode != op::MESSAGE {
                continue;
            }
            let Some(head) = MessageHead::parse(&bytes[range.clone()]) else {
                self.errors.push_back(fail(range.start, "a message that is too short for its header"));
                continue;
            };
            let MessageHead { channel, sequence, log_ns, publish_ns } = head;
            let Some(&topic) = self.bag.channels.get(&(place.0, channel)) else {
                // A channel of a topic that is there twice is known, and left out on purpose.
                if !file.channels.contains_key(&channel) {
                    let reason = format!("a message of channel {channel}, which is not described");
                    self.errors.push_back(fail(range.start, &reason));
                }
                continue;
            };
            let wanted = self.query.topics.as_ref().is_none_or(|topics| topics.contains(&topic));
            if wanted && (self.query.start_ns..=self.query.end_ns).contains(&log_ns) {
                let data = bytes.slice(range.start + MESSAGE_HEAD_BYTES..range.end);
                messages.push(RecordedMessage { topic, log_ns, publish_ns, sequence, data });
            }
        }
        // Stable: messages of one time stay in the order of the file.
        messages.sort_by_key(|message| message.log_ns);
        if let Some(first) = messages.first() {
            self.fronts.push(Reverse((first.log_ns, place)));
            let bytes = bytes.len() + messages.len() * size_of::<RecordedMessage>();
            self.open_bytes += bytes;
            self.open.insert(place, OpenSegment { bytes, messages: messages.into() });
        }
    }
}

impl Iterator for Messages<'_> {
    type Item = Result<RecordedMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.open_what_is_due();
        if let Some(error) = self.errors.pop_front() {
            return Some(Err(error));
        }
        let Reverse((_, place)) = self.fronts.pop()?;
        let segment = self.open.get_mut(&place)?;
        let message = segment.messages.pop_front()?;
        match segment.messages.front() {
            Some(next) => self.fronts.push(Reverse((next.log_ns, place))),
            None => {
                self.open_bytes -= segment.bytes;
                self.open.remove(&place);
            }
        }
        Some(Ok(message))
    }
}
