//! `feeder bag`: records, shows, checks and plays ROS 2 bags.

mod keyboard;
mod play;
mod record;
mod rerun;

pub(crate) use rerun::recorded_plan;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Subcommand;
use regex::Regex;
use ros2_bags::check::{Severity, check};
use ros2_bags::diff::{Diff, DiffSettings, diff};
use ros2_bags::export::export;
use ros2_bags::info::Info;
use ros2_bags::recover::recover;
use ros2_bags::{Bag, Distribution, Selection, WriteSettings};

/// Record, play and examine ROS 2 bags (MCAP).
#[derive(Debug, clap::Args)]
pub(crate) struct BagArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Record(record::RecordArgs),
    Play(play::PlayArgs),
    /// Show what is in a bag
    Info {
        /// The bag: a folder or an MCAP file
        bag: PathBuf,
    },
    /// Say whether a bag keeps to the conventions, every message included; exit code 1 when something is wrong
    Check {
        /// The bag: a folder or an MCAP file
        bag: PathBuf,
    },
    Diff(DiffArgs),
    Export(ExportArgs),
    Rerun(rerun::RerunArgs),
    Recover(RecoverArgs),
}

/// Compare two bags topic by topic; exit code 1 when they differ
#[derive(Debug, clap::Args)]
struct DiffArgs {
    /// One bag
    a: PathBuf,
    /// The other
    b: PathBuf,
    /// Topics to compare, instead of all
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
    /// Topics to leave out: those whose name this pattern is found in
    #[arg(long, short = 'x', value_name = "REGEX")]
    exclude_regex: Option<Regex>,
    /// Numbers may differ by so much
    #[arg(long, value_name = "NUMBER", default_value_t = 0.0, value_parser = tolerance)]
    absolute: f64,
    /// Numbers may differ by so much of the larger one
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = tolerance)]
    relative: f64,
    /// The times of messages in the bags may differ
    #[arg(long)]
    ignore_time: bool,
}

/// Write the numbers and texts of topics to CSV files, one for each topic
#[derive(Debug, clap::Args)]
struct ExportArgs {
    /// The bag
    bag: PathBuf,
    /// Folder for the files
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
    /// Topics to export, instead of all
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
}

/// Make a whole bag of what can be read of a damaged one, or write a bag anew for another distribution
#[derive(Debug, clap::Args)]
struct RecoverArgs {
    /// The bag
    bag: PathBuf,
    /// Folder for the new bag; it must not exist yet
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
    /// Write for the tools of this distribution: humble, iron, jazzy, kilted or lyrical
    #[arg(long, value_name = "DISTRO", default_value_t)]
    compat: Distribution,
}

fn tolerance(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite() && *value >= 0.0);
    value.ok_or_else(|| format!("{text} is no number from zero"))
}

/// Runs the subcommand.
pub(crate) fn run(args: &BagArgs) -> ExitCode {
    let outcome = match &args.command {
        Command::Record(args) => record::run(args).map(|()| ExitCode::SUCCESS),
        Command::Play(args) => play::run(args),
        Command::Info { bag } => info(bag),
        Command::Check { bag } => check_bag(bag),
        Command::Diff(args) => diff_bags(args),
        Command::Export(args) => export_bag(args),
        Command::Rerun(args) => rerun::run(args),
        Command::Recover(args) => recover_bag(args),
    };
    outcome.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}

fn info(path: &Path) -> anyhow::Result<ExitCode> {
    let bag = open(path)?;
    print!("{}", Info(&bag));
    Ok(ExitCode::SUCCESS)
}

/// Opens a bag, and says on standard error what is wrong with it.
fn open(path: &Path) -> anyhow::Result<Bag> {
    let bag = Bag::open(path)?;
    for problem in bag.problems() {
        eprintln!("warning: {problem}");
    }
    Ok(bag)
}

fn check_bag(path: &Path) -> anyhow::Result<ExitCode> {
    let bag = Bag::open(path)?;
    let findings = check(&bag);
    for finding in &findings {
        println!("{finding}");
    }
    let errors = findings.iter().filter(|finding| finding.severity == Severity::Error).count();
    let (messages, topics, warnings) = (bag.message_count(), bag.topics().len(), findings.len() - errors);
    println!("{}: {messages} messages of {topics} topics, {errors} errors, {warnings} warnings", path.display());
    Ok(if errors == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn diff_bags(args: &DiffArgs) -> anyhow::Result<ExitCode> {
    let settings = DiffSettings {
        selection: Selection {
            topics: args.topics.clone(),
            exclude_regex: args.exclude_regex.clone(),
            hidden: true,
            ..Selection::default()
        },
        absolute: args.absolute,
        relative: args.relative,
        ignore_time: args.ignore_time,
        before_ns: None,
    };
    Ok(show(&diff(&open(&args.a)?, &open(&args.b)?, &settings)))
}

/// Prints a comparison; the exit code says whether all is the same.
fn show(diff: &Diff) -> ExitCode {
    for error in &diff.unreadable {
        println!("unreadable: {error}");
    }
    for topic in &diff.topics {
        println!("{topic}");
    }
    let differ = diff.topics.iter().filter(|topic| topic.first.is_some()).count();
    println!("{} topics compared, {differ} differ", diff.topics.len());
    if diff.is_same() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn export_bag(args: &ExportArgs) -> anyhow::Result<ExitCode> {
    let selection = Selection { hidden: true, ..Selection::of(args.topics.clone()) };
    for exported in export(&open(&args.bag)?, &selection, &args.out)? {
        match exported.outcome {
            Ok((path, rows)) => println!("{}: {rows} rows", path.display()),
            Err(reason) => println!("{} is left out: {reason}", exported.topic),
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn recover_bag(args: &RecoverArgs) -> anyhow::Result<ExitCode> {
    let bag = open(&args.bag)?;
    let said: Vec<String> = bag.problems().iter().map(ToString::to_string).collect();
    let settings = WriteSettings { distribution: args.compat, ..WriteSettings::default() };
    let recovered = recover(&bag, &args.out, &settings)?;
    for lost in recovered.lost.iter().map(ToString::to_string).filter(|lost| !said.contains(lost)) {
        eprintln!("warning: {lost}");
    }
    println!("{}: {} messages recovered", args.out.display(), recovered.metadata.message_count);
    Ok(ExitCode::SUCCESS)
}
