//! The recorder's end.

use std::collections::VecDeque;
use std::io::{self, BufReader};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;

use super::{Frame, Hello, RunTopic, Wanted, read_json, write_json};
use crate::lockstep::{LoopContract, clock_interface};

/// Merged messages that may wait for the recorder before the nodes have to, bytes.
const WAITING_BYTES_MAX: usize = 32 * 1024 * 1024;
/// Between looks for nodes that want to introduce themselves.
const ACCEPT_PERIOD: Duration = Duration::from_millis(5);

/// What a listener hears, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunEvent {
    /// A node offers a topic, and it is wanted. Several nodes may offer the same.
    Topic(RunTopic),
    /// A message.
    Message {
        /// Its topic.
        topic: Arc<str>,
        /// The tick in which it was published.
        tick: u64,
        /// Its CDR body, without encapsulation header.
        payload: Bytes,
    },
    /// Nothing happened for a while.
    Idle,
    /// Every node has come to its end or is gone.
    End,
}

/// Hears what all nodes of a run publish.
pub struct RunListener {
    streams: Arc<Streams>,
}

impl RunListener {
    /// Listens at `socket`, a path that does not exist yet, to the nodes of `contract` and to its clock. Of their topics
    /// it takes those that `wanted` says.
    ///
    /// # Errors
    /// When there can be no socket of that name; its length is limited to about 100 bytes.
    pub fn bind(
        socket: &Path,
        contract: &LoopContract,
        wanted: impl Fn(&RunTopic) -> bool + Send + 'static,
    ) -> io::Result<Self> {
        let clock = clock_name();
        let names: Vec<String> = contract.nodes.iter().cloned().chain([clock]).collect();
        let listener = UnixListener::bind(socket)?;
        listener.set_nonblocking(true)?;
        let streams = Arc::new(Streams { merge: Mutex::new(Merge::new(names.len())), changed: Condvar::new() });
        let reception = Reception { run_id: contract.run_id, names, wanted: Box::new(wanted) };
        let shared = Arc::clone(&streams);
        std::thread::Builder::new().name("recording".to_owned()).spawn(move || reception.run(&listener, &shared))?;
        Ok(Self { streams })
    }

    /// The next event; [`RunEvent::Idle`] when there is none within `patience`.
    #[must_use]
    pub fn next(&self, patience: Duration) -> RunEvent {
        let merge = self.streams.lock();
        let idle = |merge: &mut Merge| merge.ready.is_empty() && !merge.ended();
        let waited = self.streams.changed.wait_timeout_while(merge, patience, idle);
        let (mut merge, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let Some(event) = merge.ready.pop_front() else {
            return if merge.ended() { RunEvent::End } else { RunEvent::Idle };
        };
        if let RunEvent::Message { payload, .. } = &event {
            let was_full = merge.is_full();
            merge.ready_bytes -= payload.len();
            if was_full && !merge.is_full() {
                self.streams.changed.notify_all();
            }
        }
        event
    }
}

impl Drop for RunListener {
    /// Nodes that still hand something over get an error, which ends the run.
    fn drop(&mut self) {
        let mut merge = self.streams.lock();
        merge.closed = true;
        for source in &merge.sources {
            if let Some(stream) = &source.stream {
                // One that is closed already needs no closing.
                let _ = stream.shutdown(std::net::Shutdown::Both);
            }
        }
        self.streams.changed.notify_all();
    }
}

/// The name under which the clock's messages are merged with the nodes'.
pub(super) fn clock_name() -> String {
    clock_interface().ports.remove(0).name
}

struct Streams {
    merge: Mutex<Merge>,
    changed: Condvar,
}

impl Streams {
    fn lock(&self) -> MutexGuard<'_, Merge> {
        self.merge.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lets nodes in.
struct Reception {
    run_id: u64,
    names: Vec<String>,
    wanted: Box<dyn Fn(&RunTopic) -> bool + Send>,
}

impl Reception {
    fn run(self, listener: &UnixListener, streams: &Arc<Streams>) {
        let mut missing = self.names.len();
        while missing > 0 && !streams.lock().closed {
            match listener.accept() {
                Ok((stream, _)) => match self.admit(stream, streams) {
                    Ok(()) => missing -= 1,
                    Err(error) => tracing::warn!("the recorder turned somebody away: {error}"),
                },
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(ACCEPT_PERIOD),
                Err(error) => {
                    tracing::error!("the recorder cannot listen: {error}");
                    streams.lock().closed = true;
                }
            }
        }
    }

    fn admit(&self, mut stream: UnixStream, streams: &Arc<Streams>) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        let hello: Hello = read_json(&mut stream)?;
        let at = self.names.iter().position(|name| *name == hello.node).filter(|_| hello.run_id == self.run_id);
        let at = at.ok_or_else(|| io::Error::other(format!("{} is not of this run", hello.node)))?;
        let wanted: Vec<&(usize, RunTopic)> = hello.topics.iter().filter(|(_, topic)| (self.wanted)(topic)).collect();
        write_json(&mut stream, &Wanted(wanted.iter().map(|(port, _)| *port).collect()))?;
        let names: Vec<(u32, Arc<str>)> = wanted
            .iter()
            .filter_map(|(port, topic)| Some((u32::try_from(*port).ok()?, Arc::from(topic.name.as_str()))))
            .collect();
        {
            let mut merge = streams.lock();
            // Who closed meanwhile could not know of this stream.
            if merge.closed {
                return Err(io::Error::other(format!("{} came when the recorder had gone", hello.node)));
            }
            merge.sources[at].stream = Some(stream.try_clone()?);
            merge.ready.extend(wanted.iter().map(|(_, topic)| RunEvent::Topic(topic.clone())));
        }
        let streams = Arc::clone(streams);
        std::thread::Builder::new().name("recording".to_owned()).spawn(move || {
            if let Err(error) = receive(stream, at, &names, &streams) {
                tracing::debug!("the stream of node {at} of the run broke: {error}");
            }
            streams.lock().end(at);
            streams.changed.notify_all();
        })?;
        Ok(())
    }
}

/// Takes in the frames of a node until its end.
fn receive(stream: UnixStream, at: usize, names: &[(u32, Arc<str>)], streams: &Streams) -> io::Result<()> {
    let mut stream = BufReader::with_capacity(256 * 1024, stream);
    loop {
        match Frame::read(&mut stream)? {
            Frame::Message { port, tick, payload } => {
                let known = names.iter().find(|(known, _)| *known == port);
                let (_, topic) = known.ok_or_else(|| io::Error::other(format!("port {port} was not announced")))?;
                let message = Waiting { tick, topic: Arc::clone(topic), payload: Bytes::from(payload) };
                streams.lock().sources[at].queue.push_back(message);
            }
            Frame::Until(tick) => {
                let merge = streams.lock();
                // What is merged waits for the disk alone, so waiting here holds nobody up for good.
                let full = |merge: &mut Merge| merge.is_full() && !merge.closed;
                let mut merge = streams.changed.wait_while(merge, full).unwrap_or_else(PoisonError::into_inner);
                merge.sources[at].complete_until = tick;
                if merge.advance() {
                    streams.changed.notify_all();
                }
            }
            Frame::End => return Ok(()),
        }
    }
}

struct Waiting {
    tick: u64,
    topic: Arc<str>,
    payload: Bytes,
}

#[derive(Default)]
struct Source {
    complete_until: u64,
    ended: bool,
    queue: VecDeque<Waiting>,
    stream: Option<UnixStream>,
}

/// Puts the streams of all nodes in order. What waits for a slower node is bounded by the loop's window.
struct Merge {
    sources: Vec<Source>,
    ready: VecDeque<RunEvent>,
    ready_bytes: usize,
    closed: bool,
}

impl Merge {
    fn new(sources: usize) -> Self {
        let sources = (0..sources).map(|_| Source::default()).collect();
        Self { sources, ready: VecDeque::new(), ready_bytes: 0, closed: false }
    }

    fn is_full(&self) -> bool {
        self.ready_bytes > WAITING_BYTES_MAX
    }

    fn ended(&self) -> bool {
        self.closed || self.sources.iter().all(|source| source.ended)
    }

    fn end(&mut self, at: usize) {
        self.sources[at].ended = true;
        self.sources[at].complete_until = u64::MAX;
        self.advance();
    }

    /// Moves on what can no longer be preceded by anything; says whether there was some.
    fn advance(&mut self) -> bool {
        let complete_until = self.sources.iter().map(|source| source.complete_until).min().unwrap_or(u64::MAX);
        let before = self.ready.len();
        loop {
            let fronts = self.sources.iter().filter_map(|source| source.queue.front().map(|front| front.tick));
            let Some(tick) = fronts.min().filter(|tick| *tick < complete_until) else { break };
            for source in &mut self.sources {
                while let Some(message) = source.queue.pop_front_if(|front| front.tick == tick) {
                    self.ready_bytes += message.payload.len();
                    let Waiting { tick, topic, payload } = message;
                    self.ready.push_back(RunEvent::Message { topic, tick, payload });
                }
            }
        }
        self.ready.len() > before
    }
}
