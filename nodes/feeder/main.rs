//! The `feeder` command: each subcommand lives in a module of its own, this file only names them.

mod analysis;
mod bag;
mod bulk;
mod compare;
mod crew;
mod graph_check;
mod part;
mod plan_move;
mod plot;
mod recording;
mod scenario_file;
mod slip_study;
mod summary;
mod table;
mod teach;
mod up;
mod view;
mod vision;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

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
    Check(scenario_file::CheckArgs),
    Node(NodeArgs),
    Bag(bag::BagArgs),
    Teach(teach::TeachArgs),
    GraphCheck(graph_check::Args),
    ScoreVision(vision::score_vision::Args),
    Part(part::Args),
    Bulk(bulk::Args),
    PlanMove(plan_move::Args),
    SlipStudy(slip_study::Args),
    ComparePlanners(compare::Args),
    FeedRate(analysis::feed_rate::Args),
    TrayMap(analysis::tray_map::Args),
    Figures(analysis::figures::Args),
    Optimize(analysis::optimize::Args),
    Experiment(analysis::experiment::Args),
    IdentifyFriction(analysis::identify::Args),
}

/// Run one node of a scenario.
#[derive(Debug, clap::Args)]
struct NodeArgs {
    /// Name of the node
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(table::NODES.iter().map(|entry| entry.name)))]
    name: String,
    /// Options of the node; `feeder node NAME -- --help` lists them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    options: Vec<OsString>,
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command.unwrap_or_else(|| Command::Up(up::UpArgs::default())) {
        Command::Up(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            up::run(&args)
        }
        Command::Check(args) => scenario_file::check(&args),
        Command::Node(args) => return node(args),
        Command::Bag(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            return bag::run(&args);
        }
        Command::GraphCheck(args) => graph_check::run(&args),
        Command::Teach(args) => teach::run(&args),
        Command::ScoreVision(args) => vision::score_vision::run(&args),
        Command::Part(args) => part::run(&args),
        Command::Bulk(args) => bulk::run(&args),
        Command::PlanMove(args) => plan_move::run(&args),
        Command::SlipStudy(args) => slip_study::run(&args),
        Command::ComparePlanners(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            compare::run(&args)
        }
        Command::FeedRate(args) => analysis::feed_rate::run(&args),
        Command::TrayMap(args) => analysis::tray_map::run(&args),
        Command::Figures(args) => analysis::figures::run(&args),
        Command::Optimize(args) => analysis::optimize::run(&args),
        Command::Experiment(args) => analysis::experiment::run(&args),
        Command::IdentifyFriction(args) => analysis::identify::run(&args),
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
    match table::NODES.iter().find(|entry| entry.name == args.name) {
        Some(entry) => (entry.main)(args.options),
        None => ExitCode::FAILURE,
    }
}
