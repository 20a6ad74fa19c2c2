use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use futures::{StreamExt, pin_mut};
use ros2_client::dds::rustdds::{DataReaderStatus, StatusEvented};

use super::{
    Guid, Qos, Sample,
    executor::Task,
    graph,
    participant::Inner,
    peers::{PeerEvent, Peers},
    raw::RawReader,
};

/// Samples handed over before other readers get their turn.
const BURST: usize = 64;

/// A subscription. Samples go to the function it was made with until it is dropped; when `drop`
/// returns the function has ended and is gone.
pub struct Reader {
    // Dropped in this order: the tasks own the endpoint, the participant goes last.
    _tasks: [Task; 2],
    guid: Guid,
    topic: Arc<str>,
    peers: Arc<Peers>,
    refused: Arc<AtomicU64>,
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
        let refused = Arc::new(AtomicU64::new(0));
        let watch = {
            let (raw, peers, topic) = (raw.clone(), peers.clone(), topic.clone());
            let (domain_participant, dds_type) = (participant.domain_participant.clone(), dds_type.to_owned());
            async move {
                let discovered = || {
                    graph::writers(&domain_participant)
                        .into_iter()
                        .filter(|writer| writer.topic == *topic && writer.dds_type == dds_type)
                        .filter(|writer| qos.is_served_by(writer.reliability, writer.durability))
                        .map(|writer| writer.guid)
                        .collect()
                };
                let events = raw.as_async_status_stream().map(|status| peer_event(&status));
                peers.follow(&topic, events, discovered).await;
            }
        };
        let drain = drain(raw, topic.clone(), refused.clone(), deliver);
        let tasks = [participant.executor.spawn(drain), participant.executor.spawn(watch)];
        Self { _tasks: tasks, guid, topic, peers, refused, participant }
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
        self.refused.load(Ordering::Relaxed)
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.participant.withdraw_reader(self.guid);
    }
}

/// Drains a reader that is nobody's subscription.
pub(super) async fn drain_into(raw: RawReader, deliver: impl FnMut(Sample) + Send + 'static) {
    let topic = Arc::from("ros_discovery_info");
    drain(Arc::new(raw), topic, Arc::new(AtomicU64::new(0)), deliver).await;
}

/// Hands every sample over as it comes.
async fn drain(
    raw: Arc<RawReader>,
    topic: Arc<str>,
    refused: Arc<AtomicU64>,
    mut deliver: impl FnMut(Sample) + Send + 'static,
) {
    let samples = raw.as_async_stream();
    pin_mut!(samples);
    let mut run = 0;
    while let Some(sample) = samples.next().await {
        match sample {
            Ok(change) => deliver(Sample::from_change(change)),
            Err(error) => {
                let refused = refused.fetch_add(1, Ordering::Relaxed) + 1;
                tracing::warn!(%topic, refused, "sample refused: {error}");
            }
        }
        run += 1;
        if run % BURST == 0 {
            tokio::task::yield_now().await;
        }
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
