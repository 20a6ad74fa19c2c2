//! Filling bags: from a simulated run, or from the ROS graph.

mod graph;
mod run;

pub use graph::{GraphRecorder, GraphSettings, RecordError, TopicCount};
pub use run::record_run;

use minifactory_msgs::TYPES;
use ros2_bags::qos::QosProfile;
use ros2_bags::{Definition, Definitions, NewTopic};

/// Where a recorder finds definitions: this project's messages and the standard ones, and the packages that the
/// environment names.
#[must_use]
pub fn definitions() -> Definitions {
    let known = |info: &minifactory_msgs::TypeInfo| Definition {
        ros_type: info.ros_type(),
        text: info.definition.to_owned(),
        type_hash: info.type_hash.to_owned(),
    };
    Definitions::from_env().with_known(TYPES.iter().map(known))
}

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
