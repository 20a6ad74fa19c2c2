//! Messages read ahead on a thread of their own, so that unpacking does not make them late.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use ros2_bags::{Bag, Query, RecordedMessage};

/// Messages that are read ahead.
const AHEAD: usize = 512;

pub(super) struct BagSource {
    messages: Receiver<RecordedMessage>,
    next: Option<RecordedMessage>,
    /// What could not be read, counted.
    errors: Arc<Mutex<BTreeMap<String, u64>>>,
}

impl BagSource {
    /// The messages of these topics within these times.
    pub(super) fn start(bag: &Arc<Bag>, topics: BTreeSet<usize>, start_ns: u64, end_ns: u64) -> Self {
        let (sender, messages) = sync_channel(AHEAD);
        let errors: Arc<Mutex<BTreeMap<String, u64>>> = Arc::default();
        let (bag, shared) = (Arc::clone(bag), Arc::clone(&errors));
        let read = move || {
            for message in bag.messages(&Query { topics: Some(topics), start_ns, end_ns }) {
                match message {
                    Ok(message) => {
                        // A closed channel belongs to a player that has gone elsewhere.
                        if sender.send(message).is_err() {
                            return;
                        }
                    }
                    Err(error) => {
                        let mut errors = shared.lock().unwrap_or_else(PoisonError::into_inner);
                        *errors.entry(error.to_string()).or_default() += 1;
                    }
                }
            }
        };
        // Without a thread there is nothing to play; the channel is closed then.
        if let Err(error) = std::thread::Builder::new().name("read ahead".to_owned()).spawn(read) {
            errors.lock().unwrap_or_else(PoisonError::into_inner).insert(error.to_string(), 1);
        }
        Self { messages, next: None, errors }
    }

    pub(super) fn peek(&mut self) -> Option<&RecordedMessage> {
        if self.next.is_none() {
            self.next = self.messages.recv().ok();
        }
        self.next.as_ref()
    }

    pub(super) fn next(&mut self) -> Option<RecordedMessage> {
        self.peek();
        self.next.take()
    }

    pub(super) fn take_errors(&self) -> BTreeMap<String, u64> {
        std::mem::take(&mut self.errors.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
