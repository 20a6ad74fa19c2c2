//! The loop over DDS: a hidden, reliable topic for each edge, and two for the clock.

use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use minifactory_msgs::Message;
use minifactory_msgs::msg::{LoopBundle, LoopGrant, LoopStatus};

use super::contract::LoopContract;
use super::runner::{Incoming, Links, RunError};
use crate::cdr;
use crate::dds::{DdsError, Participant, PublishError, Qos, Reader, Writer};
use crate::patience::{Patience, share_of_machine};

/// A full writer is tried again for this long, as [`Patience`] counts it, before the run is given up.
const SEND_LIMIT: Duration = Duration::from_secs(3);

/// A node's writers in the loop, and the readers that fill its inbox for as long as this lives.
pub(crate) struct DdsLinks {
    bundles: Vec<Option<LoopWriter>>,
    status: LoopWriter,
    _readers: Vec<Reader>,
}

impl DdsLinks {
    pub(crate) fn open(
        participant: &Participant,
        contract: &LoopContract,
        node: &str,
        inbox: &Sender<Incoming>,
    ) -> Result<Self, DdsError> {
        let me = contract.node_index(node);
        let mut bundles = Vec::new();
        let mut readers = Vec::new();
        for (index, edge) in contract.edges.iter().enumerate() {
            let topic = contract.edge_topic(edge);
            let sends = Some(edge.from) == me;
            bundles.push(sends.then(|| LoopWriter::open::<LoopBundle>(participant, &topic)).transpose()?);
            if Some(edge.to) == me {
                let inbox = inbox.clone();
                readers.push(read(participant, &topic, move |bundle| {
                    // A closed inbox belongs to a node that has left the loop.
                    let _ = inbox.send(Incoming::Bundle(index, bundle));
                })?);
            }
        }
        let inbox = inbox.clone();
        readers.push(read(participant, &contract.grant_topic(), move |grant: LoopGrant| {
            let _ = inbox.send(Incoming::Grant(grant));
        })?);
        let status = LoopWriter::open::<LoopStatus>(participant, &contract.status_topic())?;
        Ok(Self { bundles, status, _readers: readers })
    }
}

impl Links for DdsLinks {
    fn send_bundle(&mut self, edge: usize, bundle: LoopBundle) -> Result<(), RunError> {
        match self.bundles.get(edge) {
            Some(Some(writer)) => writer.send(&bundle),
            _ => Ok(()),
        }
    }

    fn send_status(&mut self, status: LoopStatus) -> Result<(), RunError> {
        self.status.send(&status)
    }
}

/// A writer that loses nothing: when DDS has no room it waits.
pub(super) struct LoopWriter {
    topic: String,
    writer: Writer,
}

impl LoopWriter {
    pub(super) fn open<M: Message>(participant: &Participant, topic: &str) -> Result<Self, DdsError> {
        let writer = participant.writer(topic, &M::INFO.dds_type(), &Qos::loop_edge())?;
        Ok(Self { topic: topic.to_owned(), writer })
    }

    pub(super) fn send<M: Message>(&self, message: &M) -> Result<(), RunError> {
        let failed = |reason: String| RunError::Send { topic: self.topic.clone(), reason };
        let mut payload = cdr::encode(message).map_err(|error| failed(error.to_string()))?;
        let since = Instant::now();
        let mut patience = Patience::default();
        loop {
            match self.writer.publish(payload) {
                Ok(()) => return Ok(()),
                Err(PublishError::Full { payload: returned, .. })
                    if patience.spent(since.elapsed(), share_of_machine) < SEND_LIMIT =>
                {
                    payload = returned;
                    std::thread::sleep(Duration::from_millis(1));
                }
                Err(error) => return Err(failed(error.to_string())),
            }
        }
    }
}

/// Hears a loop topic; what cannot be decoded shows up as a gap and ends the run there.
pub(super) fn read<M: Message>(
    participant: &Participant,
    topic: &str,
    mut deliver: impl FnMut(M) + Send + 'static,
) -> Result<Reader, DdsError> {
    participant.reader(topic, &M::INFO.dds_type(), &Qos::loop_edge(), move |sample| {
        match cdr::decode(&sample.payload, sample.little_endian) {
            Ok(message) => deliver(message),
            Err(error) => tracing::warn!("dropped a malformed {}: {error}", M::INFO.ros_type()),
        }
    })
}
