//! The log on `/rosout`, as a layer of a [`tracing`] subscriber.
//!
//! A message belongs to the node named by the innermost span around it that has a field `node`
//! (`info_span!("run", node = %participant.node())`), else to the first node attached.

use std::{
    cell::Cell,
    collections::BTreeMap,
    fmt::{self, Write},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use minifactory_msgs::{interface::standard::ROSOUT, rcl_interfaces::msg::Log};
use tokio::sync::mpsc;
use tracing::{
    Event, Level, Subscriber,
    field::{Field, Visit},
    span::{Attributes, Id},
};
use tracing_subscriber::{Layer, layer::Context, registry::LookupSpan};

use crate::{
    clock::TimeSource,
    dds::{BackgroundTask, DdsError, Participant, Writer},
};

/// Messages that may wait to be published; more are dropped and counted.
const QUEUE: usize = 1_000;
/// What the DDS library says of its own doings would never end, were it sent by the same library.
const NOT_SENT: [&str; 3] = ["rustdds", "ros2_client", "mio"];

thread_local! {
    /// Set while a message is being published: what is logged meanwhile is not sent.
    static PUBLISHING: Cell<bool> = const { Cell::new(false) };
}

/// The layer. Clones share their nodes.
#[derive(Clone, Default)]
pub struct RosoutLayer {
    nodes: Arc<Mutex<Nodes>>,
}

#[derive(Default)]
struct Nodes {
    first: Option<String>,
    queues: BTreeMap<String, Queue>,
}

#[derive(Clone)]
struct Queue {
    sender: mpsc::Sender<Log>,
    dropped: Arc<AtomicU64>,
    clock: TimeSource,
}

impl RosoutLayer {
    /// A layer that keeps silent until nodes are attached.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sends the messages of a participant's node until the returned handle is dropped.
    ///
    /// # Errors
    /// [`DdsError::Endpoint`] when the middleware refuses.
    pub fn attach(&self, participant: &Participant, clock: TimeSource) -> Result<Rosout, DdsError> {
        let writer = participant.topic_writer(&ROSOUT, "")?;
        let (sender, mut messages) = mpsc::channel(QUEUE);
        let node = participant.node().to_string();
        let dropped = Arc::new(AtomicU64::new(0));
        let publishing = participant.background({
            let outlet = writer.outlet();
            async move {
                while let Some(message) = messages.recv().await {
                    PUBLISHING.set(true);
                    outlet.publish_message::<Log>(&message);
                    PUBLISHING.set(false);
                }
            }
        });
        let mut nodes = lock(&self.nodes);
        nodes.first.get_or_insert_with(|| node.clone());
        nodes.queues.insert(node.clone(), Queue { sender, dropped: dropped.clone(), clock });
        drop(nodes);
        Ok(Rosout { nodes: self.nodes.clone(), node, dropped, _publishing: publishing, _writer: writer })
    }
}

fn lock(nodes: &Mutex<Nodes>) -> MutexGuard<'_, Nodes> {
    nodes.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A node whose messages are sent, until dropped.
pub struct Rosout {
    nodes: Arc<Mutex<Nodes>>,
    node: String,
    dropped: Arc<AtomicU64>,
    _publishing: BackgroundTask,
    _writer: Writer,
}

impl Rosout {
    /// Messages that came faster than they could be sent, and were dropped.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

impl Drop for Rosout {
    fn drop(&mut self) {
        let mut nodes = lock(&self.nodes);
        nodes.queues.remove(&self.node);
        if nodes.first.as_ref() == Some(&self.node) {
            nodes.first = nodes.queues.keys().next().cloned();
        }
    }
}

/// The node a span names.
struct SpanNode(String);

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for RosoutLayer {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let mut node = NodeField(None);
        attributes.record(&mut node);
        if let (Some(node), Some(span)) = (node.0, context.span(id)) {
            span.extensions_mut().insert(SpanNode(node));
        }
    }

    fn on_event(&self, event: &Event<'_>, context: Context<'_, S>) {
        if PUBLISHING.get() {
            return;
        }
        let mut text = Text::default();
        event.record(&mut text);
        let metadata = event.metadata();
        // Messages of the `log` crate carry their origin in a field.
        let target = text.log_target.as_deref().unwrap_or(metadata.target());
        if NOT_SENT.contains(&target.split("::").next().unwrap_or_default()) {
            return;
        }
        let named = context
            .event_scope(event)
            .into_iter()
            .flatten()
            .find_map(|span| span.extensions().get::<SpanNode>().map(|SpanNode(node)| node.clone()));
        let nodes = lock(&self.nodes);
        let Some(node) = named.filter(|node| nodes.queues.contains_key(node)).or_else(|| nodes.first.clone()) else {
            return;
        };
        let Some(queue) = nodes.queues.get(&node).cloned() else {
            return;
        };
        drop(nodes);
        let message = Log {
            stamp: (queue.clock)(),
            level: level(*metadata.level()),
            name: node.trim_start_matches('/').replace('/', "."),
            msg: text.message(),
            file: metadata.file().unwrap_or_default().to_owned(),
            function: target.to_owned(),
            line: metadata.line().unwrap_or_default(),
        };
        if queue.sender.try_send(message).is_err() {
            queue.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn level(level: Level) -> u8 {
    match level {
        Level::ERROR => Log::ERROR,
        Level::WARN => Log::WARN,
        Level::INFO => Log::INFO,
        _ => Log::DEBUG,
    }
}

struct NodeField(Option<String>);

impl Visit for NodeField {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "node" {
            self.0 = Some(format!("{value:?}"));
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "node" {
            self.0 = Some(value.to_owned());
        }
    }
}

/// A message and its fields as one line of text.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
    log_target: Option<String>,
}

impl Text {
    fn message(&self) -> String {
        if self.fields.is_empty() { self.message.clone() } else { format!("{} ({})", self.message, self.fields) }
    }
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            name if name.starts_with("log.") => {}
            name => {
                let comma = if self.fields.is_empty() { "" } else { ", " };
                // Writing to a string does not fail.
                let _ = write!(self.fields, "{comma}{name} {value:?}");
            }
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "log.target" {
            self.log_target = Some(value.to_owned());
        } else {
            self.record_debug(field, &value);
        }
    }
}
