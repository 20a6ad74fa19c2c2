//! Bags that are not as they should be: an error or a warning with file and place, the rest, and never a panic.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use ros2_bags::qos::{Durability, QosProfile, Reliability};
use ros2_bags::recover::recover;
use ros2_bags::{Bag, BagWriter, Compression, NewAttachment, NewTopic, Query, RecordedMessage, WriteSettings};

use crate::common::{STEP_NS, errors, fill, good, text, topic};

/// Text and joint states in the broken files that lie beside this crate, made by `examples/broken.rs`.
const WRITTEN: usize = 400;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/broken").join(name)
}

fn readable(bag: &Bag) -> Vec<RecordedMessage> {
    bag.messages(&Query::default()).filter_map(Result::ok).collect()
}

/// What is said, and how much is read all the same.
#[track_caller]
fn broken(name: &str, said: &[&str], read_min: usize) {
    let path = golden(name);
    let (told, read) = match Bag::open(&path) {
        Err(error) => (error.to_string(), 0),
        Ok(bag) => {
            let mut told: Vec<String> = bag.problems().iter().map(ToString::to_string).collect();
            told.extend(bag.messages(&Query::default()).filter_map(Result::err).map(|error| error.to_string()));
            (told.join("\n"), readable(&bag).len())
        }
    };
    for part in said {
        assert!(told.contains(part), "{name}: {part:?} is not in {told}");
    }
    assert!(read >= read_min && read <= WRITTEN, "{name}: {read} messages read, at least {read_min} should be\n{told}");
    if read_min > 0 {
        let work = tempfile::tempdir().unwrap();
        let folder = work.path().join("recovered");
        recover(&Bag::open(&path).unwrap(), &folder, &WriteSettings::default()).unwrap();
        let bag = Bag::open(&folder).unwrap();
        assert_eq!(errors(&bag), [], "{name}");
        assert_eq!(readable(&bag).len(), read, "{name}");
    }
}

#[test]
fn every_kind_of_broken_file_is_named_with_its_place_and_the_rest_is_read() {
    broken("empty.mcap", &["empty.mcap: at byte 0: the file is empty"], 0);
    broken("not_mcap.mcap", &["not_mcap.mcap: at byte 0", "magic"], 0);
    broken("future_mcap.mcap", &["at byte 0", "version '1'"], 0);
    broken("truncated.mcap", &["truncated.mcap: at byte", "beyond the end of the file"], 100);
    broken("not_closed.mcap", &["not_closed.mcap: at byte", "without a summary"], WRITTEN);
    broken("bit_flip_in_chunk.mcap", &["bit_flip_in_chunk.mcap: at byte", "chunk"], 200);
    broken("bit_flip_in_summary.mcap", &["at byte", "summary's checksum"], WRITTEN);
    broken("huge_length.mcap", &["huge_length.mcap: at byte", "beyond the end of the file"], 200);
    broken("huge_chunk.mcap", &["huge_chunk.mcap: at byte", "bytes"], 200);
    broken("wrong_profile.mcap", &["the profile is \"ros1\""], WRITTEN);
    broken("duplicate_topic.mcap", &["topic /text is there twice"], WRITTEN / 2);
    broken("missing_metadata", &["metadata.yaml is missing"], WRITTEN);
    broken("future_metadata", &["metadata.yaml: version 99"], WRITTEN);
    broken("missing_file", &["missing_file_1.mcap: metadata.yaml names this file, but it is not there"], WRITTEN);
}

/// All that a bag says of itself, and all that is in it.
fn whole(bag: &Bag) -> impl PartialEq + std::fmt::Debug + use<> {
    let (attachments, records) = bag.extras();
    let attached: Vec<_> =
        attachments.iter().map(|name| (name.to_string(), bag.attachment(name).unwrap().unwrap())).collect();
    let named = records.iter().filter(|name| **name != "rosbag2");
    let records: Vec<_> = named.map(|name| (name.to_string(), bag.records(name).last().unwrap().clone())).collect();
    let topics = bag.topics().to_vec();
    let custom = bag.metadata().map(|metadata| metadata.custom_data.clone());
    let messages: Vec<_> = readable(bag)
        .into_iter()
        .map(|message| (message.topic, message.log_ns, message.publish_ns, message.data))
        .collect();
    (attached, records, topics, custom, messages)
}

/// Quality of service, hashes, definitions, attachments, records and both times are what they were.
#[test]
fn what_is_recovered_is_all_that_was_recorded() {
    let work = tempfile::tempdir().unwrap();
    let [written, recovered] = ["written", "recovered"].map(|name| work.path().join(name));
    let custom_data = BTreeMap::from([("robot".to_owned(), "cell 7".to_owned())]);
    let mut writer = BagWriter::create(&written, WriteSettings { custom_data, ..WriteSettings::default() }).unwrap();
    for (name, data) in [("plan.yaml", "seed: 1"), ("notes", "")] {
        let (name, media_type) = (name.to_owned(), "application/octet-stream".to_owned());
        writer.attach(NewAttachment { name, media_type, data: data.into() }).unwrap();
    }
    writer.add_record("run", BTreeMap::from([("seed".to_owned(), "1".to_owned())])).unwrap();
    let offered =
        |depth, reliability, durability| QosProfile { depth, reliability, durability, ..QosProfile::default() };
    let latched = offered(1, Reliability::Reliable, Durability::TransientLocal);
    let passing = offered(10, Reliability::BestEffort, Durability::Volatile);
    let qos = [vec![latched], vec![latched, passing]];
    let topics: Vec<usize> = ["/a", "/b"]
        .into_iter()
        .zip(qos)
        .map(|(name, qos)| writer.add_topic(NewTopic { qos, ..topic(name, "std_msgs/msg/String") }).unwrap())
        .collect();
    for number in 0..200 {
        // Published before they were recorded, and later ones sometimes earlier than others.
        let log_ns = number * STEP_NS;
        writer
            .write(topics[usize::from(number % 3 == 0)], log_ns, log_ns - 7 * (number % 5).min(log_ns), &text(number))
            .unwrap();
    }
    writer.finish().unwrap();
    let before = whole(&Bag::open(&written).unwrap());
    // Without its summary and the end of its last chunk the file is one that nobody closed; by its chunks nothing is lost.
    let file = written.join("written_0.mcap");
    let bytes = std::fs::read(&file).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let end = summary.chunk_indexes.iter().map(|chunk| chunk.chunk_start_offset + chunk.chunk_length).max().unwrap();
    std::fs::write(&file, &bytes[..usize::try_from(end).unwrap()]).unwrap();
    let damaged = Bag::open(&written).unwrap();
    assert!(!damaged.problems().is_empty());
    recover(&damaged, &recovered, &WriteSettings::default()).unwrap();
    assert_eq!(whole(&Bag::open(&recovered).unwrap()), before);
}

/// As kill −9 leaves a bag: whole chunks, and nothing behind them.
#[test]
fn what_was_flushed_is_recovered_from_a_bag_that_was_not_closed() {
    let work = tempfile::tempdir().unwrap();
    let (killed, whole) = (work.path().join("killed"), work.path().join("whole"));
    let mut writer = BagWriter::create(&killed, WriteSettings::default()).unwrap();
    fill(&mut writer, 20_000);
    std::mem::forget(writer);
    let recovered = recover(&Bag::open(&killed).unwrap(), &whole, &WriteSettings::default()).unwrap();
    assert!(recovered.lost.is_empty(), "{:?}", recovered.lost);
    // The chunk that was open is lost: at most a megabyte, or half a second.
    assert!(recovered.metadata.message_count >= 20_000, "{}", recovered.metadata.message_count);
    let bag = Bag::open(&whole).unwrap();
    assert_eq!(errors(&bag), []);
    for (number, pair) in (0_u64..).zip(readable(&bag).chunks(2)) {
        assert!(pair.iter().all(|message| message.log_ns == number * crate::common::STEP_NS));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]
    /// Bits turned over, bytes lost, the end cut off: there is an answer, it is no panic, and recovery gives a good bag.
    #[test]
    fn no_damage_is_too_much(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0_u8..8), 0..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
        removed in prop::option::of((any::<prop::sample::Index>(), 1_usize..50)),
        compression in prop::sample::select(vec![Compression::None, Compression::Lz4, Compression::Zstd]),
    ) {
        let work = tempfile::tempdir().unwrap();
        let folder = work.path().join("bag");
        good(&folder, WriteSettings { compression, ..WriteSettings::default() }, 30);
        let file = folder.join("bag_0.mcap");
        let mut bytes = std::fs::read(&file).unwrap();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        if let Some((at, count)) = removed {
            let at = at.index(bytes.len());
            bytes.drain(at..(at + count).min(bytes.len()));
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len().max(1)));
        }
        std::fs::write(&file, bytes).unwrap();
        if let Ok(bag) = Bag::open(&folder) {
            let read = readable(&bag).len();
            prop_assert!(read <= 60);
            let _ = ros2_bags::check::check(&bag);
            let again = work.path().join("again");
            let recovered = recover(&bag, &again, &WriteSettings::default()).unwrap();
            prop_assert!(recovered.metadata.message_count <= read as u64);
            prop_assert_eq!(Bag::open(&again).unwrap().problems().len(), 0);
        }
    }

    /// Files that never were bags.
    #[test]
    fn foreign_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let work = tempfile::tempdir().unwrap();
        for start in [&[][..], mcap::MAGIC] {
            let file = work.path().join("x.mcap");
            std::fs::write(&file, [start, &bytes].concat()).unwrap();
            if let Ok(bag) = Bag::open(&file) {
                readable(&bag);
            }
        }
    }
}
