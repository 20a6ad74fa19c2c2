//! Whether two bags hold the same, topic by topic.

use std::collections::BTreeMap;
use std::fmt;

use sha2::{Digest as _, Sha256};

use crate::cdr::{Leaf, MessageType};
use crate::error::{BagError, Seconds};
use crate::read::{Bag, Messages, Query, RecordedMessage, Topic};
use crate::selection::Selection;

/// What counts as the same.
#[derive(Debug, Clone, Default)]
pub struct DiffSettings {
    /// The topics that are compared.
    pub selection: Selection,
    /// Numbers that differ by no more than this, or by no more than `relative` times the larger of them, are the same.
    /// Both zero: messages must be the same byte by byte.
    pub absolute: f64,
    /// See `absolute`.
    pub relative: f64,
    /// Times of messages in the bag need not be the same.
    pub ignore_time: bool,
    /// Messages from this time on are not compared, ns.
    pub before_ns: Option<u64>,
}

/// How one topic compares.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicDiff {
    /// Its name.
    pub topic: String,
    /// Number of messages in each bag.
    pub counts: [u64; 2],
    /// The first difference, if there is one.
    pub first: Option<Difference>,
}

/// Where two bags differ first, in one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Time of the message in the first bag, or in the second when the first has no more, ns; none when it is not about a
    /// message.
    pub log_ns: Option<u64>,
    /// What differs.
    pub what: String,
}

impl fmt::Display for TopicDiff {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b] = self.counts;
        match &self.first {
            None => write!(f, "same    {} ({a} messages)", self.topic),
            Some(Difference { log_ns: Some(log_ns), what }) => {
                write!(f, "DIFFERS {} ({a} and {b} messages) first at {}: {what}", self.topic, Seconds(*log_ns))
            }
            Some(Difference { log_ns: None, what }) => {
                write!(f, "DIFFERS {} ({a} and {b} messages): {what}", self.topic)
            }
        }
    }
}

/// The outcome of a comparison.
#[derive(Debug, Default)]
pub struct Diff {
    /// The topics of either bag, by name.
    pub topics: Vec<TopicDiff>,
    /// Parts of a bag that could not be read.
    pub unreadable: Vec<BagError>,
}

impl Diff {
    /// Whether nothing differs, and all could be read.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.unreadable.is_empty() && self.topics.iter().all(|topic| topic.first.is_none())
    }
}

/// Compares two bags. Each is read once, and the topics that differ once more; memory does not grow with the bags.
#[must_use]
pub fn diff(a: &Bag, b: &Bag, settings: &DiffSettings) -> Diff {
    let mut diff = Diff::default();
    let [prints_a, prints_b] = [a, b].map(|bag| fingerprints(bag, settings, &mut diff.unreadable));
    let mut topics: BTreeMap<&str, [Option<usize>; 2]> = BTreeMap::new();
    for (side, bag) in [a, b].into_iter().enumerate() {
        for (index, topic) in bag.topics().iter().enumerate() {
            if settings.selection.takes(&topic.name, &topic.ros_type) {
                topics.entry(&topic.name).or_default()[side] = Some(index);
            }
        }
    }
    for (name, sides) in topics {
        let [print_a, print_b] = [sides[0].map(|index| &prints_a[index]), sides[1].map(|index| &prints_b[index])];
        let count = |print: Option<&Fingerprint>| print.map_or(0, |print| print.count);
        let first = match sides {
            [Some(in_a), Some(in_b)] => {
                let (topic_a, topic_b) = (&a.topics()[in_a], &b.topics()[in_b]);
                if topic_a.ros_type != topic_b.ros_type {
                    let what = format!("type {} against {}", topic_a.ros_type, topic_b.ros_type);
                    Some(Difference { log_ns: None, what })
                } else if print_a == print_b {
                    None
                } else {
                    let messages =
                        [(a, in_a), (b, in_b)].map(|(bag, index)| bag.messages(&query(settings, Some(index))));
                    first_difference(messages, [topic_a, topic_b], settings)
                }
            }
            [Some(_), None] => Some(Difference { log_ns: None, what: "only in the first bag".to_owned() }),
            _ => Some(Difference { log_ns: None, what: "only in the second bag".to_owned() }),
        };
        diff.topics.push(TopicDiff { topic: name.to_owned(), counts: [count(print_a), count(print_b)], first });
    }
    diff
}

fn query(settings: &DiffSettings, topic: Option<usize>) -> Query {
    let end_ns = settings.before_ns.map_or(u64::MAX, |before| before.saturating_sub(1));
    Query { end_ns, ..topic.map(Query::topic).unwrap_or_default() }
}

#[derive(Debug, PartialEq, Eq)]
struct Fingerprint {
    count: u64,
    sha256: [u8; 32],
}

/// Of each topic, what tells it from every other sequence of messages.
fn fingerprints(bag: &Bag, settings: &DiffSettings, unreadable: &mut Vec<BagError>) -> Vec<Fingerprint> {
    let mut running: Vec<(u64, Sha256)> = bag.topics().iter().map(|_| (0, Sha256::new())).collect();
    for message in bag.messages(&query(settings, None)) {
        match message {
            Ok(message) => {
                let (count, hash) = &mut running[message.topic];
                *count += 1;
                if !settings.ignore_time {
                    hash.update(message.log_ns.to_le_bytes());
                }
                hash.update((message.data.len() as u64).to_le_bytes());
                hash.update(&message.data);
            }
            Err(error) => unreadable.push(error),
        }
    }
    running.into_iter().map(|(count, hash)| Fingerprint { count, sha256: hash.finalize().into() }).collect()
}

fn first_difference(
    [mut a, mut b]: [Messages<'_>; 2],
    topics: [&Topic; 2],
    settings: &DiffSettings,
) -> Option<Difference> {
    let types = topics.map(|topic| MessageType::parse(&topic.ros_type, &topic.schema).ok());
    // What cannot be read has been said already.
    let next = |messages: &mut Messages<'_>| messages.find_map(Result::ok);
    let mut number = 0_u64;
    loop {
        let (log_ns, what) = match (next(&mut a), next(&mut b)) {
            (None, None) => return None,
            (Some(a), None) => (a.log_ns, "the second bag has no more messages".to_owned()),
            (None, Some(b)) => (b.log_ns, "the first bag has no more messages".to_owned()),
            (Some(a), Some(b)) => match compare(&a, &b, &types, settings) {
                None => {
                    number += 1;
                    continue;
                }
                Some(what) => (a.log_ns, what),
            },
        };
        return Some(Difference { log_ns: Some(log_ns), what: format!("message {number}: {what}") });
    }
}

fn compare(
    a: &RecordedMessage,
    b: &RecordedMessage,
    types: &[Option<MessageType>; 2],
    settings: &DiffSettings,
) -> Option<String> {
    if !settings.ignore_time && a.log_ns != b.log_ns {
        return Some(format!("time {} against {}", Seconds(a.log_ns), Seconds(b.log_ns)));
    }
    if a.data == b.data {
        return None;
    }
    let exact = settings.absolute <= 0.0 && settings.relative <= 0.0;
    let leaves = [(a, &types[0]), (b, &types[1])].map(|(message, ty)| leaves(message, ty.as_ref()));
    let [Some(leaves_a), Some(leaves_b)] = leaves else {
        let at = a.data.iter().zip(&b.data).take_while(|(a, b)| a == b).count();
        return Some(format!("the bytes differ from byte {at} on ({} and {} bytes)", a.data.len(), b.data.len()));
    };
    for (a, b) in leaves_a.iter().zip(&leaves_b) {
        if a.path != b.path {
            return Some(format!("field {} against {}", a.path, b.path));
        }
        if !a.is_near(b, settings) {
            return Some(format!("{} is {} against {}", a.path, a.shown, b.shown));
        }
    }
    let longer = leaves_a.get(leaves_b.len()).or(leaves_b.get(leaves_a.len()));
    match longer {
        Some(leaf) => Some(format!("{} is only in one of them", leaf.path)),
        None if exact => Some("the bytes differ, although every field reads the same".to_owned()),
        None => None,
    }
}

/// A value of a message, to be compared with another's.
struct OwnedLeaf {
    path: String,
    number: Option<f64>,
    /// Numbers exactly, also those that a float cannot hold, and everything else.
    exact: Exact,
    shown: String,
}

#[derive(PartialEq)]
enum Exact {
    Number(u64),
    Bytes(Vec<u8>),
}

impl OwnedLeaf {
    fn new(path: &str, leaf: Leaf<'_>) -> Self {
        let exact = match leaf {
            Leaf::Bool(value) => Exact::Number(value.into()),
            Leaf::Int(value) => Exact::Number(value.cast_unsigned()),
            Leaf::Uint(value) => Exact::Number(value),
            Leaf::Float32(value) => Exact::Number(value.to_bits().into()),
            Leaf::Float64(value) => Exact::Number(value.to_bits()),
            Leaf::Text(text) => Exact::Bytes(text.as_bytes().to_vec()),
            Leaf::Bytes(bytes) => Exact::Bytes(bytes.to_vec()),
        };
        Self { path: path.to_owned(), number: leaf.number(), exact, shown: leaf.to_string() }
    }

    fn is_near(&self, other: &Self, settings: &DiffSettings) -> bool {
        if self.exact == other.exact {
            return true;
        }
        let (Some(a), Some(b)) = (self.number, other.number) else { return false };
        (a - b).abs() <= settings.absolute.max(settings.relative * a.abs().max(b.abs()))
            && (settings.absolute > 0.0 || settings.relative > 0.0)
    }
}

fn leaves(message: &RecordedMessage, ty: Option<&MessageType>) -> Option<Vec<OwnedLeaf>> {
    let mut leaves = Vec::new();
    ty?.walk(&message.data, &mut |path, leaf| leaves.push(OwnedLeaf::new(path, leaf))).ok()?;
    Some(leaves)
}
