use std::{
    collections::BTreeSet,
    fmt,
    net::Ipv4Addr,
    sync::{Arc, Mutex, MutexGuard, PoisonError, Weak},
    time::Duration,
};

use minifactory_msgs::{Message, interface::TopicSpec};
use ros2_client::{
    Gid,
    builtin_topics::ros_discovery,
    dds::rustdds::{
        DomainParticipant, DomainParticipantBuilder, Publisher, QosPolicies, RTPSEntity, Subscriber, Timestamp, Topic,
        TopicKind, dds::CreateError, no_key::DataWriterCdr,
    },
    entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
};

use super::{
    DdsError, DiscoveryRange, Domain, Graph, Guid, NodeName, Qos, Reader, SOCKET_BUFFER_BYTES, Sample, Writer,
    executor::{Executor, Spawner, Task as BackgroundTask},
    graph::{self, Nodes},
    lull::Lull,
    names::dds_name,
    qos::policies_of,
    raw::{Raw, RawAdapter, RawReader, RawWriter},
    signals::Masked,
    tally::{Counter, Loss, Tally},
};

/// One node's presence in a DDS domain. Clones share it; it leaves when the last of them, and the
/// last reader and writer made with them, is dropped.
#[derive(Clone)]
pub struct Participant {
    inner: Arc<Inner>,
}

/// How long a participant stays after its last endpoint has gone. The DDS library stops its sending thread without
/// looking whether it has sent everything, and on a busy machine it has not: what is lost then stays on the graph as a
/// ghost for most of a minute.
const FAREWELL: Duration = Duration::from_millis(30);

/// Lets the goodbyes of what was dropped before it be sent.
struct Farewell;

impl Drop for Farewell {
    fn drop(&mut self) {
        std::thread::sleep(FAREWELL);
    }
}

/// Fields are dropped in this order: first the thread with the readers it drains, the participant last.
pub(super) struct Inner {
    pub(super) executor: Executor,
    announcement: Mutex<Announcement>,
    nodes: Arc<Nodes>,
    lull: Mutex<Lull>,
    publisher: Publisher,
    subscriber: Subscriber,
    name: NodeName,
    domain: Domain,
    pub(super) tally: Tally,
    _farewell: Farewell,
    pub(super) domain_participant: DomainParticipant,
}

impl Drop for Inner {
    fn drop(&mut self) {
        // So that the node is forgotten even where the end of its participant is missed.
        self.announcement().publish(false);
    }
}

impl Participant {
    /// Joins a domain and announces the node.
    ///
    /// # Errors
    /// [`DdsError::Join`] when no port or thread is to be had.
    pub fn open(domain: &Domain, node: &NodeName) -> Result<Self, DdsError> {
        let refuse = |reason: String| DdsError::Join { node: node.to_string(), domain: domain.id, reason };
        if domain.id > Domain::ID_MAX {
            return Err(refuse(format!("the largest domain is {}", Domain::ID_MAX)));
        }
        let _masked = Masked::new();
        let builder = DomainParticipantBuilder::new(domain.id)
            .socket_receive_buffer_size(SOCKET_BUFFER_BYTES)
            .socket_send_buffer_size(SOCKET_BUFFER_BYTES);
        let domain_participant = match domain.range {
            DiscoveryRange::Localhost => builder.with_only_networks([Ipv4Addr::LOCALHOST]),
            DiscoveryRange::Subnet => builder,
            DiscoveryRange::Off => builder.with_only_networks([Ipv4Addr::UNSPECIFIED; 0]).same_host_loopback(false),
        }
        .build()
        .map_err(|error| refuse(error.to_string()))?;

        let join = || -> Result<_, CreateError> {
            let publisher = domain_participant.create_publisher(&QosPolicies::qos_none())?;
            let subscriber = domain_participant.create_subscriber(&QosPolicies::qos_none())?;
            let topic = domain_participant.create_topic(
                ros_discovery::TOPIC_NAME.to_owned(),
                ros_discovery::TYPE_NAME.to_owned(),
                &ros_discovery::QOS_PUB,
                TopicKind::NoKey,
            )?;
            let writer = publisher.create_datawriter_no_key_cdr(&topic, None)?;
            let reader = subscriber.create_simple_datareader_no_key::<Raw, RawAdapter>(&topic, None)?;
            Ok((publisher, subscriber, writer, reader))
        };
        let (publisher, subscriber, writer, reader) = join().map_err(|error| refuse(error.to_string()))?;
        let executor = Executor::start(&format!("dds {}", node.name())).map_err(|error| refuse(error.to_string()))?;
        let nodes = Arc::new(Nodes::default());
        executor.spawner().spawn(super::reader::drain_into(reader, {
            let nodes = nodes.clone();
            move |sample| nodes.take(&sample)
        }));
        let announcement = Mutex::new(Announcement {
            writer,
            participant: domain_participant.guid().into(),
            name: node.clone(),
            readers: BTreeSet::new(),
            writers: BTreeSet::new(),
        });
        let inner = Inner {
            executor,
            announcement,
            nodes,
            lull: Mutex::new(Lull::of(&domain_participant)),
            publisher,
            subscriber,
            name: node.clone(),
            domain: *domain,
            tally: Tally::default(),
            _farewell: Farewell,
            domain_participant,
        };
        inner.announcement().publish(true);
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Publishes a ROS topic, e.g. `/feeder/waveform` of DDS type
    /// `minifactory_msgs::msg::dds_::Waveform_`.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad topic, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn writer(&self, topic: &str, dds_type: &str, qos: &Qos) -> Result<Writer, DdsError> {
        self.writer_of(&dds_name("topic", "rt", topic, "")?, dds_type, qos)
    }

    /// Subscribes to a ROS topic. Samples go to `deliver` on the participant's thread, which must
    /// return soon (see [the module](super)), must not panic, and must not own the last handle of
    /// this participant.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad topic, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn reader(
        &self,
        topic: &str,
        dds_type: &str,
        qos: &Qos,
        deliver: impl FnMut(Sample) + Send + 'static,
    ) -> Result<Reader, DdsError> {
        self.reader_of(&dds_name("topic", "rt", topic, "")?, dds_type, qos, deliver)
    }

    /// Publishes a stated topic, whose owners live in `namespace`.
    ///
    /// # Errors
    /// As [`writer`](Self::writer).
    pub fn topic_writer<M: Message>(&self, topic: &TopicSpec<M>, namespace: &str) -> Result<Writer, DdsError> {
        self.writer(&topic.name_in(namespace), &topic.dds_type(), &topic.qos())
    }

    /// Subscribes to a stated topic, whose owners live in `namespace`; see [`reader`](Self::reader).
    ///
    /// # Errors
    /// As [`reader`](Self::reader).
    pub fn topic_reader<M: Message>(
        &self,
        topic: &TopicSpec<M>,
        namespace: &str,
        deliver: impl FnMut(Sample) + Send + 'static,
    ) -> Result<Reader, DdsError> {
        self.reader(&topic.name_in(namespace), &topic.dds_type(), &topic.qos(), deliver)
    }

    /// What discovery knows of other participants now; this one is not part of it.
    #[must_use]
    pub fn discovered(&self) -> Graph {
        // Where its own announcements come back to it, by multicast, the DDS library lists what it has itself too.
        let own = Guid::from(self.inner.domain_participant.guid()).participant();
        let mut writers = graph::writers(&self.inner.domain_participant);
        let mut readers = graph::readers(&self.inner.domain_participant);
        for endpoints in [&mut writers, &mut readers] {
            endpoints.retain(|endpoint| endpoint.guid.participant() != own);
        }
        Graph { nodes: self.inner.nodes.alive(&writers), writers, readers }
    }

    /// The node this participant announces.
    #[must_use]
    pub fn node(&self) -> &NodeName {
        &self.inner.name
    }

    /// The domain it has joined.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.inner.domain
    }

    /// What has been lost or refused so far, by the endpoints that are there now.
    #[must_use]
    pub fn losses(&self) -> Vec<Loss> {
        self.inner.tally.losses()
    }

    /// A counter for [`losses`](Self::losses).
    pub(crate) fn counter(&self, endpoint: &str, what: &'static str) -> Arc<Counter> {
        self.inner.tally.counter(endpoint, what)
    }

    /// What has been lost or refused, for a task that must not keep the participant alive.
    pub(crate) fn watch_losses(&self) -> impl Fn() -> Vec<Loss> + Send + 'static {
        let inner = Arc::downgrade(&self.inner);
        move || inner.upgrade().map(|inner| inner.tally.losses()).unwrap_or_default()
    }

    /// Starts a task on the participant's thread; it ends with the returned handle.
    pub(crate) fn background(&self, task: impl Future<Output = ()> + Send + 'static) -> BackgroundTask {
        self.inner.executor.spawn(task)
    }

    /// For what must not keep the participant alive.
    pub(super) fn downgrade(&self) -> Weak<Inner> {
        Arc::downgrade(&self.inner)
    }

    pub(super) fn spawner(&self) -> Spawner {
        self.inner.executor.spawner().clone()
    }

    /// A writer of a topic given by its DDS name.
    pub(super) fn writer_of(&self, name: &str, dds_type: &str, qos: &Qos) -> Result<Writer, DdsError> {
        let policies = policies_of(*qos);
        let make = || -> Result<RawWriter, CreateError> {
            let topic = self.inner.topic(name, dds_type, &policies)?;
            self.inner.publisher.create_datawriter_no_key(&topic, Some(policies.clone()))
        };
        let raw = self.inner.in_a_lull(make).map_err(|error| endpoint_error("writer", name, &error))?;
        let guid = raw.guid().into();
        let writer = Writer::start(self.inner.clone(), raw, name, dds_type, *qos);
        self.inner.announcement().change(|a| a.writers.insert(guid));
        Ok(writer)
    }

    /// A reader of a topic given by its DDS name.
    pub(super) fn reader_of(
        &self,
        name: &str,
        dds_type: &str,
        qos: &Qos,
        deliver: impl FnMut(Sample) + Send + 'static,
    ) -> Result<Reader, DdsError> {
        let policies = policies_of(*qos);
        let make = || -> Result<RawReader, CreateError> {
            let topic = self.inner.topic(name, dds_type, &policies)?;
            self.inner.subscriber.create_simple_datareader_no_key(&topic, Some(policies.clone()))
        };
        let raw = self.inner.in_a_lull(make).map_err(|error| endpoint_error("reader", name, &error))?;
        let guid = raw.guid().into();
        let reader = Reader::start(self.inner.clone(), raw, name.into(), dds_type, *qos, deliver);
        self.inner.announcement().change(|a| a.readers.insert(guid));
        Ok(reader)
    }
}

impl fmt::Debug for Participant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Participant({} in domain {})", self.inner.name, self.inner.domain.id)
    }
}

fn endpoint_error(what: &'static str, name: &str, error: &CreateError) -> DdsError {
    DdsError::Endpoint { what, name: name.to_owned(), reason: error.to_string() }
}

impl Inner {
    fn topic(&self, name: &str, dds_type: &str, policies: &QosPolicies) -> Result<Topic, CreateError> {
        self.domain_participant.create_topic(name.to_owned(), dds_type.to_owned(), policies, TopicKind::NoKey)
    }

    /// Makes an endpoint, one at a time, when that can be done.
    fn in_a_lull<T>(&self, make: impl FnOnce() -> T) -> T {
        self.lull.lock().unwrap_or_else(PoisonError::into_inner).make(make)
    }

    fn announcement(&self) -> MutexGuard<'_, Announcement> {
        self.announcement.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn withdraw_reader(&self, guid: Guid) {
        self.announcement().change(|a| a.readers.remove(&guid));
    }

    pub(super) fn withdraw_writer(&self, guid: Guid) {
        self.announcement().change(|a| a.writers.remove(&guid));
    }
}

/// What `ros_discovery_info` says of this participant: which node, and which endpoints are its own.
struct Announcement {
    writer: DataWriterCdr<ParticipantEntitiesInfo>,
    participant: Guid,
    name: NodeName,
    readers: BTreeSet<Guid>,
    writers: BTreeSet<Guid>,
}

impl Announcement {
    fn change(&mut self, change: impl FnOnce(&mut Self) -> bool) {
        if change(self) {
            self.publish(true);
        }
    }

    /// Says which endpoints the node has, or that there is no node any more.
    fn publish(&self, is_here: bool) {
        let mut node = NodeEntitiesInfo::new(self.name.inner().clone());
        self.readers.iter().for_each(|guid| node.add_reader(Gid::from(guid.0)));
        self.writers.iter().for_each(|guid| node.add_writer(Gid::from(guid.0)));
        let info =
            ParticipantEntitiesInfo::new(Gid::from(self.participant.0), is_here.then_some(node).into_iter().collect());
        if let Err(error) = self.writer.write(info, Some(Timestamp::now())) {
            tracing::warn!(node = %self.name, "the node's endpoints could not be announced: {error}");
        }
    }
}
