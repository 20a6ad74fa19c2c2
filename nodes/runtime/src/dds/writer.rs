//! Publications.

use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

use bytes::Bytes;
use futures::{FutureExt, StreamExt};
use minifactory_msgs::Message;
use minifactory_msgs::interface::TopicSpec;
use ros2_client::dds::rustdds::{
    DataWriterStatus, RTPSEntity, StatusEvented, Timestamp, WriteOptionsBuilder,
    dds::{CreateError, WriteError},
};
use serde::Serialize;

use super::{
    DdsError, Guid, Participant, PublishError, Qos, SampleId,
    datagram::FRAGMENTED_ABOVE_BYTES,
    executor::Task,
    graph,
    names::dds_name,
    participant::{Inner, endpoint_error},
    peers::{PeerEvent, Peers},
    qos::policies_of,
    raw::{Raw, RawWriter},
};
use crate::cdr;

impl Participant {
    /// Publishes a ROS topic, e.g. `/feeder/waveform` of DDS type
    /// `minifactory_msgs::msg::dds_::Waveform_`.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad topic, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn writer(&self, topic: &str, dds_type: &str, qos: &Qos) -> Result<Writer, DdsError> {
        self.writer_of(&dds_name("topic", "rt", topic, "")?, dds_type, qos)
    }

    /// Publishes a stated topic, whose owners live in `namespace`.
    ///
    /// # Errors
    /// As [`writer`](Self::writer).
    pub fn topic_writer<M: Message>(&self, topic: &TopicSpec<M>, namespace: &str) -> Result<Writer, DdsError> {
        self.writer(&topic.name_in(namespace), &topic.dds_type(), &topic.qos())
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
        self.inner.note_written(guid, name);
        let writer = Writer::start(self.inner.clone(), raw, name, dds_type, *qos);
        self.inner.announcement().change(|a| a.writers.insert(guid));
        Ok(writer)
    }
}

/// A publication. Any thread may publish.
pub struct Writer {
    // Dropped in this order: the task shares the outlet, the participant goes last.
    task: Option<Task>,
    outlet: Arc<Outlet>,
    participant: Arc<Inner>,
}

/// What of a writer may outlive its handle, and does not keep the participant alive: replies on
/// their way need it.
pub(crate) struct Outlet {
    raw: RawWriter,
    pub(super) peers: Peers,
    topic: String,
    qos: Qos,
    /// The sequence number of the last sample.
    last: Mutex<i64>,
}

impl Writer {
    pub(super) fn start(participant: Arc<Inner>, raw: RawWriter, topic: &str, dds_type: &str, qos: Qos) -> Self {
        let outlet =
            Arc::new(Outlet { raw, peers: Peers::default(), topic: topic.to_owned(), qos, last: Mutex::new(0) });
        let watch = {
            let (outlet, dds_type) = (outlet.clone(), dds_type.to_owned());
            let domain_participant = participant.domain_participant.clone();
            async move {
                let discovered = || {
                    graph::readers(&domain_participant)
                        .into_iter()
                        .filter(|reader| reader.topic == outlet.topic && reader.dds_type == dds_type)
                        .filter(|reader| qos.check_offer(reader.reliability, reader.durability).is_ok())
                        .map(|reader| reader.guid)
                        .collect()
                };
                let events = outlet.raw.as_async_status_stream().map(|status| peer_event(&status));
                outlet.peers.follow(&outlet.topic, events, discovered).await;
            }
        };
        let task = Some(participant.executor.spawn(watch));
        Self { task, outlet, participant }
    }

    /// Publishes a little-endian CDR body. Never waits.
    ///
    /// # Errors
    /// [`PublishError::Full`] gives the body back when a reliable reader has fallen behind,
    /// [`PublishError::Closed`] when the middleware has failed.
    pub fn publish(&self, payload: Bytes) -> Result<(), PublishError> {
        self.outlet.send(payload, None, None).map(|_| ())
    }

    /// Waits until every matched reliable reader has all that was published so far, at most for `patience`; says whether
    /// they do. Not to be called on the participant's own thread.
    #[must_use]
    pub fn wait_acknowledged(&self, patience: Duration) -> bool {
        let (sender, done) = mpsc::channel();
        let outlet = self.outlet();
        self.participant.executor.spawner().spawn(async move {
            outlet.acknowledged().await;
            // Nobody waits any more when the patience has ended.
            let _ = sender.send(());
        });
        done.recv_timeout(patience).is_ok()
    }

    /// DDS name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.outlet.topic
    }

    /// The identity under which peers see this writer.
    #[must_use]
    pub fn guid(&self) -> Guid {
        self.outlet.guid()
    }

    /// Readers of other participants that this writer serves now.
    #[must_use]
    pub fn matched_readers(&self) -> usize {
        self.outlet.peers.count()
    }

    pub(crate) fn outlet(&self) -> Arc<Outlet> {
        self.outlet.clone()
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.task.take();
        self.participant.withdraw_writer(self.guid());
    }
}

impl Outlet {
    /// Publishes a message for whoever listens; one that cannot be sent is logged.
    pub(crate) fn publish_message<T: Serialize>(&self, message: &T) {
        let sent = cdr::encode(message).map_err(|error| error.to_string());
        let sent = sent.and_then(|body| self.send(body, None, None).map_err(|error| error.to_string()));
        if let Err(error) = sent {
            tracing::warn!(topic = self.topic, "message not sent: {error}");
        }
    }

    pub(super) fn guid(&self) -> Guid {
        self.raw.guid().into()
    }

    /// Publishes to one reader only, or as the answer to some sample, or both; returns the sequence number.
    pub(super) fn send(
        &self,
        payload: Bytes,
        reader: Option<Guid>,
        related: Option<SampleId>,
    ) -> Result<i64, PublishError> {
        self.send_after(|_| (), payload, reader, related)
    }

    /// As [`send`](Self::send), after something has been done with the sequence number that the sample will have.
    pub(super) fn send_after(
        &self,
        before: impl FnOnce(i64),
        payload: Bytes,
        reader: Option<Guid>,
        related: Option<SampleId>,
    ) -> Result<i64, PublishError> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        before(*last + 1);
        let mut options = WriteOptionsBuilder::new()
            .source_timestamp(Timestamp::now())
            .related_sample_identity_opt(related.map(SampleId::to_dds));
        if let Some(reader) = reader {
            options = options.to_single_reader(reader.to_dds());
        }
        let sample = Raw { payload: padded(&payload), little_endian: true };
        // Polled once: there is either room now or there is not.
        match self.raw.async_write_with_options(sample, options.build()).now_or_never() {
            Some(Ok(id)) => {
                *last = id.sequence_number.into();
                Ok(*last)
            }
            None | Some(Err(WriteError::WouldBlock { .. })) => {
                Err(PublishError::Full { topic: self.topic.clone(), backlog: self.qos.backlog.into(), payload })
            }
            Some(Err(error)) => Err(PublishError::Closed { topic: self.topic.clone(), reason: error.to_string() }),
        }
    }

    /// Waits until every matched reliable reader has all that was sent so far.
    pub(super) async fn acknowledged(&self) {
        // An error means that the writer is closed: nothing more will be acknowledged.
        let _ = self.raw.async_wait_for_acknowledgments().await;
    }
}

/// A body that may leave in fragments, filled up to a multiple of four bytes. RustDDS does not pad the last fragment, and
/// Cyclone DDS up to 0.10.2 drops one that is not padded. Readers of CDR do not look at what lies behind a message.
fn padded(body: &Bytes) -> Bytes {
    let lacking = body.len().next_multiple_of(4) - body.len();
    if lacking == 0 || body.len() <= FRAGMENTED_ABOVE_BYTES {
        return body.clone();
    }
    [body.as_ref(), &[0; 4][..lacking]].concat().into()
}

/// What a writer's status event says of its readers.
fn peer_event(status: &DataWriterStatus) -> PeerEvent {
    match status {
        DataWriterStatus::PublicationMatched { current, reader, .. } if current.count_change() > 0 => {
            PeerEvent::Joined((*reader).into())
        }
        DataWriterStatus::PublicationMatched { reader, .. } => PeerEvent::Left((*reader).into()),
        DataWriterStatus::OfferedIncompatibleQos { last_policy_id, reader, .. } => {
            PeerEvent::Incompatible((*reader).into(), format!("{last_policy_id:?}"))
        }
        _ => PeerEvent::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_leave_in_fragments_ends_on_a_word() {
        for (length, expected) in [(7, 7), (1_000, 1_000), (1_001, 1_004), (1_003, 1_004), (1_004, 1_004)] {
            let body = Bytes::from(vec![9; length]);
            let padded = padded(&body);
            assert_eq!(padded.len(), expected);
            assert!(padded.starts_with(&body) && padded[length..].iter().all(|byte| *byte == 0));
        }
    }
}
