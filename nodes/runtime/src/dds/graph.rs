//! What is known of the nodes and endpoints of other participants.

use std::{
    collections::{BTreeMap, BTreeSet},
    net::SocketAddr,
    sync::{Mutex, PoisonError},
};

use bytes::Bytes;
use ros2_client::{dds::rustdds::DomainParticipant, entities_info::ParticipantEntitiesInfo};

use super::{
    Durability, Guid, Reliability, Sample,
    qos::{durability_of, reliability_of},
};

/// A reader or writer of another participant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    /// Its identity.
    pub guid: Guid,
    /// DDS name of its topic, e.g. `rt/feeder/waveform`.
    pub topic: String,
    /// DDS name of its type, e.g. `minifactory_msgs::msg::dds_::Waveform_`.
    pub dds_type: String,
    /// Reliability it offers or asks for.
    pub reliability: Reliability,
    /// Durability it offers or asks for.
    pub durability: Durability,
}

/// A node of another participant, as it announces itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeInfo {
    /// Fully qualified name.
    pub name: String,
    /// Identity of the participant it lives in.
    pub participant: Guid,
}

/// What discovery knows of other participants at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Graph {
    /// Nodes, by name.
    pub nodes: Vec<NodeInfo>,
    /// Writers, in no particular order.
    pub writers: Vec<Endpoint>,
    /// Readers, in no particular order.
    pub readers: Vec<Endpoint>,
}

impl Graph {
    /// Writers of a ROS topic, e.g. `/feeder/waveform`.
    pub fn writers_of(&self, topic: &str) -> impl Iterator<Item = &Endpoint> {
        self.writers.iter().filter(move |writer| writer.topic.strip_prefix("rt") == Some(topic))
    }

    /// Readers of a ROS topic.
    pub fn readers_of(&self, topic: &str) -> impl Iterator<Item = &Endpoint> {
        self.readers.iter().filter(move |reader| reader.topic.strip_prefix("rt") == Some(topic))
    }

    /// Whether a node of this fully qualified name is there.
    #[must_use]
    pub fn has_node(&self, name: &str) -> bool {
        self.nodes.iter().any(|node| node.name == name)
    }

    /// ROS topics and their DDS types.
    #[must_use]
    pub fn topics(&self) -> BTreeMap<&str, BTreeSet<&str>> {
        let mut topics = BTreeMap::<_, BTreeSet<_>>::new();
        for endpoint in self.writers.iter().chain(&self.readers) {
            if let Some(topic) = endpoint.topic.strip_prefix("rt").filter(|topic| topic.starts_with('/')) {
                topics.entry(topic).or_default().insert(endpoint.dds_type.as_str());
            }
        }
        topics
    }
}

/// Where a reader of another participant may be reached.
pub(super) fn reader_addresses(participant: &DomainParticipant, reader: Guid) -> Vec<SocketAddr> {
    let readers = participant.discovered_readers();
    let found = readers.iter().find(|data| Guid::from(data.reader_proxy.remote_reader_guid) == reader);
    let locators = found.into_iter().flat_map(|data| &data.reader_proxy.unicast_locator_list);
    locators.filter(|locator| locator.is_udp()).map(|locator| SocketAddr::from(*locator)).collect()
}

/// Where the readers of each topic get their messages; a topic comes once for each.
pub(super) fn reader_addresses_by_topic(participant: &DomainParticipant) -> Vec<(String, Vec<SocketAddr>)> {
    let describe = |data: ros2_client::dds::rustdds::discovery::DiscoveredReaderData| {
        let locators = data.reader_proxy.unicast_locator_list.iter().filter(|locator| locator.is_udp());
        (
            data.subscription_topic_data.topic_name().clone(),
            locators.map(|locator| SocketAddr::from(*locator)).collect(),
        )
    };
    participant.discovered_readers().into_iter().map(describe).collect()
}

/// Where the endpoints that `wanted` picks get their messages.
pub(super) fn addresses(participant: &DomainParticipant, wanted: impl Fn(&Guid) -> bool) -> BTreeSet<SocketAddr> {
    let (readers, writers) = (participant.discovered_readers(), participant.discovered_writers());
    let of_readers =
        readers.iter().map(|data| (data.reader_proxy.remote_reader_guid, &data.reader_proxy.unicast_locator_list));
    let of_writers =
        writers.iter().map(|data| (data.writer_proxy.remote_writer_guid, &data.writer_proxy.unicast_locator_list));
    of_readers
        .chain(of_writers)
        .filter(|(guid, _)| wanted(&Guid::from(*guid)))
        .flat_map(|(_, locators)| locators)
        .filter(|locator| locator.is_udp())
        .map(|locator| SocketAddr::from(*locator))
        .collect()
}

/// Readers that have been discovered.
pub(super) fn readers(participant: &DomainParticipant) -> Vec<Endpoint> {
    let describe = |data: &ros2_client::dds::rustdds::discovery::DiscoveredReaderData| {
        let (topic, qos) = (&data.subscription_topic_data, data.subscription_topic_data.qos());
        Endpoint {
            guid: data.reader_proxy.remote_reader_guid.into(),
            topic: topic.topic_name().clone(),
            dds_type: topic.type_name().clone(),
            reliability: reliability_of(&qos),
            durability: durability_of(&qos),
        }
    };
    participant.discovered_readers().iter().map(describe).collect()
}

pub(super) fn writers(participant: &DomainParticipant) -> Vec<Endpoint> {
    let describe = |data: &ros2_client::dds::rustdds::discovery::DiscoveredWriterData| {
        let (topic, qos) = (&data.publication_topic_data, data.publication_topic_data.qos());
        Endpoint {
            guid: data.writer_proxy.remote_writer_guid.into(),
            topic: topic.topic_name.clone(),
            dds_type: topic.type_name.clone(),
            reliability: reliability_of(&qos),
            durability: durability_of(&qos),
        }
    };
    participant.discovered_writers().iter().map(describe).collect()
}

/// The nodes each participant has announced on `ros_discovery_info`.
#[derive(Default)]
pub(super) struct Nodes(Mutex<BTreeMap<[u8; 12], Vec<NodeInfo>>>);

impl Nodes {
    /// Takes a participant's announcement, which replaces its earlier ones.
    pub(super) fn take(&self, sample: &Sample) {
        match sample.decode::<ParticipantEntitiesInfo>() {
            Ok(info) => {
                let participant = Guid(info.gid().to_bytes16());
                let nodes = info
                    .nodes()
                    .iter()
                    .map(|node| NodeInfo { name: node.fully_qualified_name(), participant })
                    .collect();
                self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(sample.writer_guid.participant(), nodes);
            }
            Err(error) => {
                tracing::warn!(writer = %sample.writer_guid, "node announcement refused: {error}");
            }
        }
    }

    /// The nodes of participants that still have writers (each has at least the one it announces
    /// its nodes with); those of others are forgotten.
    pub(super) fn alive(&self, writers: &[Endpoint]) -> Vec<NodeInfo> {
        let present: BTreeSet<_> = writers.iter().map(|writer| writer.guid.participant()).collect();
        let mut announced = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        announced.retain(|participant, _| present.contains(participant));
        let mut nodes: Vec<_> = announced.values().flatten().cloned().collect();
        nodes.sort_by(|a, b| (&a.name, a.participant).cmp(&(&b.name, b.participant)));
        nodes
    }
}

/// Reads an announcement of nodes; see [`crate::fuzzing`].
pub(crate) fn fuzz_announcement(input: &[u8]) {
    let nodes = Nodes::default();
    nodes.take(&Sample {
        payload: Bytes::copy_from_slice(input),
        little_endian: true,
        writer_guid: Guid([1; 16]),
        sequence: 1,
        source_timestamp: None,
        related: None,
    });
    let _ = nodes.alive(&[]);
}
