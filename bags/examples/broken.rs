//! Writes one broken bag of each kind to a folder: `cargo run -p ros2_bags --example broken -- bags/golden/broken`.
//!
//! Each begins as a good bag of 200 texts and 200 joint states, a millisecond apart, in chunks of 100 messages.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use feeder_runtime::cdr;
use mcap::records::MessageHeader;
use minifactory_msgs::TYPES;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::String as Text;
use ros2_bags::metadata::Metadata;
use ros2_bags::{Definition, Definitions};

const COUNT: u64 = 200;
const STEP_NS: u64 = 1_000_000;
const PER_CHUNK: u64 = 50;
/// Opcode of a chunk.
const CHUNK: u8 = 6;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> ExitCode {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    match folder.ok_or_else(|| "which folder?".into()).and_then(|folder| write_all(&folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn write_all(folder: &Path) -> Outcome<()> {
    fs::create_dir_all(folder)?;
    let good = bag("ros2", "std_msgs/msg/String")?;
    let chunks = chunk_offsets(&good);
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes);
    let changed = |at: usize, bytes: &[u8]| {
        let mut changed = good.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    write("empty.mcap", &[])?;
    write("not_mcap.mcap", b"this is a text, and no bag")?;
    // The version stands in the magic bytes.
    write("future_mcap.mcap", &changed(5, b"1"))?;
    write("truncated.mcap", &good[..chunks[2] + 200])?;
    write("not_closed.mcap", &good[..data_end(&good)])?;
    write("bit_flip_in_chunk.mcap", &changed(chunks[1] + 300, &[good[chunks[1] + 300] ^ 0x10]))?;
    let in_summary = good.len() - 300;
    write("bit_flip_in_summary.mcap", &changed(in_summary, &[good[in_summary] ^ 1]))?;
    // Behind the opcode stands the length of the record; behind that and two times, the size of the unpacked chunk.
    write("huge_length.mcap", &changed(chunks[1] + 1, &(u64::MAX / 2).to_le_bytes()))?;
    write("huge_chunk.mcap", &changed(chunks[1] + 9 + 16, &(1_u64 << 50).to_le_bytes()))?;
    write("wrong_profile.mcap", &bag("ros1", "std_msgs/msg/String")?)?;
    write("duplicate_topic.mcap", &bag("ros2", "minifactory_msgs/msg/WaveformSegment")?)?;

    for (name, version, files) in
        [("missing_metadata", None, 1), ("future_metadata", Some(99), 1), ("missing_file", Some(9), 2)]
    {
        let folder = folder.join(name);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(format!("{name}_0.mcap")), &good)?;
        if let Some(version) = version {
            let file =
                |number| ros2_bags::metadata::FileInfo { path: format!("{name}_{number}.mcap"), ..Default::default() };
            let metadata = Metadata { version, files: (0..files).map(file).collect(), ..Metadata::default() };
            fs::write(folder.join("metadata.yaml"), metadata.to_yaml()?)?;
        }
    }
    Ok(())
}

/// A good file but for the profile; a second type on `/text` is another topic of the same name.
fn bag(profile: &str, second_type: &str) -> Outcome<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().profile(profile).library("examples/broken.rs").chunk_size(None);
    let mut writer = options.compression_threads(0).create(&mut bytes)?;
    let known = TYPES.iter().map(|info| Definition {
        ros_type: info.ros_type(),
        text: info.definition.to_owned(),
        type_hash: info.type_hash.to_owned(),
    });
    let definitions = Definitions::new(Vec::new()).with_known(known);
    let mut channel = |topic: &str, ros_type: &str| -> Outcome<u16> {
        let definition = definitions.look_up(ros_type)?.ok_or("no definition")?;
        let schema = writer.add_schema(ros_type, "ros2msg", definition.text.as_bytes())?;
        let metadata = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), String::new()),
            ("topic_type_hash".to_owned(), definition.type_hash),
        ]);
        Ok(writer.add_channel(schema, topic, "cdr", &metadata)?)
    };
    let texts = channel("/text", "std_msgs/msg/String")?;
    let states = channel("/joints", "sensor_msgs/msg/JointState")?;
    let other = channel("/text", second_type)?;
    for number in 0..COUNT {
        let text = cdr::encode(&Text { data: format!("message {number}") })?;
        let state = cdr::encode(&JointState { position: vec![0.5], ..JointState::default() })?;
        let (log_time, publish_time, sequence) = (number * STEP_NS, number * STEP_NS, 0);
        // Of two types on one topic, each has half of the texts.
        let texts = if other != texts && number >= COUNT / 2 { other } else { texts };
        for (channel_id, body) in [(texts, text), (states, state)] {
            let header = MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &[&[0, 1, 0, 0], &*body].concat())?;
        }
        if (number + 1) % PER_CHUNK == 0 {
            writer.flush()?;
        }
    }
    writer.finish()?;
    drop(writer);
    Ok(bytes.into_inner())
}

/// Opcode, where the record begins and where it ends.
fn records(file: &[u8]) -> Vec<(u8, usize, usize)> {
    let mut records = Vec::new();
    let mut at = mcap::MAGIC.len();
    while let Some(Ok(length)) = file.get(at + 1..at + 9).map(TryInto::try_into) {
        let end = at + 9 + usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX / 2);
        if end > file.len() {
            break;
        }
        records.push((file[at], at, end));
        at = end;
    }
    records
}

fn chunk_offsets(file: &[u8]) -> Vec<usize> {
    records(file).into_iter().filter(|(opcode, ..)| *opcode == CHUNK).map(|(_, at, _)| at).collect()
}

/// Where the record begins that ends the data.
fn data_end(file: &[u8]) -> usize {
    const DATA_END: u8 = 15;
    records(file).into_iter().find(|(opcode, ..)| *opcode == DATA_END).map_or(file.len(), |(_, at, _)| at)
}
