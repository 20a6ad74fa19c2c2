//! The contract of a run: who is in the loop, who hears whom, and how late.

use std::collections::BTreeMap;

use minifactory_msgs::interface::QosMismatch;
use serde::{Deserialize, Serialize};

use crate::node::{Interface, Latency, Port, PortKind};

/// How latencies become ticks, and how far nodes may run ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopTiming {
    /// Length of a tick, ns.
    pub tick_ns: u64,
    /// Delay of [`Latency::Forward`] edges, ticks, at least 1.
    pub forward_delay_ticks: u64,
    /// Delay of [`Latency::Feedback`] edges, ticks, at least 1.
    pub feedback_delay_ticks: u64,
    /// How many ticks the clock grants ahead of the slowest node.
    pub window_ticks: u64,
}

/// Unread samples a DDS reader holds before it forgets (64), less a margin for control messages.
const READER_CAPACITY_TICKS: u64 = 56;

/// What one edge carries, in the order of its port numbers.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Messages of a topic.
    Topic(String),
    /// Requests to a service.
    Request(String),
    /// Replies of a service.
    Reply(String),
}

/// Everything one node sends to another: one ordered stream of bundles.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopEdge {
    /// Index of the sending node.
    pub from: usize,
    /// Index of the receiving node.
    pub to: usize,
    /// What is sent in tick k is consumed in tick k + `delay_ticks`.
    pub delay_ticks: u64,
    /// Port number → channel.
    pub channels: Vec<Channel>,
}

/// The whole loop, known to every node before it starts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopContract {
    /// Distinguishes this run from stale messages of others.
    pub run_id: u64,
    /// Ticks and delays.
    pub timing: LoopTiming,
    /// Names of the nodes in the loop; edges refer to them by index.
    pub nodes: Vec<String>,
    /// Who hears whom.
    pub edges: Vec<LoopEdge>,
    /// Topics with more than one publisher, whose digest needs the payloads of all of them.
    pub shared_topics: Vec<String>,
    /// Time without any progress after which the run is ended, as [`Patience`](crate::patience::Patience) counts it, s.
    pub patience_s: u32,
}

/// The same where all nodes are on one host.
pub(crate) const PATIENCE_S: u32 = 3;

/// Why no loop can be built.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ContractError {
    /// Two nodes of one name.
    #[error("node name {name:?} is used twice; names in a loop must differ")]
    DuplicateNode {
        /// The name.
        name: String,
    },
    /// One node has two ports that nothing could tell apart.
    #[error("{node} declares {name} twice in the same role; one port serves all uses")]
    DuplicatePort {
        /// The node.
        node: String,
        /// Topic or service.
        name: String,
    },
    /// Nobody publishes what a node needs.
    #[error("{node} subscribes to {name}, which no other node of the loop publishes")]
    NoPublisher {
        /// The subscriber.
        node: String,
        /// The topic.
        name: String,
    },
    /// Nobody serves what a node calls.
    #[error("{node} calls {name}, which no other node of the loop serves")]
    NoServer {
        /// The client.
        node: String,
        /// The service.
        name: String,
    },
    /// Two nodes serve one service.
    #[error("{name} is served by both {first} and {second}; a service has one server")]
    TwoServers {
        /// The service.
        name: String,
        /// One server.
        first: String,
        /// The other.
        second: String,
    },
    /// Publisher and subscriber disagree about a type.
    #[error("{node} expects {expected} on {name}, but {other} uses {found}")]
    TypeMismatch {
        /// The subscriber or client.
        node: String,
        /// Topic or service.
        name: String,
        /// Type of the subscriber or client.
        expected: String,
        /// The publisher or server.
        other: String,
        /// Its type.
        found: String,
    },
    /// A subscriber asks for more than a publisher offers.
    #[error("{subscriber} cannot hear {name} from {publisher}: {mismatch}")]
    QosMismatch {
        /// The topic.
        name: String,
        /// Who offers too little.
        publisher: String,
        /// Who asks for more.
        subscriber: String,
        /// What differs.
        mismatch: QosMismatch,
    },
    /// The window does not fit the readers.
    #[error(
        "window_ticks {window_ticks} + the largest delay {largest_delay_ticks} is more than the {READER_CAPACITY_TICKS} \
         ticks a reader may leave unread"
    )]
    WindowTooLarge {
        /// The grant window.
        window_ticks: u64,
        /// The largest delay of an edge.
        largest_delay_ticks: u64,
    },
    /// A tick or delay of zero.
    #[error("{key} must be at least 1")]
    Zero {
        /// Which value.
        key: &'static str,
    },
}

impl LoopContract {
    /// Connects the nodes' interfaces.
    ///
    /// # Errors
    /// [`ContractError`] when names collide, a subscription or call finds no partner of its type in another node, a
    /// publisher offers less than a subscriber asks for, or the timing does not fit.
    pub fn connect(run_id: u64, timing: LoopTiming, nodes: &[(String, Interface)]) -> Result<Self, ContractError> {
        for (key, value) in [
            ("tick_ns", timing.tick_ns),
            ("forward_delay_ticks", timing.forward_delay_ticks),
            ("feedback_delay_ticks", timing.feedback_delay_ticks),
            ("window_ticks", timing.window_ticks),
        ] {
            if value == 0 {
                return Err(ContractError::Zero { key });
            }
        }
        let largest_delay_ticks = timing.forward_delay_ticks.max(timing.feedback_delay_ticks);
        if timing.window_ticks.saturating_add(largest_delay_ticks) > READER_CAPACITY_TICKS {
            return Err(ContractError::WindowTooLarge { window_ticks: timing.window_ticks, largest_delay_ticks });
        }
        check_names(nodes)?;
        let mut builder = Builder { timing, nodes, edges: Vec::new() };
        for node in 0..nodes.len() {
            builder.connect_inputs(node)?;
        }
        builder.edges.sort_by_key(|edge| (edge.to, edge.from));
        Ok(Self {
            run_id,
            timing,
            nodes: nodes.iter().map(|(name, _)| name.clone()).collect(),
            edges: builder.edges,
            shared_topics: shared_topics(nodes),
            patience_s: PATIENCE_S,
        })
    }

    /// Index of the node called `name`.
    #[must_use]
    pub fn node_index(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node == name)
    }

    /// The topic that carries `edge`.
    #[must_use]
    pub fn edge_topic(&self, edge: &LoopEdge) -> String {
        format!("{}{}/to{}", self.hidden_namespace(), self.nodes[edge.from], self.nodes[edge.to])
    }

    /// The topic on which the clock grants ticks.
    #[must_use]
    pub fn grant_topic(&self) -> String {
        format!("{}/grant", self.hidden_namespace())
    }

    /// The topic on which nodes tell the clock how things stand.
    #[must_use]
    pub fn status_topic(&self) -> String {
        format!("{}/status", self.hidden_namespace())
    }

    /// Hidden, as ROS 2 hides names with a leading underscore, and each run's own: nodes of an earlier run that were
    /// killed stay on the graph for a while, and a writer would wait for what they never acknowledge.
    fn hidden_namespace(&self) -> String {
        format!("/_loop/run_{:x}", self.run_id)
    }
}

struct Builder<'a> {
    timing: LoopTiming,
    nodes: &'a [(String, Interface)],
    edges: Vec<LoopEdge>,
}

impl Builder<'_> {
    fn connect_inputs(&mut self, node: usize) -> Result<(), ContractError> {
        let (name, interface) = &self.nodes[node];
        for port in &interface.ports {
            match port.kind {
                PortKind::Subscribe(latency) => {
                    let publishers = self.partners(node, port, PortKind::Publish)?;
                    if publishers.is_empty() {
                        return Err(ContractError::NoPublisher { node: name.clone(), name: port.name.clone() });
                    }
                    for publisher in publishers {
                        self.carry(publisher, node, latency, Channel::Topic(port.name.clone()));
                    }
                }
                PortKind::Call(latency) => {
                    let Some(&server) = self.partners(node, port, PortKind::Serve)?.first() else {
                        return Err(ContractError::NoServer { node: name.clone(), name: port.name.clone() });
                    };
                    self.carry(node, server, latency, Channel::Request(port.name.clone()));
                    self.carry(server, node, Latency::Forward, Channel::Reply(port.name.clone()));
                }
                PortKind::Publish | PortKind::Serve => {}
            }
        }
        Ok(())
    }

    /// The other nodes that have a port of `kind` for what `port` of `node` needs, all of its type and a quality
    /// of service that serves it.
    fn partners(&self, node: usize, port: &Port, kind: PortKind) -> Result<Vec<usize>, ContractError> {
        let mut partners = Vec::new();
        for (other, (other_name, interface)) in self.nodes.iter().enumerate().filter(|(other, _)| *other != node) {
            let Some(found) = interface.ports.iter().find(|p| p.kind == kind && p.name == port.name) else { continue };
            if found.ros_type != port.ros_type {
                return Err(ContractError::TypeMismatch {
                    node: self.nodes[node].0.clone(),
                    name: port.name.clone(),
                    expected: port.ros_type.clone(),
                    other: other_name.clone(),
                    found: found.ros_type.clone(),
                });
            }
            found.qos.check_offer(port.qos.reliability, port.qos.durability).map_err(|mismatch| {
                ContractError::QosMismatch {
                    name: port.name.clone(),
                    publisher: other_name.clone(),
                    subscriber: self.nodes[node].0.clone(),
                    mismatch,
                }
            })?;
            partners.push(other);
        }
        Ok(partners)
    }

    /// Adds `channel` to the edge; an edge is as late as the latest thing it carries.
    fn carry(&mut self, from: usize, to: usize, latency: Latency, channel: Channel) {
        let delay_ticks = match latency {
            Latency::Forward => self.timing.forward_delay_ticks,
            Latency::Feedback => self.timing.feedback_delay_ticks,
        };
        if let Some(edge) = self.edges.iter_mut().find(|edge| (edge.from, edge.to) == (from, to)) {
            edge.delay_ticks = edge.delay_ticks.max(delay_ticks);
            if !edge.channels.contains(&channel) {
                edge.channels.push(channel);
            }
        } else {
            self.edges.push(LoopEdge { from, to, delay_ticks, channels: vec![channel] });
        }
    }
}

/// Refuses nodes, ports of a node, and servers of a service that have one name.
fn check_names(nodes: &[(String, Interface)]) -> Result<(), ContractError> {
    let mut servers: BTreeMap<&str, &str> = BTreeMap::new();
    for (index, (node, interface)) in nodes.iter().enumerate() {
        if nodes[..index].iter().any(|(other, _)| other == node) {
            return Err(ContractError::DuplicateNode { name: node.clone() });
        }
        for (index, port) in interface.ports.iter().enumerate() {
            let role = std::mem::discriminant(&port.kind);
            if interface.ports[..index].iter().any(|p| p.name == port.name && std::mem::discriminant(&p.kind) == role) {
                return Err(ContractError::DuplicatePort { node: node.clone(), name: port.name.clone() });
            }
            if port.kind == PortKind::Serve
                && let Some(first) = servers.insert(&port.name, node)
            {
                let (name, first, second) = (port.name.clone(), first.to_owned(), node.clone());
                return Err(ContractError::TwoServers { name, first, second });
            }
        }
    }
    Ok(())
}

fn shared_topics(nodes: &[(String, Interface)]) -> Vec<String> {
    let published = |interface: &Interface, name: &str| {
        interface.ports.iter().any(|p| p.kind == PortKind::Publish && p.name == name)
    };
    let mut shared: Vec<String> = nodes
        .iter()
        .flat_map(|(_, interface)| &interface.ports)
        .filter(|port| port.kind == PortKind::Publish)
        .filter(|port| nodes.iter().filter(|(_, other)| published(other, &port.name)).count() > 1)
        .map(|port| port.name.clone())
        .collect();
    shared.sort();
    shared.dedup();
    shared
}

#[cfg(test)]
mod tests;
