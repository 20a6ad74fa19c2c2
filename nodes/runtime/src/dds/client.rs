//! Clients of services: a request goes out, and its reply comes back or the call ends in time.

use std::{
    collections::BTreeMap,
    fmt,
    future::Future,
    pin::{Pin, pin},
    sync::{
        Arc, Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicI64, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};

use bytes::Bytes;
use serde::de::DeserializeOwned;
use tokio::{
    sync::{oneshot, watch},
    time::{sleep, timeout},
};

use super::{
    DdsError, Guid, Participant, PublishError, Qos, Reader, Sample, Writer,
    executor::Spawner,
    names::dds_name,
    peers::Peers,
    tally::Counter,
    wire::{self, ClientId, ReplyTo},
    writer::Outlet,
};
use crate::cdr::{self, CdrError};

/// Pause before a request that found the writer full is tried again.
const FULL_PAUSE: Duration = Duration::from_millis(5);
/// How long the first request to a server goes alone when nothing comes back. See [`Peers::first`].
const FIRST_ALONE: Duration = Duration::from_millis(250);

impl Participant {
    /// Makes a client of a service, e.g. `/feeder/load_parts`, which may come and go. It speaks the wire
    /// form of the server it finds.
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad name, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn client(&self, name: &str, request_dds_type: &str, response_dds_type: &str) -> Result<Client, DdsError> {
        let qos = Qos::service();
        let reply_topic = dds_name("service", "rr", name, "Reply")?;
        let writer = self.writer_of(&dds_name("service", "rq", name, "Request")?, request_dds_type, &qos)?;
        let calls = Arc::new(Calls {
            service: name.into(),
            waiting: Mutex::default(),
            refused: self.counter(name, "replies refused"),
            unanswered: self.counter(name, "calls without a reply"),
        });
        // The reader's function needs the reader's own identity, which is known only afterwards; no
        // reply can come before the first request.
        let id = Arc::new(OnceLock::new());
        let reader = self.reader_of(&reply_topic, response_dds_type, &qos, {
            let (calls, id) = (calls.clone(), id.clone());
            move |sample| {
                if let Some(id) = id.get() {
                    calls.take_reply(*id, &sample);
                }
            }
        })?;
        let id = *id.get_or_init(|| ClientId { writer: writer.guid(), reader: reader.guid() });
        let line = Arc::new(Line {
            id,
            outlet: writer.outlet(),
            servers: reader.peers(),
            calls,
            next_number: AtomicI64::new(1),
        });
        let (open, _) = watch::channel(());
        Ok(Client { open, line, spawner: self.spawner(), _reader: reader, _writer: writer })
    }
}

/// A client of a service. A call to a server that was just found takes
/// some tenths of a second. Calls in flight end with [`CallError::Closed`] when it is dropped.
pub struct Client {
    // Dropped first: calls in flight end by it.
    open: watch::Sender<()>,
    line: Arc<Line>,
    spawner: Spawner,
    _reader: Reader,
    _writer: Writer,
}

impl Client {
    /// Whether a server is there to take a request.
    #[must_use]
    pub fn is_available(&self) -> bool {
        self.line.server().is_some()
    }

    /// Sends a little-endian CDR body as soon as a server is there.
    pub fn call(&self, payload: Bytes, timeout: Duration) -> Call {
        let (sender, reply) = oneshot::channel();
        self.call_with(payload, timeout, move |outcome| {
            // Nobody waits any more: then nobody needs the reply.
            let _ = sender.send(outcome);
        });
        Call { reply, service: self.line.calls.service.clone(), spawner: self.spawner.clone() }
    }

    /// As [`call`](Self::call), with the outcome going to a function on the participant's thread, which
    /// must return soon (see [the module](super)). It is not called once the participant is gone.
    pub fn call_with(
        &self,
        payload: Bytes,
        timeout: Duration,
        answer: impl FnOnce(Result<Reply, CallError>) + Send + 'static,
    ) {
        self.start(payload, timeout, false, answer);
    }

    /// As [`call_with`](Self::call_with) for a reply that may take as long as it likes. As long as a server is there the
    /// request is sent again every `period`: a server that has taken another's place was not asked yet.
    pub fn call_again_with(
        &self,
        payload: Bytes,
        period: Duration,
        answer: impl FnOnce(Result<Reply, CallError>) + Send + 'static,
    ) {
        self.start(payload, period, true, answer);
    }

    fn start(
        &self,
        payload: Bytes,
        timeout: Duration,
        again: bool,
        answer: impl FnOnce(Result<Reply, CallError>) + Send + 'static,
    ) {
        let (line, mut open) = (self.line.clone(), self.open.subscribe());
        self.spawner.spawn(async move {
            let calls = async {
                loop {
                    match line.call(payload.clone(), timeout).await {
                        Err(CallError::TimedOut { .. }) if again => {}
                        outcome => break outcome,
                    }
                }
            };
            let outcome = tokio::select! {
                outcome = calls => outcome,
                // Nothing is ever sent: this ends when the client is dropped.
                _ = open.changed() => Err(CallError::Closed { service: line.calls.service.to_string() }),
            };
            if matches!(outcome, Err(CallError::Unavailable { .. } | CallError::TimedOut { .. })) {
                line.calls.unanswered.add(1);
            }
            answer(outcome);
        });
    }

    /// Name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.line.calls.service
    }

    /// Replies that could not be read, each logged with its reason.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.line.calls.refused.get()
    }
}

/// An answer to a [`Client`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// CDR body of the response.
    pub payload: Bytes,
    /// Its byte order.
    pub little_endian: bool,
}

impl Reply {
    /// Reads the body as a message.
    ///
    /// # Errors
    /// [`CdrError`] when the body is not one of type `T`.
    pub fn decode<T: DeserializeOwned>(&self) -> Result<T, CdrError> {
        cdr::decode(&self.payload, self.little_endian)
    }
}

/// Why a call has no answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CallError {
    /// No server was found in time; nothing was sent.
    #[error("{service}: no server within {timeout:?}")]
    Unavailable {
        /// Name of the service.
        service: String,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// The request was sent, but no reply came in time.
    #[error("{service}: no reply within {timeout:?}")]
    TimedOut {
        /// Name of the service.
        service: String,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// The client or its participant is gone.
    #[error("{service}: the client has closed")]
    Closed {
        /// Name of the service.
        service: String,
    },
    /// The call was waited for on the participant's thread, which alone could bring the reply.
    #[error("{service}: a function called by the DDS thread cannot wait for a reply")]
    WouldWaitForever {
        /// Name of the service.
        service: String,
    },
}

/// A call in flight: a future, for any executor, or something to wait for. Dropped, the reply is not waited for.
pub struct Call {
    reply: oneshot::Receiver<Result<Reply, CallError>>,
    service: Arc<str>,
    spawner: Spawner,
}

impl Call {
    /// Blocks until the call has ended.
    ///
    /// # Errors
    /// [`CallError`] when there is no reply.
    pub fn wait(self) -> Result<Reply, CallError> {
        if self.spawner.is_current_thread() {
            return Err(CallError::WouldWaitForever { service: self.service.to_string() });
        }
        futures::executor::block_on(self)
    }
}

impl Future for Call {
    type Output = Result<Reply, CallError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let outcome = std::task::ready!(Pin::new(&mut self.reply).poll(context));
        Poll::Ready(outcome.unwrap_or_else(|_| Err(CallError::Closed { service: self.service.to_string() })))
    }
}

impl fmt::Debug for Call {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Call({})", self.service)
    }
}

/// What calls in flight share.
struct Line {
    id: ClientId,
    outlet: Arc<Outlet>,
    servers: Arc<Peers>,
    calls: Arc<Calls>,
    next_number: AtomicI64,
}

impl Line {
    /// The server to ask: both its request reader and its reply writer are matched. Of several, always the same one.
    fn server(&self) -> Option<Guid> {
        let replying = self.servers.matched();
        let asked = self.outlet.peers.matched();
        asked.into_iter().find(|reader| replying.iter().any(|writer| writer.participant() == reader.participant()))
    }

    async fn call(&self, payload: Bytes, patience: Duration) -> Result<Reply, CallError> {
        let service = || self.calls.service.to_string();
        let mut sent = false;
        let exchange = async {
            let server = self.wait_for_server().await;
            sent = true;
            self.exchange(server, payload).await
        };
        match timeout(patience, exchange).await {
            Ok(Some(reply)) => Ok(reply),
            Ok(None) => Err(CallError::Closed { service: service() }),
            Err(_) if sent => Err(CallError::TimedOut { service: service(), timeout: patience }),
            Err(_) => Err(CallError::Unavailable { service: service(), timeout: patience }),
        }
    }

    async fn wait_for_server(&self) -> Guid {
        let mut readers = self.outlet.peers.changes();
        let mut writers = self.servers.changes();
        loop {
            if let Some(server) = self.server() {
                self.outlet.peers.settled(server).await;
                return server;
            }
            tokio::select! {
                _ = readers.changed() => {}
                _ = writers.changed() => {}
            }
        }
    }

    /// Sends a request in the server's form and waits for its reply.
    async fn exchange(&self, server: Guid, body: Bytes) -> Option<Reply> {
        let header = wire::speaks_header(server).then(|| self.next_number.fetch_add(1, Ordering::Relaxed));
        let (payload, related) = match header {
            Some(number) => (self.id.header_request(number, &body), None),
            None => (body, Some(self.id.related_request())),
        };
        let first = self.outlet.peers.first(server).await;
        let sequence = loop {
            match self.outlet.send(payload.clone(), Some(server), related) {
                Ok(sequence) => break sequence,
                Err(PublishError::Full { .. }) => sleep(FULL_PAUSE).await,
                Err(PublishError::Closed { .. }) => return None,
            }
        };
        // Replies are taken on this very thread, so none can be missed before this line.
        let entry = header.map_or(ReplyTo::Related(sequence), ReplyTo::Header);
        let mut reply = pin!(Waiting::enter(&self.calls, entry));
        if let Some(first) = first {
            tokio::select! {
                reply = &mut reply => return reply,
                _ = timeout(FIRST_ALONE, self.outlet.acknowledged()) => drop(first),
            }
        }
        reply.await
    }
}

/// The calls that wait for a reply.
struct Calls {
    service: Arc<str>,
    waiting: Mutex<BTreeMap<ReplyTo, oneshot::Sender<Reply>>>,
    refused: Arc<Counter>,
    unanswered: Arc<Counter>,
}

impl Calls {
    fn waiting(&self) -> MutexGuard<'_, BTreeMap<ReplyTo, oneshot::Sender<Reply>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take_reply(&self, id: ClientId, sample: &Sample) {
        match id.read_reply(sample) {
            Ok(Some((to, payload))) => {
                // A reply that came twice, or too late, finds nobody.
                if let Some(call) = self.waiting().remove(&to) {
                    let _ = call.send(Reply { payload, little_endian: sample.little_endian });
                }
            }
            Ok(None) => {}
            Err(error) => {
                self.refused.add(1);
                tracing::warn!(service = &*self.service, server = %sample.writer_guid, "reply refused: {error}");
            }
        }
    }
}

/// An entry among the waiting calls, taken out again however the wait ends.
struct Waiting<'a> {
    calls: &'a Calls,
    entry: ReplyTo,
}

impl<'a> Waiting<'a> {
    async fn enter(calls: &'a Calls, entry: ReplyTo) -> Option<Reply> {
        let (sender, reply) = oneshot::channel();
        let _entry = Self { calls, entry };
        calls.waiting().insert(entry, sender);
        reply.await.ok()
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.calls.waiting().remove(&self.entry);
    }
}
