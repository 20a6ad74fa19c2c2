use std::{
    collections::BTreeSet,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use futures::{FutureExt, Stream, StreamExt, pin_mut};

use super::Guid;

/// The endpoints of other participants that an endpoint of ours has matched.
#[derive(Default)]
pub(super) struct Peers {
    count: AtomicUsize,
    matched: Mutex<BTreeSet<Guid>>,
}

/// What happened to a match.
pub(super) enum PeerEvent {
    Joined(Guid),
    Left(Guid),
    /// The peer would match but for the named policy.
    Incompatible(Guid, String),
    Other,
}

impl Peers {
    pub(super) fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }

    /// Follows the events of an endpoint. Its queue in the DDS library is short (four events) and
    /// drops the rest in silence, so after a burst the peers are taken from what discovery knows,
    /// which is never behind the events.
    pub(super) async fn follow(
        &self,
        topic: &str,
        events: impl Stream<Item = PeerEvent>,
        discovered: impl Fn() -> BTreeSet<Guid>,
    ) {
        pin_mut!(events);
        while let Some(event) = events.next().await {
            self.take(topic, event);
            let mut burst = false;
            while let Some(Some(event)) = events.next().now_or_never() {
                self.take(topic, event);
                burst = true;
            }
            if burst {
                self.change(|matched| *matched = discovered());
            }
        }
    }

    fn take(&self, topic: &str, event: PeerEvent) {
        match event {
            PeerEvent::Joined(peer) => self.change(|matched| _ = matched.insert(peer)),
            PeerEvent::Left(peer) => self.change(|matched| _ = matched.remove(&peer)),
            PeerEvent::Incompatible(peer, policy) => {
                tracing::warn!(topic, %peer, policy, "this peer asks for more than is offered: they do not match");
            }
            PeerEvent::Other => {}
        }
    }

    fn change(&self, change: impl FnOnce(&mut BTreeSet<Guid>)) {
        let mut matched = self.matched.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut matched);
        self.count.store(matched.len(), Ordering::Relaxed);
    }
}
