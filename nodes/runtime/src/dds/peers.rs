//! The endpoints of others that one of ours has found.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use futures::{FutureExt, Stream, StreamExt, pin_mut};
use tokio::{
    sync::{Mutex, OwnedMutexGuard, watch},
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
    matched: watch::Sender<BTreeMap<Guid, Match>>,
}

/// What is known of a matched endpoint.
pub(super) struct Match {
    found: Instant,
    /// Whether it has been sent a sample of its own. Locked while the first is on its way.
    met: Arc<Mutex<bool>>,
}

impl Match {
    fn new() -> Self {
        Self { found: Instant::now(), met: Arc::default() }
    }
}

/// The right to send a peer its first sample. Whoever has more for that peer waits until this is dropped.
pub(super) struct First {
    _met: OwnedMutexGuard<bool>,
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

    pub(super) fn is_matched(&self, peer: Guid) -> bool {
        self.matched.borrow().contains_key(&peer)
    }

    /// Tells whenever the matched peers have changed.
    pub(super) fn changes(&self) -> watch::Receiver<BTreeMap<Guid, Match>> {
        self.matched.subscribe()
    }

    /// Waits until a peer has had time to find this end in turn.
    pub(super) async fn settled(&self, peer: Guid) {
        let found = self.matched.borrow().get(&peer).map(|matched| matched.found);
        if let Some(found) = found {
            sleep_until(found + SETTLING).await;
        }
    }

    /// Waits while the first sample to a peer is on its way; `Some` for whoever is to send it. To be kept until the peer
    /// has answered in some way: Cyclone DDS begins with the first heartbeat that it hears, and takes what that announces
    /// for gone by. RustDDS sends none before its first sample, and with that sample announces all that waits behind it.
    pub(super) async fn first(&self, peer: Guid) -> Option<First> {
        let met = self.matched.borrow().get(&peer)?.met.clone();
        let mut met = met.lock_owned().await;
        (!std::mem::replace(&mut *met, true)).then_some(First { _met: met })
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
                        matched.entry(peer).or_insert_with(Match::new);
                    }
                });
            }
        }
    }

    fn take(&self, topic: &str, event: PeerEvent) {
        match event {
            PeerEvent::Joined(peer) => {
                self.change(|matched| _ = matched.insert(peer, Match::new()));
            }
            PeerEvent::Left(peer) => self.change(|matched| _ = matched.remove(&peer)),
            PeerEvent::Incompatible(peer, policy) => {
                tracing::warn!(topic, %peer, policy, "this peer asks for more than is offered: they do not match");
            }
            PeerEvent::Other => {}
        }
    }

    fn change(&self, change: impl FnOnce(&mut BTreeMap<Guid, Match>)) {
        self.matched.send_modify(|matched| {
            change(matched);
            self.count.store(matched.len(), Ordering::Relaxed);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peers(matched: &[Guid]) -> Peers {
        let peers = Peers::default();
        for peer in matched {
            peers.take("topic", PeerEvent::Joined(*peer));
        }
        peers
    }

    #[test]
    fn all_wait_for_the_first_sample_to_a_peer_and_for_no_other() {
        let [a, b] = [1, 2].map(|byte| Guid([byte; 16]));
        let peers = peers(&[a, b]);
        let first = peers.first(a).now_or_never().unwrap().unwrap();
        let second = peers.first(a);
        pin_mut!(second);
        assert!(second.as_mut().now_or_never().is_none());
        assert!(peers.first(b).now_or_never().unwrap().is_some(), "another peer has a first of its own");
        drop(first);
        assert!(second.now_or_never().unwrap().is_none());
        assert!(peers.first(a).now_or_never().unwrap().is_none(), "there is one first only");
    }

    #[test]
    fn a_peer_that_comes_again_has_a_first_again_and_one_that_is_not_there_has_none() {
        let peer = Guid([1; 16]);
        let peers = peers(&[peer]);
        drop(peers.first(peer).now_or_never().unwrap().unwrap());
        peers.take("topic", PeerEvent::Left(peer));
        assert!(peers.first(peer).now_or_never().unwrap().is_none());
        peers.take("topic", PeerEvent::Joined(peer));
        assert!(peers.first(peer).now_or_never().unwrap().is_some());
    }
}
