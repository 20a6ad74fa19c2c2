//! A viewer in this process: it reads the very messages that the page gets.

use std::collections::BTreeSet;
use std::sync::Arc;

use axum::extract::ws::Utf8Bytes;
use serde_json::Value;

use crate::board::Newest;
use crate::viewers::{Channel, Subscription, Viewer};
use crate::{Shared, View};

/// Somebody in this process who looks, until dropped. What the graph publishes only for those who look is published
/// for it too.
pub struct Watch {
    viewer: Viewer,
    shared: Arc<Shared>,
    feeder: usize,
    /// The number of the newest event that it has seen.
    seen: u64,
}

/// The newest message of each kind, as the page gets them; null where there is none.
#[derive(Clone, Debug, Default)]
pub struct Sight {
    /// The cell, and where it comes from.
    pub hello: Value,
    /// The state of everything.
    pub frame: Value,
    /// What changes slowly.
    pub status: Value,
    /// The motion of the tray in focus, with the errors of the periods before.
    pub motion: Value,
    /// The events since the last look, oldest first.
    pub events: Vec<Value>,
}

impl View {
    /// Looks from within this process; nothing when there are as many viewers as may be.
    #[must_use]
    pub fn watch(&self) -> Option<Watch> {
        let viewer = self.shared.viewers.enter()?;
        let mut watch = Watch { viewer, shared: Arc::clone(&self.shared), feeder: 0, seen: 0 };
        watch.turn_to(0);
        Some(watch)
    }
}

impl Watch {
    /// Sees the motion of this feeder's tray from now on, by its index; one that is not there changes nothing.
    pub fn turn_to(&mut self, feeder: usize) {
        if feeder < self.shared.cell.feeders.len() {
            self.feeder = feeder;
            let channels = BTreeSet::from([Channel::Frame, Channel::Event, Channel::Motion]);
            self.viewer.subscribe(Subscription { channels, feeder });
        }
    }

    /// What is to be seen now.
    pub fn look(&mut self) -> Sight {
        let board = &self.shared.board;
        let events = self.shared.events.since(self.seen).map(|(mut message, last)| {
            self.seen = last;
            message["events"].as_array_mut().map(std::mem::take).unwrap_or_default()
        });
        Sight {
            hello: newest(&board.hello),
            frame: newest(&board.frame),
            status: newest(&board.status),
            motion: newest(&board.feeders[self.feeder].motion),
            events: events.unwrap_or_default(),
        }
    }
}

fn newest(place: &Newest<Utf8Bytes>) -> Value {
    let text = place.borrow().clone();
    // What the server itself has written can be read.
    text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}
