//! The writers of the topics that are played.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use bytes::Bytes;
use feeder_runtime::dds::{Durability, Participant, PublishError, Qos, Reliability, Writer};

use super::{PlayError, PlaySettings};
use ros2_bags::cdr::{HEADER_BYTES, MessageType, is_little_endian};
use ros2_bags::dds_type;
use ros2_bags::qos::{self, History, QosProfile, parse_profiles};
use ros2_bags::{Bag, RecordedMessage, Topic};

/// Samples that a slow reader may leave unacknowledged.
const BACKLOG: u16 = 2048;
/// How long reliable readers may take to hand over what they have acknowledged. RustDDS 0.15.1 forgets with a writer what has
/// not been handed over yet (`structure/dds_cache.rs`, 245 and 460): on a busy machine, the last messages of a bag.
const HANDOVER: Duration = Duration::from_millis(200);

pub(super) struct Outlets {
    writers: BTreeMap<usize, Outlet>,
    topics: BTreeSet<usize>,
}

struct Outlet {
    writer: Writer,
    name: String,
    /// To turn big endian into little endian.
    ty: Option<MessageType>,
}

impl Outlets {
    pub(super) fn open(participant: &Participant, bag: &Bag, settings: &PlaySettings) -> Result<Self, PlayError> {
        let mut writers = BTreeMap::new();
        for (index, topic) in bag.topics().iter().enumerate() {
            if !settings.selection.takes(&topic.name, &topic.ros_type) {
                continue;
            }
            // A type that ROS did not name was recorded under its DDS name.
            let foreign = topic.ros_type.contains("::").then(|| topic.ros_type.clone());
            let Some(dds_type) = dds_type(&topic.ros_type).or(foreign).filter(|_| topic.message_encoding == "cdr")
            else {
                tracing::warn!("{} is not played: {:?} is no type of ROS 2 in CDR", topic.name, topic.ros_type);
                continue;
            };
            let name = settings.remaps.get(&topic.name).unwrap_or(&topic.name).clone();
            let writer = participant.writer(&name, &dds_type, &offered(topic, settings))?;
            let ty = MessageType::parse(&topic.ros_type, &topic.schema).ok();
            writers.insert(index, Outlet { writer, name, ty });
        }
        let topics = writers.keys().copied().collect();
        Ok(Self { writers, topics })
    }

    /// Indices of the topics that are played.
    pub(super) fn topics(&self) -> &BTreeSet<usize> {
        &self.topics
    }

    /// # Errors
    /// The reason, in words that are the same for all messages that fail alike.
    pub(super) fn publish(&self, message: &RecordedMessage) -> Result<(), String> {
        let Some(outlet) = self.writers.get(&message.topic) else { return Ok(()) };
        let fail = |reason: String| format!("{}: {reason}", outlet.name);
        let body = if is_little_endian(&message.data).map_err(fail)? {
            message.data.slice(HEADER_BYTES..)
        } else {
            let ty =
                outlet.ty.as_ref().ok_or_else(|| fail("big endian, and its definition is not known".to_owned()))?;
            let swapped = ty.swapped(&message.data).map_err(|_| fail("does not fit its definition".to_owned()))?;
            Bytes::from(swapped).slice(HEADER_BYTES..)
        };
        match outlet.writer.publish(body) {
            Ok(()) => Ok(()),
            Err(PublishError::Full { .. }) => Err(fail("a reliable reader is too slow".to_owned())),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Waits until reliable readers have everything, and returns what they do not have.
    pub(super) fn close(&self, patience: Duration) -> Vec<(String, u64)> {
        let until = Instant::now() + patience;
        let heard: Vec<_> = self.writers.values().filter(|outlet| outlet.writer.matched_readers() > 0).collect();
        let late = heard
            .iter()
            .filter(|outlet| !outlet.writer.wait_acknowledged(until.saturating_duration_since(Instant::now())))
            .map(|outlet| (format!("{}: the last messages were not acknowledged", outlet.name), 1))
            .collect();
        if !heard.is_empty() {
            std::thread::sleep(HANDOVER);
        }
        late
    }
}

/// The bag's quality of service with the overrides in its place: what every reader of the recorded publishers could match.
fn offered(topic: &Topic, settings: &PlaySettings) -> Qos {
    let profiles = parse_profiles(&topic.qos).unwrap_or_default();
    let mut profile = profiles.first().copied().unwrap_or_default();
    if profiles.iter().any(|other| other.durability == qos::Durability::TransientLocal) {
        profile.durability = qos::Durability::TransientLocal;
    }
    if profiles.iter().any(|other| other.reliability == qos::Reliability::Reliable) {
        profile.reliability = qos::Reliability::Reliable;
    }
    if let Some(replaced) = settings.qos_overrides.get(&topic.name) {
        profile = replaced.over(profile);
    }
    let QosProfile { history, depth, reliability, durability, .. } = profile;
    let depth =
        if history == History::KeepAll { BACKLOG } else { u16::try_from(depth).unwrap_or(BACKLOG).min(BACKLOG) };
    Qos {
        reliability: match reliability {
            qos::Reliability::BestEffort => Reliability::BestEffort,
            _ => Reliability::Reliable,
        },
        durability: match durability {
            qos::Durability::TransientLocal => Durability::TransientLocal,
            _ => Durability::Volatile,
        },
        // Discovery did not tell the recorder how deep the history was: ROS's default then.
        depth: if depth == 0 { 10 } else { depth },
        backlog: BACKLOG,
        lifespan_s: None,
    }
}
