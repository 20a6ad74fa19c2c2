//! What `check` says of bags that break one convention each, and of those that keep to all.

use std::path::Path;

use mcap::records::MessageHeader;
use ros2_bags::check::{Severity, check};
use ros2_bags::{Bag, BagWriter, NewTopic, WriteSettings};

use crate::common::{STEP_NS, definitions, good, text, topic};

/// All that is said of a bag, a line each.
fn said(path: &Path) -> Vec<String> {
    check(&Bag::open(path).unwrap()).iter().map(ToString::to_string).collect()
}

/// When the bags of one topic begin: bags of real clocks do not at 0.
const START_NS: u64 = 1_700_000_000_250_000_000;

/// Writes a bag of one topic with these messages, a millisecond apart.
fn write(folder: &Path, topic: NewTopic, messages: &[Vec<u8>]) {
    let mut writer = BagWriter::create(folder, WriteSettings::default()).unwrap();
    let topic = writer.add_topic(topic).unwrap();
    for (time_ns, data) in (START_NS..).step_by(usize::try_from(STEP_NS).unwrap()).zip(messages) {
        writer.write(topic, time_ns, time_ns, data).unwrap();
    }
    writer.finish().unwrap();
}

/// What is said of such a bag.
fn said_of(topic: NewTopic, messages: &[Vec<u8>]) -> Vec<String> {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    write(&folder, topic, messages);
    said(&folder)
}

#[test]
fn a_good_bag_has_no_findings() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), 20);
    assert_eq!(check(&Bag::open(&folder).unwrap()), []);
}

#[test]
fn names_that_are_no_absolute_ros_names_are_warned_of() {
    for name in ["/text", "/a/b_2", "/_a"] {
        assert_eq!(said_of(topic(name, "std_msgs/msg/String"), &[text(0)]), [""; 0], "{name}");
    }
    for name in ["text", "/", "/a//b", "/2a", "/a/2", "/a-b", "/a b", "/ä"] {
        let expected = format!("warning: {name:?} is no absolute topic name of ROS 2 (REP-144)");
        assert_eq!(said_of(topic(name, "std_msgs/msg/String"), &[text(0)]), [expected]);
    }
}

#[test]
fn what_is_not_known_of_a_topic_is_warned_of_and_what_cannot_be_right_is_an_error() {
    let good = topic("/text", "std_msgs/msg/String");
    let other_hash = definitions().look_up("std_msgs/msg/Header").unwrap().unwrap().type_hash;
    let wrong = format!("error: /text: its type hash is {other_hash}, the definition's is {}", good.type_hash);
    for (altered, expected) in [
        (NewTopic { qos: vec![], ..good.clone() }, "warning: /text: no quality of service is known"),
        (NewTopic { type_hash: String::new(), ..good.clone() }, "warning: /text: its type hash is not known"),
        (NewTopic { type_hash: other_hash, ..good.clone() }, &wrong),
        (
            NewTopic { schema_encoding: String::new(), schema: String::new(), ..good.clone() },
            "warning: /text: the bag has no definition of std_msgs/msg/String",
        ),
        (
            NewTopic { schema_encoding: "ros2idl".to_owned(), ..good.clone() },
            "warning: /text: its definition is in \"ros2idl\"; only ros2msg is checked",
        ),
    ] {
        assert_eq!(said_of(altered, &[text(0)]), [expected]);
    }
    let nonsense = said_of(NewTopic { schema: "string string string".to_owned(), ..good }, &[text(0)]);
    assert!(matches!(&nonsense[..], [only] if only.starts_with("error: /text: ")), "{nonsense:?}");
}

#[test]
fn messages_that_do_not_fit_their_definition_are_named_up_to_three_and_then_counted() {
    let cut = || text(0)[..8].to_vec();
    for (bad, named, more) in [(0, 0, None), (3, 3, None), (4, 3, Some("1 more")), (6, 3, Some("3 more"))] {
        let messages: Vec<_> = [text(1)].into_iter().chain((0..bad).map(|_| cut())).collect();
        let said = said_of(topic("/text", "std_msgs/msg/String"), &messages);
        let (summed, single): (Vec<_>, Vec<_>) = said.iter().partition(|line| line.contains("do not fit"));
        assert_eq!(single.len(), named, "{said:?}");
        assert!(single.iter().all(|line| line.starts_with("error: ") && line.contains("/text")), "{said:?}");
        let expected = more.map(|more| format!("error: /text: {more} messages do not fit their definition"));
        assert_eq!(summed.into_iter().collect::<Vec<_>>(), expected.iter().collect::<Vec<_>>());
    }
    // Without a definition the encapsulation alone can be held against its form.
    let unknown =
        NewTopic { schema_encoding: String::new(), schema: String::new(), ..topic("/text", "std_msgs/msg/String") };
    let said = said_of(unknown, &[vec![0, 9, 0, 0, 1], text(0)]);
    assert_eq!(said.iter().filter(|line| line.starts_with("error: ")).count(), 1, "{said:?}");
}

/// An MCAP file of ten texts, not written by us.
fn foreign(path: &Path, encoding: &str, indexed: bool) {
    let topic = topic("/text", "std_msgs/msg/String");
    let options = mcap::WriteOptions::new().profile("ros2").emit_message_indexes(indexed).emit_chunk_indexes(indexed);
    let mut writer = options.create(std::fs::File::create(path).unwrap()).unwrap();
    let schema = writer.add_schema(&topic.ros_type, &topic.schema_encoding, topic.schema.as_bytes()).unwrap();
    let channel = writer.add_channel(schema, &topic.name, encoding, &std::collections::BTreeMap::new()).unwrap();
    for sequence in 0..10 {
        let time_ns = u64::from(sequence) * STEP_NS;
        let header = MessageHeader { channel_id: channel, sequence, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, &text(0)).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn files_without_an_index_and_messages_that_are_not_cdr_are_told_of() {
    let work = tempfile::tempdir().unwrap();
    let path = work.path().join("a.mcap");
    let of = |encoding, indexed| {
        foreign(&path, encoding, indexed);
        said(&path)
    };
    let index = format!("warning: {}: no index of messages: readers have to read it all", path.display());
    assert!(!of("cdr", true).contains(&index));
    assert!(of("cdr", false).contains(&index));
    let not_cdr = "error: /text: messages are written as \"json\", in ROS 2 as \"cdr\"";
    assert_eq!(of("json", true), [not_cdr]);
}

#[test]
fn what_metadata_tell_otherwise_than_the_files_is_an_error() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    write(&folder, topic("/text", "std_msgs/msg/String"), &(0..20).map(text).collect::<Vec<_>>());
    let path = folder.join("metadata.yaml");
    let told = std::fs::read_to_string(&path).unwrap();
    // The first of each kind stands for the whole bag.
    for (from, to, expected) in [
        ("\n  message_count: 20", "\n  message_count: 21", "message_count 21, the files say 20"),
        (
            "    nanoseconds: 19000000",
            "    nanoseconds: 18000000",
            "duration 0.018000000 s, the files say 0.019000000 s",
        ),
        (
            "    nanoseconds_since_epoch: 1700000000250000000",
            "    nanoseconds_since_epoch: 0",
            "starting_time 0.000000000 s, the files say 1700000000.250000000 s",
        ),
        ("\n    message_count: 20", "\n    message_count: 21", "messages of /text 21, the files say 20"),
        (
            "type: std_msgs/msg/String",
            "type: std_msgs/msg/Bool",
            "std_msgs/msg/Bool, the files say std_msgs/msg/String",
        ),
        ("name: /text", "name: /other", "topic /other, the files say nothing"),
        ("name: /text", "name: /other", "topic nothing, the files say /text"),
    ] {
        assert!(told.contains(from), "{from:?} is not in\n{told}");
        std::fs::write(&path, told.replacen(from, to, 1)).unwrap();
        let findings = check(&Bag::open(&folder).unwrap());
        let said: Vec<_> = findings.iter().map(ToString::to_string).collect();
        assert!(
            said.iter().any(|line| line.starts_with("error: metadata.yaml says ") && line.contains(expected)),
            "{said:?}"
        );
        assert!(findings.iter().all(|finding| finding.severity == Severity::Error), "{said:?}");
    }
}
