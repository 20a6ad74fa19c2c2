//! A fingerprint of everything a run published: per topic the number of messages and the SHA-256 of their payloads.
//!
//! Each node hashes what it publishes and leaves the result in a file; [`merge`] puts them together. The order is that
//! of ticks, then publishers, then sequence. A latched message counts at tick 0.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::Error;
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
/// When a file cannot be read or is not a digest; the error names it.
pub fn merge(dir: &Path) -> std::io::Result<Vec<DigestLine>> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(dir)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.sort();
    let mut lines = Vec::new();
    let mut shared: BTreeMap<String, Vec<(u64, Vec<u8>)>> = BTreeMap::new();
    for file in files {
        let topics = read(&file).map_err(|error| Error::new(error.kind(), format!("{}: {error}", file.display())))?;
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

fn read(file: &Path) -> std::io::Result<NodeDigest> {
    Ok(serde_json::from_slice(&std::fs::read(file)?)?)
}

/// Whether a digest covers `topic`: not those of wall time, and nothing hidden.
pub(crate) fn covered(topic: &str) -> bool {
    !EXCLUDED.contains(&topic) && !topic.split('/').any(|token| token.starts_with('_'))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dds::Qos;

    fn port(name: &str, qos: Qos) -> Port {
        let (ros_type, dds_types) = ("std_msgs/msg/String".to_owned(), Vec::new());
        Port { kind: PortKind::Publish, name: name.into(), ros_type, dds_types, qos }
    }

    fn sha256(bytes: &[u8]) -> String {
        hex(&Sha256::digest(bytes))
    }

    /// What the nodes of a run publish: (node, port, tick, payload), in the order in which each node does.
    fn merged(shared: &[&str], published: &[(&str, &Port, u64, &str)]) -> Vec<DigestLine> {
        let dir = tempfile::tempdir().unwrap();
        let shared: Vec<String> = shared.iter().map(ToString::to_string).collect();
        let nodes: BTreeSet<&str> = published.iter().map(|(node, ..)| *node).collect();
        for node in nodes {
            let mut digest = Digest::new(Some(dir.path()), node, &shared);
            for (_, port, tick, payload) in published.iter().filter(|(of, ..)| *of == node) {
                digest.add(port, *tick, payload.as_bytes());
            }
            digest.finish().unwrap();
        }
        merge(dir.path()).unwrap()
    }

    fn line(topic: &str, count: u64, payloads: &str) -> DigestLine {
        DigestLine { topic: topic.into(), count, sha256: sha256(payloads.as_bytes()) }
    }

    #[test]
    fn topics_are_hashed_in_order_and_sorted_by_name() {
        let (x, y) = (port("/x", Qos::command()), port("/y", Qos::command()));
        let lines = merged(&[], &[("/b", &y, 0, "1"), ("/b", &y, 5, "2"), ("/a", &x, 3, "3")]);
        assert_eq!(lines, [line("/x", 1, "3"), line("/y", 2, "12")]);
        let text = "/x 1 4e07408562bedb8b60ce05c1decfe3ad16b72230967de01f640b7e4729b49fce";
        assert_eq!(lines[0].to_string(), text);
    }

    #[test]
    fn publishers_of_one_topic_are_merged_by_tick_then_publisher_then_sequence() {
        let tf = port("/tf", Qos::command());
        let published = [
            ("/b", &tf, 0, "b0"),
            ("/b", &tf, 2, "b2"),
            ("/b", &tf, 2, "B2"),
            ("/a", &tf, 1, "a1"),
            ("/a", &tf, 2, "a2"),
            ("/c", &tf, 0, "c0"),
        ];
        assert_eq!(merged(&["/tf"], &published), [line("/tf", 6, "b0c0a1a2b2B2")]);
    }

    #[test]
    fn latched_messages_count_at_tick_zero() {
        let latched = port("/tf_static", Qos::latched());
        let published = [("/b", &latched, 1, "b"), ("/a", &latched, 7, "a")];
        assert_eq!(merged(&["/tf_static"], &published), [line("/tf_static", 2, "ab")]);
    }

    #[test]
    fn what_depends_on_wall_time_and_what_is_hidden_is_left_out() {
        let ports = [
            "/rosout",
            "/parameter_events",
            "/diagnostics",
            "/ros_discovery_info",
            "/_loop/grant",
            "/a/_action/status",
        ]
        .map(|name| port(name, Qos::command()));
        let published: Vec<_> = ports.iter().map(|port| ("/a", port, 0, "1")).collect();
        assert_eq!(merged(&[], &published), []);
        let request = Port { kind: PortKind::Call(crate::node::Latency::Forward), ..port("/go", Qos::service()) };
        assert_eq!(merged(&[], &[("/a", &request, 0, "1")]), []);
        assert_eq!(merged(&[], &[("/a", &port("/a/rosout", Qos::command()), 0, "1")]), [line("/a/rosout", 1, "1")]);
    }

    #[test]
    fn without_a_folder_nothing_is_kept() {
        let mut digest = Digest::new(None, "/a", &[]);
        assert!(!digest.active());
        digest.add(&port("/x", Qos::command()), 0, b"1");
        digest.finish().unwrap();
    }

    #[test]
    fn a_file_that_is_no_digest_is_named() {
        let dir = tempfile::tempdir().unwrap();
        Digest::new(Some(dir.path()), "/ns/a", &[]).finish().unwrap();
        assert_eq!(merge(dir.path()).unwrap(), []);
        for garbage in ["", "{\"/x\":{\"Alone\":{\"count\":1}}}", "nonsense"] {
            std::fs::write(dir.path().join("ns.b.json"), garbage).unwrap();
            let error = merge(dir.path()).unwrap_err();
            assert!(error.to_string().contains("ns.b.json"), "{error}");
        }
        assert!(merge(&dir.path().join("nowhere")).is_err());
    }
}
