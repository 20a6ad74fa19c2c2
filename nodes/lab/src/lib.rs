//! The laboratory: studies of the feeder that no run needs, and the `feeder-lab` command that makes them.

mod analysis;
mod bulk;
mod compare;
pub mod design;
mod drop;
pub mod experiment;
mod good_parts;
pub mod identify;
mod identify_motor;
mod plan_move;
mod plot;
pub mod results;
mod scene;
mod slip_study;
mod try_motors;
mod try_suite;
mod view_cost;
mod vision;
mod whole_run;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

pub use analysis::fuzz_recording;

/// Studies of the feeder: design, figures, experiments, scores.
#[derive(Debug, Parser)]
#[command(name = "feeder-lab", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Bulk(bulk::Args),
    ComparePlanners(compare::Args),
    Drop(drop::Args),
    Experiment(analysis::experiment::Args),
    FeedRate(analysis::feed_rate::Args),
    Figures(analysis::figures::Args),
    GoodParts(good_parts::Args),
    IdentifyFriction(analysis::identify::Args),
    IdentifyMotor(identify_motor::Args),
    Optimize(analysis::optimize::Args),
    PlanMove(plan_move::Args),
    Plot(plot::Args),
    Results(results::Args),
    Scene(scene::Args),
    ScorePictures(vision::score_pictures::Args),
    ScoreVision(vision::score_vision::Args),
    VisionSensitivity(vision::sensitivity::Args),
    SlipStudy(slip_study::Args),
    TrayMap(analysis::tray_map::Args),
    TryMotors(try_motors::Args),
    TrySuite(try_suite::Args),
    ViewCost(view_cost::Args),
}

/// What the `feeder-lab` command takes, for those who check or describe it.
#[must_use]
pub fn command_line() -> clap::Command {
    Cli::command()
}

/// The command line: runs the study asked for.
#[must_use]
pub fn main() -> ExitCode {
    // A study whose reader has seen enough ends quietly.
    sigpipe::reset();
    let outcome = match Cli::parse().command {
        Command::Bulk(args) => bulk::run(&args),
        Command::ComparePlanners(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            compare::run(&args)
        }
        Command::Drop(args) => drop::run(&args),
        Command::Experiment(args) => analysis::experiment::run(&args),
        Command::FeedRate(args) => analysis::feed_rate::run(&args),
        Command::Figures(args) => analysis::figures::run(&args),
        Command::GoodParts(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            good_parts::run(&args)
        }
        Command::IdentifyFriction(args) => analysis::identify::run(&args),
        Command::IdentifyMotor(args) => identify_motor::run(&args),
        Command::Optimize(args) => analysis::optimize::run(&args),
        Command::PlanMove(args) => plan_move::run(&args),
        Command::Plot(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            plot::run(&args)
        }
        Command::Results(args) => results::run(&args),
        Command::Scene(args) => scene::run(&args),
        Command::ScorePictures(args) => vision::score_pictures::run(&args),
        Command::ScoreVision(args) => vision::score_vision::run(&args),
        Command::VisionSensitivity(args) => vision::sensitivity::run(&args),
        Command::SlipStudy(args) => slip_study::run(&args),
        Command::TrayMap(args) => analysis::tray_map::run(&args),
        Command::TryMotors(args) => try_motors::run(&args),
        Command::TrySuite(args) => {
            feeder_runtime::start_logging(feeder_runtime::LogSettings::default());
            try_suite::run(&args)
        }
        Command::ViewCost(args) => view_cost::run(&args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
