//! Who looks, and at what.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Deserialize;

/// Most viewers at a time.
pub(crate) const VIEWERS_MAX: usize = 16;

/// A kind of message that a viewer can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Channel {
    /// The state of everything, thirty times a second, and what changes more slowly.
    Frame,
    /// What has happened.
    Event,
    /// The motion of the tray over a period.
    Motion,
    /// The motion of the tray, every sample.
    Servo,
    /// Pictures of the camera.
    Picture,
}

/// What a viewer wants to see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Subscription {
    /// The kinds of messages.
    pub(crate) channels: BTreeSet<Channel>,
    /// The feeder whose motion and pictures are wanted, by its index.
    pub(crate) feeder: usize,
}

impl Default for Subscription {
    fn default() -> Self {
        Self { channels: BTreeSet::from([Channel::Frame, Channel::Event]), feeder: 0 }
    }
}

impl Subscription {
    /// Whether messages of this kind are wanted.
    pub(crate) fn wants(&self, channel: Channel) -> bool {
        self.channels.contains(&channel)
    }
}

/// What all viewers together want to see.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Interest {
    /// There is a viewer.
    pub(crate) watched: bool,
    /// Feeders whose tray's motion is wanted.
    pub(crate) motion: BTreeSet<usize>,
    /// Feeders whose pictures are wanted.
    pub(crate) picture: BTreeSet<usize>,
}

/// All viewers.
#[derive(Clone)]
pub(crate) struct Viewers(Arc<Mutex<Inner>>);

struct Inner {
    subscriptions: BTreeMap<u64, Subscription>,
    next: u64,
    /// Hears of every change.
    changes: Sender<Interest>,
}

impl Inner {
    fn interest(&self) -> Interest {
        let of = |channels: &[Channel]| {
            let all = self.subscriptions.values();
            let wanting = all.filter(|one| channels.iter().any(|channel| one.wants(*channel)));
            wanting.map(|one| one.feeder).collect()
        };
        Interest {
            watched: !self.subscriptions.is_empty(),
            motion: of(&[Channel::Motion, Channel::Servo]),
            picture: of(&[Channel::Picture]),
        }
    }

    fn tell(&self) {
        // A closed inbox belongs to a server that is leaving.
        let _ = self.changes.send(self.interest());
    }
}

impl Viewers {
    /// Nobody yet. Changes of interest go to `changes`.
    pub(crate) fn new(changes: Sender<Interest>) -> Self {
        Self(Arc::new(Mutex::new(Inner { subscriptions: BTreeMap::new(), next: 0, changes })))
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a viewer in, unless there are too many.
    pub(crate) fn enter(&self) -> Option<Viewer> {
        let mut inner = self.inner();
        if inner.subscriptions.len() >= VIEWERS_MAX {
            return None;
        }
        let id = inner.next;
        inner.next += 1;
        inner.subscriptions.insert(id, Subscription::default());
        inner.tell();
        drop(inner);
        Some(Viewer { id, all: self.clone() })
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.inner().subscriptions.len()
    }

    /// What they want to see.
    pub(crate) fn interest(&self) -> Interest {
        self.inner().interest()
    }
}

/// One viewer, until it is dropped.
pub(crate) struct Viewer {
    id: u64,
    all: Viewers,
}

impl Viewer {
    /// Changes what it wants to see.
    pub(crate) fn subscribe(&self, subscription: Subscription) {
        let mut inner = self.all.inner();
        inner.subscriptions.insert(self.id, subscription);
        inner.tell();
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let mut inner = self.all.inner();
        inner.subscriptions.remove(&self.id);
        inner.tell();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn interest_follows_those_who_look() {
        let (sender, changes) = channel();
        let viewers = Viewers::new(sender);
        let one = viewers.enter().unwrap();
        let other = viewers.enter().unwrap();
        other.subscribe(Subscription { channels: BTreeSet::from([Channel::Servo]), feeder: 2 });
        one.subscribe(Subscription { channels: BTreeSet::from([Channel::Picture]), feeder: 1 });
        let both = Interest { watched: true, motion: BTreeSet::from([2]), picture: BTreeSet::from([1]) };
        assert_eq!(viewers.interest(), both);
        drop(other);
        assert_eq!(viewers.interest(), Interest { motion: BTreeSet::new(), ..both });
        drop(one);
        assert_eq!(changes.try_iter().last(), Some(Interest::default()));
    }

    #[test]
    fn no_more_are_let_in_than_there_is_room_for() {
        let (sender, _changes) = channel();
        let viewers = Viewers::new(sender);
        let mut inside: Vec<Viewer> = (0..VIEWERS_MAX).map(|_| viewers.enter().unwrap()).collect();
        assert!(viewers.enter().is_none());
        inside.pop();
        assert!(viewers.enter().is_some());
    }
}
