//! `feeder-lab try-suite`: whole runs on motors that the controller was not made for, learning beside feedback alone.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, Result, anyhow};
use feeder::up::{self, UpArgs};
use feeder_model::motor::Load;
use feeder_scenario::{MotorSource, Scenario};
use minifactory_msgs::msg::{CourierState, FeederState};
use ros2_bags::{Bag, Query};

use crate::experiment::motors::{self, Plant};
use crate::whole_run::whole_run;

/// Runs scenarios and variations of their motors with learning and with feedback alone: parts delivered, how far they slid,
/// and what was said of the feed.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scenario files (YAML); without one the built-in scenario.
    #[arg(long, value_name = "FILE")]
    scenario: Vec<PathBuf>,
    /// The scenarios' motors as they are, and not their variations.
    #[arg(long)]
    as_is: bool,
    /// Only motors whose name contains this.
    #[arg(long, default_value = "")]
    only: String,
    /// In place of the variations, so many motors drawn at random, as `try-motors` draws them.
    #[arg(long)]
    drawn: Option<usize>,
    /// Seed of the motors drawn.
    #[arg(long, default_value_t = 1)]
    draw_seed: u64,
    /// Simulated seconds of each run.
    #[arg(long, default_value_t = 60.0)]
    duration: f64,
    /// Folder for the bags of the runs; it must not exist yet.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// DDS domain, instead of ROS_DOMAIN_ID.
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// The variations that are run, by their names in `try-motors`.
const VARIATIONS: [&str; 13] = [
    "as assumed",
    "lag x 0",
    "lag x 3",
    "inertia x 1.6",
    "inertia x 2",
    "mode 120 Hz, 10 %, sensor on courier",
    "mode 180 Hz, 10 %, sensor on courier",
    "mode 400 Hz, 10 %, sensor on courier",
    "mode 120 Hz, 10 %, sensor on tray",
    "mode 180 Hz, 10 %, sensor on tray",
    "mode 400 Hz, 10 %, sensor on tray",
    "noise 2 µm",
    "30 parts of 2 g taken away",
];

/// Bytes before the payload of a message in a bag.
const HEADER_BYTES: usize = 4;

/// Fewer parts than this share of what feedback alone delivers are clearly fewer.
const CLEARLY_FEWER: f64 = 0.75;

/// What a run shows.
#[derive(Debug)]
struct Outcome {
    delivered: u64,
    wrong: u64,
    slip_m: Option<f64>,
    told: Told,
}

/// What a run said of its feed: when first, s, and what.
#[derive(Debug, Default)]
struct Told {
    /// The driver's warning or fault.
    courier: Option<(f64, String)>,
    /// The feeder's state, where it was held or in fault, or worked with something to say.
    state: Option<(f64, String)>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let stop = up::stop_on_signals()?;
    std::fs::create_dir(&args.out).with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let files: Vec<Option<PathBuf>> =
        if args.scenario.is_empty() { vec![None] } else { args.scenario.iter().cloned().map(Some).collect() };
    println!(
        "| Scenario, motor | Feedback: delivered, slip | Learning: delivered, slip | The driver said first | `state` said first |"
    );
    println!("|---|---|---|---|---|");
    let (mut rows, mut silent) = (0, 0);
    for file in files {
        let options = UpArgs { scenario: file.clone(), domain: args.domain, composed: true, ..UpArgs::default() };
        let scenario = up::load_scenario(&options)?.with_duration_s(args.duration)?;
        let name = file.as_deref().and_then(Path::file_stem).map_or("default".into(), |stem| stem.to_string_lossy());
        for plant in plants(&scenario, args)? {
            rows += 1;
            let varied = |learning: bool| {
                let folder = args.out.join(format!("{rows}_{}", if learning { "learning" } else { "feedback" }));
                outcome(&vary(&scenario, &plant, learning), &options, &folder, &stop)
                    .with_context(|| format!("{name}, {}", plant.name))
            };
            let (feedback, learning) = (varied(false)?, varied(true)?);
            let is_silent = (learning.delivered as f64) < CLEARLY_FEWER * feedback.delivered as f64
                && learning.told.courier.is_none()
                && learning.told.state.is_none();
            silent += u32::from(is_silent);
            let said = |told: &Option<(f64, String)>| {
                told.as_ref().map_or_else(String::new, |(time_s, text)| format!("{time_s:.1} s: {text}"))
            };
            println!(
                "| {name}, {} | {} | {}{} | {} | {} |",
                plant.name,
                parts(&feedback),
                parts(&learning),
                if is_silent { ", SILENT" } else { "" },
                said(&learning.told.courier),
                said(&learning.told.state),
            );
        }
    }
    println!("\n{rows} motors, {silent} of them fed clearly fewer parts than with feedback alone without a word");
    Ok(())
}

fn parts(outcome: &Outcome) -> String {
    let slip = outcome.slip_m.map_or_else(|| "–".to_owned(), |slip_m| format!("{:.1} µm", 1e6 * slip_m));
    let wrong = if outcome.wrong > 0 { format!(" ({} wrong)", outcome.wrong) } else { String::new() };
    format!("{}{wrong}, {slip}", outcome.delivered)
}

/// The scenario's motor, and those that differ from it in one way.
fn plants(scenario: &Scenario, args: &Args) -> Result<Vec<Plant>> {
    let motor = scenario.world.motor.parameters().map_err(|problem| anyhow!(problem))?;
    if args.as_is {
        return Ok(vec![Plant { name: "as it is".to_owned(), motor, taken_away: Load::default(), is_told: false }]);
    }
    let mut plants = match args.drawn {
        Some(count) => motors::drawn(motor, count, args.draw_seed),
        None => motors::plants(motor),
    };
    plants.retain(|plant| args.drawn.is_some() || VARIATIONS.contains(&plant.name.as_str()));
    plants.retain(|plant| plant.name.contains(&args.only));
    Ok(plants)
}

/// The scenario on another motor. What was taken away the driver still reckons with.
fn vary(scenario: &Scenario, plant: &Plant, learning: bool) -> Scenario {
    let mut varied = scenario.clone();
    let (mut motor, gone) = (plant.motor, plant.taken_away);
    // The simulated motor carries what the driver reckons with.
    motor.mass_kg -= gone.mass_kg;
    motor.inertia_kg_m2 -= gone.inertia_kg_m2;
    varied.courier.load.mass_kg += gone.mass_kg;
    varied.courier.load.inertia_kg_m2 += gone.inertia_kg_m2;
    varied.world.motor = MotorSource::Here(Box::new(motor));
    varied.courier.learning.enabled = learning;
    varied
}

fn outcome(scenario: &Scenario, options: &UpArgs, folder: &Path, stop: &Arc<AtomicBool>) -> Result<Outcome> {
    let topics = ["courier_state", "state"].map(|topic| format!("{}/{topic}", scenario.namespace()));
    let mut options = options.clone();
    options.recording.record = Some(folder.to_owned());
    options.recording.record_topics = Some(topics.to_vec());
    let (summary, _) = whole_run(&scenario.plan()?, &options, stop)?;
    let summary = serde_json::to_value(&summary)?;
    let count = |key: &str| summary[key].as_u64().with_context(|| format!("the summary has no {key}"));
    Ok(Outcome {
        delivered: count("delivered")?,
        wrong: count("wrong_pose_delivered")?,
        slip_m: summary["max_slip_m"].as_f64(),
        told: told(folder)?,
    })
}

/// What was said first, as the bag of a run has it.
fn told(folder: &Path) -> Result<Told> {
    let bag = Bag::open(folder)?;
    let mut told = Told::default();
    for message in bag.messages(&Query::default()) {
        let message = message?;
        let little_endian = ros2_bags::cdr::is_little_endian(&message.data).map_err(anyhow::Error::msg)?;
        let data = &message.data[HEADER_BYTES..];
        let time_s = message.log_ns as f64 * 1e-9;
        match bag.topics()[message.topic].ros_type.as_str() {
            "minifactory_msgs/msg/CourierState" => {
                let state: CourierState = feeder_runtime::cdr::decode(data, little_endian)?;
                let said = if state.fault.is_empty() { state.warning } else { format!("fault: {}", state.fault) };
                if !said.is_empty() {
                    told.courier.get_or_insert((time_s, said));
                }
            }
            "minifactory_msgs/msg/FeederState" => {
                let state: FeederState = feeder_runtime::cdr::decode(data, little_endian)?;
                let word = match state.state {
                    FeederState::HELD => "HELD: ",
                    FeederState::ABORTED => "ABORTED: ",
                    FeederState::EXECUTE if !state.message.is_empty() => "EXECUTE: ",
                    _ => continue,
                };
                let graver =
                    told.state.as_ref().is_some_and(|(_, said)| said.starts_with("EXECUTE") && word != "EXECUTE: ");
                if told.state.is_none() || graver {
                    told.state = Some((time_s, format!("{word}{}", state.message)));
                }
            }
            _ => {}
        }
    }
    Ok(told)
}
