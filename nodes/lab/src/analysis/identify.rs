//! `feeder-lab identify-friction`: friction from a recording of how a part slips.
//!
//! A recording is a bag with velocities of joints called `tray` and `part`, or a CSV file of the same numbers.

use std::path::{Path, PathBuf};

use crate::identify::{VelocitySample, kinetic_friction};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_runtime::node::{ns_of_stamp, stamp_of_ns};
use minifactory_msgs::Message as _;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::Header;
use ros2_bags::{Bag, BagWriter, NewTopic, Query, WriteSettings};
use serde::Serialize;

use super::print_json;

/// Columns of a recording as CSV.
const COLUMNS: [&str; 3] = ["time_s", "tray_velocity_m_s", "part_velocity_m_s"];
/// The topic of a recording as a bag.
const TOPIC: &str = "/rig/interferometer";
/// Bytes before the payload of a message in a bag.
const HEADER_BYTES: usize = 4;

/// Kinetic friction from a recording of a part that slips on a level tray, as JSON.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// The recording: a bag (folder or MCAP file), or a CSV file with the columns time_s, tray_velocity_m_s and
    /// part_velocity_m_s; velocities are those in the world
    recording: PathBuf,
    /// Topic of a bag: sensor_msgs/msg/JointState with the velocities of two joints.
    #[arg(long, default_value = TOPIC)]
    topic: String,
    /// Joint that is the tray.
    #[arg(long, default_value = "tray")]
    tray: String,
    /// Joint that is the part.
    #[arg(long, default_value = "part")]
    part: String,
    /// Gravity, m/s².
    #[arg(long, default_value_t = STANDARD_GRAVITY_M_S2, allow_negative_numbers = true)]
    gravity: f64,
}

#[derive(Debug, Serialize)]
struct FrictionReport {
    kinetic_friction: f64,
    standard_error: f64,
    slips: usize,
    samples: usize,
    noise_m_s: f64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let is_csv = args.recording.extension().is_some_and(|extension| extension == "csv");
    let samples = if is_csv { read_csv(&args.recording) } else { read_bag(args) };
    let samples = samples.with_context(|| format!("in {}", args.recording.display()))?;
    let found = kinetic_friction(&samples, args.gravity).with_context(|| format!("in {}", args.recording.display()))?;
    print_json(&FrictionReport {
        kinetic_friction: found.kinetic,
        standard_error: found.standard_error,
        slips: found.slips,
        samples: found.samples,
        noise_m_s: found.noise_m_s,
    })
}

fn read_bag(args: &Args) -> Result<Vec<VelocitySample>> {
    let bag = Bag::open(&args.recording)?;
    let wanted = JointState::INFO.ros_type();
    let Some(topic) = bag.topics().iter().position(|topic| topic.name == args.topic && topic.ros_type == wanted) else {
        let there: Vec<_> = bag.topics().iter().map(|topic| format!("{} ({})", topic.name, topic.ros_type)).collect();
        bail!("no topic {} of type {wanted}; there are {}", args.topic, there.join(", "));
    };
    let mut samples = Vec::new();
    for message in bag.messages(&Query::default()) {
        let message = message?;
        if message.topic != topic {
            continue;
        }
        let little_endian = ros2_bags::cdr::is_little_endian(&message.data).map_err(anyhow::Error::msg)?;
        let state: JointState = feeder_runtime::cdr::decode(&message.data[HEADER_BYTES..], little_endian)?;
        let velocity = |joint: &str| {
            let place = state.name.iter().position(|name| name == joint);
            place.and_then(|place| state.velocity.get(place)).copied().with_context(|| {
                format!("message {} gives no velocity of {joint:?}; its joints are {:?}", samples.len(), state.name)
            })
        };
        #[expect(clippy::cast_precision_loss, reason = "wall time to 0.3 µs, time since a start exactly")]
        let time_s = ns_of_stamp(&state.header.stamp) as f64 * 1e-9;
        samples.push(VelocitySample { time_s, tray_m_s: velocity(&args.tray)?, part_m_s: velocity(&args.part)? });
    }
    Ok(samples)
}

/// Writes a recording as a bag, which must not exist yet.
pub(crate) fn write_bag(folder: &Path, samples: &[VelocitySample]) -> Result<()> {
    let mut writer = BagWriter::create(folder, WriteSettings::default())?;
    let topic = writer.add_topic(NewTopic {
        name: TOPIC.to_owned(),
        ros_type: JointState::INFO.ros_type(),
        schema_encoding: "ros2msg".to_owned(),
        schema: JointState::INFO.definition.to_owned(),
        type_hash: JointState::INFO.type_hash.to_owned(),
        ..NewTopic::default()
    })?;
    for sample in samples {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds, not negative")]
        let time_ns = (sample.time_s * 1e9).round() as u64;
        let state = JointState {
            header: Header { stamp: stamp_of_ns(time_ns), frame_id: String::new() },
            name: vec!["tray".to_owned(), "part".to_owned()],
            velocity: vec![sample.tray_m_s, sample.part_m_s],
            ..JointState::default()
        };
        // CDR, little-endian.
        let data = [&[0, 1, 0, 0], &*feeder_runtime::cdr::encode(&state)?].concat();
        writer.write(topic, time_ns, time_ns, &data)?;
    }
    writer.finish()?;
    Ok(())
}

fn read_csv(file: &Path) -> Result<Vec<VelocitySample>> {
    parse_csv(&std::fs::read(file)?)
}

/// Reads any bytes as a recording; for fuzzers.
pub fn fuzz(input: &[u8]) {
    if let Ok(samples) = parse_csv(input) {
        let _ = kinetic_friction(&samples, STANDARD_GRAVITY_M_S2);
    }
}

fn parse_csv(text: &[u8]) -> Result<Vec<VelocitySample>> {
    let mut reader = csv::Reader::from_reader(text);
    let headers = reader.headers()?.clone();
    let place = |name: &str| headers.iter().position(|header| header.trim() == name);
    let [Some(time), Some(tray), Some(part)] = COLUMNS.map(place) else {
        bail!("the columns are {:?}, wanted are {COLUMNS:?}", headers.iter().collect::<Vec<_>>());
    };
    let mut samples = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record?;
        let number = |column: usize| {
            let text = record.get(column).unwrap_or_default().trim();
            text.parse::<f64>()
                .with_context(|| format!("row {}: {} = {text:?} is no number", row + 2, &headers[column]))
        };
        samples.push(VelocitySample { time_s: number(time)?, tray_m_s: number(tray)?, part_m_s: number(part)? });
    }
    Ok(samples)
}
