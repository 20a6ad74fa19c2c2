//! Why a scenario cannot run, and checks that several sections need.

use std::fmt;

/// Why a scenario cannot run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScenarioError {
    /// The text is not a scenario: an unknown key, a wrong type, a missing value.
    #[error("{0}")]
    Yaml(String),
    /// A value is out of its range, or does not go with others.
    #[error("{section}: {problem}")]
    Invalid {
        /// Top-level key.
        section: &'static str,
        /// Key, value and allowed range.
        problem: String,
    },
}

/// What YAML types are called where one is wrong, and what is allowed there.
const KINDS: [(&str, &str); 5] = [
    ("invalid u32", "not a whole number from 0 to 4294967295"),
    ("invalid u64", "not a whole number from 0 to 18446744073709551615"),
    ("invalid usize", "not a whole number of 0 or more"),
    ("invalid f64", "not a number"),
    ("invalid bool", "neither true nor false"),
];

/// What is wrong with a text: the place, the reason once, and the lines about it.
pub(crate) fn yaml_problem(error: &serde_saphyr::Error) -> String {
    let mut said = error.to_string();
    for (kind, allowed) in KINDS {
        said = said.replace(kind, allowed);
    }
    let mut lines = said.lines();
    let first = lines.next().unwrap_or_default();
    let mut problem = first.strip_prefix("error: ").unwrap_or(first).to_owned();
    for line in lines.filter(|line| !line.trim_start().starts_with("-->")) {
        // Under the wrong word the reason stands again.
        let pointer = line.trim_start().strip_prefix('|').is_some_and(|rest| rest.trim_start().starts_with('^'));
        let end = if pointer { line.find('^').map_or(line.len(), |at| at + 1) } else { line.len() };
        problem += "\n";
        problem += line[..end].trim_end();
    }
    problem
}

/// A complaint about a section.
pub(crate) fn invalid(section: &'static str, problem: &impl fmt::Display) -> ScenarioError {
    ScenarioError::Invalid { section, problem: problem.to_string() }
}

pub(crate) fn check_count(
    section: &'static str,
    key: &str,
    value: u64,
    min: u64,
    max: u64,
) -> Result<(), ScenarioError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    let problem = format!("{key} = {value} is outside its range: {min} to {max}");
    Err(ScenarioError::Invalid { section, problem })
}

/// ROS names: a letter, then letters, digits and underscores.
pub(crate) fn check_name(section: &'static str, name: &str) -> Result<(), ScenarioError> {
    let mut chars = name.chars();
    let starts = chars.next().is_some_and(|first| first.is_ascii_alphabetic());
    if starts && chars.all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Ok(());
    }
    let problem = format!("name {name:?} is no ROS name, allowed are a letter, then letters, digits and underscores");
    Err(ScenarioError::Invalid { section, problem })
}

/// Checks the time between a node's steps.
pub(crate) fn check_tick(tick_ms: u64) -> Result<(), ScenarioError> {
    check_count("time", "tick_ms", tick_ms, 1, 100)
}
