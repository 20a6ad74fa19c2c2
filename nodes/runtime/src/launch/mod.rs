//! Starts nodes: in a loop, against the wall clock, or on what a run recorded; from a table of all nodes, or from a node's own executable.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

mod replay;

use bytes::Bytes;
use minifactory_msgs::interface::standard::CLOCK;

use crate::args::{NameKind, RosArgs};
use crate::clock::TimeSource;
use crate::configuration::{Configuration, declarations_of};
use crate::dds::{Domain, NodeName, Participant};
use crate::digest::Digest;
use crate::housekeeping::{AUTOSTART, Housekeeping, USE_SIM_TIME, apply_own, own_parameters, reconfiguring};
use crate::lockstep::{DdsLinks, Hub, Links, LoopContract, RunError, Runner};
use crate::node::{
    Arrival, Declare, FeederNode, Interface, Managed, NodeError, NotStated, Output, PortKind, Start, StepIo,
    stamp_of_ns,
};
use crate::parameters::{Declaration, Value};
use crate::public::PublicSide;
use crate::recording::Tap;
use crate::wall_clock::{self, Pace, Time};

/// Full name of the node `name` in `namespace`.
#[must_use]
pub fn full_name(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

/// What a node needs to take its place in a loop.
#[derive(Clone, Debug)]
pub struct Seat {
    /// The loop.
    pub contract: Arc<LoopContract>,
    /// The namespace the node lives in.
    pub namespace: String,
    /// The DDS domain.
    pub domain: Domain,
    /// Where the others are, when all nodes of the loop live in this process; else they are found over DDS. What the
    /// node publishes goes out over DDS either way.
    pub hub: Option<Hub>,
    /// Where to leave the digest, if one is wanted.
    pub digest_dir: Option<PathBuf>,
    /// The socket of the run's recorder, if it is recorded.
    pub record_to: Option<PathBuf>,
    /// Set to leave before the run ends.
    pub stop: Arc<AtomicBool>,
}

/// The ports of node `N` in `namespace`.
///
/// # Errors
/// When a port is not stated for this node.
pub fn interface<N: FeederNode>(namespace: &str, config: &N::Config) -> Result<Interface, NotStated> {
    let mut declare = Declare::new(N::NAME, namespace);
    let _ = Managed::<N>::declare(&mut declare, config);
    declare.finish()
}

/// The parameters that node `N` declares of its configuration, besides those that every node has.
///
/// # Errors
/// When the configuration cannot be written as JSON.
pub fn parameters<N: FeederNode>(config: &N::Config) -> Result<Vec<Declaration>, NodeError> {
    declarations_of(config, N::settable(), N::not_parameters())
}

/// Runs node `N` in a loop until the run ends.
///
/// # Errors
/// [`RunError`] when the node, the loop or DDS fails. The clock is told.
pub fn run_in_loop<N: FeederNode>(seat: &Seat, config: &N::Config) -> Result<(), RunError> {
    let (wanted, given) = (N::tick(config), Duration::from_nanos(seat.contract.timing.tick_ns));
    if wanted != given {
        let reason = format!("the run's tick is {given:?}, but the configuration says {wanted:?}");
        return Err(RunError::Node(NodeError::new(reason)));
    }
    let mut declare = Declare::new(N::NAME, &seat.namespace);
    let ports = Managed::<N>::declare(&mut declare, config);
    let interface = declare.finish().map_err(|error| RunError::Node(NodeError::new(error)))?;
    let node = Managed::<N>::open(ports, config).map_err(RunError::Node)?;
    run_opened(seat, node, N::NAME, config, interface)
}

/// Runs a node that its caller has opened, under a name of its own; see [`run_in_loop`].
///
/// # Errors
/// As [`run_in_loop`].
pub fn run_opened<N: FeederNode>(
    seat: &Seat,
    node: N,
    name: &str,
    config: &N::Config,
    interface: Interface,
) -> Result<(), RunError> {
    let full_name = full_name(&seat.namespace, name);
    let participant = Participant::secluded(&seat.domain, &NodeName::new(&seat.namespace, name)?)?;
    let now_ns = Arc::new(AtomicU64::new(0));
    let clock: TimeSource = Arc::new({
        let now_ns = Arc::clone(&now_ns);
        move || stamp_of_ns(now_ns.load(Ordering::Relaxed))
    });
    let configuration = Configuration::new(
        config,
        N::check,
        N::settable(),
        N::not_parameters(),
        own_parameters(true, N::START.map(|_| true)),
        &BTreeMap::new(),
    );
    let configuration = configuration.map_err(RunError::Node)?;
    let (reconfigure, reconfigured) = channel();
    let accept = reconfiguring(&configuration, reconfigure);
    let _housekeeping = Housekeeping::open(&participant, configuration.store, &clock, accept)?;
    // What this thread logs is this node's, also where several share a process.
    let _span = tracing::info_span!("node", node = %participant.node()).entered();
    let (sender, inbox) = channel();
    let links: Box<dyn Links> = match &seat.hub {
        Some(hub) => Box::new(hub.join(&seat.contract, &full_name, sender.clone())),
        None => Box::new(DdsLinks::open(&participant, &seat.contract, &full_name, &sender)?),
    };
    let public = PublicSide::open(&participant, &interface, &sender)?;
    participant.meet_others();
    let digest = Digest::new(seat.digest_dir.as_deref(), &full_name, &seat.contract.shared_topics);
    let tap = seat.record_to.as_deref().map(|socket| Tap::open(socket, seat.contract.run_id, &full_name, &interface));
    let tap = tap.transpose().map_err(RunError::Record)?;
    Runner::new(node, full_name, interface, &seat.contract, links, Some(public), digest)?
        .timed(now_ns)
        .recorded(tap)
        .reconfigured_by(reconfigured)
        .counted_by(participant.counter("messages", "samples that are not of their type"))
        .run(&inbox, &seat.stop)
}

/// A message of a recorded run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Its topic.
    pub topic: String,
    /// The tick in which it was published.
    pub tick: u64,
    /// Its CDR body, little endian.
    pub payload: Bytes,
}

/// Runs node `N` alone on what a run recorded: the node gets in each of `ticks` ticks what it got then, and what it
/// publishes on topics that are `wanted` goes to `publish`.
///
/// # Errors
/// When the node fails, when it is not in the `contract`, and when it talks to others by services or by topics of
/// several publishers: what was recorded does not tell who sent what when. It is active throughout.
pub fn replay<N: FeederNode>(
    contract: &LoopContract,
    namespace: &str,
    config: &N::Config,
    ticks: u64,
    recorded: &mut dyn Iterator<Item = Recorded>,
    wanted: &dyn Fn(&str) -> bool,
    publish: &mut dyn FnMut(Recorded),
) -> Result<(), NodeError> {
    let name = full_name(namespace, N::NAME);
    let mut declare = Declare::new(N::NAME, namespace);
    let ports = Managed::<N>::declare(&mut declare, config);
    let interface = declare.finish().map_err(NodeError::new)?;
    let delays = replay::delays(contract, &name, &interface)?;
    let mut node = Managed::<N>::open(ports, config)?;
    let mut io = StepIo::new(interface.ports.len(), contract.timing.tick_ns);
    for (port, declared) in interface.ports.iter().enumerate() {
        io.note_wanted(port, declared.kind == PortKind::Publish && wanted(&declared.name));
    }
    let mut inputs = replay::Inputs::new(delays, recorded);
    for tick in 0..ticks {
        io.begin(tick, tick * contract.timing.tick_ns);
        for (port, payload) in inputs.due(tick) {
            io.arrive(port, Arrival::Message { payload, little_endian: true });
        }
        node.step(&mut io)?;
        io.end();
        for output in std::mem::take(&mut io.outputs) {
            if let Output::Message { port, payload } = output {
                publish(Recorded { topic: interface.ports[port].name.clone(), tick, payload });
            }
        }
    }
    Ok(())
}

/// Runs node `N` against the wall clock until `stop` is set. Stamps are wall time since 1970, as is usual in ROS.
///
/// # Errors
/// [`RunError`] when the node or DDS fails.
pub fn run_real<N: FeederNode>(
    domain: &Domain,
    namespace: &str,
    config: &N::Config,
    stop: &AtomicBool,
) -> Result<(), RunError> {
    run_remapped::<N>(domain, namespace, &RosArgs::default(), config, stop)
}

/// As [`run_real`], under the names and with the parameters that ROS arguments give the node, its topics and services.
///
/// # Errors
/// As [`run_real`], and when a name or a parameter makes no sense.
pub fn run_remapped<N: FeederNode>(
    domain: &Domain,
    namespace: &str,
    ros: &RosArgs,
    config: &N::Config,
    stop: &AtomicBool,
) -> Result<(), RunError> {
    let name = ros.node_name(&NodeName::new(namespace, N::NAME)?)?;
    let given = ros.parameters(&name);
    let (settable, own) = (N::settable(), own_parameters(false, N::START.map(|start| start == Start::Active)));
    let configuration = Configuration::new(config, N::check, settable, N::not_parameters(), own, &given);
    let configuration = configuration.map_err(RunError::Node)?;
    apply_own(&configuration.store).map_err(RunError::Node)?;
    let config = configuration.config.clone();
    let mut declare = Declare::new(N::NAME, name.namespace());
    let ports = Managed::<N>::declare(&mut declare, &config);
    let mut interface = declare.finish().map_err(|error| RunError::Node(NodeError::new(error)))?;
    for port in &mut interface.ports {
        let kind = match port.kind {
            PortKind::Publish | PortKind::Subscribe(_) => NameKind::Topic,
            PortKind::Serve | PortKind::Call(_) => NameKind::Service,
        };
        port.name = ros.resolve(&name, &port.name, kind)?;
    }
    let autostart = configuration.store.get(AUTOSTART) == Some(&Value::Bool(true));
    let node = Managed::<N>::open(ports, &config).map_err(RunError::Node)?.autostart(autostart);
    let participant = Participant::secluded(domain, &name)?;
    let time = match configuration.store.get(USE_SIM_TIME) {
        Some(Value::Bool(true)) => {
            Time::simulated(&participant, &ros.resolve(&name, &CLOCK.name_in(""), NameKind::Topic)?)?
        }
        _ => Time::Wall,
    };
    let (reconfigure, reconfigured) = channel();
    let accept = reconfiguring(&configuration, reconfigure);
    let _housekeeping = Housekeeping::open(&participant, configuration.store, &time.clock(), accept)?;
    let tick = N::tick(&config);
    wall_clock::run(&participant, node, &interface, &Pace { time, tick, stop }, &reconfigured)
}
