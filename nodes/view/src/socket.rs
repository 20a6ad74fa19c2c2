//! The conversation with one viewer.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::Shared;
use crate::control_table::Scope;
use crate::controls::{in_words, perform, reply};
use crate::events::{Event, Level};
use crate::viewers::{Channel, Subscription, Viewer};

/// Largest message of a viewer, bytes.
const MESSAGE_BYTES_MAX: usize = 16 * 1024;
/// Messages a second that a viewer may send, and how many at once.
const RATE_PER_S: f64 = 20.0;
const BURST: f64 = 40.0;
/// A viewer that has not read a message after so long is gone.
const PATIENCE: Duration = Duration::from_secs(10);
/// Between two questions whether the viewer is still there.
const PING_PERIOD: Duration = Duration::from_secs(5);
/// Messages that may still come from a viewer that was sent away.
const LATE_MAX: usize = 1000;
/// Controls of a viewer that may be under way at a time.
const CONTROLS_MAX: usize = 8;

/// What a viewer says.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum Said {
    /// It wants to see this from now on.
    Subscribe {
        channels: BTreeSet<Channel>,
        #[serde(default)]
        feeder: Option<String>,
    },
    /// Something is to be done.
    Control {
        id: u64,
        name: String,
        #[serde(default)]
        feeder: Option<String>,
        #[serde(default)]
        arguments: Map<String, Value>,
    },
}

/// Why a conversation ends.
enum End {
    /// The viewer has closed it or is gone.
    Gone,
    /// The server leaves.
    Leaving,
    /// The viewer does not keep to the rules: with a close code, and why.
    Broken(u16, String),
}

/// How many messages a viewer may still send.
struct Allowance {
    left: f64,
    since: Instant,
}

impl Allowance {
    fn new(now: Instant) -> Self {
        Self { left: BURST, since: now }
    }

    /// Takes one, if there is one.
    fn take(&mut self, now: Instant) -> bool {
        let earned = now.duration_since(self.since).as_secs_f64() * RATE_PER_S;
        (self.left, self.since) = ((self.left + earned).min(BURST), now);
        if self.left < 1.0 {
            return false;
        }
        self.left -= 1.0;
        true
    }
}

/// Talks with a viewer until either leaves.
pub(crate) async fn converse(socket: WebSocket, shared: Arc<Shared>, viewer: Viewer, left: watch::Receiver<bool>) {
    let mut conversation =
        Conversation { socket, shared, viewer, subscription: Subscription::default(), replies: JoinSet::new() };
    let end = conversation.run(left).await;
    match end {
        End::Gone => {}
        End::Leaving => conversation.farewell(close_code::AWAY, "the run has ended".to_owned()).await,
        End::Broken(code, reason) => {
            conversation.shared.turned_away.count("a viewer was sent away", &reason);
            let error = json!({ "type": "error", "message": reason }).to_string();
            let _ = conversation.send(Message::Text(error.into())).await;
            conversation.farewell(code, reason).await;
            conversation.hear_out().await;
        }
    }
}

struct Conversation {
    socket: WebSocket,
    shared: Arc<Shared>,
    viewer: Viewer,
    subscription: Subscription,
    /// Controls under way, each with its reply.
    replies: JoinSet<Value>,
}

/// Waits until the server leaves.
pub(crate) async fn told_to_leave(left: &mut watch::Receiver<bool>) {
    // A sender that is gone means the same.
    let _ = left.wait_for(|left| *left).await;
}

/// The newest of a board's place, when it is new and wanted.
async fn newest<T: Clone>(place: &mut watch::Receiver<Option<T>>, wanted: bool) -> Option<T> {
    if !wanted {
        return std::future::pending().await;
    }
    // The board lives as long as the server.
    place.changed().await.ok()?;
    place.borrow_and_update().clone()
}

impl Conversation {
    async fn run(&mut self, mut left: watch::Receiver<bool>) -> End {
        let shared = Arc::clone(&self.shared);
        let (mut hello, mut frame) = (shared.board.hello.subscribe(), shared.board.frame.subscribe());
        let (mut status, mut events) = (shared.board.status.subscribe(), shared.events.newest());
        hello.mark_changed();
        frame.mark_changed();
        status.mark_changed();
        events.mark_changed();
        let mut seen = 0;
        let of = |feeder: usize| {
            let board = &shared.board.feeders[feeder];
            let mut places = (board.motion.subscribe(), board.waveform.subscribe(), board.picture.subscribe());
            places.0.mark_changed();
            places.1.mark_changed();
            places.2.mark_changed();
            (places, board.servo.subscribe())
        };
        let ((mut motion, mut waveform, mut picture), mut servo) = of(0);
        let mut allowance = Allowance::new(Instant::now());
        let mut pings = interval(PING_PERIOD);
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut unanswered = 0;
        loop {
            let wants = |channel| self.subscription.wants(channel);
            let (frames, motions) = (wants(Channel::Frame), wants(Channel::Motion));
            let (servos, pictures, told) = (wants(Channel::Servo), wants(Channel::Picture), wants(Channel::Event));
            // In this order: whoever sends without end still hears that it is sent away, and the hello comes first.
            let sent = tokio::select! {
                biased;
                () = told_to_leave(&mut left) => return End::Leaving,
                text = newest(&mut hello, true) => self.text(text).await,
                message = self.socket.recv() => match message {
                    // It has closed the connection, or what comes makes no sense.
                    None | Some(Err(_) | Ok(Message::Close(_))) => return End::Gone,
                    Some(Ok(Message::Pong(_))) => { unanswered = 0; Ok(()) }
                    Some(Ok(message)) => {
                        if !allowance.take(Instant::now()) {
                            let reason = format!("more than {RATE_PER_S} messages a second");
                            return End::Broken(close_code::POLICY, reason);
                        }
                        match self.hear(&message) {
                            Ok(true) => { ((motion, waveform, picture), servo) = of(self.subscription.feeder); Ok(()) }
                            Ok(false) => Ok(()),
                            Err((code, reason)) => return End::Broken(code, reason),
                        }
                    }
                },
                Some(reply) = self.replies.join_next(), if !self.replies.is_empty() => {
                    // One that panicked has said so.
                    self.text(reply.ok().map(|reply| reply.to_string().into())).await
                }
                _ = pings.tick() => {
                    unanswered += 1;
                    if unanswered > 3 { return End::Gone }
                    self.send(Message::Ping(Bytes::new())).await
                }
                text = newest(&mut frame, frames) => self.text(text).await,
                text = newest(&mut status, frames) => self.text(text).await,
                changed = events.changed(), if told => {
                    if changed.is_err() { return End::Leaving }
                    events.borrow_and_update();
                    match shared.events.since(seen) {
                        Some((message, last)) => { seen = last; self.text(Some(message.to_string().into())).await }
                        None => Ok(()),
                    }
                }
                text = newest(&mut waveform, motions) => self.text(text).await,
                text = newest(&mut motion, motions) => self.text(text).await,
                block = servo.recv(), if servos => match block {
                    Ok(text) => self.text(Some(text)).await,
                    // A viewer that is too slow for every sample goes on with the newest.
                    Err(RecvError::Lagged(_)) => Ok(()),
                    Err(RecvError::Closed) => return End::Leaving,
                },
                bytes = newest(&mut picture, pictures) => match bytes {
                    Some(bytes) => self.send(Message::Binary(bytes)).await,
                    None => Ok(()),
                },
            };
            if sent.is_err() {
                return End::Gone;
            }
        }
    }

    async fn text(&mut self, text: Option<Utf8Bytes>) -> Result<(), ()> {
        match text {
            Some(text) => self.send(Message::Text(text)).await,
            None => Ok(()),
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), ()> {
        match timeout(PATIENCE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(()),
        }
    }

    async fn farewell(&mut self, code: u16, reason: String) {
        // Whoever does not take it has gone already.
        let _ = self.send(Message::Close(Some(CloseFrame { code, reason: reason.into() }))).await;
    }

    /// Reads, without regard, what the viewer says until it has taken the farewell. A connection closed over bytes not
    /// read is reset, and the viewer might never see why it was sent away.
    async fn hear_out(&mut self) {
        let _ = timeout(PATIENCE, async {
            for _ in 0..LATE_MAX {
                if !matches!(self.socket.recv().await, Some(Ok(_))) {
                    break;
                }
            }
        })
        .await;
    }

    /// Takes in what the viewer says; true when it wants to see something else from now on. What breaks the rules ends
    /// the conversation, with a close code and the reason.
    fn hear(&mut self, message: &Message) -> Result<bool, (u16, String)> {
        let text = match message {
            Message::Text(text) if text.len() > MESSAGE_BYTES_MAX => {
                let reason = format!("a message of {} bytes, allowed are {MESSAGE_BYTES_MAX}", text.len());
                return Err((close_code::SIZE, reason));
            }
            Message::Text(text) => text,
            Message::Ping(_) => return Ok(false),
            _ => return Err((close_code::POLICY, "a message that is not text".to_owned())),
        };
        let said = serde_json::from_str(text);
        match said.map_err(|error| (close_code::POLICY, format!("a message that cannot be read: {error}")))? {
            Said::Subscribe { channels, feeder } => {
                let feeder = self.feeder(feeder).map_err(|reason| (close_code::POLICY, reason))?;
                self.subscription = Subscription { channels, feeder };
                self.viewer.subscribe(self.subscription.clone());
                Ok(true)
            }
            Said::Control { id, name, feeder, arguments } => {
                if let Err(reason) = self.begin(id, &name, feeder, arguments) {
                    let refused = reply(id, &Err(reason));
                    self.replies.spawn(async move { refused });
                }
                Ok(false)
            }
        }
    }
}

impl Conversation {
    /// The index of the feeder of this name, or of the first.
    fn feeder(&self, name: Option<String>) -> Result<usize, String> {
        let feeders = &self.shared.cell.feeders;
        let Some(name) = name else { return Ok(0) };
        feeders.iter().position(|feeder| feeder.name == name).ok_or_else(|| {
            let names: Vec<&str> = feeders.iter().map(|feeder| feeder.name.as_str()).collect();
            format!("feeder = {name:?}, allowed are {names:?}")
        })
    }

    /// Begins what a control asks for.
    fn begin(
        &mut self,
        id: u64,
        name: &str,
        feeder: Option<String>,
        arguments: Map<String, Value>,
    ) -> Result<(), String> {
        let shared = Arc::clone(&self.shared);
        let control = shared.clockwork.control(name).ok_or_else(|| format!("{name:?} is no control"))?;
        let feeder = self.feeder(feeder)?;
        let arguments = control.arguments(arguments)?;
        if self.replies.len() >= CONTROLS_MAX {
            return Err("too much is under way: wait for the replies".to_owned());
        }
        self.replies.spawn(async move {
            let outcome = perform(&shared, shared.clockwork.source(), control.name, feeder, &arguments).await;
            if outcome.is_ok() {
                let text = in_words(control.name, &arguments);
                let event = Event::new("control", Level::Info, shared.clockwork.now_s(), text);
                let of_feeder = control.scope == Scope::Feeder;
                shared.events.add(if of_feeder { event.of(&shared.cell.feeders[feeder].name) } else { event });
                shared.clockwork.look_now();
            }
            reply(id, &outcome)
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpStream;

    use feeder_runtime::testing::TestDomain;
    use feeder_scenario::plan::load_plan;
    use tungstenite::{Message as Received, WebSocket};

    use super::*;
    use crate::description::Source;
    use crate::{Settings, View};

    /// Longest wait for a message. It only keeps a failing test from hanging.
    const PATIENCE: Duration = Duration::from_secs(60);

    /// The next message of this type.
    fn next(viewer: &mut WebSocket<TcpStream>, wanted: &str) -> Value {
        loop {
            if let Received::Text(text) = viewer.read().unwrap() {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["type"] == wanted {
                    return message;
                }
            }
        }
    }

    /// Shows this many messages of this type while a viewer does not read, and counts those that were kept for it.
    fn kept(kind: &str, shown: u64, show: impl Fn(&View, Utf8Bytes)) -> u64 {
        // So long that few fit in what the system holds for a connection.
        let padding = "x".repeat(64 * 1024);
        let domain = TestDomain::claim();
        let settings = Settings {
            place: Some("0".parse().unwrap()),
            read_only: false,
            source: Source::Run,
            scenario: "default".to_owned(),
            domain: *domain,
        };
        let view = View::start(&load_plan(None).unwrap(), &settings).unwrap();
        let address = view.address().unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (mut viewer, _) = tungstenite::client(format!("ws://{address}/ws"), stream).unwrap();
        // Nothing runs on the graph: the server itself shows no other frame after its first.
        next(&mut viewer, "frame");
        let subscribe = json!({ "type": "subscribe", "channels": ["frame", "servo"] });
        viewer.send(Received::text(subscribe.to_string())).unwrap();
        // Answered after the subscription, so that it is known to be heard.
        viewer.send(Received::text(json!({ "type": "control", "id": 1, "name": "fly" }).to_string())).unwrap();
        next(&mut viewer, "reply");
        for number in 1..=shown {
            show(&view, json!({ "type": kind, "number": number, "padding": padding }).to_string().into());
        }
        // The newest is never missed.
        let numbers = std::iter::repeat_with(|| next(&mut viewer, kind)["number"].as_u64());
        1 + numbers.take_while(|number| *number != Some(shown)).count() as u64
    }

    #[test]
    fn nothing_queues_for_a_viewer_that_is_slow() {
        const SHOWN: u64 = 2000;
        let frames = kept("frame", SHOWN, |view, frame| {
            view.shared.board.frame.send_replace(Some(frame));
        });
        assert!(frames < SHOWN / 4, "{frames} of {SHOWN} frames were kept");
        let blocks = kept("servo", SHOWN, |view, block| {
            // Whoever listens may be gone, which the wait for the last tells.
            let _ = view.shared.board.feeders[0].servo.send(block);
        });
        assert!(blocks < SHOWN / 4, "{blocks} of {SHOWN} blocks of samples were kept");
    }
}
