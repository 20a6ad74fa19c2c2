//! The endpoints of others that one of ours has found.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use futures::{FutureExt, Stream, StreamExt, pin_mut};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until},
};

use super::Guid;

/// How long a peer that was just found is given to find this end in turn. What it gets earlier may be
/// lost to it, acknowledged though it is: a volatile reader begins with what comes after it has found
/// the writer.
const SETTLING: Duration = Duration::from_millis(300);

/// The endpoints of other participants that an endpoint of ours has matched.
#[derive(Default)]
pub(super) struct Peers {
    // Beside the set, so that counting never waits for a change.
    count: AtomicUsize,
    /// With the time at which each was found.
    matched: watch::Sender<BTreeMap<Guid, Instant>>,
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
        self.matched.borrow().keys().copied().collect()
    }

    /// Tells whenever the matched peers have changed.
    pub(super) fn changes(&self) -> watch::Receiver<BTreeMap<Guid, Instant>> {
        self.matched.subscribe()
    }

    /// Waits until a peer has had time to find this end in turn.
    pub(super) async fn settled(&self, peer: Guid) {
        let found = self.matched.borrow().get(&peer).copied();
        if let Some(found) = found {
            sleep_until(found + SETTLING).await;
        }
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
                let discovered = discovered();
                self.change(|matched| {
                    matched.retain(|peer, _| discovered.contains(peer));
                    for peer in discovered {
                        matched.entry(peer).or_insert_with(Instant::now);
                    }
                });
            }
        }
    }

    fn take(&self, topic: &str, event: PeerEvent) {
        match event {
            PeerEvent::Joined(peer) => {
                self.change(|matched| _ = matched.insert(peer, Instant::now()));
            }
            PeerEvent::Left(peer) => self.change(|matched| _ = matched.remove(&peer)),
            PeerEvent::Incompatible(peer, policy) => {
                tracing::warn!(topic, %peer, policy, "this peer asks for more than is offered: they do not match");
            }
            PeerEvent::Other => {}
        }
    }

    fn change(&self, change: impl FnOnce(&mut BTreeMap<Guid, Instant>)) {
        self.matched.send_modify(|matched| {
            change(matched);
            self.count.store(matched.len(), Ordering::Relaxed);
        });
    }
}
