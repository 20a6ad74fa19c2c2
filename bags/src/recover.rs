//! A whole bag from what can be read of a damaged one, or from a whole one for another distribution.

use std::path::Path;

use crate::error::BagError;
use crate::metadata::Metadata;
use crate::qos::parse_profiles;
use crate::read::{Bag, Query};
use crate::write::{BagWriter, NewAttachment, NewTopic, WriteSettings};

/// What was saved.
#[derive(Debug)]
pub struct Recovered {
    /// The new bag.
    pub metadata: Metadata,
    /// What could not be read, beside the [problems](Bag::problems) of the bag.
    pub lost: Vec<BagError>,
}

/// Writes everything of `bag` that can be read to a new bag in `folder`: messages, attachments and metadata records.
///
/// # Errors
/// When the new bag cannot be written.
pub fn recover(bag: &Bag, folder: &Path, settings: &WriteSettings) -> Result<Recovered, BagError> {
    let mut lost = Vec::new();
    let custom_data = bag.metadata().map(|metadata| metadata.custom_data.clone()).unwrap_or_default();
    let mut writer = BagWriter::create(folder, WriteSettings { custom_data, ..settings.clone() })?;
    let (attachments, records) = bag.extras();
    for name in attachments {
        match bag.attachment(name) {
            Ok(Some(data)) => {
                let media_type = "application/octet-stream".to_owned();
                writer.attach(NewAttachment { name: name.to_owned(), media_type, data })?;
            }
            Ok(None) => {}
            Err(error) => lost.push(error),
        }
    }
    for name in records.into_iter().filter(|name| *name != "rosbag2") {
        // Every file of a bag may repeat them.
        if let Some(texts) = bag.records(name).last() {
            writer.add_record(name, texts.clone())?;
        }
    }
    let mut topics = Vec::new();
    for topic in bag.topics() {
        if topic.message_encoding != "cdr" {
            let reason = format!("{} is written as {:?}, not cdr: left out", topic.name, topic.message_encoding);
            lost.push(BagError::invalid(bag.path(), reason));
            topics.push(None);
            continue;
        }
        let qos = parse_profiles(&topic.qos).unwrap_or_else(|reason| {
            lost.push(BagError::invalid(bag.path(), format!("quality of service of {}: {reason}", topic.name)));
            Vec::new()
        });
        topics.push(Some(writer.add_topic(NewTopic {
            name: topic.name.clone(),
            ros_type: topic.ros_type.clone(),
            schema_encoding: topic.schema_encoding.clone(),
            schema: topic.schema.clone(),
            qos,
            type_hash: topic.type_hash.clone(),
        })?));
    }
    for message in bag.messages(&Query::default()) {
        match message {
            Ok(message) => {
                if let Some(topic) = topics[message.topic] {
                    writer.write(topic, message.log_ns, message.publish_ns, &message.data)?;
                }
            }
            Err(error) => lost.push(error),
        }
    }
    Ok(Recovered { metadata: writer.finish()?, lost })
}
