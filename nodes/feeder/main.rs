//! The `feeder` command: each subcommand lives in a module of its own, this file only names them.

mod analysis;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// A miniature mobile parts feeder.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    FeedRate(analysis::feed_rate::Args),
    TrayMap(analysis::tray_map::Args),
    Figures(analysis::figures::Args),
    Optimize(analysis::optimize::Args),
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::FeedRate(args) => analysis::feed_rate::run(&args),
        Command::TrayMap(args) => analysis::tray_map::run(&args),
        Command::Figures(args) => analysis::figures::run(&args),
        Command::Optimize(args) => analysis::optimize::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
