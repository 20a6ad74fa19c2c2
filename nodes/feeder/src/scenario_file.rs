//! `feeder check`.

use std::path::PathBuf;

use anyhow::Context as _;
use feeder_scenario::Scenario;
use feeder_scenario::plan::{DeliveryPlannerConfig, PartSimulatorConfig, load_plan};

/// Check a scenario file and say what is wrong with it, or print what a scenario may hold.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct CheckArgs {
    /// Scenario file (YAML)
    #[arg(required_unless_present = "schema")]
    file: Option<PathBuf>,
    /// Print the JSON Schema of a scenario, with which editors check and complete one
    #[arg(long, conflicts_with = "file")]
    schema: bool,
}

/// Checks a file, including what only shows when the nodes are connected; or prints the schema.
pub(crate) fn check(args: &CheckArgs) -> anyhow::Result<()> {
    let Some(file) = &args.file else {
        println!("{}", serde_json::to_string_pretty(&schemars::schema_for!(Scenario))?);
        return Ok(());
    };
    let plan = load_plan(Some(file))?;
    let contract = crate::up::connect(&plan).with_context(|| file.display().to_string())?;
    println!(
        "{}: ok, {} nodes, {} parts, {} stations, {} s",
        file.display(),
        contract.nodes.len(),
        plan.of_kind::<PartSimulatorConfig>().map(|(_, config)| config.parts_loaded).sum::<u32>(),
        plan.of_kind::<DeliveryPlannerConfig>().next().map_or(0, |(_, config)| config.stations.len()),
        plan.run.duration_s
    );
    Ok(())
}
