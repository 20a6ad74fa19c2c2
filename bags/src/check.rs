//! Whether a bag keeps to the conventions: what readers rely on, and what its own index and metadata promise.

use std::collections::BTreeMap;
use std::fmt;

use crate::cdr::{MessageType, is_little_endian};
use crate::error::{BagError, Seconds};
use crate::metadata::Metadata;
use crate::qos::parse_profiles;
use crate::read::{Bag, Query, Topic};

/// Faults of messages that are listed for each topic; further ones are only counted.
const FAULTS_PER_TOPIC: u64 = 3;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Something is unusual, and does no harm to most readers.
    Warning,
    /// Something is lost, or some reader will refuse the bag.
    Error,
}

/// Something about a bag that is not as it should be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is, with its place.
    pub what: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        write!(f, "{severity}: {}", self.what)
    }
}

/// Reads a whole bag and says what is wrong with it. Every message is taken apart by its definition.
#[must_use]
pub fn check(bag: &Bag) -> Vec<Finding> {
    let mut findings = Findings::default();
    for problem in bag.problems() {
        findings.error(problem.to_string());
    }
    for file in bag.files() {
        if file.is_complete() && !file.is_indexed() && file.message_count() > 0 {
            findings.warning(format!("{}: no index of messages: readers have to read it all", file.path().display()));
        }
    }
    let mut types = Vec::new();
    for topic in bag.topics() {
        types.push(check_topic(topic, &mut findings));
    }
    let counts = check_messages(bag, &types, &mut findings);
    for (topic, count) in bag.topics().iter().zip(&counts) {
        if topic.count != *count {
            let what = format!("{}: {count} messages can be read, the index promises {}", topic.name, topic.count);
            findings.error(what);
        }
    }
    if let Some(metadata) = bag.metadata() {
        check_metadata(bag, metadata, &mut findings);
    }
    findings.0
}

#[derive(Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn error(&mut self, what: String) {
        self.0.push(Finding { severity: Severity::Error, what });
    }

    fn warning(&mut self, what: String) {
        self.0.push(Finding { severity: Severity::Warning, what });
    }
}

fn check_topic(topic: &Topic, findings: &mut Findings) -> Option<MessageType> {
    let name = &topic.name;
    let mut parts = name.split('/');
    let absolute = parts.next() == Some("");
    let word = |part: &str| {
        !part.is_empty()
            && !part.starts_with(|c: char| c.is_ascii_digit())
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    if !absolute || !parts.all(word) {
        findings.warning(format!("{name:?} is no absolute topic name of ROS 2 (REP-144)"));
    }
    if topic.message_encoding != "cdr" {
        findings.error(format!("{name}: messages are written as {:?}, in ROS 2 as \"cdr\"", topic.message_encoding));
        return None;
    }
    match parse_profiles(&topic.qos) {
        Ok(profiles) if profiles.is_empty() => findings.warning(format!("{name}: no quality of service is known")),
        Ok(_) => {}
        Err(reason) => findings.error(format!("{name}: its quality of service cannot be read: {reason}")),
    }
    match topic.schema_encoding.as_str() {
        "ros2msg" => {}
        "" => {
            findings.warning(format!("{name}: the bag has no definition of {}", topic.ros_type));
            return None;
        }
        other => {
            findings.warning(format!("{name}: its definition is in {other:?}; only ros2msg is checked"));
            return None;
        }
    }
    let ty = match MessageType::parse(&topic.ros_type, &topic.schema) {
        Ok(ty) => ty,
        Err(error) => {
            findings.error(format!("{name}: {error}"));
            return None;
        }
    };
    match ty.type_hash() {
        Some(hash) if !topic.type_hash.is_empty() && topic.type_hash != hash => {
            findings.error(format!("{name}: its type hash is {}, the definition's is {hash}", topic.type_hash));
        }
        _ if topic.type_hash.is_empty() => findings.warning(format!("{name}: its type hash is not known")),
        _ => {}
    }
    Some(ty)
}

/// Takes every message apart and counts them, topic by topic.
fn check_messages(bag: &Bag, types: &[Option<MessageType>], findings: &mut Findings) -> Vec<u64> {
    let mut counts = vec![0; bag.topics().len()];
    let mut faults: BTreeMap<usize, u64> = BTreeMap::new();
    // What could not be read when the bag was opened is said already.
    let said: Vec<String> = bag.problems().iter().map(ToString::to_string).collect();
    for message in bag.messages(&Query::default()) {
        let message = match message {
            Ok(message) => message,
            Err(error) => {
                let what = error.to_string();
                if !said.contains(&what) {
                    findings.error(what);
                }
                continue;
            }
        };
        counts[message.topic] += 1;
        let fits = match &types[message.topic] {
            Some(ty) => ty.walk(&message.data, &mut |_, _| ()),
            None if bag.topics()[message.topic].message_encoding == "cdr" => {
                is_little_endian(&message.data).map(|_| ())
            }
            None => Ok(()),
        };
        if let Err(reason) = fits {
            let so_far = faults.entry(message.topic).or_default();
            *so_far += 1;
            if *so_far <= FAULTS_PER_TOPIC {
                let topic = bag.topics()[message.topic].name.clone();
                findings.error(BagError::Message { topic, log_ns: message.log_ns, reason }.to_string());
            }
        }
    }
    for (topic, count) in faults.into_iter().filter(|(_, count)| *count > FAULTS_PER_TOPIC) {
        let name = &bag.topics()[topic].name;
        findings.error(format!("{name}: {} more messages do not fit their definition", count - FAULTS_PER_TOPIC));
    }
    counts
}

fn check_metadata(bag: &Bag, metadata: &Metadata, findings: &mut Findings) {
    let mut differs = |what: &str, told: &dyn fmt::Display, found: &dyn fmt::Display| {
        findings.error(format!("metadata.yaml says {what} {told}, the files say {found}"));
    };
    if metadata.message_count != bag.message_count() {
        differs("message_count", &metadata.message_count, &bag.message_count());
    }
    if let Some((start, end)) = bag.bounds_ns().filter(|_| bag.message_count() > 0) {
        if metadata.start_ns != start {
            differs("starting_time", &Seconds(metadata.start_ns), &Seconds(start));
        }
        if metadata.duration_ns != end - start {
            differs("duration", &Seconds(metadata.duration_ns), &Seconds(end - start));
        }
    }
    for topic in bag.topics() {
        match metadata.topics.iter().find(|told| told.name == topic.name) {
            None => differs("topic", &"nothing", &topic.name),
            Some(told) if told.message_count != topic.count => {
                differs(&format!("messages of {}", topic.name), &told.message_count, &topic.count);
            }
            Some(told) if told.ros_type != topic.ros_type => {
                differs(&format!("type of {}", topic.name), &told.ros_type, &topic.ros_type);
            }
            Some(_) => {}
        }
    }
    for told in metadata.topics.iter().filter(|told| bag.topics().iter().all(|topic| topic.name != told.name)) {
        differs("topic", &told.name, &"nothing");
    }
}
