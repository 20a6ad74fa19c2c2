use std::{
    collections::BTreeSet,
    sync::atomic::{AtomicUsize, Ordering},
};

use futures::{FutureExt, Stream, StreamExt, pin_mut};
use tokio::sync::watch;

use super::Guid;

/// The endpoints of other participants that an endpoint of ours has matched.
#[derive(Default)]
pub(super) struct Peers {
    // Beside the set, so that counting never waits for a change.
    count: AtomicUsize,
    matched: watch::Sender<BTreeSet<Guid>>,
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

    pub(super) fn matched(&self) -> BTreeSet<Guid> {
        self.matched.borrow().clone()
    }

    pub(super) fn subscribe(&self) -> watch::Receiver<BTreeSet<Guid>> {
        self.matched.subscribe()
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
        self.matched.send_modify(|matched| {
            change(matched);
            self.count.store(matched.len(), Ordering::Relaxed);
        });
    }
}
