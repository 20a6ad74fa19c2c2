//! The `feeder` command as a library: each subcommand lives in a module of its own, this file only names them.

mod attempt;
mod bag;
mod calibrate;
mod crew;
mod graph_check;
mod join;
pub mod lesson;
mod live;
mod look;
mod muster;
pub mod part;
mod pictures;
pub mod recording;
mod restart;
pub mod scenario_file;
pub mod summary;
mod table;
mod teach;
pub mod up;
mod view;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

pub use table::parameters_of;
pub use teach::fuzz_labels;

/// A miniature mobile parts feeder. Without a subcommand the built-in scenario runs.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Up(up::UpArgs),
    Join(join::JoinArgs),
    View(live::ViewArgs),
    Top(live::TopArgs),
    Check(scenario_file::CheckArgs),
    Node(NodeArgs),
    Bag(bag::BagArgs),
    Teach(teach::TeachArgs),
    Look(look::LookArgs),
    Calibrate(calibrate::CalibrateArgs),
    GraphCheck(graph_check::Args),
    Part(part::Args),
}

impl Command {
    /// Whether nothing is lost when the reader of the output goes: `feeder part | head` ends quietly then.
    const fn only_prints(&self) -> bool {
        matches!(self, Self::Check(_) | Self::Teach(_) | Self::Look(_) | Self::Calibrate(_) | Self::Part(_))
    }
}

/// Run one node of a scenario.
#[derive(Debug, clap::Args)]
struct NodeArgs {
    /// Name of the node
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(table::NODES.iter().map(|entry| entry.name)))]
    name: String,
    /// Start it again when something has ended it, as where it ran out of memory
    #[arg(long)]
    restart: bool,
    /// Options of the node; `feeder node NAME -- --help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    options: Vec<OsString>,
}

/// What the `feeder` command takes, for those who check or describe it.
#[must_use]
pub fn command_line() -> clap::Command {
    Cli::command()
}

/// The command line: runs the subcommand asked for.
#[must_use]
pub fn main() -> ExitCode {
    let command = Cli::parse().command.unwrap_or_else(|| Command::Up(up::UpArgs::default()));
    if command.only_prints() {
        sigpipe::reset();
    }
    let outcome = match command {
        Command::Up(args) => {
            feeder_runtime::memory::bound_memory();
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            up::run(&args)
        }
        Command::Join(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            join::run(&args)
        }
        Command::View(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            live::view(&args)
        }
        Command::Top(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            live::top(&args)
        }
        Command::Check(args) => scenario_file::check(&args),
        Command::Node(args) => return node(args),
        Command::Bag(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            return bag::run(&args);
        }
        Command::GraphCheck(args) => graph_check::run(&args),
        Command::Teach(args) => teach::run(&args),
        Command::Look(args) => look::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Part(args) => part::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn node(args: NodeArgs) -> ExitCode {
    if args.restart {
        feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
        return restart::run(&args.name, &args.options).unwrap_or_else(|error| {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        });
    }
    match table::NODES.iter().find(|entry| entry.name == args.name) {
        Some(entry) => (entry.main)(args.options),
        None => ExitCode::FAILURE,
    }
}
