//! `feeder-lab compare-planners`: one scenario under the planner and under a naive one.

use std::path::PathBuf;

use feeder_control::delivery::Strategy;
use serde::Serialize;

use feeder::summary::Summary;
use feeder::up::{self, UpArgs};

/// Run a scenario under the planner and under a naive one (one part a trip, fixed waits, trapezoids of speed at half of
/// what friction holds), and print how both did.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Scenario file (YAML); without it the built-in scenario runs
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Simulated seconds to run each, instead of the scenario's
    #[arg(long, allow_negative_numbers = true, value_name = "SECONDS")]
    duration: Option<f64>,
    /// Seed of all random numbers, instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

#[derive(Debug, Serialize)]
struct Comparison {
    optimal: Summary,
    naive: Summary,
    /// Parts a minute of the one over the other.
    gain: f64,
}

/// Runs both and prints the comparison as JSON.
///
/// # Errors
/// A scenario that cannot run, or a run that does not come to its end.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let options = UpArgs {
        scenario: args.scenario.clone(),
        duration: args.duration,
        seed: args.seed,
        domain: args.domain,
        composed: true,
        ..UpArgs::default()
    };
    let stop = up::stop_on_signals()?;
    let under = |strategy| {
        let mut scenario = up::load_scenario(&options)?;
        scenario.delivery.strategy = strategy;
        let ended = up::execute(&scenario, &options, &stop)?;
        ended.outcome.map(|()| ended.summary)
    };
    let (optimal, naive) = (under(Strategy::Optimal)?, under(Strategy::Naive)?);
    let gain = optimal.delivered_per_minute / naive.delivered_per_minute;
    println!("{}", serde_json::to_string_pretty(&Comparison { optimal, naive, gain })?);
    Ok(())
}
