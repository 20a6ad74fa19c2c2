//! Servers of services: requests come in, and each reply goes out until the client has it.

use std::{
    collections::BTreeMap,
    fmt,
    sync::{
        Arc, Weak,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, SystemTime},
};

use bytes::Bytes;
use serde::{Serialize, de::DeserializeOwned};
use tokio::{
    task::yield_now,
    time::{sleep, timeout},
};

use super::{
    DdsError, Guid, Participant, PublishError, Qos, Reader, SampleId, Writer,
    datagram::{self, FRAGMENTED_ABOVE_BYTES, WholeSample},
    executor::Spawner,
    graph,
    names::dds_name,
    others::Leave,
    participant::Inner,
    peers::Match,
    tally::Counter,
    wire::{self, RequestForm},
    writer::Outlet,
};
use crate::cdr::{self, CdrError};

/// How long a reply waits for the client's reply reader to be found. Some clients' readers are
/// found seconds after their first request.
const MATCH_PATIENCE: Duration = Duration::from_secs(5);
/// How long a reply waits to be acknowledged before it is sent again as a new sample: doubled each time. DDS repeats by
/// itself what was lost on the way; this is for a client that had not found the server yet, and it should not come sooner
/// than a busy client acknowledges: some say so when they get a reply twice.
const FIRST_RESEND_AFTER: Duration = Duration::from_millis(250);
/// How often a reply is sent before it is given up.
const SEND_COUNT_MAX: u32 = 4;
/// How often to ask how a client left: the library says so just after it has forgotten the client, on a busy machine later.
const LEAVE_LOOKS: u32 = 400;
/// Between two times.
const LEAVE_LOOK: Duration = Duration::from_millis(5);
/// Pause before a reply that found the writer full is tried again.
const FULL_PAUSE: Duration = Duration::from_millis(5);

/// The body of a sample that stands for one that went out in a datagram of its own.
const STAND_IN: Bytes = Bytes::from_static(&[0; 4]);

/// Why a reply was not sent.
enum SendError {
    /// RustDDS did not take it.
    Publish(PublishError),
    /// The datagram could not be made or sent.
    Datagram(String),
}

impl Participant {
    /// Offers a service, e.g. `/feeder/load_parts`, to clients of either wire form. Requests go to
    /// `deliver` on the participant's thread, which must return soon (see [the module](super)); the
    /// answer may be given at any time, from any thread, through [`Request::reply`].
    ///
    /// # Errors
    /// [`DdsError::Name`] for a bad name, [`DdsError::Endpoint`] when the middleware refuses.
    pub fn server(
        &self,
        name: &str,
        request_dds_type: &str,
        response_dds_type: &str,
        mut deliver: impl FnMut(Request) + Send + 'static,
    ) -> Result<Server, DdsError> {
        let qos = Qos::service();
        let request_topic = dds_name("service", "rq", name, "Request")?;
        let writer = self.writer_of(&dds_name("service", "rr", name, "Reply")?, response_dds_type, &qos)?;
        let counters = Arc::new(Counters {
            requests: AtomicU64::new(0),
            on_the_way: AtomicU64::new(0),
            refused: self.counter(name, "requests refused"),
            replies_lost: self.counter(name, "replies lost"),
        });
        let service: Arc<str> = name.into();
        let reader = self.reader_of(&request_topic, request_dds_type, &qos, {
            let (counters, service) = (counters.clone(), service.clone());
            let (outlet, spawner, participant) = (writer.outlet(), self.spawner(), self.downgrade());
            move |sample| {
                counters.requests.fetch_add(1, Ordering::Relaxed);
                let reply = |form| ReplyHandle {
                    service: service.clone(),
                    outlet: outlet.clone(),
                    spawner: spawner.clone(),
                    participant: participant.clone(),
                    counters: counters.clone(),
                    client: sample.writer_guid,
                    form,
                    answered: false,
                };
                match wire::read_request(&sample) {
                    Ok((form, payload)) => {
                        deliver(Request { payload, little_endian: sample.little_endian, reply: reply(form) });
                    }
                    Err(error) => counters.refuse(&service, sample.writer_guid, &error),
                }
            }
        })?;
        Ok(Server { _reader: reader, writer, counters, service })
    }
}

/// A service on offer, until dropped.
pub struct Server {
    // Dropped in this order: no request is taken that could not be answered.
    _reader: Reader,
    writer: Writer,
    counters: Arc<Counters>,
    service: Arc<str>,
}

impl Server {
    /// Name of the service.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.service
    }

    /// Clients that are there now.
    #[must_use]
    pub fn clients(&self) -> usize {
        self.writer.matched_readers()
    }

    /// How many replies are on their way: a server that is dropped before they have arrived may take them with it.
    #[must_use]
    pub fn replies_on_the_way(&self) -> u64 {
        self.counters.on_the_way.load(Ordering::Relaxed)
    }

    /// What has become of the requests so far.
    #[must_use]
    pub fn counts(&self) -> ServerCounts {
        ServerCounts {
            requests: self.counters.requests.load(Ordering::Relaxed),
            refused: self.counters.refused.get(),
            replies_lost: self.counters.replies_lost.get(),
        }
    }
}

/// What has become of a server's requests; each refusal and loss is logged with its reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ServerCounts {
    /// Requests that came.
    pub requests: u64,
    /// Those that could not be read or got no answer.
    pub refused: u64,
    /// Replies whose client was not found, or never acknowledged them.
    pub replies_lost: u64,
}

struct Counters {
    requests: AtomicU64,
    /// Replies whose clients have not acknowledged them yet.
    on_the_way: AtomicU64,
    refused: Arc<Counter>,
    replies_lost: Arc<Counter>,
}

impl Counters {
    fn refuse(&self, service: &str, client: Guid, reason: &dyn fmt::Display) {
        self.refused.add(1);
        tracing::warn!(service, %client, "request refused: {reason}");
    }

    fn lose_reply(&self, service: &str, client: Guid, reason: &dyn fmt::Display) {
        self.replies_lost.add(1);
        tracing::warn!(service, %client, "reply lost: {reason}");
    }
}

/// A request to a [`Server`].
#[derive(Debug)]
pub struct Request {
    /// CDR body of the request.
    pub payload: Bytes,
    /// Its byte order.
    pub little_endian: bool,
    /// Where the answer goes.
    pub reply: ReplyHandle,
}

impl Request {
    /// Reads the body as a message.
    ///
    /// # Errors
    /// [`CdrError`] when the body is not one of type `T`; pass it to [`ReplyHandle::refuse`].
    pub fn decode<T: DeserializeOwned>(&self) -> Result<T, CdrError> {
        cdr::decode(&self.payload, self.little_endian)
    }
}

/// The right to answer one request. Dropped unused, the client gets no answer, which counts as a refusal.
pub struct ReplyHandle {
    service: Arc<str>,
    outlet: Arc<Outlet>,
    spawner: Spawner,
    participant: Weak<Inner>,
    counters: Arc<Counters>,
    client: Guid,
    form: RequestForm,
    answered: bool,
}

impl Drop for ReplyHandle {
    fn drop(&mut self) {
        if !self.answered {
            self.counters.refuse(&self.service, self.client, &"nobody answered it");
        }
    }
}

impl ReplyHandle {
    /// Answers with a little-endian CDR body. Returns at once: the reply waits for the client's reader
    /// to be found and is sent again until acknowledged, without holding up other replies.
    pub fn send(mut self, body: Bytes) {
        self.answered = true;
        let spawner = self.spawner.clone();
        self.counters.on_the_way.fetch_add(1, Ordering::Relaxed);
        spawner.spawn(async move {
            if let Err(reason) = self.deliver(body).await {
                self.counters.lose_reply(&self.service, self.client, &reason);
            }
            self.counters.on_the_way.fetch_sub(1, Ordering::Relaxed);
        });
    }

    /// Answers with a message; see [`send`](Self::send). A message without a CDR form is logged and not sent.
    pub fn send_message<T: Serialize>(self, message: &T) {
        match cdr::encode(message) {
            Ok(body) => self.send(body),
            Err(error) => self.refuse(&error),
        }
    }

    /// Gives no answer, because the request made no sense: the reason is logged and the request counted.
    pub fn refuse(mut self, reason: &dyn fmt::Display) {
        self.answered = true;
        self.counters.refuse(&self.service, self.client, reason);
    }

    /// The client's request writer.
    #[must_use]
    pub fn client(&self) -> Guid {
        self.client
    }

    async fn wait_for_readers(&self) -> Vec<Guid> {
        let peers = &self.outlet.peers;
        let readers_among =
            |matched: &BTreeMap<Guid, Match>| self.form.reply_readers(self.client, matched.keys().copied());
        let mut changes = peers.changes();
        let found = changes.wait_for(|matched| !readers_among(matched).is_empty()).await;
        // The other outcome, that nothing will change any more, needs the peers to be gone.
        let readers = found.map(|matched| readers_among(&matched)).unwrap_or_default();
        futures::future::join_all(readers.iter().map(|reader| peers.settled(*reader))).await;
        readers
    }

    async fn deliver(&self, body: Bytes) -> Result<(), String> {
        let readers = timeout(MATCH_PATIENCE, self.wait_for_readers())
            .await
            .map_err(|_| format!("the client's reply reader was not found in {MATCH_PATIENCE:?}"))?;
        let (payload, related) = self.form.reply(body);
        let mut firsts = Vec::new();
        for turn in 0..SEND_COUNT_MAX {
            for reader in &readers {
                firsts.extend(self.outlet.peers.first(*reader).await);
                while let Err(error) = self.send_to(*reader, &payload, related) {
                    match error {
                        SendError::Publish(PublishError::Full { .. }) => sleep(FULL_PAUSE).await,
                        SendError::Publish(PublishError::Closed { reason, .. }) | SendError::Datagram(reason) => {
                            return Err(reason);
                        }
                    }
                }
            }
            if timeout(FIRST_RESEND_AFTER * (1 << turn), self.outlet.acknowledged()).await.is_ok() {
                return self.check_presence(&readers).await;
            }
            firsts.clear();
        }
        Err(format!("not acknowledged, though sent {SEND_COUNT_MAX} times"))
    }

    /// Whether those that a reply was sent to have acknowledged it, and did not vanish instead.
    async fn check_presence(&self, readers: &[Guid]) -> Result<(), String> {
        for reader in readers {
            if self.has_vanished(*reader).await {
                return Err("the client fell silent before it acknowledged".to_owned());
            }
        }
        Ok(())
    }

    /// Whether a reader is gone because its lease ran out: the library then takes all that it was sent for acknowledged.
    async fn has_vanished(&self, reader: Guid) -> bool {
        // Whoever follows the readers has been woken before this task, and has its turn first.
        yield_now().await;
        if self.outlet.peers.is_matched(reader) {
            return false;
        }
        for _ in 0..LEAVE_LOOKS {
            if let Some(leave) = self.participant.upgrade().and_then(|participant| participant.leave_of(reader)) {
                return leave == Leave::Silent;
            }
            sleep(LEAVE_LOOK).await;
        }
        // Its participant is there: it has closed this client.
        false
    }

    /// Sends a reply to a reader: a long one to Fast DDS in one datagram, see [`datagram`].
    fn send_to(&self, reader: Guid, payload: &Bytes, related: Option<SampleId>) -> Result<(), SendError> {
        let Some(related) = related.filter(|_| payload.len() > FRAGMENTED_ABOVE_BYTES && wire::speaks_related(reader))
        else {
            return self.outlet.send(payload.clone(), Some(reader), related).map(|_| ()).map_err(SendError::Publish);
        };
        let participant =
            self.participant.upgrade().ok_or_else(|| SendError::Datagram("the participant has left".to_owned()))?;
        let addresses = graph::reader_addresses(&participant.domain_participant, reader);
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let mut sent = Ok(());
        let send_whole = |sequence| {
            let sample =
                WholeSample { writer: self.outlet.guid(), reader, sequence, related, since_1970, body: payload };
            sent = sample.encode().map_err(|error| error.to_string()).and_then(|message| {
                datagram::send(&message, &addresses)
                    .map_err(|error| format!("the reply could not be sent whole: {error}"))
            });
        };
        self.outlet.send_after(send_whole, STAND_IN, Some(reader), None).map_err(SendError::Publish)?;
        sent.map_err(SendError::Datagram)
    }
}

impl fmt::Debug for ReplyHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ReplyHandle({} to {})", self.service, self.client)
    }
}
