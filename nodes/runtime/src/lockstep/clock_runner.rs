//! Runs the clock: hears statuses, sends grants, publishes `/clock`.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use minifactory_msgs::Message;
use minifactory_msgs::interface::standard::CLOCK;
use minifactory_msgs::msg::{LoopGrant, LoopStatus};
use minifactory_msgs::rosgraph_msgs::msg::Clock as ClockMessage;

use super::clock::{ClockError, LoopClock, Speed};
use super::contract::LoopContract;
use super::control::{Control, ResetRefusal, Wish};
use super::hub::Hub;
use super::links::{LoopWriter, read};
use super::runner::RunError;
use crate::cdr;
use crate::clock::TimeSource;
use crate::dds::{Participant, Reader, Writer};
use crate::digest::Digest;
use crate::housekeeping::{Housekeeping, own_parameters};
use crate::node::{Interface, NodeError, Port, PortKind, stamp_of_ns};
use crate::parameters::{Declaration, Range, Store, Value};
use crate::patience::share_of_machine;
use crate::recording::Tap;

/// Between grants that say nothing new, so that a node can tell a slow clock from a dead one.
const RENEW_PERIOD: Duration = Duration::from_millis(100);
/// The clock waits no longer than this, so that pacing stays smooth.
const POLL_PERIOD: Duration = Duration::from_millis(2);

/// Between warnings that a busy machine keeps the run waiting.
const WARN_PERIOD: Duration = Duration::from_secs(5);

/// Why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunEnd {
    /// The loop broke.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// A grant could not be sent.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Whoever watches the processes found one gone.
    #[error("{0}")]
    Watcher(String),
}

/// The clock of a run over DDS.
pub struct ClockRunner {
    clock: LoopClock,
    tick_ns: u64,
    statuses: Receiver<LoopStatus>,
    nodes: Nodes,
    time: Writer,
    time_port: Port,
    told_tick: u64,
    digest: Digest,
    tap: Option<Tap>,
    made_at: Instant,
    orders: Receiver<Order>,
    control: Control,
    /// Whether anything keeps the run from being started again.
    reset_refusal: Box<dyn Fn() -> Option<ResetRefusal> + Send>,
    /// The run ends because it is to be started again.
    is_reset: bool,
    housekeeping: Housekeeping,
}

/// What people ask of the clock by its parameters. None of it changes a result.
enum Order {
    Speed(Speed),
    Pause(bool),
}

/// The parameter that says how fast simulated time may pass.
const SPEED: &str = "speed";
/// The largest speed that can be asked for; 0 asks for no limit.
const SPEED_MAX: f64 = 1000.0;
/// The parameter that stops simulated time.
const PAUSED: &str = "paused";

/// The clock's parameters.
fn parameters(clock: &LoopClock) -> Result<Store, RunError> {
    let speed = if let Speed::Paced(speed) = clock.speed() { speed.min(SPEED_MAX) } else { 0.0 };
    let mut declarations = own_parameters(true, None);
    let description = "Simulated seconds per wall second at most; 0: as fast as possible. It changes no result";
    let range = Range::Double { from: 0.0, to: SPEED_MAX, step: 0.0 };
    declarations.push(Declaration::new(SPEED, Value::Double(speed), description).range(range));
    let description = "Whether simulated time stands still. It changes no result";
    declarations.push(Declaration::new(PAUSED, Value::Bool(clock.is_paused()), description));
    Store::new(declarations).map_err(|error| RunError::Node(NodeError::new(error)))
}

/// How the clock reaches the nodes.
enum Nodes {
    Dds { grant: Box<LoopWriter>, _statuses: Box<Reader> },
    Here(Hub),
}

impl Nodes {
    fn grant(&self, grant: &LoopGrant) -> Result<(), RunError> {
        match self {
            Self::Dds { grant: writer, .. } => writer.send(grant),
            Self::Here(hub) => {
                hub.grant(grant);
                Ok(())
            }
        }
    }
}

/// What the clock itself publishes on the graph.
#[must_use]
pub fn clock_interface() -> Interface {
    Interface {
        ports: vec![Port {
            kind: PortKind::Publish,
            name: CLOCK.name_in(""),
            ros_type: ClockMessage::INFO.ros_type(),
            dds_types: vec![CLOCK.dds_type()],
            qos: CLOCK.qos(),
        }],
    }
}

/// Why a run ended, when the loop has broken: because a node is gone, if whoever watches them says so. Others then wait
/// for it or complain about it, sometimes before the watcher looks.
fn blame(end: RunEnd, watched: Result<(), String>) -> RunEnd {
    match (&end, watched) {
        // A node that said why it leaves has said more than that it has left.
        (RunEnd::Clock(ClockError::NodeFailed { node, .. }), Err(gone)) if gone.starts_with(node.as_str()) => end,
        (RunEnd::Clock(_) | RunEnd::Run(_), Err(gone)) => RunEnd::Watcher(gone),
        _ => end,
    }
}

impl ClockRunner {
    /// Opens the clock's end of the loop: over DDS, or in the hub of nodes that live in this process.
    ///
    /// # Errors
    /// [`RunError`] when DDS refuses an endpoint.
    pub fn open(
        participant: &Participant,
        contract: &LoopContract,
        hub: Option<&Hub>,
        clock: LoopClock,
        digest: Digest,
    ) -> Result<Self, RunError> {
        let (sender, statuses): (Sender<LoopStatus>, _) = channel();
        let nodes = match hub {
            Some(hub) => {
                hub.join_as_clock(sender);
                Nodes::Here(hub.clone())
            }
            None => {
                let grant = Box::new(LoopWriter::open::<LoopGrant>(participant, &contract.grant_topic())?);
                let statuses = read(participant, &contract.status_topic(), move |status: LoopStatus| {
                    // A closed inbox belongs to a clock that has stopped.
                    let _ = sender.send(status);
                })?;
                Nodes::Dds { grant, _statuses: Box::new(statuses) }
            }
        };
        let time_port = clock_interface().ports.remove(0);
        let (sender, orders) = channel();
        let accept = move |changes: &[(String, Value)]| {
            for (name, value) in changes {
                let order = match (name.as_str(), value) {
                    (SPEED, Value::Double(speed)) if *speed > 0.0 => Order::Speed(Speed::Paced(*speed)),
                    (SPEED, _) => Order::Speed(Speed::Max),
                    (PAUSED, Value::Bool(paused)) => Order::Pause(*paused),
                    _ => continue,
                };
                sender.send(order).map_err(|_| "the run is over".to_owned())?;
            }
            Ok(())
        };
        let now: TimeSource = Arc::new(crate::clock::wall_clock);
        let housekeeping = Housekeeping::open(participant, parameters(&clock)?, &now, accept)?;
        let control = Control::open(participant, clock.is_paused())?;
        Ok(Self {
            clock,
            tick_ns: contract.timing.tick_ns,
            statuses,
            nodes,
            time: participant.writer(&time_port.name, &time_port.dds_types[0], &time_port.qos)?,
            time_port,
            told_tick: 0,
            digest,
            tap: None,
            made_at: Instant::now(),
            orders,
            control,
            reset_refusal: Box::new(|| None),
            is_reset: false,
            housekeeping,
        })
    }

    /// Hands over `/clock` to the recorder that listens at `socket`.
    ///
    /// # Errors
    /// When none does.
    pub fn record_to(&mut self, socket: &Path, contract: &LoopContract) -> std::io::Result<()> {
        let interface = clock_interface();
        self.tap = Some(Tap::open(socket, contract.run_id, &self.time_port.name, &interface)?);
        Ok(())
    }

    /// Refuses to end the run so that it can be started again while `refusal` gives a reason.
    pub fn refuse_reset_for(&mut self, refusal: impl Fn() -> Option<ResetRefusal> + Send + 'static) {
        self.reset_refusal = Box::new(refusal);
    }

    /// Whether the run has ended because it is to be started again.
    #[must_use]
    pub fn is_reset(&self) -> bool {
        self.is_reset
    }

    /// How fast time may pass, and whether it stands still.
    #[must_use]
    pub fn pace(&self) -> (Speed, bool) {
        (self.clock.speed(), self.clock.is_paused())
    }

    /// When the first tick was granted.
    #[must_use]
    pub fn started_at(&self) -> Option<Instant> {
        self.clock.started_at().map(|since| self.made_at + since)
    }

    /// The tick every node has reached.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.clock.tick()
    }

    /// Runs until the end, asking `watch` about every 100 ms whether all is well. When `stop` is set the run ends
    /// cleanly at the next tick all nodes can reach.
    ///
    /// # Errors
    /// [`RunEnd`] naming the node at fault. The nodes are told to leave in any case.
    pub fn run(&mut self, stop: &AtomicBool, mut watch: impl FnMut(u64) -> Result<(), String>) -> Result<(), RunEnd> {
        let result = self.run_to_the_end(stop, &mut watch).map_err(|end| blame(end, watch(self.clock.tick())));
        self.control.close(self.clock.tick());
        if result.is_err() {
            let ended = LoopGrant { ended: true, ..self.clock.last_grant() };
            // The run has failed already; nodes that miss this leave when grants stop coming.
            let _ = self.nodes.grant(&ended);
        }
        self.control.settle();
        result
    }

    /// Leaves the digest of `/clock` and the recorder.
    ///
    /// # Errors
    /// When the file cannot be written, or the recorder is gone.
    pub fn finish(self) -> std::io::Result<()> {
        self.tap.map_or(Ok(()), Tap::finish).and(self.digest.finish())
    }

    fn run_to_the_end(
        &mut self,
        stop: &AtomicBool,
        watch: &mut impl FnMut(u64) -> Result<(), String>,
    ) -> Result<(), RunEnd> {
        let mut renewed_at = Instant::now();
        let mut warned_at = None;
        loop {
            match self.statuses.recv_timeout(POLL_PERIOD) {
                Ok(status) => self.clock.accept(&status, self.made_at.elapsed())?,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
            while let Ok(status) = self.statuses.try_recv() {
                self.clock.accept(&status, self.made_at.elapsed())?;
            }
            if stop.load(Ordering::Relaxed) {
                if self.clock.started_at().is_none() {
                    return Err(RunEnd::Watcher("stopped before the loop was up".to_owned()));
                }
                self.clock.end_early();
            }
            self.obey();
            self.tell_time().map_err(RunError::Record)?;
            let renew = renewed_at.elapsed() >= RENEW_PERIOD;
            if let Some(grant) = self.clock.grant(self.made_at.elapsed(), renew || self.clock.finished()) {
                self.nodes.grant(&grant)?;
                if grant.ended {
                    return Ok(());
                }
            }
            if renew {
                renewed_at = Instant::now();
                watch(self.clock.tick()).map_err(RunEnd::Watcher)?;
                let now = self.made_at.elapsed();
                self.clock.check(now, share_of_machine)?;
                warn_of_delay(&mut warned_at, self.clock.delay(now));
            }
        }
    }

    fn obey(&mut self) {
        for order in self.orders.try_iter() {
            let now = self.made_at.elapsed();
            match order {
                Order::Speed(speed) => self.clock.set_speed(speed, now),
                // How the next run begins is settled.
                Order::Pause(_) if self.is_reset => {}
                Order::Pause(paused) => self.clock.set_paused(paused, now),
            }
        }
        for wish in self.control.serve(&mut self.clock, &self.reset_refusal) {
            match wish {
                Wish::Pause(paused) => {
                    self.clock.set_paused(paused, self.made_at.elapsed());
                    if let Err(reason) = self.housekeeping.set(PAUSED, Value::Bool(paused)) {
                        tracing::warn!("{reason}");
                    }
                }
                Wish::Reset => {
                    self.is_reset = true;
                    self.clock.end_early();
                }
                Wish::End => self.clock.end_early(),
            }
        }
    }

    /// Publishes `/clock` for every tick that all nodes have reached.
    fn tell_time(&mut self) -> std::io::Result<()> {
        while self.told_tick < self.clock.tick() {
            self.told_tick += 1;
            let message = ClockMessage { clock: stamp_of_ns(self.told_tick * self.tick_ns) };
            let Ok(payload) = cdr::encode(&message) else { break };
            self.digest.add(&self.time_port, self.told_tick, &payload);
            if let Some(tap) = &mut self.tap {
                tap.add(0, self.told_tick, &payload)?;
                tap.complete_until(self.told_tick + 1)?;
            }
            if self.time.matched_readers() > 0 {
                // Best effort: a viewer that misses a tick sees the next.
                let _ = self.time.publish(payload);
            }
        }
        self.tap.as_mut().map_or(Ok(()), Tap::flush)
    }
}

/// Says now and then whom the run waits for: a busy machine, or a long piece of work, keeps it.
fn warn_of_delay(warned_at: &mut Option<Instant>, delay: Option<(Duration, String)>) {
    let Some((waited, whom)) = delay else { return };
    if warned_at.is_none_or(|warned_at| warned_at.elapsed() >= WARN_PERIOD) {
        *warned_at = Some(Instant::now());
        let waited_s = waited.as_secs_f64();
        tracing::warn!(
            "no progress for {waited_s:.1} s, still waiting: {whom}; it has much to do, or the machine is busy"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_dead_node_is_named_and_not_those_that_miss_it() {
        let failed = |node: &str| {
            RunEnd::Clock(ClockError::NodeFailed { node: node.to_owned(), message: "lost a bundle from /a".to_owned() })
        };
        let gone = || Err("/a is gone (signal: 9)".to_owned());
        assert_eq!(blame(failed("/b"), gone()).to_string(), "/a is gone (signal: 9)");
        assert!(blame(failed("/a"), gone()).to_string().starts_with("/a failed"));
        assert!(blame(failed("/b"), Ok(())).to_string().starts_with("/b failed"));
    }
}
