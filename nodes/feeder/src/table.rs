//! The nodes this executable can be.

use std::sync::Arc;

use feeder_runtime::launch::{Recorded, Seat, full_name, interface, replay, run_in_loop};
use feeder_runtime::lockstep::{LoopContract, RunError};
use feeder_runtime::node::{FeederNode, Interface, NodeError, NotStated};
use feeder_scenario::Scenario;

/// Runs a node of a run in a namespace alone for so many ticks: what it hears, which topics are wanted, and where they go.
pub(crate) type Replay = fn(
    &LoopContract,
    &str,
    &Scenario,
    u64,
    &mut dyn Iterator<Item = Recorded>,
    &dyn Fn(&str) -> bool,
    &mut dyn FnMut(Recorded),
) -> Result<(), NodeError>;

/// A kind of node, with its generics bound.
pub(crate) struct NodeEntry {
    /// Name of the node.
    pub(crate) name: &'static str,
    /// The namespaces a scenario asks for one in.
    pub(crate) namespaces: fn(&Scenario) -> Vec<String>,
    /// Its ports.
    pub(crate) interface: fn(&str, &Scenario) -> Result<Interface, NotStated>,
    /// Runs it in a loop.
    pub(crate) run: fn(&Seat, &Scenario) -> Result<(), RunError>,
    /// Runs it alone on what a run recorded.
    pub(crate) replay: Replay,
    /// Runs its own command line, without the program's name.
    pub(crate) main: fn(Vec<std::ffi::OsString>) -> std::process::ExitCode,
}

const fn entry<N: FeederNode<Config = Scenario>>() -> NodeEntry {
    NodeEntry {
        name: N::NAME,
        namespaces: N::namespaces,
        interface: interface::<N>,
        run: run_in_loop::<N>,
        replay: replay::<N>,
        main: feeder_runtime::main_with::<N>,
    }
}

/// A node of a run: what it is, where it lives, and the scenario as the feeder it belongs to sees it.
pub(crate) struct Placed {
    pub(crate) entry: &'static NodeEntry,
    pub(crate) namespace: String,
    pub(crate) scenario: Arc<Scenario>,
}

impl Placed {
    pub(crate) fn full_name(&self) -> String {
        full_name(&self.namespace, self.entry.name)
    }
}

/// All nodes that a scenario asks for. What belongs to no feeder alone goes with the first.
pub(crate) fn placed(scenario: &Scenario) -> Vec<Placed> {
    let feeders: Vec<Arc<Scenario>> = scenario.of_each_feeder().into_iter().map(Arc::new).collect();
    let mut placed: Vec<Placed> = Vec::new();
    for entry in NODES {
        for scenario in &feeders {
            for namespace in (entry.namespaces)(scenario) {
                if !placed.iter().any(|other| other.entry.name == entry.name && other.namespace == namespace) {
                    placed.push(Placed { entry, namespace, scenario: Arc::clone(scenario) });
                }
            }
        }
    }
    placed
}

/// Every node a scenario runs, in the order in which they are listed and started.
pub(crate) const NODES: &[NodeEntry] = &[
    entry::<waveform_generator::WaveformGenerator>(),
    entry::<courier_driver::CourierDriver>(),
    entry::<part_simulator::PartSimulator>(),
    entry::<vision_selector::VisionSelector>(),
    entry::<delivery_planner::DeliveryPlanner>(),
    entry::<overhead_manipulator::OverheadManipulator>(),
    entry::<platen_arbiter::PlatenArbiter>(),
];
