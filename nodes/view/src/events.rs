//! What has happened: the newest events, each with a number, for whoever looks now and whoever comes later.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use serde_json::{Value, json};
use tokio::sync::watch;

use crate::numbers::seconds;

/// Most events that are kept.
const EVENTS_MAX: usize = 500;

/// How bad an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Level {
    /// Things go on.
    Info,
    /// Somebody should look.
    Warn,
    /// Something has stopped.
    Error,
}

/// Something that has happened.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Event {
    /// Simulated time, s.
    pub(crate) time_s: Option<f64>,
    /// What it is about.
    pub(crate) feeder: Option<String>,
    /// One of the kinds that the page knows.
    pub(crate) kind: &'static str,
    /// How bad it is.
    pub(crate) level: Level,
    /// The delivery it belongs to.
    pub(crate) delivery_id: Option<String>,
    /// The station it belongs to.
    pub(crate) station: Option<String>,
    /// The node that says so.
    pub(crate) node: Option<String>,
    /// For people.
    pub(crate) message: String,
}

impl Event {
    /// An event of no feeder.
    pub(crate) fn new(kind: &'static str, level: Level, time_s: Option<f64>, message: impl Into<String>) -> Self {
        let (message, time_s) = (message.into(), time_s.map(seconds));
        Self { time_s, feeder: None, kind, level, delivery_id: None, station: None, node: None, message }
    }

    /// The same event of a feeder.
    pub(crate) fn of(self, feeder: &str) -> Self {
        Self { feeder: Some(feeder.to_owned()), ..self }
    }
}

/// An event with its number, counted from 1.
#[derive(Clone, Debug, Serialize)]
struct Numbered {
    sequence: u64,
    #[serde(flatten)]
    event: Event,
}

/// The newest events.
#[derive(Clone)]
pub(crate) struct Events(Arc<Inner>);

struct Inner {
    kept: Mutex<VecDeque<Numbered>>,
    /// The number of the newest.
    newest: watch::Sender<u64>,
}

impl Default for Events {
    fn default() -> Self {
        Self(Arc::new(Inner { kept: Mutex::default(), newest: watch::Sender::new(0) }))
    }
}

impl Events {
    fn kept(&self) -> MutexGuard<'_, VecDeque<Numbered>> {
        self.0.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an event.
    pub(crate) fn add(&self, event: Event) {
        let mut kept = self.kept();
        let sequence = *self.0.newest.borrow() + 1;
        if kept.len() == EVENTS_MAX {
            kept.pop_front();
        }
        kept.push_back(Numbered { sequence, event });
        self.0.newest.send_replace(sequence);
    }

    /// Changes with every event.
    pub(crate) fn newest(&self) -> watch::Receiver<u64> {
        self.0.newest.subscribe()
    }

    /// The message of all events after number `seen`, and the number of the last.
    pub(crate) fn since(&self, seen: u64) -> Option<(Value, u64)> {
        let kept = self.kept();
        let new: Vec<&Numbered> = kept.iter().filter(|event| event.sequence > seen).collect();
        let (first, last) = (new.first()?.sequence, new.last()?.sequence);
        let skipped = if seen == 0 { 0 } else { first - seen - 1 };
        Some((json!({ "type": "events", "skipped": skipped, "events": new }), last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_viewer_is_told_how_many_events_it_has_missed() {
        let events = Events::default();
        assert!(events.since(0).is_none());
        for _ in 0..3 {
            events.add(Event::new("log", Level::Warn, Some(1.5), "slow").of("feeder"));
        }
        let (message, last) = events.since(1).unwrap();
        assert_eq!((last, &message["skipped"], message["events"].as_array().unwrap().len()), (3, &json!(0), 2));
        let first = &message["events"][0];
        assert_eq!(
            (&first["sequence"], &first["level"], &first["feeder"]),
            (&json!(2), &json!("warn"), &json!("feeder"))
        );
        for _ in 0..EVENTS_MAX + 7 {
            events.add(Event::new("log", Level::Info, None, "more"));
        }
        let (message, _) = events.since(3).unwrap();
        assert_eq!(message["skipped"], json!(7));
        assert_eq!(message["events"].as_array().unwrap().len(), EVENTS_MAX);
    }
}
