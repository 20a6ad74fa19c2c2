//! One step of a node: its inputs of this tick, and its outputs.

use std::collections::VecDeque;
use std::fmt;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

use bytes::{Bytes, BytesMut};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::stamp_of_ns;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::{Message, Service};

use super::lifecycle::LifecycleState;
use super::ports::{Client, Publisher, Server, Subscriber};
use crate::cdr;
use crate::dds::{Counter, ReplyHandle};

/// Who asked, so that the answer finds the way back. May be kept over many steps.
#[derive(Debug)]
pub struct Asker(pub(crate) AskerInner);

impl Asker {
    /// A number that tells this client from the others of the same service; two share one with a chance of 2⁻⁶⁴.
    #[must_use]
    pub fn client(&self) -> u64 {
        match &self.0 {
            AskerInner::Loop { edge, .. } => *edge as u64,
            AskerInner::Graph(reply) => {
                let mut hasher = DefaultHasher::new();
                reply.client().hash(&mut hasher);
                hasher.finish()
            }
        }
    }

    /// A number that tells this client's process from others: that of its DDS participant, or of its node in the loop.
    #[must_use]
    pub fn participant(&self) -> u64 {
        match &self.0 {
            AskerInner::Loop { edge, .. } => *edge as u64,
            AskerInner::Graph(reply) => {
                let mut hasher = DefaultHasher::new();
                reply.client().participant().hash(&mut hasher);
                hasher.finish()
            }
        }
    }

    /// Gives no answer, because the request made no sense.
    fn refuse(self, reason: &dyn fmt::Display) {
        match self.0 {
            AskerInner::Graph(handle) => handle.refuse(reason),
            AskerInner::Loop { .. } => tracing::warn!("request refused: {reason}"),
        }
    }
}

#[derive(Debug)]
pub(crate) enum AskerInner {
    /// A node of the loop, at the other end of an in-edge.
    Loop { edge: usize, call: u64 },
    /// A client anywhere on the graph.
    Graph(ReplyHandle),
}

/// Identifies a call of this node until its reply has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CallId(pub(crate) u64);

/// What has arrived at a port and was not taken yet.
#[derive(Debug)]
pub(crate) enum Arrival {
    Message {
        payload: Bytes,
        little_endian: bool,
    },
    Request {
        payload: Bytes,
        little_endian: bool,
        asker: Asker,
    },
    Reply {
        payload: Bytes,
        little_endian: bool,
        call: CallId,
    },
    /// No reply will come to this call.
    NoReply {
        call: CallId,
    },
}

/// What a step wants sent.
#[derive(Debug)]
pub(crate) enum Output {
    Message { port: usize, payload: Bytes },
    Request { port: usize, call: CallId, payload: Bytes },
    Reply { port: usize, asker: Asker, payload: Bytes },
}

/// A node's view of one tick.
#[derive(Debug)]
pub struct StepIo {
    tick: u64,
    now_ns: u64,
    tick_ns: u64,
    arrivals: Vec<VecDeque<Arrival>>,
    pub(crate) outputs: Vec<Output>,
    wanted: Vec<bool>,
    next_call: u64,
    lifecycle: LifecycleState,
    /// Whether this is the first step since the node became active.
    activated: bool,
    pub(crate) goal_reached: bool,
    undecodable: Option<Arc<Counter>>,
}

impl StepIo {
    pub(crate) fn new(ports: usize, tick_ns: u64) -> Self {
        Self {
            tick: 0,
            now_ns: 0,
            tick_ns,
            arrivals: (0..ports).map(|_| VecDeque::new()).collect(),
            outputs: Vec::new(),
            wanted: vec![true; ports],
            next_call: 0,
            lifecycle: LifecycleState::Active,
            activated: true,
            goal_reached: false,
            undecodable: None,
        }
    }

    /// Counts what cannot be decoded.
    pub(crate) fn counted_by(self, undecodable: Arc<Counter>) -> Self {
        Self { undecodable: Some(undecodable), ..self }
    }

    pub(crate) fn begin(&mut self, tick: u64, now_ns: u64) {
        self.tick = tick;
        self.now_ns = now_ns;
    }

    pub(crate) fn arrive(&mut self, port: usize, arrival: Arrival) {
        self.arrivals[port].push_back(arrival);
    }

    /// Drops what no step took: a node that does not look at a port does not save up for later.
    pub(crate) fn end(&mut self) {
        self.activated = false;
        for queue in &mut self.arrivals {
            queue.clear();
        }
    }

    pub(crate) fn note_wanted(&mut self, port: usize, wanted: bool) {
        self.wanted[port] = wanted;
    }

    /// Whether anybody would get what `publisher` publishes now. A costly message that serves viewers alone may be left
    /// unmade when not.
    #[must_use]
    pub fn wanted<M: Message>(&self, publisher: &Publisher<M>) -> bool {
        self.wanted[publisher.port]
    }

    pub(crate) fn set_lifecycle(&mut self, state: LifecycleState) {
        let active = state == LifecycleState::Active;
        self.activated = active && (self.activated || !self.is_active());
        self.lifecycle = state;
    }

    /// In which state of its lifecycle the node is; one that has none is always active.
    #[must_use]
    pub fn lifecycle(&self) -> LifecycleState {
        self.lifecycle
    }

    /// Whether the node is to do what it is there for.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.lifecycle == LifecycleState::Active
    }

    /// Whether this is the first step in which it is, since its start or since it was not.
    #[must_use]
    pub fn is_activated(&self) -> bool {
        self.activated
    }

    /// Whether a request may be taken by a node that is called `node`.
    ///
    /// # Errors
    /// That it is not active, for the reply.
    pub fn check_active(&self, node: &str) -> Result<(), String> {
        if self.is_active() { Ok(()) } else { Err(format!("{node} is {}, not active", self.lifecycle.label())) }
    }

    /// The tick being stepped, counted from the start of the run; against the wall clock, from the start of the node.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Length of a tick, s.
    #[must_use]
    pub fn tick_s(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a tick is far below 2^53 ns")]
        let ns = self.tick_ns as f64;
        ns * 1e-9
    }

    /// The present, ns since the start of the run; against the wall clock, since 1970 (UTC), as stamps count in ROS.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The present, s; see [`now_ns`](Self::now_ns).
    #[must_use]
    pub fn now_s(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "exact for 104 days of simulated time, wall time to 0.3 µs")]
        let ns = self.now_ns() as f64;
        ns * 1e-9
    }

    /// The present as a stamp.
    #[must_use]
    pub fn stamp(&self) -> Time {
        stamp_of_ns(self.now_ns())
    }

    /// A header with the present as its stamp.
    #[must_use]
    pub fn header(&self, frame_id: &str) -> Header {
        Header { stamp: self.stamp(), frame_id: frame_id.to_owned() }
    }

    /// Takes the messages that arrived for this tick, oldest first. One that cannot be decoded is dropped and counted.
    pub fn take<M: Message>(&mut self, subscriber: &Subscriber<M>) -> Vec<M> {
        let arrivals: Vec<Arrival> = self.arrivals[subscriber.port].drain(..).collect();
        arrivals
            .into_iter()
            .filter_map(|arrival| match arrival {
                Arrival::Message { payload, little_endian } => self.decode(&payload, little_endian),
                Arrival::Request { .. } | Arrival::Reply { .. } | Arrival::NoReply { .. } => None,
            })
            .collect()
    }

    /// Publishes `message`, if anybody would get it.
    pub fn publish<M: Message>(&mut self, publisher: &Publisher<M>, message: &M) {
        if !self.wanted(publisher) {
            return;
        }
        if let Some(payload) = self.encode(message) {
            self.outputs.push(Output::Message { port: publisher.port, payload });
        }
    }

    /// Takes the requests that arrived for this tick, oldest first. One that cannot be decoded is refused and counted.
    pub fn requests<S: Service>(&mut self, server: &Server<S>) -> Vec<(Asker, S::Request)> {
        let arrivals: Vec<Arrival> = self.arrivals[server.port].drain(..).collect();
        arrivals
            .into_iter()
            .filter_map(|arrival| match arrival {
                Arrival::Request { payload, little_endian, asker } => match cdr::decode(&payload, little_endian) {
                    Ok(request) => Some((asker, request)),
                    Err(error) => {
                        asker.refuse(&error);
                        None
                    }
                },
                Arrival::Message { .. } | Arrival::Reply { .. } | Arrival::NoReply { .. } => None,
            })
            .collect()
    }

    /// Answers a request.
    pub fn reply<S: Service>(&mut self, server: &Server<S>, asker: Asker, response: &S::Response) {
        if let Some(payload) = self.encode(response) {
            self.outputs.push(Output::Reply { port: server.port, asker, payload });
        }
    }

    /// Calls a service. The reply arrives with a later step.
    pub fn call<S: Service>(&mut self, client: &Client<S>, request: &S::Request) -> CallId {
        let call = CallId(self.next_call);
        self.next_call += 1;
        if let Some(payload) = self.encode(request) {
            self.outputs.push(Output::Request { port: client.port, call, payload });
        }
        call
    }

    /// Takes the replies that arrived for this tick.
    pub fn replies<S: Service>(&mut self, client: &Client<S>) -> Vec<(CallId, S::Response)> {
        let answers = self.answers(client);
        answers.into_iter().filter_map(|(call, response)| Some((call, response?))).collect()
    }

    /// Takes the ends of calls for this tick: the reply, or nothing where none will come: no server was found in time, or
    /// its reply was lost or makes no sense. Whether the server has acted on such a request is not known. Between nodes
    /// of a loop every call gets its reply.
    pub fn answers<S: Service>(&mut self, client: &Client<S>) -> Vec<(CallId, Option<S::Response>)> {
        let arrivals: Vec<Arrival> = self.arrivals[client.port].drain(..).collect();
        arrivals
            .into_iter()
            .filter_map(|arrival| match arrival {
                Arrival::Reply { payload, little_endian, call } => Some((call, self.decode(&payload, little_endian))),
                Arrival::NoReply { call } => Some((call, None)),
                Arrival::Message { .. } | Arrival::Request { .. } => None,
            })
            .collect()
    }

    /// Declares the goal of the run reached; the run ends a fixed number of ticks later.
    pub fn reach_goal(&mut self) {
        self.goal_reached = true;
    }

    fn decode<M: Message>(&mut self, payload: &[u8], little_endian: bool) -> Option<M> {
        match cdr::decode(payload, little_endian) {
            Ok(message) => Some(message),
            Err(error) => {
                if let Some(counter) = &self.undecodable {
                    counter.add(1);
                }
                tracing::warn!("dropped a {} of {} bytes: {error}", M::INFO.ros_type(), payload.len());
                None
            }
        }
    }

    fn encode<M: Message>(&mut self, message: &M) -> Option<Bytes> {
        match cdr::encode(message) {
            Ok(payload) => Some(payload),
            Err(error) => {
                tracing::error!("cannot encode a {}: {error}", M::INFO.ros_type());
                None
            }
        }
    }
}

/// Puts the number of a call before its payload, as the loop carries both in one message.
pub(crate) fn with_call(call: CallId, payload: &[u8]) -> Bytes {
    let mut bytes = BytesMut::with_capacity(8 + payload.len());
    bytes.extend_from_slice(&call.0.to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes.freeze()
}

/// The inverse of [`with_call`].
pub(crate) fn split_call(payload: &Bytes) -> Option<(CallId, Bytes)> {
    let call = payload.get(..8)?.try_into().ok().map(u64::from_le_bytes)?;
    Some((CallId(call), payload.slice(8..)))
}
