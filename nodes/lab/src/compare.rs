//! `feeder-lab compare-planners`: one scenario under the planner and under a naive one.

use std::path::PathBuf;

use feeder_control::delivery::{DeliveryConfig, GentleParameters};
use serde::Serialize;

use feeder::summary::Summary;
use feeder::up::{self, UpArgs};

use crate::whole_run::whole_run;

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

/// What one would set up first: one part a trip in the order of the requests, fixed waits that are long enough, and moves at
/// half of what friction holds, with so much jerk that the speed is a trapezoid.
fn naive(given: DeliveryConfig) -> DeliveryConfig {
    let gentle = GentleParameters { friction_share: 0.5, jerk_m_s3_max: 1e4, ..given.gentle };
    DeliveryConfig { stops_max: 1, feed_s_min: 2.0, settle_s: 0.8, gentle, ..given }
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
        plain: true,
        ..UpArgs::default()
    };
    let stop = up::stop_on_signals()?;
    let under = |planner: fn(DeliveryConfig) -> DeliveryConfig| {
        let mut scenario = up::load_scenario(&options)?;
        scenario.delivery = planner(scenario.delivery);
        whole_run(&scenario.plan()?, &options, &stop).map(|(summary, _)| summary)
    };
    let (optimal, naive) = (under(|as_given| as_given)?, under(naive)?);
    let gain = optimal.delivered_per_minute / naive.delivered_per_minute;
    println!("{}", serde_json::to_string_pretty(&Comparison { optimal, naive, gain })?);
    Ok(())
}
