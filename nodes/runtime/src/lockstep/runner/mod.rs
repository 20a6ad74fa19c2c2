//! Runs one node in the loop: receives bundles and grants, steps, sends. The only place where the loop meets threads.

use std::os::unix::process::parent_id;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use minifactory_msgs::msg::{LoopBundle, LoopGrant, LoopStatus};

use super::contract::LoopContract;
use super::engine::{Blocked, Engine, LoopError};
use super::routing::{Carries, Routing};
use crate::dds::Counter;
use crate::digest::Digest;
use crate::node::{
    Arrival, Asker, AskerInner, FeederNode, Interface, NodeError, Output, StepIo, split_call, with_call,
};
use crate::patience::{Patience, share_of_machine};
use crate::public::PublicSide;
use crate::recording::Tap;

/// Between probes while the loop comes up.
const PROBE_PERIOD: Duration = Duration::from_millis(20);
/// Between statuses while a node is blocked.
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);
/// A node that hears no grant for so much longer than the clock would wait for it, as [`Patience`] counts it, has lost its
/// clock.
const CLOCK_MARGIN: Duration = Duration::from_secs(2);
/// The same when the process that started this one is gone as well: it was the clock's, as a rule.
const ORPHAN_LIMIT: Duration = Duration::from_secs(1);
/// The same before the first grant: the clock waits for all nodes, and gives up sooner than this.
const START_LIMIT: Duration = Duration::from_secs(60);
/// A node that fails waits this long for the clock to take note.
const LAST_WORD_LIMIT: Duration = Duration::from_secs(1);
/// Steps between looks at the inbox while a node runs ahead.
const STEPS_PER_LOOK: usize = 8;

/// What arrives at a node of the loop.
#[derive(Debug)]
pub(crate) enum Incoming {
    /// A bundle on the edge with this index in the contract.
    Bundle(usize, LoopBundle),
    /// A grant of the clock.
    Grant(LoopGrant),
    /// Something from outside the loop for this port.
    Outside(usize, Arrival),
}

/// How a node of the loop reaches the others.
pub(crate) trait Links: Send {
    /// Sends a bundle on the edge with this index in the contract.
    fn send_bundle(&mut self, edge: usize, bundle: LoopBundle) -> Result<(), RunError>;
    /// Tells the clock how things stand.
    fn send_status(&mut self, status: LoopStatus) -> Result<(), RunError>;
}

impl Links for Box<dyn Links> {
    fn send_bundle(&mut self, edge: usize, bundle: LoopBundle) -> Result<(), RunError> {
        (**self).send_bundle(edge, bundle)
    }

    fn send_status(&mut self, status: LoopStatus) -> Result<(), RunError> {
        (**self).send_status(status)
    }
}

/// Why a node left the loop.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The stream of inputs broke.
    #[error(transparent)]
    Loop(#[from] LoopError),
    /// The node itself failed.
    #[error("{0}")]
    Node(#[source] NodeError),
    /// Nothing was heard of the clock.
    #[error("no word from the clock for {after:?}; the run is over")]
    ClockLost {
        /// How long the node has waited.
        after: Duration,
    },
    /// Asked to stop before the run ended.
    #[error("stopped by a signal at tick {tick}")]
    Stopped {
        /// The next tick it would have run.
        tick: u64,
    },
    /// A message could not be sent.
    #[error("cannot send to {topic}: {reason}")]
    Send {
        /// The topic.
        topic: String,
        /// Why not.
        reason: String,
    },
    /// The digest could not be kept.
    #[error("cannot keep the digest: {0}")]
    Digest(#[from] std::io::Error),
    /// The run's recorder is gone.
    #[error("cannot hand over to the recorder: {0}")]
    Record(#[source] std::io::Error),
    /// The middleware refused.
    #[error(transparent)]
    Dds(#[from] crate::dds::DdsError),
}

/// A node in the loop, ready to run.
pub(crate) struct Runner<N: FeederNode, L> {
    node: N,
    name: String,
    run_id: u64,
    tick_ns: u64,
    interface: Interface,
    engine: Engine,
    routing: Routing,
    io: StepIo,
    links: L,
    public: Option<PublicSide>,
    digest: Digest,
    tap: Option<Tap>,
    status_period_ticks: u64,
    clock_limit: Duration,
    goal_tick: u64,
    made_at: Instant,
    /// The process that started this one.
    parent: u32,
    said_at: Instant,
    /// The wait for the clock's next word.
    patience: Patience,
    started: bool,
    now_ns: Arc<AtomicU64>,
    reconfigured: Option<Receiver<N::Config>>,
    /// Whether something has come from outside the loop since the node last attended to it.
    has_visitors: bool,
}

impl<N: FeederNode, L: Links> Runner<N, L> {
    pub(crate) fn new(
        node: N,
        name: String,
        interface: Interface,
        contract: &LoopContract,
        links: L,
        public: Option<PublicSide>,
        digest: Digest,
    ) -> Result<Self, LoopError> {
        let engine = Engine::new(contract, &name)?;
        let routing = Routing::new(&name, &interface, &engine, contract)?;
        Ok(Self {
            node,
            name,
            run_id: contract.run_id,
            tick_ns: contract.timing.tick_ns,
            io: StepIo::new(interface.ports.len(), contract.timing.tick_ns),
            interface,
            engine,
            routing,
            links,
            public,
            digest,
            tap: None,
            clock_limit: Duration::from_secs(contract.patience_s.into()) + CLOCK_MARGIN,
            status_period_ticks: (contract.timing.window_ticks / 2).max(1),
            goal_tick: LoopStatus::NO_GOAL,
            now_ns: Arc::default(),
            reconfigured: None,
            has_visitors: false,
            made_at: Instant::now(),
            parent: parent_id(),
            said_at: Instant::now(),
            patience: Patience::default(),
            started: false,
        })
    }

    /// Keeps the present, ns since the start of the run, where others can read it.
    pub(crate) fn timed(self, now_ns: Arc<AtomicU64>) -> Self {
        Self { now_ns, ..self }
    }

    /// Hands over what the node publishes to the run's recorder.
    pub(crate) fn recorded(self, tap: Option<Tap>) -> Self {
        Self { tap, ..self }
    }

    /// Takes over configurations that come, each before the next step.
    pub(crate) fn reconfigured_by(self, configurations: Receiver<N::Config>) -> Self {
        Self { reconfigured: Some(configurations), ..self }
    }

    /// Counts what cannot be decoded.
    pub(crate) fn counted_by(self, undecodable: Arc<Counter>) -> Self {
        Self { io: self.io.counted_by(undecodable), ..self }
    }

    /// Runs until the clock ends the run, and tells the clock about any failure.
    pub(crate) fn run(mut self, inbox: &Receiver<Incoming>, stop: &Arc<AtomicBool>) -> Result<(), RunError> {
        let result = self.run_to_the_end(inbox, stop);
        let told = self.say_last_word(inbox, result.as_ref().err());
        self.digest.finish()?;
        let recorded = self.tap.map_or(Ok(()), Tap::finish).map_err(RunError::Record);
        result.and(told).and(recorded)
    }

    /// Tells the clock that the node leaves, and why. What a participant sends and does not stay for may get lost, so
    /// a failure is told until the clock answers it by the end of the run.
    fn say_last_word(&mut self, inbox: &Receiver<Incoming>, error: Option<&RunError>) -> Result<(), RunError> {
        let message = error.map(ToString::to_string).unwrap_or_default();
        let last_word = LoopStatus { error: message, finished: true, ..self.status() };
        let answered = !matches!(error, None | Some(RunError::ClockLost { .. }));
        let since = Instant::now();
        loop {
            self.links.send_status(last_word.clone())?;
            let again_at = Instant::now() + HEARTBEAT_PERIOD;
            loop {
                if !answered || self.engine.ended() || since.elapsed() > LAST_WORD_LIMIT {
                    return Ok(());
                }
                match inbox.recv_timeout(again_at.saturating_duration_since(Instant::now())) {
                    Ok(Incoming::Grant(grant)) => self.engine.accept_grant(&grant),
                    Ok(_) => {}
                    Err(RecvTimeoutError::Timeout) => break,
                    Err(RecvTimeoutError::Disconnected) => return Ok(()),
                }
            }
        }
    }

    fn run_to_the_end(&mut self, inbox: &Receiver<Incoming>, stop: &Arc<AtomicBool>) -> Result<(), RunError> {
        loop {
            if stop.load(Ordering::Relaxed) {
                return Err(RunError::Stopped { tick: self.engine.next_tick() });
            }
            while let Ok(incoming) = inbox.try_recv() {
                self.accept(incoming)?;
            }
            if self.engine.ended() {
                return Ok(());
            }
            self.step_while_possible()?;
            if self.engine.blocked().is_none() {
                continue;
            }
            self.attend()?;
            self.flush()?;
            let (period, limit) =
                if self.started { (HEARTBEAT_PERIOD, self.clock_limit) } else { (PROBE_PERIOD, START_LIMIT) };
            if self.said_at.elapsed() >= period {
                if !self.started {
                    for (edge, probe) in self.engine.probes() {
                        self.links.send_bundle(edge, probe)?;
                    }
                }
                self.tell_clock()?;
            }
            let now = self.made_at.elapsed();
            let limit = if parent_id() == self.parent { limit } else { ORPHAN_LIMIT };
            if self.patience.spent(now, share_of_machine) > limit {
                return Err(RunError::ClockLost { after: self.patience.waited(now) });
            }
            match inbox.recv_timeout(period.saturating_sub(self.said_at.elapsed())) {
                Ok(incoming) => self.accept(incoming)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(RunError::ClockLost { after: Duration::ZERO }),
            }
        }
    }

    fn accept(&mut self, incoming: Incoming) -> Result<(), RunError> {
        match incoming {
            Incoming::Bundle(edge, bundle) => self.engine.accept_bundle(edge, bundle)?,
            Incoming::Grant(grant) => {
                if grant.run_id == self.run_id {
                    self.started = true;
                    self.patience = Patience::since(self.made_at.elapsed());
                }
                self.engine.accept_grant(&grant);
            }
            Incoming::Outside(port, arrival) => {
                self.has_visitors = true;
                self.io.arrive(port, arrival);
            }
        }
        Ok(())
    }

    fn tell_clock(&mut self) -> Result<(), RunError> {
        self.said_at = Instant::now();
        self.links.send_status(self.status())
    }

    fn step_while_possible(&mut self) -> Result<(), RunError> {
        for _ in 0..STEPS_PER_LOOK {
            if self.engine.blocked().is_some() {
                break;
            }
            self.step()?;
            let tick = self.engine.next_tick();
            let at_the_limit = matches!(self.engine.blocked(), Some(Blocked::Grant | Blocked::Ended));
            self.flush()?;
            let due = tick.is_multiple_of(self.status_period_ticks) || tick.checked_sub(1) == Some(self.goal_tick);
            // A node whose steps are slow is alive all the same.
            if due || at_the_limit || self.said_at.elapsed() >= HEARTBEAT_PERIOD {
                self.tell_clock()?;
            }
        }
        Ok(())
    }

    /// Lets the node answer, between two ticks, those who ask from outside the loop.
    fn attend(&mut self) -> Result<(), RunError> {
        if self.started && std::mem::take(&mut self.has_visitors) {
            let tick = self.engine.next_tick();
            self.io.begin(tick, tick * self.tick_ns);
            self.node.attend(&mut self.io);
            self.send_outputs(tick)?;
        }
        Ok(())
    }

    fn send_outputs(&mut self, tick: u64) -> Result<(), RunError> {
        std::mem::take(&mut self.io.outputs).into_iter().try_for_each(|output| self.send(tick, output))
    }

    fn step(&mut self) -> Result<(), RunError> {
        let tick = self.engine.next_tick();
        self.io.begin(tick, tick * self.tick_ns);
        self.now_ns.store(self.io.now_ns(), Ordering::Relaxed);
        for config in self.reconfigured.iter().flat_map(Receiver::try_iter) {
            self.node.reconfigure(&config);
        }
        self.note_what_is_wanted();
        let inputs = self.engine.inputs();
        if Engine::has_much_to_do(&inputs) {
            self.send_bundles(Engine::take_complete)?;
        }
        for input in inputs {
            let (port, carries) = self.routing.arrivals[input.edge][usize::from(input.port)];
            let arrival = match carries {
                Carries::Message => Arrival::Message { payload: input.payload, little_endian: true },
                Carries::Request | Carries::Reply => {
                    let Some((call, payload)) = split_call(&input.payload) else { continue };
                    if matches!(carries, Carries::Reply) {
                        Arrival::Reply { payload, little_endian: true, call }
                    } else {
                        let asker = Asker(AskerInner::Loop { edge: input.edge, call: call.0 });
                        Arrival::Request { payload, little_endian: true, asker }
                    }
                }
            };
            self.io.arrive(port, arrival);
        }
        self.node.step(&mut self.io).map_err(RunError::Node)?;
        self.io.end();
        self.send_outputs(tick)?;
        if self.io.goal_reached && self.goal_tick == LoopStatus::NO_GOAL {
            self.goal_tick = tick;
        }
        self.engine.finish_tick();
        if let Some(tap) = &mut self.tap {
            tap.complete_until(tick + 1).map_err(RunError::Record)?;
        }
        Ok(())
    }

    /// What nobody hears need not be made; the digest wants it all the same.
    fn note_what_is_wanted(&mut self) {
        for port in 0..self.interface.ports.len() {
            let wanted = !self.routing.sends[port].is_empty()
                || self.digest.active()
                || self.tap.as_ref().is_some_and(|tap| tap.wants(port))
                || self.public.as_ref().is_some_and(|public| public.is_heard(port));
            self.io.note_wanted(port, wanted);
        }
    }

    fn send(&mut self, tick: u64, output: Output) -> Result<(), RunError> {
        match output {
            Output::Message { port, payload } => {
                for &route in &self.routing.sends[port] {
                    self.engine.send(route, &payload)?;
                }
                self.digest.add(&self.interface.ports[port], tick, &payload);
                if let Some(tap) = &mut self.tap {
                    tap.add(port, tick, &payload).map_err(RunError::Record)?;
                }
                if let Some(public) = &mut self.public {
                    public.publish(port, payload);
                }
            }
            Output::Request { port, call, payload } => {
                let payload = with_call(call, &payload);
                for &route in &self.routing.sends[port] {
                    self.engine.send(route, &payload)?;
                }
            }
            Output::Reply { port, asker, payload } => match asker.0 {
                AskerInner::Loop { edge, call } => {
                    if let Some(route) = self.routing.replies[edge][port] {
                        self.engine.send(route, &with_call(crate::node::CallId(call), &payload))?;
                    }
                }
                AskerInner::Graph(handle) => handle.send(payload),
            },
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RunError> {
        if self.engine.blocked().is_some()
            && let Some(tap) = &mut self.tap
        {
            tap.flush().map_err(RunError::Record)?;
        }
        self.send_bundles(Engine::take_bundles)
    }

    fn send_bundles(&mut self, take: impl FnOnce(&mut Engine) -> Vec<(usize, LoopBundle)>) -> Result<(), RunError> {
        take(&mut self.engine).into_iter().try_for_each(|(edge, bundle)| self.links.send_bundle(edge, bundle))
    }

    fn status(&self) -> LoopStatus {
        let waiting_for = match self.engine.blocked() {
            None => String::new(),
            Some(Blocked::Grant) if !self.engine.wired() => "its inputs".to_owned(),
            Some(Blocked::Grant) => "the clock".to_owned(),
            Some(Blocked::Input(from)) => from.to_owned(),
            Some(Blocked::Ended) => "the end".to_owned(),
        };
        LoopStatus {
            run_id: self.run_id,
            node: self.name.clone(),
            tick: self.engine.next_tick(),
            wired: self.engine.wired(),
            goal_tick: self.goal_tick,
            waiting_for,
            ..LoopStatus::default()
        }
    }
}

#[cfg(test)]
mod tests;
