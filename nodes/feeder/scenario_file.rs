//! Reading scenario files, and `feeder check`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use feeder_core::scenario::Scenario;

/// Check a scenario file and say what is wrong with it.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct CheckArgs {
    /// Scenario file (YAML)
    file: PathBuf,
}

/// Checks a file, including what only shows when the nodes are connected.
pub(crate) fn check(args: &CheckArgs) -> anyhow::Result<()> {
    let scenario = load_taught(Some(&args.file))?;
    let contract = crate::up::connect(&scenario).with_context(|| args.file.display().to_string())?;
    println!(
        "{}: ok, {} nodes, {} parts, {} stations, {} s",
        args.file.display(),
        contract.nodes.len(),
        scenario.parts_loaded,
        scenario.stations.len(),
        scenario.run.duration_s
    );
    Ok(())
}

/// The scenario in `file`, or the built-in one, if its part was taught: it can run.
pub(crate) fn load_taught(file: Option<&Path>) -> anyhow::Result<Scenario> {
    let scenario = load(file)?;
    scenario.taught_selector().with_context(|| named(file))?;
    Ok(scenario)
}

/// The scenario in `file`, or the built-in one.
pub(crate) fn load(file: Option<&Path>) -> anyhow::Result<Scenario> {
    let Some(file) = file else { return Ok(Scenario::default()) };
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    // What a scenario names lies beside it.
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut read = |name: &str| std::fs::read(folder.join(name)).map_err(|error| error.to_string());
    Scenario::read(&text, &mut read).with_context(|| named(Some(file)))
}

fn named(file: Option<&Path>) -> String {
    file.map_or_else(|| "the built-in scenario".to_owned(), |file| file.display().to_string())
}
