//! Reading the files of a run: a scenario with what it names, or a plan that was written before.

use std::path::{Path, PathBuf};

use super::{NodeConfig, RunPlan};
use crate::{BUILT_IN, Scenario, ScenarioError};

/// Why a file gives no run.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error("cannot read {}: {problem}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        problem: std::io::Error,
    },
    /// What it holds cannot run.
    #[error("{name}: {problem}")]
    Invalid {
        /// The file, or what stands in for it.
        name: String,
        /// Key, value and allowed range.
        problem: ScenarioError,
    },
    /// Its run has no such node.
    #[error("{name}: the run has no {kind}{}; it has {known}", namespace.as_ref().map_or_else(String::new, |namespace| format!(" in {namespace}")))]
    NoNode {
        /// The file, or what stands in for it.
        name: String,
        /// The kind of node looked for.
        kind: &'static str,
        /// Where it was looked for, if not everywhere.
        namespace: Option<String>,
        /// The nodes of the run.
        known: String,
    },
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one at a time")]
pub enum Loaded {
    /// A scenario, and its text.
    Scenario(Scenario, String),
    /// A plan.
    Plan(RunPlan),
}

/// Reads what `file` holds, a scenario with the files it names or a plan; without a file the built-in scenario.
///
/// # Errors
/// A file that cannot be read, or what it says is wrong.
pub fn load(file: Option<&Path>) -> Result<Loaded, LoadError> {
    let text = read_text(file)?;
    if is_plan(&text) {
        return RunPlan::from_yaml(&text).map(Loaded::Plan).map_err(|problem| invalid(file, problem));
    }
    let scenario = Scenario::read(&text, &mut beside(file)).map_err(|problem| invalid(file, problem))?;
    Ok(Loaded::Scenario(scenario, text))
}

/// Reads the plan of the run that `file` describes.
///
/// # Errors
/// As [`load`], and a scenario that cannot run.
pub fn load_plan(file: Option<&Path>) -> Result<RunPlan, LoadError> {
    match load(file)? {
        Loaded::Plan(plan) => Ok(plan),
        Loaded::Scenario(scenario, text) => scenario.resolve(&text).map_err(|problem| invalid(file, problem)),
    }
}

/// Reads the configuration of a node, and the namespace it lives in: the one asked for, or that of the first of its kind.
///
/// # Errors
/// As [`load_plan`], and a run without such a node.
pub fn load_node<C: NodeConfig + Clone + 'static>(
    file: Option<&Path>,
    namespace: Option<&str>,
) -> Result<(String, C), LoadError> {
    let plan = load_plan(file)?;
    let found = plan.of_kind::<C>().find(|(lives_in, _)| namespace.is_none_or(|wanted| wanted == *lives_in));
    if let Some((lives_in, config)) = found {
        return Ok((lives_in.to_owned(), config.clone()));
    }
    let known = plan.nodes.iter().map(|planned| format!("{}/{}", planned.namespace, planned.node.kind()));
    Err(LoadError::NoNode {
        name: named(file),
        kind: C::KIND,
        namespace: namespace.map(str::to_owned),
        known: known.collect::<Vec<_>>().join(", "),
    })
}

/// Reads a scenario without what its selector was taught: that is about to be made anew.
///
/// # Errors
/// As [`load`].
pub fn load_untaught(file: Option<&Path>) -> Result<Scenario, LoadError> {
    let text = read_text(file)?;
    Scenario::read_untaught(&text, &mut beside(file)).map_err(|problem| invalid(file, problem))
}

/// Reads a scenario with `model` in place of what it says its selector was taught; without one, as it is.
///
/// # Errors
/// As [`load`], and a model that cannot be read or was taught another part.
pub fn load_with_model(file: Option<&Path>, model: Option<&Path>) -> Result<Scenario, LoadError> {
    let Some(model) = model else {
        let text = read_text(file)?;
        return Scenario::read(&text, &mut beside(file)).map_err(|problem| invalid(file, problem));
    };
    let mut scenario = load_untaught(file)?;
    let taught = std::fs::read_to_string(model);
    let taught = taught.map_err(|problem| LoadError::Read { file: model.to_owned(), problem })?;
    scenario.teach(&taught).map_err(|problem| invalid(Some(model), problem))?;
    Ok(scenario)
}

/// A plan begins with where it comes from, which no scenario says.
fn is_plan(text: &str) -> bool {
    text.lines().any(|line| line.starts_with("provenance:"))
}

fn read_text(file: Option<&Path>) -> Result<String, LoadError> {
    let Some(file) = file else { return Ok(BUILT_IN.to_owned()) };
    std::fs::read_to_string(file).map_err(|problem| LoadError::Read { file: file.to_owned(), problem })
}

/// Reads files that lie beside the scenario that names them.
fn beside(file: Option<&Path>) -> impl FnMut(&str) -> Result<Vec<u8>, String> {
    let folder = file.and_then(Path::parent).map(Path::to_owned);
    move |name| {
        let folder = folder.as_ref().ok_or("the built-in scenario names no files")?;
        std::fs::read(folder.join(name)).map_err(|error| error.to_string())
    }
}

fn invalid(file: Option<&Path>, problem: ScenarioError) -> LoadError {
    LoadError::Invalid { name: named(file), problem }
}

/// What to call the file, or what stands in for it.
#[must_use]
pub fn named(file: Option<&Path>) -> String {
    file.map_or_else(|| "the built-in scenario".to_owned(), |file| file.display().to_string())
}
