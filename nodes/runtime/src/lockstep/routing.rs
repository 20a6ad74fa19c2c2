//! Which port of a node an edge's port belongs to.

use super::contract::{Channel, LoopContract};
use super::engine::{Engine, LoopError, Route};
use crate::node::{Interface, PortKind};

/// Between the ports of a node and the ports of its edges.
pub(super) struct Routing {
    /// In-edge → port of that edge → port of the node.
    pub(super) arrivals: Vec<Vec<(usize, Carries)>>,
    /// Port of the node → where its messages or requests go.
    pub(super) sends: Vec<Vec<Route>>,
    /// In-edge → port of the node → where replies to that edge's client go.
    pub(super) replies: Vec<Vec<Option<Route>>>,
}

/// What a port of an edge carries.
#[derive(Clone, Copy)]
pub(super) enum Carries {
    Message,
    Request,
    Reply,
}

impl Routing {
    /// # Errors
    /// [`LoopError::Misfit`] when the contract was made for other ports.
    pub(super) fn new(
        node: &str,
        interface: &Interface,
        engine: &Engine,
        contract: &LoopContract,
    ) -> Result<Self, LoopError> {
        let misfit = |name: &str| LoopError::Misfit { node: node.to_owned(), name: name.to_owned() };
        let mut arrivals = Vec::new();
        for (_, channels) in engine.in_edges() {
            let ports = channels.iter().map(|channel| {
                let (name, carries) = match channel {
                    Channel::Topic(name) => (name, Carries::Message),
                    Channel::Request(name) => (name, Carries::Request),
                    Channel::Reply(name) => (name, Carries::Reply),
                };
                let port = interface.ports.iter().position(|port| carries.fits(port.kind) && port.name == *name);
                port.map(|port| (port, carries)).ok_or_else(|| misfit(name))
            });
            arrivals.push(ports.collect::<Result<Vec<_>, _>>()?);
        }
        for (index, port) in interface.ports.iter().enumerate() {
            let hears = matches!(port.kind, PortKind::Subscribe(_) | PortKind::Call(_));
            if hears && !arrivals.iter().flatten().any(|(port, _)| *port == index) {
                return Err(misfit(&port.name));
            }
        }
        let sends = interface
            .ports
            .iter()
            .map(|port| match port.kind {
                PortKind::Publish => engine.routes(&Channel::Topic(port.name.clone())),
                PortKind::Call(_) => engine.routes(&Channel::Request(port.name.clone())),
                PortKind::Subscribe(_) | PortKind::Serve => Vec::new(),
            })
            .collect();
        let in_edges = engine.in_edges().count();
        let replies = (0..in_edges)
            .map(|edge| {
                let reply = |port: &crate::node::Port| {
                    let channel = Channel::Reply(port.name.clone());
                    (port.kind == PortKind::Serve).then(|| engine.reply_route(contract, edge, &channel)).flatten()
                };
                interface.ports.iter().map(reply).collect()
            })
            .collect();
        Ok(Self { arrivals, sends, replies })
    }
}

impl Carries {
    fn fits(self, kind: PortKind) -> bool {
        match self {
            Self::Message => matches!(kind, PortKind::Subscribe(_)),
            Self::Request => kind == PortKind::Serve,
            Self::Reply => matches!(kind, PortKind::Call(_)),
        }
    }
}
