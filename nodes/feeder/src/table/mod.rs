//! The nodes this executable can be.

use feeder_runtime::launch::{Recorded, Seat, full_name, interface, parameters, replay, run_in_loop};
use feeder_runtime::lockstep::{LoopContract, RunError};
use feeder_runtime::node::{FeederNode, Interface, NodeError};
use feeder_runtime::parameters::Declaration;
use feeder_scenario::plan::{NodeConfig, PlannedNode, RunPlan, load_node};
use run_monitor::RunMonitor;

/// Runs a node of a run alone for so many ticks: what it hears, which topics are wanted, and where they go.
pub(crate) type Replay = fn(
    &LoopContract,
    &PlannedNode,
    u64,
    &mut dyn Iterator<Item = Recorded>,
    &dyn Fn(&str) -> bool,
    &mut dyn FnMut(Recorded),
) -> Result<(), NodeError>;

/// A kind of node, with its generics bound.
pub(crate) struct NodeEntry {
    /// Name of the node.
    pub(crate) name: &'static str,
    /// Its ports.
    pub(crate) interface: fn(&PlannedNode) -> Result<Interface, NodeError>,
    /// Its parameters.
    parameters: fn(&PlannedNode) -> Result<Vec<Declaration>, NodeError>,
    /// Runs it in a loop.
    pub(crate) run: fn(&Seat, &PlannedNode) -> Result<(), RunError>,
    /// Runs it alone on what a run recorded.
    pub(crate) replay: Replay,
    /// Runs its own command line, without the program's name.
    pub(crate) main: fn(Vec<std::ffi::OsString>) -> std::process::ExitCode,
}

/// The configuration of a planned node, which must be of this kind.
fn config<C: NodeConfig>(planned: &PlannedNode) -> Result<&C, NodeError> {
    C::of(&planned.node).ok_or_else(|| NodeError::new(format!("{} is no {}", name_of(planned), C::KIND)))
}

const fn entry<N: FeederNode<Config: NodeConfig>>() -> NodeEntry {
    NodeEntry {
        name: N::NAME,
        interface: |planned| interface::<N>(&planned.namespace, config(planned)?).map_err(NodeError::new),
        parameters: |planned| parameters::<N>(config(planned)?),
        run: |seat, planned| run_in_loop::<N>(seat, config(planned).map_err(RunError::Node)?),
        replay: |contract, planned, ticks, recorded, wanted, publish| {
            replay::<N>(contract, &planned.namespace, config(planned)?, ticks, recorded, wanted, publish)
        },
        main: |arguments| feeder_runtime::main_with::<N, _>(load_node, arguments),
    }
}

/// The parameters that a planned node declares, besides those that every node has.
///
/// # Errors
/// When its configuration cannot be written as JSON.
pub fn parameters_of(planned: &PlannedNode) -> Result<Vec<Declaration>, NodeError> {
    let monitor = entry::<RunMonitor>();
    let entry = NODES.iter().chain([&monitor]).find(|entry| entry.name == planned.node.kind());
    let entry = entry.ok_or_else(|| NodeError::new(format!("there is no kind of node {}", planned.node.kind())))?;
    (entry.parameters)(planned)
}

/// Full name of a planned node.
pub(crate) fn name_of(planned: &PlannedNode) -> String {
    full_name(&planned.namespace, planned.node.kind())
}

/// The nodes of a plan that this executable can be, each with its kind: all but the monitor, which `feeder up` itself is.
pub(crate) fn placed(plan: &RunPlan) -> impl Iterator<Item = (&'static NodeEntry, &PlannedNode)> {
    let entry = |planned: &PlannedNode| NODES.iter().find(|entry| entry.name == planned.node.kind());
    plan.nodes.iter().filter_map(move |planned| Some((entry(planned)?, planned)))
}

/// Every kind of node but the monitor.
pub(crate) const NODES: &[NodeEntry] = &[
    entry::<waveform_generator::WaveformGenerator>(),
    entry::<courier_driver::CourierDriver>(),
    entry::<part_simulator::PartSimulator>(),
    entry::<vision_selector::VisionSelector>(),
    entry::<delivery_planner::DeliveryPlanner>(),
    entry::<overhead_manipulator::OverheadManipulator>(),
    entry::<platen_arbiter::PlatenArbiter>(),
];

#[cfg(test)]
mod tests;
