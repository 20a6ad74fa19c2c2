//! The page, and the file of what was seen.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

use super::{Row, Section, sections};

const INTRODUCTION: &str = "# Results

Every figure with the command that gives it, as it was seen when it was last measured, good or bad. Machines are shared, so ratios
tell more than times. Figures of the selector hold for pictures of our own renderer; for pictures of another one see [how it
decides](concepts/vision.md). Figures on motors that the courier was not made for are in [the learning
courier](concepts/learning_control.md).

`feeder-lab results`, in a clone, with `feeder` and `feeder-lab` on the `PATH`, measures them anew and writes this page; `--only ROW`
measures one. `cargo test --workspace` measures the quick ones and compares.
";

/// What was seen of all rows, by their names.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Seen(BTreeMap<String, SeenRow>);

/// What was seen of a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SeenRow {
    pub(super) figures: BTreeMap<String, String>,
    /// Commit that was measured.
    pub(super) at: String,
    /// Machine that it was measured on.
    pub(super) on: String,
}

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    row: String,
    figure: String,
    value: String,
    commit: String,
    machine: String,
}

impl Seen {
    pub(super) fn read(file: &Path) -> Result<Self> {
        let mut seen = Self::default();
        let mut reader = csv::Reader::from_path(file).with_context(|| file.display().to_string())?;
        for line in reader.deserialize() {
            let Line { row, figure, value, commit, machine } = line.with_context(|| file.display().to_string())?;
            let entry = seen.0.entry(row).or_default();
            (entry.at, entry.on) = (commit, machine);
            entry.figures.insert(figure, value);
        }
        Ok(seen)
    }

    pub(super) fn write(&self, file: &Path) -> Result<()> {
        let mut writer = csv::Writer::from_path(file).with_context(|| file.display().to_string())?;
        for (row, seen) in &self.0 {
            for (figure, value) in &seen.figures {
                let (row, figure, value) = (row.clone(), figure.clone(), value.clone());
                writer.serialize(Line { row, figure, value, commit: seen.at.clone(), machine: seen.on.clone() })?;
            }
        }
        Ok(writer.flush()?)
    }

    pub(super) fn row(&self, name: &str) -> Option<&SeenRow> {
        self.0.get(name)
    }

    pub(super) fn set(&mut self, name: &str, row: SeenRow) {
        self.0.insert(name.to_owned(), row);
    }
}

/// The page of results of the clone in a folder, made of the rows and of what was seen.
///
/// # Errors
/// A file that is missing or makes no sense.
pub fn page(clone: &Path) -> Result<String> {
    let seen = Seen::read(&clone.join("docs/results.csv"))?;
    let sections = sections()?;
    let machines: BTreeSet<&str> = seen.0.values().map(|row| row.on.as_str()).collect();
    let mut page = INTRODUCTION.to_owned();
    if !machines.is_empty() {
        writeln!(page, "\nMeasured on: {}.", machines.into_iter().collect::<Vec<_>>().join("; "))?;
    }
    for Section { title, rows, after } in &sections {
        writeln!(page, "\n## {title}\n\n| What | Seen | Commit | Command |\n|---|---|---|---|")?;
        for row in rows {
            writeln!(page, "{}", line(row, seen.row(&row.name)))?;
        }
        if !after.is_empty() {
            write!(page, "\n{after}")?;
        }
    }
    Ok(page)
}

fn line(row: &Row, seen: Option<&SeenRow>) -> String {
    let command = |command: &String| {
        if command.contains('`') { command.clone() } else { format!("`{}`", command.replace('|', "\\|")) }
    };
    let commands = row.commands.iter().map(command).collect::<Vec<_>>().join(", ");
    let (shown, at) = match seen {
        _ if row.figures.is_empty() => (row.seen.clone(), "by hand"),
        Some(seen) if row.figures.keys().all(|name| seen.figures.contains_key(name)) => {
            let shown = seen
                .figures
                .iter()
                .fold(row.seen.clone(), |shown, (name, value)| shown.replace(&format!("{{{name}}}"), value));
            (shown, seen.at.as_str())
        }
        _ => ("not measured".to_owned(), ""),
    };
    format!("| {} | {shown} | {at} | {commands} |", row.what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_seen_comes_back_from_its_file() {
        let mut seen = Seen::default();
        let figures = BTreeMap::from([("feed".to_owned(), "12.3".to_owned()), ("slip".to_owned(), "0.0".to_owned())]);
        seen.set("fig6", SeenRow { figures, at: "abc".to_owned(), on: "2 cores, \"x\", dev build".to_owned() });
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("results.csv");
        seen.write(&file).unwrap();
        assert_eq!(Seen::read(&file).unwrap(), seen);
    }

    #[test]
    fn a_row_shows_its_figures_or_that_they_were_not_measured() {
        let rows = sections().unwrap();
        let row = rows.iter().flat_map(|section| &section.rows).find(|row| row.name == "move").unwrap();
        assert!(line(row, None).contains("| not measured |"));
        let figures = ["planned", "bound"].map(|name| (name.to_owned(), "0.5".to_owned()));
        let seen = SeenRow { figures: figures.into(), at: "abc".to_owned(), on: String::new() };
        assert!(line(row, Some(&seen)).contains("| 0.5 s, 0.5 s | abc | `feeder-lab plan-move"));
    }
}
