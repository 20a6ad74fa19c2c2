//! `feeder-lab try-motors`: what the courier feeds on motors that its controller was not made for.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, ensure};
use clap::Args as ClapArgs;

use crate::experiment::feed::FeedTrial;
use crate::experiment::motors::{self, PlantRun};
use feeder::up::{self, UpArgs};
use feeder_control::courier::CourierConfig;
use feeder_scenario::assumed_motor;
use feeder_sim::motor::MotorParameters;

/// Feeds on motors that the courier's controller was not made for, with learning and with feedback alone.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Only plants whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
    /// Seed of the sensor's noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// In place of the motors of the table, so many drawn at random, all of them off in several ways at once.
    #[arg(long)]
    drawn: Option<usize>,
    /// Seed of the motors drawn.
    #[arg(long, default_value_t = 1)]
    draw_seed: u64,
    /// Scenario file (YAML) whose motor and courier are varied, in place of the assumed ones.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Goes on listening to the driver up to this time of each run, s.
    #[arg(long, default_value_t = 8.0)]
    listen: f64,
}

/// The motor and the courier of a scenario, or those that are assumed.
pub(crate) fn base(scenario: Option<&Path>) -> Result<(MotorParameters, CourierConfig)> {
    let Some(file) = scenario else { return Ok((assumed_motor(), CourierConfig::default())) };
    let options = UpArgs { scenario: Some(file.to_owned()), ..UpArgs::default() };
    let scenario = up::load_scenario(&options)?;
    let motor = scenario.world.motor.parameters().map_err(|problem| anyhow!(problem))?;
    Ok((motor, CourierConfig { start: CourierConfig::default().start, ..scenario.courier }))
}

/// How many runs came out how.
#[derive(Debug, Default)]
struct Tally {
    runs: u32,
    close: u32,
    told: u32,
    faults: u32,
    silent: u32,
    worse: u32,
    worse_silent: u32,
}

impl Tally {
    /// Feed within this counts as close, and beyond that as wrong.
    const CLOSE: f64 = 0.05;
    const WRONG: f64 = 0.1;

    fn add(&mut self, learning: &PlantRun, feedback: &PlantRun) {
        let off = |run: &PlantRun| (run.after_2_s - 1.0).abs().max((run.after_7_s - 1.0).abs());
        let told = learning.said_s.is_some();
        let worse = off(learning) > off(feedback).max(Self::WRONG);
        self.runs += 1;
        self.close += u32::from(off(learning) < Self::CLOSE);
        self.told += u32::from(told);
        self.faults += u32::from(learning.is_fault);
        self.silent += u32::from(!told && off(learning) > Self::WRONG);
        self.worse += u32::from(worse);
        self.worse_silent += u32::from(worse && !told);
    }
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let (motor, config) = base(args.scenario.as_deref())?;
    let trials = [
        ("paper, 30 Hz", FeedTrial::paper(config.servo_period_s)),
        ("optimal, 10 Hz", FeedTrial::optimal(config.servo_period_s)),
        ("built-in", FeedTrial::built_in(config.servo_period_s)),
    ];
    let plants = match args.drawn {
        Some(count) => motors::drawn(motor, count, args.draw_seed),
        None => motors::plants(motor),
    };
    let chosen: Vec<_> = plants.iter().filter(|plant| plant.name.contains(&args.only)).collect();
    ensure!(!chosen.is_empty(), "--only: {}", motors::unknown(&args.only, &plants));
    println!(
        "Feed on the ramp over that of the ideal tray: from 2 to 3 s after a cold start, from 5 to 6 s, and from 7 to 8 s."
    );
    for (name, trial) in trials {
        println!("\nWaveform: {name}\n");
        println!(
            "| Plant | Feedback 2 s | 5 s | 7 s | Learning 2 s | 5 s | 7 s | The driver said |\n|---|---|---|---|---|---|---|---|"
        );
        let mut tally = Tally::default();
        for plant in &chosen {
            let feedback = motors::run(&trial, plant, config, false, args.seed, 0.0)?;
            let learning = motors::run(&trial, plant, config, true, args.seed, args.listen)?;
            let said = learning.said_s.map_or_else(String::new, |s| format!("{s:.1} s: {}", learning.said));
            let feed = |run: &PlantRun| {
                let stopped = if run.is_fault { " fault" } else { "" };
                format!("{:.3} | {:.3} | {:.3}{stopped}", run.after_2_s, run.after_5_s, run.after_7_s)
            };
            println!("| {} | {} | {} | {said} |", plant.name, feed(&feedback), feed(&learning));
            tally.add(&learning, &feedback);
        }
        let Tally { runs, close, told, faults, silent, worse, worse_silent } = tally;
        println!(
            "\n{runs} motors: {close} within 5 % at both times, {told} told of ({faults} faults), {silent} wrong by more than \
             10 % without a word, {worse} both wrong and farther off than with feedback ({worse_silent} of them without a word)"
        );
    }
    Ok(())
}
