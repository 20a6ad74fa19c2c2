//! The loop inside one process: the same bundles, grants and statuses, handed over by channels instead of DDS.

use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use minifactory_msgs::msg::{LoopBundle, LoopGrant, LoopStatus};

use super::contract::LoopContract;
use super::runner::{Incoming, Links, RunError};

/// Where the members of a loop that lives in one process find each other. Clones are the same hub.
#[derive(Clone, Debug, Default)]
pub struct Hub(Arc<Mutex<Members>>);

#[derive(Debug, Default)]
struct Members {
    /// Inboxes of the nodes, by index in the contract.
    nodes: Vec<Option<Sender<Incoming>>>,
    clock: Option<Sender<LoopStatus>>,
}

impl Hub {
    fn members(&self) -> MutexGuard<'_, Members> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn join_as_clock(&self, inbox: Sender<LoopStatus>) {
        self.members().clock = Some(inbox);
    }

    /// Sends a grant to every node. One that has left misses nothing.
    pub(super) fn grant(&self, grant: &LoopGrant) {
        for inbox in self.members().nodes.iter().flatten() {
            let _ = inbox.send(Incoming::Grant(*grant));
        }
    }

    /// Takes the place of `node` in the loop.
    pub(crate) fn join(&self, contract: &LoopContract, node: &str, inbox: Sender<Incoming>) -> HubLinks {
        let mut members = self.members();
        members.nodes.resize(contract.nodes.len(), None);
        if let Some(index) = contract.node_index(node) {
            members.nodes[index] = Some(inbox);
        }
        HubLinks { hub: self.clone(), receivers: contract.edges.iter().map(|edge| edge.to).collect() }
    }
}

/// A node's way to the others in its process.
pub(crate) struct HubLinks {
    hub: Hub,
    /// Receiving node of each edge.
    receivers: Vec<usize>,
}

impl Links for HubLinks {
    fn send_bundle(&mut self, edge: usize, bundle: LoopBundle) -> Result<(), RunError> {
        // Nobody is there yet while the loop comes up, when only probes are sent; nobody is left when it ends.
        if let Some(inbox) = &self.hub.members().nodes[self.receivers[edge]] {
            let _ = inbox.send(Incoming::Bundle(edge, bundle));
        }
        Ok(())
    }

    fn send_status(&mut self, status: LoopStatus) -> Result<(), RunError> {
        if let Some(clock) = &self.hub.members().clock {
            let _ = clock.send(status);
        }
        Ok(())
    }
}
