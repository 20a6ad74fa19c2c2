use std::sync::Arc;

use bytes::Bytes;
use futures::{FutureExt, StreamExt};
use ros2_client::dds::rustdds::{
    DataWriterStatus, RTPSEntity, StatusEvented, Timestamp, WriteOptionsBuilder, dds::WriteError,
};

use super::{
    Guid, PublishError, Qos, SampleId,
    executor::Task,
    graph,
    participant::Inner,
    peers::{PeerEvent, Peers},
    raw::{Raw, RawWriter},
};

/// A publication. Any thread may publish.
pub struct Writer {
    // Dropped in this order: the task shares the endpoint, the participant goes last.
    task: Option<Task>,
    raw: Arc<RawWriter>,
    peers: Arc<Peers>,
    topic: Arc<str>,
    qos: Qos,
    participant: Arc<Inner>,
}

impl Writer {
    pub(super) fn start(
        participant: Arc<Inner>,
        raw: RawWriter,
        topic: Arc<str>,
        dds_type: &str,
        qos: Qos,
    ) -> Self {
        let raw = Arc::new(raw);
        let peers = Arc::new(Peers::default());
        let watch = {
            let (raw, peers, topic) = (raw.clone(), peers.clone(), topic.clone());
            let (domain_participant, dds_type) =
                (participant.domain_participant.clone(), dds_type.to_owned());
            async move {
                let discovered = || {
                    graph::readers(&domain_participant)
                        .into_iter()
                        .filter(|reader| reader.topic == *topic && reader.dds_type == dds_type)
                        .filter(|reader| qos.serves(reader.reliability, reader.durability))
                        .map(|reader| reader.guid)
                        .collect()
                };
                let events = raw
                    .as_async_status_stream()
                    .map(|status| peer_event(&status));
                peers.follow(&topic, events, discovered).await;
            }
        };
        let task = Some(participant.executor.spawn(watch));
        Self {
            task,
            raw,
            peers,
            topic,
            qos,
            participant,
        }
    }

    /// Publishes a little-endian CDR body. Never waits.
    ///
    /// # Errors
    /// [`PublishError::Full`] gives the body back when a reliable reader has fallen behind,
    /// [`PublishError::Closed`] when the middleware has failed.
    pub fn publish(&self, payload: Bytes) -> Result<(), PublishError> {
        self.send(payload, None, None)
    }

    /// Publishes to one reader only, or as the answer to some sample, or both.
    pub(super) fn send(
        &self,
        payload: Bytes,
        reader: Option<Guid>,
        related: Option<SampleId>,
    ) -> Result<(), PublishError> {
        let mut options = WriteOptionsBuilder::new()
            .source_timestamp(Timestamp::now())
            .related_sample_identity_opt(related.map(SampleId::to_dds));
        if let Some(reader) = reader {
            options = options.to_single_reader(reader.to_dds());
        }
        let sample = Raw {
            payload: payload.clone(),
            little_endian: true,
        };
        // Polled once: there is either room now or there is not.
        match self
            .raw
            .async_write_with_options(sample, options.build())
            .now_or_never()
        {
            Some(Ok(_)) => Ok(()),
            None | Some(Err(WriteError::WouldBlock { .. })) => Err(PublishError::Full {
                topic: self.topic.to_string(),
                backlog: self.qos.backlog.into(),
                payload,
            }),
            Some(Err(error)) => Err(PublishError::Closed {
                topic: self.topic.to_string(),
                reason: error.to_string(),
            }),
        }
    }

    /// DDS name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// The identity under which peers see this writer.
    #[must_use]
    pub fn guid(&self) -> Guid {
        self.raw.guid().into()
    }

    /// Readers of other participants that this writer serves now.
    #[must_use]
    pub fn matched_readers(&self) -> usize {
        self.peers.count()
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.task.take();
        self.participant.withdraw_writer(self.guid());
    }
}

/// What a writer's status event says of its readers.
fn peer_event(status: &DataWriterStatus) -> PeerEvent {
    match status {
        DataWriterStatus::PublicationMatched {
            current, reader, ..
        } if current.count_change() > 0 => PeerEvent::Joined((*reader).into()),
        DataWriterStatus::PublicationMatched { reader, .. } => PeerEvent::Left((*reader).into()),
        DataWriterStatus::OfferedIncompatibleQos {
            last_policy_id,
            reader,
            ..
        } => PeerEvent::Incompatible((*reader).into(), format!("{last_policy_id:?}")),
        _ => PeerEvent::Other,
    }
}
