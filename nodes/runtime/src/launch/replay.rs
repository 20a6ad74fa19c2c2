//! Which recorded message a node gets in which tick.

use std::collections::{BTreeMap, VecDeque};
use std::iter::Peekable;

use bytes::Bytes;

use super::Recorded;
use crate::lockstep::{Channel, LoopContract};
use crate::node::{Interface, NodeError, PortKind};

/// Topic → port, and ticks from when a message is sent to when it arrives.
pub(super) type Delays = BTreeMap<String, (usize, u64)>;

/// The topics that `node` hears.
pub(super) fn delays(contract: &LoopContract, node: &str, interface: &Interface) -> Result<Delays, NodeError> {
    let me = contract.node_index(node).ok_or_else(|| {
        NodeError::new(format!("{node} is not part of the run, which has {}", contract.nodes.join(", ")))
    })?;
    let mut delays = Delays::new();
    for (port, declared) in interface.ports.iter().enumerate() {
        let name = &declared.name;
        match declared.kind {
            PortKind::Publish => {}
            // Nobody in the loop uses what lies below the node's own name: its lifecycle.
            PortKind::Serve if declared.name.starts_with(&format!("{node}/")) => {}
            PortKind::Serve | PortKind::Call(_) => {
                return Err(NodeError::new(format!("{node} talks by the service {name}, which is not recorded")));
            }
            PortKind::Subscribe(_) => {
                let channel = Channel::Topic(name.clone());
                let mut edges = contract.edges.iter().filter(|edge| edge.to == me && edge.channels.contains(&channel));
                let (Some(edge), None) = (edges.next(), edges.next()) else {
                    let reason =
                        format!("{node} hears {name} of several nodes, and what is recorded tells them not apart");
                    return Err(NodeError::new(reason));
                };
                delays.insert(name.clone(), (port, edge.delay_ticks));
            }
        }
    }
    Ok(delays)
}

/// Recorded messages, in the order of their ticks, as a node gets them.
pub(super) struct Inputs<'a> {
    delays: Delays,
    recorded: Peekable<&'a mut dyn Iterator<Item = Recorded>>,
    /// Port → tick of arrival and payload, oldest first.
    waiting: BTreeMap<usize, VecDeque<(u64, Bytes)>>,
}

impl<'a> Inputs<'a> {
    pub(super) fn new(delays: Delays, recorded: &'a mut dyn Iterator<Item = Recorded>) -> Self {
        Self { delays, recorded: recorded.peekable(), waiting: BTreeMap::new() }
    }

    /// What arrives in `tick`, with its port.
    pub(super) fn due(&mut self, tick: u64) -> Vec<(usize, Bytes)> {
        while let Some(Recorded { topic, tick: sent, payload }) = self.recorded.next_if(|next| next.tick <= tick) {
            if let Some(&(port, delay)) = self.delays.get(&topic) {
                self.waiting.entry(port).or_default().push_back((sent + delay, payload));
            }
        }
        let mut due = Vec::new();
        for (port, waiting) in &mut self.waiting {
            while let Some((_, payload)) = waiting.pop_front_if(|(arrives, _)| *arrives <= tick) {
                due.push((*port, payload));
            }
        }
        due
    }
}
