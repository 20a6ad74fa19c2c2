//! `feeder-lab results`: measures the figures of the results page, and writes the page.
//!
//! The rows, with the commands that give their figures, are in `rows.yaml`; what was seen last lies beside the page, in
//! `results.csv`. The page is made of both, so a figure and its command cannot part.

mod figure;
mod page;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use serde::Deserialize;

use figure::{Figure, difference};
pub use page::page;
use page::{Seen, SeenRow};

/// Measures figures of the results page with the commands that stand beside them: `feeder` and `feeder-lab` must be on the
/// PATH, and the folder a clone of the suite.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Only the row of this name; may be given several times.
    #[arg(long, value_name = "ROW")]
    only: Vec<String>,
    /// Only the rows that take some seconds.
    #[arg(long)]
    quick: bool,
    /// Compare with what the page says, and fail where a figure is off by more than its row allows, in place of writing.
    #[arg(long)]
    compare: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Section {
    title: String,
    rows: Vec<Row>,
    /// Markdown behind the table.
    #[serde(default)]
    after: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    what: String,
    #[serde(default)]
    quick: bool,
    /// For a shell, in an empty folder beside the clone's own folders; those of cargo in the clone.
    commands: Vec<String>,
    /// Files that the commands write and that are read behind what they print.
    #[serde(default)]
    read: Vec<PathBuf>,
    /// The figures' names stand in braces.
    seen: String,
    #[serde(default)]
    figures: BTreeMap<String, Figure>,
}

fn sections() -> Result<Vec<Section>> {
    let sections: Vec<Section> = serde_saphyr::from_str(include_str!("rows.yaml")).context("rows.yaml")?;
    for row in sections.iter().flat_map(|section| &section.rows) {
        ensure!(!row.commands.is_empty(), "row {} has no command", row.name);
        for name in row.figures.keys() {
            ensure!(row.seen.contains(&format!("{{{name}}}")), "row {} does not show its figure {name}", row.name);
        }
    }
    Ok(sections)
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let sections = sections()?;
    let rows: Vec<&Row> = sections.iter().flat_map(|section| &section.rows).collect();
    for name in &args.only {
        let known = || rows.iter().map(|row| row.name.as_str()).collect::<Vec<_>>().join(", ");
        ensure!(rows.iter().any(|row| row.name == *name), "no row {name:?}; there are {}", known());
    }
    let is_wanted = |row: &Row| (args.only.is_empty() || args.only.contains(&row.name)) && (!args.quick || row.quick);
    let clone = std::env::current_dir()?;
    ensure!(clone.join("docs/results.csv").is_file(), "no docs/results.csv here: begin this in a clone of the suite");
    let mut seen = Seen::read(&clone.join("docs/results.csv"))?;
    let state = State::of(&clone)?;
    let mut troubles = Vec::new();
    // Rows that share their commands share a run of them.
    let mut said = BTreeMap::new();
    for row in rows.into_iter().filter(|row| is_wanted(row) && !row.figures.is_empty()) {
        let text =
            said.entry((row.commands.as_slice(), row.read.as_slice())).or_insert_with(|| -> Result<String, String> {
                eprintln!("{}", row.commands.join("; "));
                run_commands(row, &clone).map_err(|error| format!("{error:#}"))
            });
        match text.clone().map_err(anyhow::Error::msg).and_then(|text| find_figures(row, &text)) {
            Ok(found) => {
                let figures = found.iter().map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>();
                println!("{}: {}", row.name, figures.join(", "));
                if args.compare {
                    let last = seen.row(&row.name);
                    troubles.extend(found.iter().filter_map(|(name, value)| {
                        let last = last.and_then(|last| last.figures.get(name)).map_or("nothing", String::as_str);
                        let trouble = difference(last, value, row.figures[name].within)?;
                        Some(format!("{}, {name}: {trouble}", row.name))
                    }));
                } else {
                    let row_seen = SeenRow { figures: found, at: state.commit.clone(), on: state.machine.clone() };
                    seen.set(&row.name, row_seen);
                    // After each row: some take an hour.
                    seen.write(&clone.join("docs/results.csv"))?;
                }
            }
            Err(error) => troubles.push(format!("{}: {error:#}", row.name)),
        }
    }
    if !args.compare {
        std::fs::write(clone.join("docs/results.md"), page(&clone)?)?;
    }
    if troubles.is_empty() { Ok(()) } else { bail!("{}", troubles.join("\n")) }
}

/// Runs the commands of a row, and gives what they said.
fn run_commands(row: &Row, clone: &Path) -> Result<String> {
    let folder = tempfile::tempdir()?;
    for name in ["launch_configs", "tests", "docs"] {
        std::os::unix::fs::symlink(clone.join(name), folder.path().join(name))?;
    }
    let mut text = String::new();
    for command in &row.commands {
        // cargo works on the clone itself.
        let place = if command.starts_with("cargo ") { clone } else { folder.path() };
        let output = Command::new("sh").args(["-c", command]).current_dir(place).output()?;
        let errors = String::from_utf8_lossy(&output.stderr);
        let last = errors.lines().last().unwrap_or_default();
        ensure!(output.status.success(), "{command}: {}: {last}", output.status);
        text += &String::from_utf8_lossy(&output.stdout);
    }
    for file in &row.read {
        text += &std::fs::read_to_string(folder.path().join(file)).with_context(|| file.display().to_string())?;
    }
    Ok(text)
}

fn find_figures(row: &Row, text: &str) -> Result<BTreeMap<String, String>> {
    let found = row.figures.iter().map(|(name, figure)| {
        let value = figure.find(text).with_context(|| format!("{name} is not in what the commands say"))?;
        Ok((name.clone(), value))
    });
    found.collect()
}

/// What is measured, and where.
struct State {
    commit: String,
    machine: String,
}

impl State {
    fn of(clone: &Path) -> Result<Self> {
        let git = |arguments: &[&str]| -> Result<String> {
            let output = Command::new("git").args(arguments).current_dir(clone).output().context("git")?;
            ensure!(output.status.success(), "git: {}", String::from_utf8_lossy(&output.stderr));
            Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
        };
        // What stands only in the working tree is in no commit.
        let changed = !git(&["status", "--porcelain", "--", "nodes", "launch_configs", "Cargo.lock"])?.is_empty();
        let commit = git(&["rev-parse", "--short", "HEAD"])? + if changed { " and changes" } else { "" };
        let cpus = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = cpus.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        let model = model.map_or(std::env::consts::ARCH, |(_, model)| model);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
        Ok(Self { commit, machine: format!("{cores} cores, {model}, {profile} build") })
    }
}
