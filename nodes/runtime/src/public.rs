//! A node's ports as the rest of the ROS graph sees them.
//!
//! In a simulated run nodes hear each other over the loop alone; what they publish goes out here a second time for
//! everybody else, and requests of clients outside the loop come in here. Nobody outside can hold the loop up: what an
//! outsider is too slow for is dropped, counted and reported.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use bytes::Bytes;

use crate::dds::{Counter, DdsError, Durability, Participant, PublishError, Qos, Server, Writer};
use crate::lockstep::Incoming;
use crate::node::{Arrival, Asker, AskerInner, Interface, Port, PortKind};

/// The public endpoints of one node.
pub(crate) struct PublicSide {
    writers: Vec<Option<PublicWriter>>,
    servers: Vec<Server>,
}

struct PublicWriter {
    writer: Writer,
    qos: Qos,
    lost: Arc<Counter>,
}

impl PublicWriter {
    /// A latched message is also for those who will come.
    fn is_heard(&self) -> bool {
        self.qos.durability == Durability::TransientLocal || self.writer.matched_readers() > 0
    }
}

impl PublicSide {
    /// Opens writers for all published ports, and servers whose requests go to `inbox`.
    pub(crate) fn open(
        participant: &Participant,
        interface: &Interface,
        inbox: &Sender<Incoming>,
    ) -> Result<Self, DdsError> {
        let mut writers = Vec::new();
        let mut servers = Vec::new();
        for (index, port) in interface.ports.iter().enumerate() {
            writers.push(match port.kind {
                PortKind::Publish => {
                    let writer = participant.writer(&port.name, &port.dds_types[0], &port.qos)?;
                    let lost = participant.counter(writer.topic(), "samples not sent, as a reader is too slow");
                    Some(PublicWriter { writer, qos: port.qos, lost })
                }
                PortKind::Subscribe(_) | PortKind::Serve | PortKind::Call(_) => None,
            });
            if port.kind == PortKind::Serve {
                servers.push(serve(participant, port, index, inbox.clone())?);
            }
        }
        Ok(Self { writers, servers })
    }

    /// How many replies are on their way.
    pub(crate) fn replies_on_the_way(&self) -> u64 {
        self.servers.iter().map(Server::replies_on_the_way).sum()
    }

    /// Whether anybody outside the loop hears what `port` publishes, or will come to hear it.
    pub(crate) fn is_heard(&self, port: usize) -> bool {
        self.writers[port].as_ref().is_some_and(PublicWriter::is_heard)
    }

    /// Publishes for everybody who hears it.
    pub(crate) fn publish(&mut self, port: usize, payload: Bytes) {
        let Some(public) = &mut self.writers[port] else { return };
        if !public.is_heard() {
            return;
        }
        match public.writer.publish(payload) {
            Ok(()) => {}
            Err(PublishError::Full { .. }) => {
                let lost = public.lost.add(1);
                // Said at 1, 2, 4, 8, … so that a dead reader does not fill the log.
                if lost.is_power_of_two() {
                    tracing::warn!("{}: a reader is too slow, {lost} messages dropped", public.writer.topic());
                }
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }
}

fn serve(participant: &Participant, port: &Port, index: usize, inbox: Sender<Incoming>) -> Result<Server, DdsError> {
    participant.server(&port.name, &port.dds_types[0], &port.dds_types[1], move |request| {
        let asker = Asker(AskerInner::Graph(request.reply));
        let arrival = Arrival::Request { payload: request.payload, little_endian: request.little_endian, asker };
        // A closed inbox belongs to a node that has left; its client hears nothing, as of any node that leaves.
        let _ = inbox.send(Incoming::Outside(index, arrival));
    })
}
