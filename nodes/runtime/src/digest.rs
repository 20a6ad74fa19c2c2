//! A fingerprint of everything a run published: per topic the number of messages and the SHA-256 of their payloads.
//!
//! Each node hashes what it publishes and leaves the result in a file; [`merge`] puts them together. The order is that
//! of ticks, then publishers, then sequence. A latched message counts at tick 0.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::dds::Durability;
use crate::node::{Port, PortKind};

/// Topics that no digest covers, because their content depends on wall time.
const EXCLUDED: [&str; 4] = ["/rosout", "/parameter_events", "/diagnostics", "/ros_discovery_info"];

/// One line of a digest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DigestLine {
    /// The topic.
    pub topic: String,
    /// How many messages were published on it.
    pub count: u64,
    /// SHA-256 over their CDR payloads, in hexadecimal.
    pub sha256: String,
}

impl std::fmt::Display for DigestLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {} {}", self.topic, self.count, self.sha256)
    }
}

/// What one node leaves in its file: topic → what it published there.
type NodeDigest = BTreeMap<String, Published>;

#[derive(Debug, Serialize, Deserialize)]
enum Published {
    /// The only publisher of its topic: the hash is final.
    Alone { count: u64, sha256: String },
    /// One of several: (tick, payload) in order.
    Shared(Vec<(u64, Vec<u8>)>),
}

#[derive(Debug)]
enum Running {
    Alone { count: u64, hash: Sha256 },
    Shared(Vec<(u64, Vec<u8>)>),
}

/// The digest of one node, while it runs.
#[derive(Debug)]
pub struct Digest {
    file: Option<PathBuf>,
    shared_topics: BTreeSet<String>,
    topics: BTreeMap<String, Running>,
}

impl Digest {
    /// A digest that is kept for `node` in `dir`, or none at all.
    #[must_use]
    pub fn new(dir: Option<&Path>, node: &str, shared_topics: &[String]) -> Self {
        let file = dir.map(|dir| dir.join(format!("{}.json", node.trim_matches('/').replace('/', "."))));
        Self { file, shared_topics: shared_topics.iter().cloned().collect(), topics: BTreeMap::new() }
    }

    /// Whether anything is kept.
    #[must_use]
    pub fn active(&self) -> bool {
        self.file.is_some()
    }

    /// Adds a message that `port` published in `tick`.
    pub fn add(&mut self, port: &Port, tick: u64, payload: &[u8]) {
        if !self.active() || port.kind != PortKind::Publish || !covered(&port.name) {
            return;
        }
        let shared = self.shared_topics.contains(&port.name);
        let topic = self.topics.entry(port.name.clone()).or_insert_with(|| {
            if shared { Running::Shared(Vec::new()) } else { Running::Alone { count: 0, hash: Sha256::new() } }
        });
        match topic {
            Running::Alone { count, hash } => {
                *count += 1;
                hash.update(payload);
            }
            Running::Shared(messages) => {
                messages
                    .push((if port.qos.durability == Durability::TransientLocal { 0 } else { tick }, payload.to_vec()));
            }
        }
    }

    /// Writes the file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> std::io::Result<()> {
        let Some(file) = self.file else { return Ok(()) };
        let topics: NodeDigest = self
            .topics
            .into_iter()
            .map(|(topic, running)| {
                let published = match running {
                    Running::Alone { count, hash } => Published::Alone { count, sha256: hex(&hash.finalize()) },
                    Running::Shared(messages) => Published::Shared(messages),
                };
                (topic, published)
            })
            .collect();
        std::fs::write(file, serde_json::to_vec(&topics)?)
    }
}

/// Puts together what the nodes left in `dir`, sorted by topic.
///
/// # Errors
/// When a file cannot be read or is not a digest.
pub fn merge(dir: &Path) -> std::io::Result<Vec<DigestLine>> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(dir)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.sort();
    let mut lines = Vec::new();
    let mut shared: BTreeMap<String, Vec<(u64, Vec<u8>)>> = BTreeMap::new();
    for file in files {
        let topics: NodeDigest = serde_json::from_slice(&std::fs::read(file)?)?;
        for (topic, published) in topics {
            match published {
                Published::Alone { count, sha256 } => lines.push(DigestLine { topic, count, sha256 }),
                Published::Shared(messages) => shared.entry(topic).or_default().extend(messages),
            }
        }
    }
    for (topic, mut messages) in shared {
        // Stable: within a tick, files and so publishers stay in order of name, and messages in order of sequence.
        messages.sort_by_key(|(tick, _)| *tick);
        let mut hash = Sha256::new();
        for (_, payload) in &messages {
            hash.update(payload);
        }
        lines.push(DigestLine { topic, count: messages.len() as u64, sha256: hex(&hash.finalize()) });
    }
    lines.sort_by(|a, b| a.topic.cmp(&b.topic));
    Ok(lines)
}

/// Whether a digest covers `topic`: not those of wall time, and nothing hidden.
fn covered(topic: &str) -> bool {
    !EXCLUDED.contains(&topic) && !topic.split('/').any(|token| token.starts_with('_'))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
