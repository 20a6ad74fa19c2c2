//! Filling bags: from a simulated run, or from the ROS graph.

mod graph;
mod run;

pub use graph::{GraphRecorder, GraphSettings, RecordError, TopicCount};
pub use run::record_run;

use feeder_bags::Definitions;
use feeder_bags::NewTopic;
use feeder_bags::qos::QosProfile;

/// A topic as it is written, with its definition if there is one.
fn described(definitions: &Definitions, name: &str, ros_type: &str, qos: Vec<QosProfile>) -> NewTopic {
    let definition = definitions.look_up(ros_type).unwrap_or_else(|reason| {
        tracing::warn!("{name} is recorded without the definition of {ros_type}: {reason}");
        None
    });
    let (name, ros_type) = (name.to_owned(), ros_type.to_owned());
    match definition {
        Some(definition) => NewTopic {
            name,
            ros_type,
            schema_encoding: "ros2msg".to_owned(),
            schema: definition.text,
            qos,
            type_hash: definition.type_hash,
        },
        None => NewTopic { name, ros_type, qos, ..NewTopic::default() },
    }
}

/// Puts the encapsulation header of plain CDR before a body.
fn with_header(buffer: &mut Vec<u8>, body: &[u8], little_endian: bool) {
    buffer.clear();
    buffer.extend_from_slice(&[0, u8::from(little_endian), 0, 0]);
    buffer.extend_from_slice(body);
}
