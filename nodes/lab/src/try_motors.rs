//! `feeder-lab try-motors`: what the courier feeds on motors that its controller was not made for.

use anyhow::Result;
use clap::Args as ClapArgs;

use crate::experiment::feed::FeedTrial;
use crate::experiment::motors::{self, PlantRun};
use feeder_control::courier::CourierConfig;
use feeder_scenario::assumed_motor;

/// Feeds on motors that the courier's controller was not made for, with learning and with feedback alone.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Only plants whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
    /// Seed of the sensor's noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let config = CourierConfig::default();
    let trials = [
        ("paper, 30 Hz", FeedTrial::paper(config.servo_period_s)),
        ("built-in, 10 Hz", FeedTrial::built_in(config.servo_period_s)),
    ];
    println!("Feed on the ramp over that of the ideal tray: from 2 to 3 s after a cold start, and from 7 to 8 s.");
    for (name, trial) in trials {
        println!("\nWaveform: {name}\n");
        println!("| Plant | Feedback 2 s | 7 s | Learning 2 s | 7 s | The driver said |\n|---|---|---|---|---|---|");
        for plant in motors::plants(assumed_motor()).iter().filter(|plant| plant.name.contains(&args.only)) {
            let feedback = motors::run(&trial, plant, config, false, args.seed)?;
            let learning = motors::run(&trial, plant, config, true, args.seed)?;
            let said = learning.said_s.map_or_else(String::new, |s| format!("{s:.1} s: {}", learning.said));
            let feed = |run: &PlantRun| {
                let stopped = if run.is_fault { " fault" } else { "" };
                format!("{:.3} | {:.3}{stopped}", run.after_2_s, run.after_7_s)
            };
            println!("| {} | {} | {} | {said} |", plant.name, feed(&feedback), feed(&learning));
        }
    }
    Ok(())
}
