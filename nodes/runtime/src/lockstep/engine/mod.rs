//! The loop as one node sees it: which tick may run, on which inputs, and what must be sent. No I/O.

use std::collections::VecDeque;

use bytes::Bytes;
use minifactory_msgs::msg::{LoopBundle, LoopEntry, LoopGrant};

use super::contract::{Channel, LoopContract};

/// Bundles are cut at this many bytes, so that one stays below a UDP datagram of 64 kB.
const BUNDLE_BYTES_MAX: usize = 48 * 1024;
/// What an entry takes beside its payload, in CDR with padding.
const ENTRY_BYTES: usize = 32;
/// A node that never blocks still sends this often, so that those who wait for it can go on.
const BUNDLE_TICKS_MAX: u64 = 8;
/// A tick with inputs of so many bytes is likely to take long.
const LONG_STEP_BYTES: usize = 8 * 1024;

/// Why a loop cannot go on.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum LoopError {
    /// A bundle is missing: something was lost between two nodes, or the sender was started a second time.
    #[error("lost a bundle from {from}: expected sequence {expected}, got {got}")]
    Gap {
        /// The sending node.
        from: String,
        /// Sequence number that should have come.
        expected: u64,
        /// Sequence number that came.
        got: u64,
    },
    /// A bundle names a port its edge does not have.
    #[error("bundle from {from} names port {port}, but that edge has {ports}")]
    UnknownPort {
        /// The sending node.
        from: String,
        /// The port.
        port: u16,
        /// How many the edge has.
        ports: usize,
    },
    /// The contract does not list this node.
    #[error("{node} is not part of the loop: {nodes:?}")]
    NotInLoop {
        /// The node.
        node: String,
        /// The nodes of the contract.
        nodes: Vec<String>,
    },
    /// The node has other ports than the contract says: the two were made from different configurations.
    #[error("the contract does not fit {node}: its inputs differ in {name}")]
    Misfit {
        /// The node.
        node: String,
        /// Topic or service.
        name: String,
    },
    /// A message is too large for the loop.
    #[error("a message of {bytes} bytes; the loop carries at most {} bytes", super::MESSAGE_BYTES_MAX)]
    TooLarge {
        /// Its size.
        bytes: usize,
    },
}

/// What keeps a node from running its next tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blocked<'a> {
    /// The clock has not granted it.
    Grant,
    /// The named node has not sent what is due.
    Input(&'a str),
    /// The run has ended.
    Ended,
}

/// One input of a tick, on the channel it came by.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Index of the in-edge.
    pub edge: usize,
    /// Port of that edge.
    pub port: u16,
    /// What was sent.
    pub payload: Bytes,
}

#[derive(Debug)]
struct InEdge {
    contract_index: usize,
    from: String,
    delay_ticks: u64,
    ports: usize,
    /// Everything up to and without this tick has arrived.
    complete_until: u64,
    next_sequence: u64,
    queue: VecDeque<LoopEntry>,
    heard: bool,
}

#[derive(Debug)]
struct OutEdge {
    contract_index: usize,
    /// Whether anybody hears the consumer: if not, nobody waits for it.
    leads_on: bool,
    next_bundle: u64,
    next_entry: u32,
    first_tick: u64,
    bytes: usize,
    pending: Vec<LoopEntry>,
    finished: Vec<LoopBundle>,
}

/// Where a channel leads: out-edge and port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Route {
    edge: usize,
    port: u16,
}

/// The loop as one node sees it.
#[derive(Debug)]
pub struct Engine {
    run_id: u64,
    next_tick: u64,
    granted_until: u64,
    end_tick: u64,
    ended: bool,
    ins: Vec<InEdge>,
    outs: Vec<OutEdge>,
    channels_in: Vec<Vec<Channel>>,
    channels_out: Vec<Vec<Channel>>,
}

impl Engine {
    /// The loop of `contract` as `node` sees it.
    ///
    /// # Errors
    /// [`LoopError::NotInLoop`] when the contract does not list `node`.
    pub fn new(contract: &LoopContract, node: &str) -> Result<Self, LoopError> {
        let me = contract
            .node_index(node)
            .ok_or_else(|| LoopError::NotInLoop { node: node.to_owned(), nodes: contract.nodes.clone() })?;
        let edges = || contract.edges.iter().enumerate();
        Ok(Self {
            run_id: contract.run_id,
            next_tick: 0,
            granted_until: 0,
            end_tick: u64::MAX,
            ended: false,
            channels_in: edges().filter(|(_, e)| e.to == me).map(|(_, e)| e.channels.clone()).collect(),
            channels_out: edges().filter(|(_, e)| e.from == me).map(|(_, e)| e.channels.clone()).collect(),
            ins: edges()
                .filter(|(_, edge)| edge.to == me)
                .map(|(contract_index, edge)| InEdge {
                    contract_index,
                    from: contract.nodes[edge.from].clone(),
                    delay_ticks: edge.delay_ticks,
                    ports: edge.channels.len(),
                    complete_until: 0,
                    next_sequence: 0,
                    queue: VecDeque::new(),
                    heard: false,
                })
                .collect(),
            outs: edges()
                .filter(|(_, edge)| edge.from == me)
                .map(|(contract_index, edge)| OutEdge {
                    contract_index,
                    leads_on: contract.edges.iter().any(|other| other.from == edge.to),
                    next_bundle: 0,
                    next_entry: 0,
                    first_tick: 0,
                    bytes: 0,
                    pending: Vec::new(),
                    finished: Vec::new(),
                })
                .collect(),
        })
    }

    /// The next tick to run.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.next_tick
    }

    /// Whether the clock has ended the run.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.ended
    }

    /// Whether every node this one listens to has been heard.
    #[must_use]
    pub fn wired(&self) -> bool {
        self.ins.iter().all(|edge| edge.heard)
    }

    /// The in-edges: index in the contract and channels, in the order [`Input::edge`] counts.
    pub fn in_edges(&self) -> impl Iterator<Item = (usize, &[Channel])> {
        self.ins.iter().zip(&self.channels_in).map(|(edge, channels)| (edge.contract_index, channels.as_slice()))
    }

    /// Where messages of `channel` go.
    #[must_use]
    pub fn routes(&self, channel: &Channel) -> Vec<Route> {
        let mut routes = Vec::new();
        for (edge, channels) in self.channels_out.iter().enumerate() {
            if let Some(port) = channels.iter().position(|c| c == channel)
                && let Ok(port) = u16::try_from(port)
            {
                routes.push(Route { edge, port });
            }
        }
        routes
    }

    /// The route of replies to the node at the other end of in-edge `in_edge`.
    #[must_use]
    pub fn reply_route(&self, contract: &LoopContract, in_edge: usize, channel: &Channel) -> Option<Route> {
        let client = contract.edges[self.ins.get(in_edge)?.contract_index].from;
        self.routes(channel).into_iter().find(|route| contract.edges[self.outs[route.edge].contract_index].to == client)
    }

    /// Takes in a grant; one of another run is ignored.
    pub fn accept_grant(&mut self, grant: &LoopGrant) {
        if grant.run_id != self.run_id {
            return;
        }
        self.granted_until = self.granted_until.max(grant.until_tick);
        self.end_tick = self.end_tick.min(grant.end_tick);
        self.ended |= grant.ended;
    }

    /// Takes in a bundle of the in-edge that has `contract_index`; one of another run is ignored.
    ///
    /// # Errors
    /// [`LoopError::Gap`] when a bundle was lost, [`LoopError::UnknownPort`] when it does not fit the contract.
    pub fn accept_bundle(&mut self, contract_index: usize, bundle: LoopBundle) -> Result<(), LoopError> {
        if bundle.run_id != self.run_id {
            return Ok(());
        }
        let Some(edge) = self.ins.iter_mut().find(|edge| edge.contract_index == contract_index) else {
            return Ok(());
        };
        edge.heard = true;
        if bundle.probe {
            return Ok(());
        }
        if bundle.sequence != edge.next_sequence {
            return Err(LoopError::Gap { from: edge.from.clone(), expected: edge.next_sequence, got: bundle.sequence });
        }
        if let Some(entry) = bundle.entries.iter().find(|entry| usize::from(entry.port) >= edge.ports) {
            return Err(LoopError::UnknownPort { from: edge.from.clone(), port: entry.port, ports: edge.ports });
        }
        edge.next_sequence += 1;
        edge.complete_until = bundle.until_tick;
        edge.queue.extend(bundle.entries);
        Ok(())
    }

    /// What keeps the next tick from running, if anything.
    #[must_use]
    pub fn blocked(&self) -> Option<Blocked<'_>> {
        if self.ended || self.next_tick >= self.end_tick {
            return Some(Blocked::Ended);
        }
        if self.next_tick >= self.granted_until {
            return Some(Blocked::Grant);
        }
        let late = self.ins.iter().find(|edge| self.next_tick + 1 > edge.due(edge.complete_until));
        late.map(|edge| Blocked::Input(&edge.from))
    }

    /// The inputs of the next tick, ordered by publisher, then by tick and sequence.
    pub fn inputs(&mut self) -> Vec<Input> {
        let mut inputs = Vec::new();
        for (index, edge) in self.ins.iter_mut().enumerate() {
            while edge.queue.front().is_some_and(|entry| edge.due(entry.tick) <= self.next_tick) {
                if let Some(entry) = edge.queue.pop_front() {
                    inputs.push(Input { edge: index, port: entry.port, payload: Bytes::from(entry.payload) });
                }
            }
        }
        inputs
    }

    /// Queues `payload` for `route`, as sent in the current tick.
    ///
    /// # Errors
    /// [`LoopError::TooLarge`] when it fits no bundle.
    pub fn send(&mut self, route: Route, payload: &[u8]) -> Result<(), LoopError> {
        if payload.len() > super::MESSAGE_BYTES_MAX {
            return Err(LoopError::TooLarge { bytes: payload.len() });
        }
        let (run_id, tick) = (self.run_id, self.next_tick);
        let edge = &mut self.outs[route.edge];
        let bytes = ENTRY_BYTES + payload.len();
        if edge.bytes + bytes > BUNDLE_BYTES_MAX && !edge.pending.is_empty() {
            // This tick is not complete yet, so the bundle ends before it.
            edge.cut(run_id, tick);
        }
        edge.bytes += bytes;
        edge.pending.push(LoopEntry { tick, sequence: edge.next_entry, port: route.port, payload: payload.to_vec() });
        edge.next_entry = edge.next_entry.wrapping_add(1);
        Ok(())
    }

    /// Ends the current tick.
    pub fn finish_tick(&mut self) {
        self.next_tick += 1;
    }

    /// Whether the inputs of the next tick are so large that it is likely to take long, as a picture does to look at. What
    /// others may be waiting for is then to be sent before.
    #[must_use]
    pub fn has_much_to_do(inputs: &[Input]) -> bool {
        inputs.iter().map(|input| input.payload.len()).sum::<usize>() >= LONG_STEP_BYTES
    }

    /// Bundles to send before a tick that takes long: all that is complete and that others may be waiting for.
    pub fn take_complete(&mut self) -> Vec<(usize, LoopBundle)> {
        self.take(|edge, age| age > 0 && edge.leads_on)
    }

    /// Bundles to send, as (contract index of the edge, bundle): when the node has no more to run all that is complete, when it
    /// waits for input what others may be waiting for, and else only what is long or large enough.
    pub fn take_bundles(&mut self) -> Vec<(usize, LoopBundle)> {
        let (waits, is_done) = match self.blocked() {
            None => (false, false),
            Some(Blocked::Input(_)) => (true, false),
            Some(Blocked::Grant | Blocked::Ended) => (true, true),
        };
        self.take(|edge, age| {
            let is_due = age >= BUNDLE_TICKS_MAX || edge.bytes > BUNDLE_BYTES_MAX / 2;
            age > 0 && (is_due || is_done || waits && edge.leads_on)
        })
    }

    /// Takes what is finished, after the pending bundles are cut to which that applies, by the ticks they hold.
    fn take(&mut self, applies: impl Fn(&OutEdge, u64) -> bool) -> Vec<(usize, LoopBundle)> {
        let mut bundles = Vec::new();
        for edge in &mut self.outs {
            if applies(edge, self.next_tick - edge.first_tick) {
                edge.cut(self.run_id, self.next_tick);
            }
            bundles.extend(edge.finished.drain(..).map(|bundle| (edge.contract_index, bundle)));
        }
        bundles
    }

    /// Bundles that only show that the edges work, sent until the run starts.
    #[must_use]
    pub fn probes(&self) -> Vec<(usize, LoopBundle)> {
        let probe = LoopBundle { run_id: self.run_id, probe: true, ..LoopBundle::default() };
        self.outs.iter().map(|edge| (edge.contract_index, probe.clone())).collect()
    }
}

impl InEdge {
    /// The tick that what was sent in `tick` is meant for; a tick is whatever a sender says it is, and may be any.
    fn due(&self, tick: u64) -> u64 {
        tick.saturating_add(self.delay_ticks)
    }
}

impl OutEdge {
    /// Closes the pending bundle: everything before `until_tick` is complete with it.
    fn cut(&mut self, run_id: u64, until_tick: u64) {
        self.finished.push(LoopBundle {
            run_id,
            sequence: self.next_bundle,
            first_tick: self.first_tick,
            until_tick,
            probe: false,
            entries: std::mem::take(&mut self.pending),
        });
        self.next_bundle += 1;
        self.first_tick = until_tick;
        self.bytes = 0;
    }
}

#[cfg(test)]
mod tests;
