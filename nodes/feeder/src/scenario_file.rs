//! `feeder check`.

use std::path::PathBuf;

use anyhow::Context as _;
use feeder_scenario::plan::{DeliveryPlannerConfig, PartSimulatorConfig, load_plan};

/// Check a scenario file and say what is wrong with it.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct CheckArgs {
    /// Scenario file (YAML)
    file: PathBuf,
}

/// Checks a file, including what only shows when the nodes are connected.
pub(crate) fn check(args: &CheckArgs) -> anyhow::Result<()> {
    let plan = load_plan(Some(&args.file))?;
    let contract = crate::up::connect(&plan).with_context(|| args.file.display().to_string())?;
    println!(
        "{}: ok, {} nodes, {} parts, {} stations, {} s",
        args.file.display(),
        contract.nodes.len(),
        plan.of_kind::<PartSimulatorConfig>().map(|(_, config)| config.parts_loaded).sum::<u32>(),
        plan.of_kind::<DeliveryPlannerConfig>().next().map_or(0, |(_, config)| config.stations.len()),
        plan.run.duration_s
    );
    Ok(())
}
