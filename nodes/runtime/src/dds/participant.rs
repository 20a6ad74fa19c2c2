//! A node's presence in a domain, with which endpoints are opened.

use std::{
    collections::BTreeSet,
    fmt,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak},
};

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
    DdsError, DiscoveryRange, Domain, Graph, Guid, NodeName, SOCKET_BUFFER_BYTES,
    door::{Door, LastWord},
    executor::{Executor, Spawner, Task as BackgroundTask},
    farewell::Farewell,
    graph::{self, Nodes},
    loops::Loops,
    lull::Lull,
    others::Leave,
    raw::{Raw, RawAdapter},
    reach::Reach,
    relay::{Relay, Written},
    signals::Masked,
    tally::{Counter, Loss, Tally},
};

/// One node's presence in a DDS domain. Clones share it; it leaves when the last of them, and the
/// last reader and writer made with them, is dropped.
#[derive(Clone)]
pub struct Participant {
    pub(super) inner: Arc<Inner>,
}

/// Fields are dropped in this order: first the thread with the readers it drains, then the participant, and what is said
/// when it has gone last. The tasks on that thread share single fields: one that held all of it at the wrong moment would be
/// the one to say goodbye, and the process might end before it has.
pub(super) struct Inner {
    pub(super) executor: Executor,
    announcement: Mutex<Announcement>,
    nodes: Arc<Nodes>,
    lull: Arc<Mutex<Lull>>,
    door: Door,
    relay: OnceLock<Relay>,
    written: Written,
    pub(super) publisher: Publisher,
    pub(super) subscriber: Subscriber,
    name: NodeName,
    domain: Domain,
    pub(super) tally: Arc<Tally>,
    _farewell: Farewell,
    pub(super) domain_participant: DomainParticipant,
    _last_word: LastWord,
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
        let participant = Self::secluded(domain, node)?;
        participant.meet_others();
        Ok(participant)
    }

    /// Joins a domain where nobody can meet it before [`meet_others`](Self::meet_others): endpoints that are made until then
    /// are made at once, as the DDS library cannot lock up over whom it finds meanwhile.
    ///
    /// # Errors
    /// [`DdsError::Join`] when no port or thread is to be had.
    pub fn secluded(domain: &Domain, node: &NodeName) -> Result<Self, DdsError> {
        let refuse = |reason: String| DdsError::Join { node: node.to_string(), domain: domain.id, reason };
        if domain.id > Domain::ID_MAX {
            return Err(refuse(format!("the largest domain is {}", Domain::ID_MAX)));
        }
        let _masked = Masked::new();
        let builder = DomainParticipantBuilder::new(domain.id)
            .socket_receive_buffer_size(SOCKET_BUFFER_BYTES)
            .socket_send_buffer_size(SOCKET_BUFFER_BYTES);
        let build = |reach: &Reach| {
            let builder = builder.same_host_loopback(domain.range != DiscoveryRange::Off);
            match &reach.networks {
                Some(networks) => builder.with_only_networks(networks.iter().copied()),
                None => builder,
            }
            .build()
        };
        let (opened, loops) = Loops::of(|| Door::shut(domain, build));
        let (domain_participant, door) = opened.map_err(|error| refuse(error.to_string()))?;

        let join = || -> Result<_, CreateError> {
            let publisher = domain_participant.create_publisher(&QosPolicies::qos_none())?;
            let subscriber = domain_participant.create_subscriber(&QosPolicies::qos_none())?;
            let topic = domain_participant.create_topic(
                ros_discovery::TOPIC_NAME.to_owned(),
                ros_discovery::TYPE_NAME.to_owned(),
                &ros_discovery::QOS_PUB,
                TopicKind::NoKey,
            )?;
            let writer = publisher.create_datawriter_no_key_cdr::<ParticipantEntitiesInfo>(&topic, None)?;
            let reader = subscriber.create_simple_datareader_no_key::<Raw, RawAdapter>(&topic, None)?;
            Ok((publisher, subscriber, writer, reader))
        };
        let (publisher, subscriber, writer, reader) = join().map_err(|error| refuse(error.to_string()))?;
        let executor = Executor::start(&format!("dds {}", node.name())).map_err(|error| refuse(error.to_string()))?;
        executor.spawner().spawn(loops.watch(node.to_string()));
        let nodes = Arc::new(Nodes::default());
        executor.spawner().spawn(super::drain::drain_into(reader, {
            let nodes = nodes.clone();
            move |sample| nodes.take(&sample)
        }));
        let announcement = Mutex::new(Announcement {
            writer,
            participant: domain_participant.guid().into(),
            name: node.clone(),
            readers: BTreeSet::new(),
            writers: BTreeSet::new(),
            is_public: false,
        });
        let inner = Inner {
            executor,
            announcement,
            nodes,
            lull: Arc::new(Mutex::new(Lull::of(&domain_participant))),
            relay: OnceLock::new(),
            written: Written::default(),
            publisher,
            subscriber,
            name: node.clone(),
            domain: *domain,
            tally: Arc::default(),
            _last_word: door.last_word(domain_participant.guid().into(), domain_participant.participant_id()),
            door,
            _farewell: Farewell::of(&domain_participant),
            domain_participant,
        };
        inner.executor.spawner().spawn(Lull::keep_up(Arc::clone(&inner.lull)));
        let announcer = inner.announcement().writer.guid().into();
        inner.note_written(announcer, ros_discovery::TOPIC_NAME);
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Lets others in and announces the node, with what endpoints it has.
    pub fn meet_others(&self) {
        let inner = &self.inner;
        inner.announcement().begin();
        let participant = &inner.domain_participant;
        if let Some(relay) = (!inner.door.is_open()).then(|| inner.door.relay(participant, &inner.written)).flatten() {
            // Set once: the door has been shut until now.
            let _ = inner.relay.set(relay);
        }
        let known = {
            let lull = Arc::clone(&inner.lull);
            // Whoever holds the lock makes an endpoint; the next time will do.
            move || lull.try_lock().map(|mut lull| lull.others().there()).unwrap_or_default()
        };
        if let Some(later) = inner.door.open(participant.guid().into(), participant.participant_id(), known) {
            inner.executor.spawner().spawn(later);
        }
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

    /// What has been lost or refused, for a task, which must not keep the participant alive.
    pub(crate) fn watch_losses(&self) -> impl Fn() -> Vec<Loss> + Send + 'static {
        let tally = Arc::clone(&self.inner.tally);
        move || tally.losses()
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
}

impl fmt::Debug for Participant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Participant({} in domain {})", self.inner.name, self.inner.domain.id)
    }
}

pub(super) fn endpoint_error(what: &'static str, name: &str, error: &CreateError) -> DdsError {
    DdsError::Endpoint { what, name: name.to_owned(), reason: error.to_string() }
}

impl Inner {
    pub(super) fn topic(&self, name: &str, dds_type: &str, policies: &QosPolicies) -> Result<Topic, CreateError> {
        self.domain_participant.create_topic(name.to_owned(), dds_type.to_owned(), policies, TopicKind::NoKey)
    }

    /// Makes an endpoint, one at a time, when that can be done.
    pub(super) fn in_a_lull<T>(&self, make: impl FnOnce() -> T) -> T {
        self.lull.lock().unwrap_or_else(PoisonError::into_inner).make(self.door.is_open(), make)
    }

    /// How the participant of an endpoint left; `None` also while an endpoint is being made.
    pub(super) fn leave_of(&self, endpoint: Guid) -> Option<Leave> {
        self.lull.try_lock().ok()?.others().leave_of(endpoint)
    }

    pub(super) fn announcement(&self) -> MutexGuard<'_, Announcement> {
        self.announcement.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn withdraw_reader(&self, guid: Guid) {
        self.announcement().change(|a| a.readers.remove(&guid));
    }

    /// Notes what a writer writes.
    pub(super) fn note_written(&self, writer: Guid, topic: &str) {
        let [.., a, b, c, d] = writer.0;
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.insert([a, b, c, d], topic.to_owned());
    }

    pub(super) fn withdraw_writer(&self, guid: Guid) {
        self.announcement().change(|a| a.writers.remove(&guid));
    }
}

/// What `ros_discovery_info` says of this participant: which node, and which endpoints are its own.
pub(super) struct Announcement {
    writer: DataWriterCdr<ParticipantEntitiesInfo>,
    participant: Guid,
    name: NodeName,
    pub(super) readers: BTreeSet<Guid>,
    pub(super) writers: BTreeSet<Guid>,
    /// Whether it has been published yet.
    is_public: bool,
}

impl Announcement {
    pub(super) fn change(&mut self, change: impl FnOnce(&mut Self) -> bool) {
        if change(self) && self.is_public {
            self.publish(true);
        }
    }

    fn begin(&mut self) {
        self.is_public = true;
        self.publish(true);
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
