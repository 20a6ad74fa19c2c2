//! Runs one node against the wall clock: as on hardware, and with nodes of anybody's making. With `use_sim_time` it goes
//! by `/clock` instead, outside any loop.
//!
//! The node does not notice: its steps come at the same tick length as in a simulated run, but what it hears, serves and
//! calls goes over the public topics and services, as it comes, and stamps are wall time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::Bytes;
use minifactory_msgs::interface::standard::CLOCK;
use minifactory_msgs::rosgraph_msgs::msg::Clock as ClockMessage;

use crate::clock::TimeSource;
use crate::dds::{CallError, Client, DdsError, Participant, Reader, Reply};
use crate::lockstep::{Incoming, RunError};
use crate::node::{
    Arrival, AskerInner, CallId, FeederNode, Interface, Output, PortKind, StepIo, ns_of_stamp, stamp_of_ns,
};
use crate::public::PublicSide;

/// How far steps may lag behind the wall clock before some are given up.
const LAG_MAX: Duration = Duration::from_millis(500);
/// How long a call waits for its reply.
const REPLY_LIMIT: Duration = Duration::from_secs(5);
/// A node looks at least this often whether it is to stop.
const STOP_POLL: Duration = Duration::from_millis(100);

/// When steps are due, in ns of wall time since 1970: one a tick, in time with the clock even when it is slewed.
#[derive(Debug)]
struct Schedule {
    tick_ns: u64,
    next_ns: u64,
}

#[derive(Debug, PartialEq, Eq)]
enum Due {
    /// The step of this time is due.
    Now(u64),
    /// The next step is due in so many ns.
    InNs(u64),
}

impl Schedule {
    fn new(tick_ns: u64, now_ns: u64) -> Self {
        Self { tick_ns, next_ns: now_ns }
    }

    fn due(&mut self, now_ns: u64) -> Due {
        let lag_max_ns = u64::try_from(LAG_MAX.as_nanos()).unwrap_or(u64::MAX);
        if now_ns > self.next_ns.saturating_add(lag_max_ns) {
            tracing::warn!("{} ms behind the clock; going on from now", (now_ns - self.next_ns) / 1_000_000);
            self.next_ns = now_ns;
        } else if self.next_ns > now_ns.saturating_add(self.tick_ns) {
            tracing::warn!("the clock was set back by {} ms", (self.next_ns - now_ns) / 1_000_000);
            self.next_ns = now_ns;
        }
        if now_ns < self.next_ns {
            return Due::InNs(self.next_ns - now_ns);
        }
        let stamp_ns = self.next_ns;
        self.next_ns += self.tick_ns;
        Due::Now(stamp_ns)
    }
}

/// Where the time comes from.
pub(crate) enum Time {
    /// The wall clock, in ns since 1970.
    Wall,
    /// `/clock`, as somebody's simulation says it.
    Simulated { said: Arc<SaidTime>, _reader: Reader },
}

/// The time last said on `/clock`, ns; 0 before the first.
#[derive(Default)]
pub(crate) struct SaidTime {
    now_ns: Mutex<u64>,
    moved: Condvar,
}

impl Time {
    /// Hears `topic`, which is `/clock` unless remapped.
    pub(crate) fn simulated(participant: &Participant, topic: &str) -> Result<Self, DdsError> {
        let said = Arc::new(SaidTime::default());
        // As ROS 2 nodes hear it: the newest counts, and a lost one does not matter.
        let reader = participant.reader(topic, &CLOCK.dds_type(), &CLOCK.qos(), {
            let said = Arc::clone(&said);
            move |sample| match sample.decode::<ClockMessage>() {
                Ok(message) => said.say(ns_of_stamp(&message.clock)),
                Err(error) => tracing::warn!("dropped a malformed clock: {error}"),
            }
        })?;
        Ok(Self::Simulated { said, _reader: reader })
    }

    /// For stamps of what the node does not publish itself.
    pub(crate) fn clock(&self) -> TimeSource {
        match self {
            Self::Wall => Arc::new(crate::clock::wall_clock),
            Self::Simulated { said, .. } => {
                let said = Arc::clone(said);
                Arc::new(move || stamp_of_ns(said.now_ns().unwrap_or(0)))
            }
        }
    }

    /// The present, once it is known.
    fn now_ns(&self) -> Option<u64> {
        match self {
            Self::Wall => Some(wall_ns()),
            Self::Simulated { said, .. } => said.now_ns(),
        }
    }

    /// Waits until `wait_ns` may have passed; never long.
    fn wait(&self, since_ns: Option<u64>, wait_ns: u64) {
        match self {
            Self::Wall => std::thread::sleep(Duration::from_nanos(wait_ns).min(STOP_POLL)),
            Self::Simulated { said, .. } => said.wait(since_ns),
        }
    }
}

impl SaidTime {
    fn lock(&self) -> MutexGuard<'_, u64> {
        self.now_ns.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn say(&self, now_ns: u64) {
        *self.lock() = now_ns;
        self.moved.notify_all();
    }

    fn now_ns(&self) -> Option<u64> {
        Some(*self.lock()).filter(|now_ns| *now_ns > 0)
    }

    /// Waits until another time is said than `since_ns`; never long.
    fn wait(&self, since_ns: Option<u64>) {
        let same = |now_ns: &mut u64| *now_ns == since_ns.unwrap_or(0);
        // A lock that somebody has panicked with still tells the time.
        drop(self.moved.wait_timeout_while(self.lock(), STOP_POLL, same));
    }
}

/// When a node steps, and until when.
pub(crate) struct Pace<'a> {
    pub(crate) time: Time,
    pub(crate) tick: Duration,
    pub(crate) stop: &'a AtomicBool,
}

/// A node and its ends of topics and services.
struct WallRunner<N> {
    node: N,
    io: StepIo,
    public: PublicSide,
    /// Port → client, for ports that call.
    clients: Vec<Option<Client>>,
    sender: Sender<Incoming>,
    inbox: Receiver<Incoming>,
    tick: u64,
    _readers: Vec<Reader>,
}

/// Steps `node` every tick until it is to stop; configurations that come are taken over between two steps. Others are met
/// when it has its endpoints.
pub(crate) fn run<N: FeederNode>(
    participant: &Participant,
    node: N,
    interface: &Interface,
    pace: &Pace,
    reconfigured: &Receiver<N::Config>,
) -> Result<(), RunError> {
    let tick_ns = u64::try_from(pace.tick.as_nanos()).unwrap_or(u64::MAX);
    let mut runner = WallRunner::open(participant, node, interface, tick_ns)?;
    participant.meet_others();
    let mut schedule = None;
    while !pace.stop.load(Ordering::Relaxed) {
        let now_ns = pace.time.now_ns();
        let due = now_ns.map(|now_ns| schedule.get_or_insert_with(|| Schedule::new(tick_ns, now_ns)).due(now_ns));
        match due {
            Some(Due::Now(now_ns)) => {
                for config in reconfigured.try_iter() {
                    runner.node.reconfigure(&config);
                }
                runner.step(now_ns)?;
            }
            Some(Due::InNs(wait_ns)) => pace.time.wait(now_ns, wait_ns),
            None => pace.time.wait(now_ns, u64::MAX),
        }
    }
    Ok(())
}

fn wall_ns() -> u64 {
    // A clock before 1970 reads as 1970.
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since_epoch.as_nanos()).unwrap_or(u64::MAX)
}

impl<N: FeederNode> WallRunner<N> {
    fn open(participant: &Participant, node: N, interface: &Interface, tick_ns: u64) -> Result<Self, DdsError> {
        let (sender, inbox) = channel();
        let mut readers = Vec::new();
        let mut clients = Vec::new();
        for (index, port) in interface.ports.iter().enumerate() {
            clients.push(None);
            match port.kind {
                PortKind::Subscribe(_) => {
                    let sender = sender.clone();
                    readers.push(participant.reader(&port.name, &port.dds_types[0], &port.qos, move |sample| {
                        let arrival = Arrival::Message { payload: sample.payload, little_endian: sample.little_endian };
                        // A closed inbox belongs to a node that has stopped.
                        let _ = sender.send(Incoming::Outside(index, arrival));
                    })?);
                }
                PortKind::Call(_) => {
                    clients[index] = Some(participant.client(&port.name, &port.dds_types[0], &port.dds_types[1])?);
                }
                PortKind::Publish | PortKind::Serve => {}
            }
        }
        let public = PublicSide::open(participant, interface, &sender)?;
        let undecodable = participant.counter("messages", "samples that are not of their type");
        let io = StepIo::new(interface.ports.len(), tick_ns).counted_by(undecodable);
        Ok(Self { node, io, public, clients, sender, inbox, tick: 0, _readers: readers })
    }

    fn step(&mut self, now_ns: u64) -> Result<(), RunError> {
        self.io.begin(self.tick, now_ns);
        while let Ok(incoming) = self.inbox.try_recv() {
            if let Incoming::Outside(port, arrival) = incoming {
                self.io.arrive(port, arrival);
            }
        }
        for port in 0..self.clients.len() {
            self.io.note_wanted(port, self.public.is_heard(port));
        }
        self.node.step(&mut self.io).map_err(RunError::Node)?;
        self.io.end();
        for output in std::mem::take(&mut self.io.outputs) {
            match output {
                Output::Message { port, payload } => self.public.publish(port, payload),
                Output::Request { port, call, payload } => self.call(port, call, payload),
                Output::Reply { asker, payload, .. } => match asker.0 {
                    AskerInner::Graph(handle) => handle.send(payload),
                    AskerInner::Loop { .. } => {}
                },
            }
        }
        self.tick += 1;
        Ok(())
    }

    /// The reply arrives with a later step, or that there is none, which is logged too.
    fn call(&self, port: usize, call: CallId, payload: Bytes) {
        let Some(client) = &self.clients[port] else { return };
        let sender = self.sender.clone();
        let answer = move |outcome: Result<Reply, CallError>| {
            let arrival = match outcome {
                Ok(reply) => Arrival::Reply { payload: reply.payload, little_endian: reply.little_endian, call },
                Err(error) => {
                    tracing::warn!("{error}");
                    Arrival::NoReply { call }
                }
            };
            let _ = sender.send(Incoming::Outside(port, arrival));
        };
        // A result comes when its goal has ended; a server that was started again answers that it does not know the goal.
        if client.name().ends_with("/_action/get_result") {
            client.call_again_with(payload, REPLY_LIMIT, answer);
        } else {
            client.call_with(payload, REPLY_LIMIT, answer);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TICK_NS: u64 = 10_000_000;
    const MS: u64 = 1_000_000;
    const START_NS: u64 = 1_700_000_000_000_000_000;

    #[test]
    fn steps_come_on_a_grid_however_late_they_are_looked_for() {
        let mut schedule = Schedule::new(TICK_NS, START_NS);
        assert_eq!(schedule.due(START_NS), Due::Now(START_NS));
        assert_eq!(schedule.due(START_NS + 4 * MS), Due::InNs(6 * MS));
        assert_eq!(schedule.due(START_NS + 35 * MS), Due::Now(START_NS + TICK_NS));
        assert_eq!(schedule.due(START_NS + 35 * MS), Due::Now(START_NS + 2 * TICK_NS));
        assert_eq!(schedule.due(START_NS + 36 * MS), Due::Now(START_NS + 3 * TICK_NS));
        assert_eq!(schedule.due(START_NS + 37 * MS), Due::InNs(3 * MS));
    }

    #[test]
    fn a_pause_is_not_caught_up_with_and_a_clock_set_back_stops_nothing() {
        let mut schedule = Schedule::new(TICK_NS, START_NS);
        let later_ns = START_NS + 3_000 * MS;
        assert_eq!(schedule.due(later_ns), Due::Now(later_ns));
        assert_eq!(schedule.due(later_ns), Due::InNs(TICK_NS));
        let earlier_ns = START_NS - 3_600_000 * MS;
        assert_eq!(schedule.due(earlier_ns), Due::Now(earlier_ns));
        assert_eq!(schedule.due(earlier_ns), Due::InNs(TICK_NS));
    }

    proptest! {
        /// While the clock runs on, the stamps are a tick apart, none in the future, none older than the lag allowed.
        #[test]
        fn stamps_keep_to_the_clock(advances in prop::collection::vec(0_u64..400 * MS, 1..50)) {
            let mut schedule = Schedule::new(TICK_NS, START_NS);
            let mut now_ns = START_NS;
            let mut expected_ns = START_NS;
            for advance_ns in advances {
                now_ns += advance_ns;
                while let Due::Now(stamp_ns) = schedule.due(now_ns) {
                    prop_assert_eq!(stamp_ns, expected_ns);
                    prop_assert!(stamp_ns <= now_ns);
                    expected_ns += TICK_NS;
                }
                prop_assert!(now_ns < expected_ns);
            }
        }
    }
}
