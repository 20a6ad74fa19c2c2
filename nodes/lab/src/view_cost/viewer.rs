//! Somebody who looks, and counts what comes.

use std::io;
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use serde::Deserialize;
use serde_json::{Value, json};
use tungstenite::{Error, Message, WebSocket};

/// Longest wait for a message: every look at whether to leave comes so soon.
const LOOK: Duration = Duration::from_millis(500);
/// How long something that was asked for may take.
const PATIENCE: Duration = Duration::from_secs(120);

/// What came, over which time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Traffic {
    pub(super) frames: u32,
    bytes: usize,
    over: Duration,
}

impl Traffic {
    pub(super) fn frames_per_s(&self) -> f64 {
        f64::from(self.frames) / self.over.as_secs_f64()
    }

    #[expect(clippy::cast_precision_loss, reason = "bytes of some seconds")]
    pub(super) fn bytes_per_s(&self) -> f64 {
        self.bytes as f64 / self.over.as_secs_f64()
    }

    fn add(&mut self, message: &Message) -> Result<()> {
        self.bytes += message.len();
        if let Message::Text(text) = message {
            let Kind { kind } = serde_json::from_str(text)?;
            self.frames += u32::from(kind == "frame");
        }
        Ok(())
    }
}

#[derive(Deserialize)]
struct Kind {
    #[serde(rename = "type")]
    kind: String,
}

/// A viewer.
pub(super) struct Viewer(WebSocket<TcpStream>);

impl Viewer {
    /// One that wants to see this.
    pub(super) fn connect(address: SocketAddr, channels: &[&str]) -> Result<Self> {
        let stream = TcpStream::connect(address).context("cannot reach the view")?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let (mut socket, _) = tungstenite::client(format!("ws://{address}/ws"), stream)
            .map_err(|error| anyhow!("the view lets nobody in: {error}"))?;
        socket.send(Message::text(json!({ "type": "subscribe", "channels": channels }).to_string()))?;
        socket.get_ref().set_read_timeout(Some(LOOK))?;
        Ok(Self(socket))
    }

    /// The next message; nothing when none comes for a while.
    fn read(&mut self) -> Result<Option<Message>, Error> {
        match self.0.read() {
            Ok(message) => Ok(Some(message)),
            Err(Error::Io(error)) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// The first message of which there is something to say.
    fn until<T>(&mut self, what: &str, said: impl Fn(&Value) -> Option<T>) -> Result<T> {
        let since = Instant::now();
        while since.elapsed() < PATIENCE {
            let Some(Message::Text(text)) = self.read()? else { continue };
            if let Some(found) = said(&serde_json::from_str(&text)?) {
                return Ok(found);
            }
        }
        bail!("the view does not tell {what}")
    }

    /// How many parts there are, once there are any.
    pub(super) fn parts(&mut self) -> Result<u32> {
        let count = self.until("how many parts there are", |message| {
            message["feeders"].as_object()?.values().find_map(|feeder| Some(feeder["truth"]["id"].as_array()?.len()))
        });
        Ok(u32::try_from(count?)?)
    }

    /// Has parts loaded.
    pub(super) fn load_parts(&mut self, count: u32) -> Result<()> {
        let control = json!({ "type": "control", "id": 1, "name": "load_parts", "arguments": { "count": count } });
        self.0.send(Message::text(control.to_string()))?;
        let reply =
            self.until("whether parts are loaded", |message| (message["type"] == "reply").then(|| message.clone()));
        let reply = reply?;
        ensure!(reply["ok"] == true, "{count} parts are not loaded: {}", reply["message"]);
        Ok(())
    }

    /// Counts what comes over this time, from the first frame on.
    pub(super) fn look(&mut self, period: Duration) -> Result<Traffic> {
        self.until("anything", |message| (message["type"] == "frame").then_some(()))?;
        let (mut traffic, since) = (Traffic::default(), Instant::now());
        while since.elapsed() < period {
            if let Some(message) = self.read()? {
                traffic.add(&message)?;
            }
        }
        traffic.over = since.elapsed();
        Ok(traffic)
    }

    /// Reads on and on.
    pub(super) fn read_in_background(mut self) -> Looking {
        let leave = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&leave);
        let thread = std::thread::spawn(move || {
            let (mut traffic, since) = (Traffic::default(), Instant::now());
            while !told.load(Ordering::Relaxed) {
                match self.read() {
                    Ok(Some(Message::Close(_))) | Err(Error::ConnectionClosed | Error::AlreadyClosed) => break,
                    Ok(Some(message)) => traffic.add(&message)?,
                    Ok(None) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            traffic.over = since.elapsed();
            Ok(traffic)
        });
        Looking { leave, thread }
    }
}

/// A viewer that reads on and on.
pub(super) struct Looking {
    leave: Arc<AtomicBool>,
    thread: JoinHandle<Result<Traffic>>,
}

impl Looking {
    /// Has it leave.
    pub(super) fn leave(self) -> Result<()> {
        self.leave.store(true, Ordering::Relaxed);
        self.end().map(|_| ())
    }

    /// Waits until it has left, and returns what it got.
    pub(super) fn end(self) -> Result<Traffic> {
        self.thread.join().map_err(|_| anyhow!("a viewer has panicked"))?
    }
}
