//! Subscriptions.

use std::sync::Arc;

use futures::StreamExt;
use minifactory_msgs::Message;
use minifactory_msgs::interface::TopicSpec;
use ros2_client::dds::rustdds::{DataReaderStatus, StatusEvented, dds::CreateError};

use super::{
    DdsError, Guid, Participant, Qos, Sample,
    drain::{Losses, drain},
    executor::Task,
    graph,
    names::dds_name,
    participant::{Inner, endpoint_error},
    peers::{PeerEvent, Peers},
    qos::policies_of,
    raw::RawReader,
};

impl Participant {
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

/// A subscription. Samples go to the function it was made with until it is dropped; when `drop`
/// returns the function has ended and is gone.
pub struct Reader {
    // Dropped in this order: the tasks own the endpoint, the participant goes last.
    _tasks: [Task; 2],
    guid: Guid,
    topic: Arc<str>,
    peers: Arc<Peers>,
    losses: Losses,
    participant: Arc<Inner>,
}

impl Reader {
    pub(super) fn start(
        participant: Arc<Inner>,
        raw: RawReader,
        topic: Arc<str>,
        dds_type: &str,
        qos: Qos,
        deliver: impl FnMut(Sample) + Send + 'static,
    ) -> Self {
        let guid = raw.guid().into();
        let raw = Arc::new(raw);
        let peers = Arc::new(Peers::default());
        let losses = Losses::new(&participant.tally, &topic, qos.reliability);
        let watch = {
            let (raw, peers, topic) = (raw.clone(), peers.clone(), topic.clone());
            let (domain_participant, dds_type) = (participant.domain_participant.clone(), dds_type.to_owned());
            async move {
                let discovered = || {
                    graph::writers(&domain_participant)
                        .into_iter()
                        .filter(|writer| writer.topic == *topic && writer.dds_type == dds_type)
                        .filter(|writer| {
                            let offer = Qos { reliability: writer.reliability, durability: writer.durability, ..qos };
                            offer.check_offer(qos.reliability, qos.durability).is_ok()
                        })
                        .map(|writer| writer.guid)
                        .collect()
                };
                let events = raw.as_async_status_stream().map(|status| peer_event(&status));
                peers.follow(&topic, events, discovered).await;
            }
        };
        let drain = drain(raw, topic.clone(), losses.clone(), deliver);
        let tasks = [participant.executor.spawn(drain), participant.executor.spawn(watch)];
        Self { _tasks: tasks, guid, topic, peers, losses, participant }
    }

    /// DDS name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// The identity under which peers see this reader.
    #[must_use]
    pub fn guid(&self) -> Guid {
        self.guid
    }

    /// Writers of other participants that serve this reader now.
    #[must_use]
    pub fn matched_writers(&self) -> usize {
        self.peers.count()
    }

    pub(super) fn peers(&self) -> Arc<Peers> {
        self.peers.clone()
    }

    /// Samples that came in an encoding that cannot be read, each logged with its reason.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.losses.refused.get()
    }

    /// Samples that never came, by the gaps in the numbers of those that did.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.losses.lost.get()
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.participant.withdraw_reader(self.guid);
    }
}

/// What a reader's status event says of its writers.
fn peer_event(status: &DataReaderStatus) -> PeerEvent {
    match status {
        DataReaderStatus::SubscriptionMatched { current, writer, .. } if current.count_change() > 0 => {
            PeerEvent::Joined((*writer).into())
        }
        DataReaderStatus::SubscriptionMatched { writer, .. } => PeerEvent::Left((*writer).into()),
        DataReaderStatus::RequestedIncompatibleQos { last_policy_id, writer, .. } => {
            PeerEvent::Incompatible((*writer).into(), format!("{last_policy_id:?}"))
        }
        _ => PeerEvent::Other,
    }
}
