//! Runs one node against the wall clock: as on hardware, and with nodes of anybody's making.
//!
//! The node does not notice: its steps come at the same tick length as in a simulated run, but what it hears, serves and
//! calls goes over the public topics and services, as it comes, and stamps are wall time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::Bytes;

use crate::dds::{Client, DdsError, Participant, Reader};
use crate::lockstep::{Incoming, RunError};
use crate::node::{Arrival, AskerInner, CallId, FeederNode, Interface, Output, PortKind, StepIo};
use crate::public::PublicSide;

/// How far steps may lag behind the wall clock before some are given up.
const LAG_MAX: Duration = Duration::from_millis(500);
/// How long a call waits for its reply.
const REPLY_LIMIT: Duration = Duration::from_secs(5);
/// How long a call waits for the result of an action's goal, which comes when the goal has ended.
const RESULT_LIMIT: Duration = Duration::from_secs(3600);
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
            tracing::warn!("{} ms behind the wall clock; going on from now", (now_ns - self.next_ns) / 1_000_000);
            self.next_ns = now_ns;
        } else if self.next_ns > now_ns.saturating_add(self.tick_ns) {
            tracing::warn!("the wall clock was set back by {} ms", (self.next_ns - now_ns) / 1_000_000);
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

/// Steps `node` every `tick` until `stop` is set.
pub(crate) fn run<N: FeederNode>(
    participant: &Participant,
    node: N,
    interface: &Interface,
    tick: Duration,
    stop: &AtomicBool,
) -> Result<(), RunError> {
    let tick_ns = u64::try_from(tick.as_nanos()).unwrap_or(u64::MAX);
    let mut runner = WallRunner::open(participant, node, interface, tick_ns)?;
    let mut schedule = Schedule::new(tick_ns, wall_ns());
    while !stop.load(Ordering::Relaxed) {
        match schedule.due(wall_ns()) {
            Due::Now(now_ns) => runner.step(now_ns)?,
            Due::InNs(wait_ns) => std::thread::sleep(Duration::from_nanos(wait_ns).min(STOP_POLL)),
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
        let mut io = StepIo::new(interface.ports.len(), tick_ns);
        io.set_simulated(false);
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
            self.io.note_wanted(port, self.public.has_readers(port));
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

    /// The reply arrives with a later step; a call that gets none is logged.
    fn call(&self, port: usize, call: CallId, payload: Bytes) {
        let Some(client) = &self.clients[port] else { return };
        let limit = if client.name().ends_with("/_action/get_result") { RESULT_LIMIT } else { REPLY_LIMIT };
        let sender = self.sender.clone();
        client.call_with(payload, limit, move |outcome| match outcome {
            Ok(reply) => {
                let arrival = Arrival::Reply { payload: reply.payload, little_endian: reply.little_endian, call };
                let _ = sender.send(Incoming::Outside(port, arrival));
            }
            Err(error) => tracing::warn!("{error}"),
        });
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
