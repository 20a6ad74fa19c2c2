//! Reading scenario files, and `feeder check`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use feeder_scenario::{BUILT_IN, Scenario, ScenarioError};

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
pub fn load_taught(file: Option<&Path>) -> anyhow::Result<Scenario> {
    let scenario = load(file)?;
    scenario.taught_selector().with_context(|| named(file))?;
    Ok(scenario)
}

/// The scenario in `file`, or the built-in one.
pub fn load(file: Option<&Path>) -> anyhow::Result<Scenario> {
    load_with(file, Scenario::read)
}

/// The same without what the selector was taught.
pub fn load_untaught(file: Option<&Path>) -> anyhow::Result<Scenario> {
    load_with(file, Scenario::read_untaught)
}

type ReadFile<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>, String>;

fn load_with(
    file: Option<&Path>,
    parse: impl FnOnce(&str, ReadFile<'_>) -> Result<Scenario, ScenarioError>,
) -> anyhow::Result<Scenario> {
    let text = match file {
        Some(file) => std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?,
        None => BUILT_IN.to_owned(),
    };
    // What a scenario names lies beside it.
    let folder = file.and_then(Path::parent);
    let mut read = |name: &str| {
        let folder = folder.ok_or("the built-in scenario names no files")?;
        std::fs::read(folder.join(name)).map_err(|error| error.to_string())
    };
    parse(&text, &mut read).with_context(|| named(file))
}

fn named(file: Option<&Path>) -> String {
    file.map_or_else(|| "the built-in scenario".to_owned(), |file| file.display().to_string())
}
