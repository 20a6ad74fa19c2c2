//! Bags to begin with.

use std::path::Path;

use feeder_runtime::cdr;
use minifactory_msgs::TYPES;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::String as Text;
use ros2_bags::check::{Finding, Severity, check};
use ros2_bags::{Bag, BagWriter, Definition, Definitions, NewTopic, Query, RecordedMessage, WriteSettings};

pub(crate) const STEP_NS: u64 = 1_000_000;

/// The messages that the tests write.
pub(crate) fn definitions() -> Definitions {
    let known = TYPES.iter().map(|info| Definition {
        ros_type: info.ros_type(),
        text: info.definition.to_owned(),
        type_hash: info.type_hash.to_owned(),
    });
    Definitions::new(Vec::new()).with_known(known)
}

/// A topic of a known type.
pub(crate) fn topic(name: &str, ros_type: &str) -> NewTopic {
    let definition = definitions().look_up(ros_type).unwrap().unwrap();
    NewTopic {
        name: name.to_owned(),
        ros_type: ros_type.to_owned(),
        schema_encoding: "ros2msg".to_owned(),
        schema: definition.text,
        qos: vec![ros2_bags::qos::QosProfile::default()],
        type_hash: definition.type_hash,
    }
}

/// A message as bags hold it.
pub(crate) fn encoded<T: serde::Serialize>(message: &T) -> Vec<u8> {
    [&[0, 1, 0, 0], &*cdr::encode(message).unwrap()].concat()
}

pub(crate) fn text(number: u64) -> Vec<u8> {
    encoded(&Text { data: format!("message {number}") })
}

#[expect(clippy::cast_precision_loss, reason = "small numbers")]
pub(crate) fn joints(number: u64) -> Vec<u8> {
    let position = vec![number as f64, 0.5];
    encoded(&JointState { name: vec!["x".into(), "y".into()], position, ..JointState::default() })
}

/// Writes `count` texts and joint states, a millisecond apart, and flushes every `per_chunk` of them.
pub(crate) fn fill(writer: &mut BagWriter, count: u64) {
    let texts = writer.add_topic(topic("/text", "std_msgs/msg/String")).unwrap();
    let states = writer.add_topic(topic("/joints", "sensor_msgs/msg/JointState")).unwrap();
    for number in 0..count {
        let time_ns = number * STEP_NS;
        writer.write(texts, time_ns, time_ns, &text(number)).unwrap();
        writer.write(states, time_ns, time_ns, &joints(number)).unwrap();
    }
}

/// A good bag in a folder of its own.
pub(crate) fn good(folder: &Path, settings: WriteSettings, count: u64) {
    let mut writer = BagWriter::create(folder, settings).unwrap();
    fill(&mut writer, count);
    writer.finish().unwrap();
}

pub(crate) fn messages(bag: &Bag) -> Vec<RecordedMessage> {
    bag.messages(&Query::default()).collect::<Result<_, _>>().unwrap()
}

pub(crate) fn errors(bag: &Bag) -> Vec<Finding> {
    check(bag).into_iter().filter(|finding| finding.severity == Severity::Error).collect()
}
