//! `feeder-lab experiment faults`: what the courier driver does about every fault.

use crate::experiment::faults::{Doing, matrix};
use anyhow::Result;
use clap::Args as ClapArgs;
use feeder_control::courier::{CourierConfig, LearningParameters};
use feeder_scenario::{SimulatedCourier, assumed_motor};

/// What the driver does about each fault of its hardware and of those who command it: how soon it notices, how soon the
/// courier stands, how far it goes until then, and whether it works again afterwards.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {}

pub(crate) fn run(_: &Args) -> Result<()> {
    let learning = LearningParameters { enabled: true, ..LearningParameters::default() };
    let config =
        SimulatedCourier { config: CourierConfig { learning, ..CourierConfig::default() }, motor: assumed_motor() };
    let seconds =
        |time_s: Option<f64>| time_s.map_or_else(|| "–".to_owned(), |time_s| format!("{:.1} ms", time_s * 1e3));
    println!("| fault | while | noticed after | stands after | way | works again | what the driver does |");
    println!("|---|---|---|---|---|---|---|");
    for report in matrix(config)? {
        let doing = match report.doing {
            Doing::Moving => "moving",
            Doing::Vibrating => "vibrating",
        };
        println!(
            "| {} | {doing} | {} | {} | {:.1} mm | {} | {} |",
            report.fault,
            seconds(report.noticed_s),
            seconds(report.safe_s),
            report.way_m * 1e3,
            if report.recovered { "yes" } else { "no" },
            report.reaction,
        );
    }
    Ok(())
}
