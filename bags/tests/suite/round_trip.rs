//! What is written is read.

use std::collections::BTreeMap;

use mcap::records::MessageHeader;
use proptest::prelude::*;
use ros2_bags::metadata::Metadata;
use ros2_bags::{Bag, BagWriter, Compression, Distribution, NewAttachment, NewTopic, Query, WriteSettings};

use crate::common::{STEP_NS, errors, fill, good, messages, text, topic};

#[test]
fn a_bag_for_every_distribution_keeps_to_the_conventions() {
    let work = tempfile::tempdir().unwrap();
    for distribution in Distribution::ALL {
        let folder = work.path().join(distribution.name());
        good(&folder, WriteSettings { distribution, ..WriteSettings::default() }, 50);
        let bag = Bag::open(&folder).unwrap();
        assert_eq!(errors(&bag), [], "{distribution}");
        let metadata = Metadata::read(&folder).unwrap().unwrap();
        assert_eq!(metadata.version, distribution.metadata_version());
        assert_eq!((metadata.message_count, metadata.duration_ns), (100, 49 * STEP_NS));
        assert_eq!(bag.files().map(|file| file.profile().to_owned()).collect::<Vec<_>>(), ["ros2"]);
        assert_eq!(bag.records("rosbag2").count(), 1);
        let names: Vec<String> =
            folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name().to_str().unwrap().to_owned()).collect();
        assert_eq!(names.len(), 2, "{names:?}");
    }
}

#[test]
fn a_bag_is_split_by_size_and_by_time_and_every_part_tells_what_it_is() {
    let work = tempfile::tempdir().unwrap();
    let (by_size, by_time) = (work.path().join("by_size"), work.path().join("by_time"));
    let compression = Compression::None;
    let settings = WriteSettings { compression, split_bytes: Some(2 << 20), ..WriteSettings::default() };
    let mut writer = BagWriter::create(&by_size, settings).unwrap();
    let big = writer.add_topic(topic("/big", "std_msgs/msg/String")).unwrap();
    let payload = crate::common::encoded(&"x".repeat(100_000));
    for number in 0..60 {
        writer.write(big, number, number, &payload).unwrap();
    }
    assert!(writer.finish().unwrap().files.len() >= 3);

    let settings = WriteSettings { split_ns: Some(100 * STEP_NS), ..WriteSettings::default() };
    let mut writer = BagWriter::create(&by_time, settings).unwrap();
    let (name, media_type) = ("scenario.yaml".to_owned(), "application/yaml".to_owned());
    writer.attach(NewAttachment { name, media_type, data: b"seed: 1".to_vec() }).unwrap();
    writer.add_record("run", BTreeMap::from([("seed".to_owned(), "1".to_owned())])).unwrap();
    fill(&mut writer, 250);
    assert_eq!(writer.finish().unwrap().files.len(), 3);

    for (folder, count) in [(&by_size, 60), (&by_time, 500)] {
        let bag = Bag::open(folder).unwrap();
        assert_eq!(errors(&bag), []);
        let read = messages(&bag);
        assert_eq!(read.len(), count);
        assert!(read.windows(2).all(|pair| pair[0].log_ns <= pair[1].log_ns));
    }
    let last = Bag::open(&by_time.join("by_time_2.mcap")).unwrap();
    assert_eq!(last.attachment("scenario.yaml").unwrap().as_deref(), Some(&b"seed: 1"[..]));
    assert_eq!(last.records("run").next().unwrap()["seed"], "1");
    assert_eq!(messages(&last).len(), 100);
}

/// When the writer was called does not show: chunks end by what the messages say.
#[test]
fn a_chunk_holds_a_fifth_of_a_second_of_messages() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), 1000);
    let file = std::fs::read(folder.join("bag_0.mcap")).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let spans = summary.chunk_indexes.iter().map(|chunk| (chunk.message_start_time, chunk.message_end_time));
    // The message that makes it a fifth of a second is the last.
    let steps = |start: u64, end: u64| (start * STEP_NS, end * STEP_NS);
    let expected = [steps(0, 200), steps(200, 400), steps(400, 600), steps(600, 800), steps(800, 999)];
    let ends: Vec<(u64, u64)> = spans.filter(|(_, end)| *end > 0).collect();
    assert_eq!(ends, expected);
}

#[test]
fn a_topic_without_definition_or_message_is_kept() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    let mut writer = BagWriter::create(&folder, WriteSettings::default()).unwrap();
    let (name, ros_type) = ("/unknown".to_owned(), "other_msgs/msg/Thing".to_owned());
    let unknown = writer.add_topic(NewTopic { name, ros_type, ..NewTopic::default() }).unwrap();
    writer.add_topic(topic("/silent", "std_msgs/msg/String")).unwrap();
    writer.write(unknown, 3, 2, &[0, 1, 0, 0, 9]).unwrap();
    writer.finish().unwrap();
    let bag = Bag::open(&folder).unwrap();
    assert_eq!(errors(&bag), []);
    let names: Vec<(&str, u64)> = bag.topics().iter().map(|topic| (topic.name.as_str(), topic.count)).collect();
    assert_eq!(names, [("/silent", 0), ("/unknown", 1)]);
    let read = messages(&bag);
    assert_eq!((read[0].log_ns, read[0].publish_ns, &read[0].data[..]), (3, 2, &[0, 1, 0, 0, 9][..]));
}

#[test]
fn nothing_is_overwritten() {
    let work = tempfile::tempdir().unwrap();
    std::fs::write(work.path().join("precious"), "").unwrap();
    let error = BagWriter::create(work.path(), WriteSettings::default()).err().unwrap().to_string();
    assert!(error.contains("not empty"), "{error}");
}

/// As other writers leave it: without chunks, or with chunks that overlap in time.
#[test]
fn messages_come_in_the_order_of_their_times_however_they_lie_in_the_file() {
    let work = tempfile::tempdir().unwrap();
    for (name, chunks) in [("plain.mcap", false), ("chunks.mcap", true)] {
        let path = work.path().join(name);
        let options = mcap::WriteOptions::new().profile("ros2").use_chunks(chunks).chunk_size(Some(500));
        let mut writer = options.create(std::fs::File::create(&path).unwrap()).unwrap();
        let described = topic("/text", "std_msgs/msg/String");
        let schema = writer.add_schema(&described.ros_type, "ros2msg", described.schema.as_bytes()).unwrap();
        let channel_id = writer.add_channel(schema, "/text", "cdr", &BTreeMap::new()).unwrap();
        // 977 is prime to 1000: every time once, out of order.
        for number in 0..1000_u64 {
            let log_time = number * 977 % 1000;
            let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &text(log_time)).unwrap();
        }
        writer.finish().unwrap();
        let bag = Bag::open(&path).unwrap();
        assert_eq!(bag.problems().len(), 0, "{:?}", bag.problems());
        let read = messages(&bag);
        assert!(read.iter().map(|message| message.log_ns).eq(0..1000), "{name}");
        assert!(read.iter().all(|message| message.data == text(message.log_ns)));
        let part = Query { start_ns: 100, end_ns: 199, ..Query::default() };
        assert!(bag.messages(&part).map(|message| message.unwrap().log_ns).eq(100..200), "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]
    #[test]
    fn every_message_comes_back(
        written in prop::collection::vec((0_usize..3, 0_u64..1000, prop::collection::vec(any::<u8>(), 0..400)), 0..60),
        compression in prop::sample::select(vec![Compression::None, Compression::Lz4, Compression::Zstd]),
        split_bytes in prop::option::of(1_u64..20_000),
    ) {
        let work = tempfile::tempdir().unwrap();
        let folder = work.path().join("bag");
        let settings = WriteSettings { compression, split_bytes, ..WriteSettings::default() };
        let mut writer = BagWriter::create(&folder, settings).unwrap();
        let names = ["/a", "/b", "/c"];
        let topics = names.map(|name| writer.add_topic(topic(name, "std_msgs/msg/String")).unwrap());
        for (topic, time_ns, data) in &written {
            writer.write(topics[*topic], *time_ns, time_ns + 1, data).unwrap();
        }
        let metadata = writer.finish().unwrap();
        prop_assert_eq!(metadata.message_count, written.len() as u64);
        let bag = Bag::open(&folder).unwrap();
        prop_assert_eq!(bag.problems().len(), 0, "{:?}", bag.problems());
        let mut expected: Vec<_> = written.into_iter().map(|(topic, time, data)| (time, names[topic], data)).collect();
        expected.sort_by_key(|(time, ..)| *time);
        let read: Vec<_> = messages(&bag).into_iter()
            .map(|message| (message.log_ns, bag.topics()[message.topic].name.clone(), message.data.to_vec())).collect();
        prop_assert_eq!(read.len(), expected.len());
        for (read, expected) in read.iter().zip(&expected) {
            prop_assert_eq!((read.0, &*read.1, &read.2), (expected.0, expected.1, &expected.2));
        }
    }
}
