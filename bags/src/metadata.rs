//! `metadata.yaml`, as rosbag2 writes it beside a bag's files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::distribution::{Distribution, METADATA_WITH_WORDS, NEWEST_METADATA};
use crate::error::BagError;
use crate::qos::{QosProfile, QosYaml, parse_profiles, to_text};

/// Name of the file.
pub const FILE_NAME: &str = "metadata.yaml";
/// A file that is larger is not read.
const FILE_BYTES_MAX: u64 = 64 << 20;

/// What is known of a bag as a whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Metadata {
    /// Version of the file's form.
    pub version: u32,
    /// The files, in order, beside their own times and counts.
    pub files: Vec<FileInfo>,
    /// Time of the first message, ns.
    pub start_ns: u64,
    /// From the first message to the last, ns.
    pub duration_ns: u64,
    /// Number of messages.
    pub message_count: u64,
    /// The topics.
    pub topics: Vec<TopicInfo>,
    /// Free pairs of names and texts, from version 6.
    pub custom_data: BTreeMap<String, String>,
    /// Distribution the bag was written for, from version 8.
    pub ros_distro: String,
}

/// A file of a bag.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FileInfo {
    /// Its name, in the bag's folder.
    pub path: String,
    /// Time of its first message, ns.
    pub start_ns: u64,
    /// From its first message to its last, ns.
    pub duration_ns: u64,
    /// Number of its messages.
    pub message_count: u64,
}

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TopicInfo {
    /// Its name.
    pub name: String,
    /// Its type, `package/msg/Name`.
    pub ros_type: String,
    /// How its messages are written: `cdr`.
    pub serialization_format: String,
    /// What its publishers offer.
    pub qos: Vec<QosProfile>,
    /// Hash of its type (REP-2011), from version 7; empty when not known.
    pub type_hash: String,
    /// Number of its messages.
    pub message_count: u64,
}

impl Metadata {
    /// Reads the file in `folder`, if there is one.
    ///
    /// # Errors
    /// [`BagError::Invalid`] naming the file when it is not one, or of a newer version.
    pub fn read(folder: &Path) -> Result<Option<Self>, BagError> {
        let path = folder.join(FILE_NAME);
        let length = match std::fs::metadata(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            other => other.map_err(BagError::io(&path))?.len(),
        };
        if length > FILE_BYTES_MAX {
            return Err(BagError::invalid(&path, format!("{length} bytes are too many, at most {FILE_BYTES_MAX}")));
        }
        let text = std::fs::read_to_string(&path).map_err(BagError::io(&path))?;
        Self::parse(&text).map(Some).map_err(|reason| BagError::invalid(&path, reason))
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let root: Root = serde_saphyr::from_str(text).map_err(|error| error.to_string())?;
        let yaml = root.rosbag2_bagfile_information;
        if yaml.version > NEWEST_METADATA {
            let version = yaml.version;
            return Err(format!("version {version} is newer than {NEWEST_METADATA}, the newest that can be read"));
        }
        if yaml.storage_identifier != "mcap" {
            let reason = "cannot be read, only \"mcap\"; ros2 bag convert makes one of the other";
            return Err(format!("storage {:?} {reason}", yaml.storage_identifier));
        }
        if !yaml.compression_mode.is_empty() && !yaml.compression_mode.eq_ignore_ascii_case("none") {
            let mode = yaml.compression_mode;
            return Err(format!("compression mode {mode:?} cannot be read, only MCAP's own compression of chunks"));
        }
        yaml.into_metadata()
    }

    /// The text of the file.
    ///
    /// # Errors
    /// What the YAML library says.
    pub fn to_yaml(&self) -> Result<String, String> {
        let root = Root { rosbag2_bagfile_information: Yaml::new(self)? };
        serde_saphyr::to_string(&root).map_err(|error| error.to_string())
    }

    /// The text that a file's own metadata record carries: the same without the root key.
    pub(crate) fn to_serialized(&self) -> Result<String, String> {
        serde_saphyr::to_string(&Yaml::new(self)?).map_err(|error| error.to_string())
    }

    /// Metadata of an empty bag for `distribution`.
    pub(crate) fn empty(distribution: Distribution) -> Self {
        let (version, ros_distro) = (distribution.metadata_version(), distribution.name().to_owned());
        Self { version, ros_distro, ..Self::default() }
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Root {
    rosbag2_bagfile_information: Yaml,
}

#[derive(Debug, Serialize, Deserialize)]
struct Yaml {
    version: u32,
    storage_identifier: String,
    duration: Nanoseconds,
    starting_time: SinceEpoch,
    message_count: u64,
    topics_with_message_count: Vec<TopicYaml>,
    #[serde(default)]
    compression_format: String,
    #[serde(default)]
    compression_mode: String,
    relative_file_paths: Vec<String>,
    #[serde(default)]
    files: Option<Vec<FileYaml>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    custom_data: Option<BTreeMap<String, String>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ros_distro: Option<String>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Nanoseconds {
    nanoseconds: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct SinceEpoch {
    nanoseconds_since_epoch: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileYaml {
    path: String,
    starting_time: SinceEpoch,
    duration: Nanoseconds,
    message_count: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct TopicYaml {
    topic_metadata: TopicMetadata,
    message_count: u64,
}

#[derive(Debug, Serialize, Deserialize)]
struct TopicMetadata {
    name: String,
    #[serde(rename = "type")]
    ros_type: String,
    serialization_format: String,
    #[serde(default)]
    offered_qos_profiles: Option<Offered>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    type_description_hash: Option<String>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Offered {
    Text(String),
    List(Vec<QosYaml>),
}

impl Yaml {
    fn new(metadata: &Metadata) -> Result<Self, String> {
        let version = metadata.version;
        let topic = |topic: &TopicInfo| -> Result<TopicYaml, String> {
            let offered = if version < METADATA_WITH_WORDS {
                Offered::Text(to_text(&topic.qos, version)?)
            } else {
                Offered::List(topic.qos.iter().map(|profile| QosYaml::new(profile, version)).collect())
            };
            Ok(TopicYaml {
                topic_metadata: TopicMetadata {
                    name: topic.name.clone(),
                    ros_type: topic.ros_type.clone(),
                    serialization_format: topic.serialization_format.clone(),
                    offered_qos_profiles: Some(offered),
                    type_description_hash: (version >= 7).then(|| topic.type_hash.clone()),
                },
                message_count: topic.message_count,
            })
        };
        let file = |file: &FileInfo| FileYaml {
            path: file.path.clone(),
            starting_time: SinceEpoch { nanoseconds_since_epoch: file.start_ns },
            duration: Nanoseconds { nanoseconds: file.duration_ns },
            message_count: file.message_count,
        };
        Ok(Self {
            version,
            storage_identifier: "mcap".to_owned(),
            duration: Nanoseconds { nanoseconds: metadata.duration_ns },
            starting_time: SinceEpoch { nanoseconds_since_epoch: metadata.start_ns },
            message_count: metadata.message_count,
            topics_with_message_count: metadata.topics.iter().map(topic).collect::<Result<_, _>>()?,
            compression_format: String::new(),
            compression_mode: String::new(),
            relative_file_paths: metadata.files.iter().map(|file| file.path.clone()).collect(),
            files: Some(metadata.files.iter().map(file).collect()),
            custom_data: (version >= 6).then(|| metadata.custom_data.clone()),
            ros_distro: (version >= 8).then(|| metadata.ros_distro.clone()),
        })
    }

    fn into_metadata(self) -> Result<Metadata, String> {
        let topic = |yaml: TopicYaml| -> Result<TopicInfo, String> {
            let meta = yaml.topic_metadata;
            let qos = match meta.offered_qos_profiles {
                None => Ok(Vec::new()),
                Some(Offered::Text(text)) => parse_profiles(&text),
                Some(Offered::List(list)) => list.iter().map(|yaml| yaml.over(QosProfile::default())).collect(),
            };
            Ok(TopicInfo {
                qos: qos.map_err(|error| format!("offered_qos_profiles of {}: {error}", meta.name))?,
                name: meta.name,
                ros_type: meta.ros_type,
                serialization_format: meta.serialization_format,
                type_hash: meta.type_description_hash.unwrap_or_default(),
                message_count: yaml.message_count,
            })
        };
        let known: BTreeMap<String, FileYaml> =
            self.files.unwrap_or_default().into_iter().map(|file| (file.path.clone(), file)).collect();
        let file = |path: String| match known.get(&path) {
            None => FileInfo { path, ..FileInfo::default() },
            Some(file) => FileInfo {
                start_ns: file.starting_time.nanoseconds_since_epoch,
                duration_ns: file.duration.nanoseconds,
                message_count: file.message_count,
                path,
            },
        };
        Ok(Metadata {
            version: self.version,
            files: self.relative_file_paths.into_iter().map(file).collect(),
            start_ns: self.starting_time.nanoseconds_since_epoch,
            duration_ns: self.duration.nanoseconds,
            message_count: self.message_count,
            topics: self.topics_with_message_count.into_iter().map(topic).collect::<Result<_, _>>()?,
            custom_data: self.custom_data.unwrap_or_default(),
            ros_distro: self.ros_distro.unwrap_or_default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metadata(distribution: Distribution) -> Metadata {
        let topic = TopicInfo {
            name: "/x".to_owned(),
            ros_type: "std_msgs/msg/String".to_owned(),
            serialization_format: "cdr".to_owned(),
            qos: vec![QosProfile::default()],
            type_hash: if distribution == Distribution::Humble { String::new() } else { "RIHS01_0".to_owned() },
            message_count: 3,
        };
        let file = FileInfo { path: "b_0.mcap".to_owned(), start_ns: 5, duration_ns: 7, message_count: 3 };
        let custom =
            if distribution == Distribution::Humble { vec![] } else { vec![("k".to_owned(), "v: 1".to_owned())] };
        Metadata {
            files: vec![file],
            start_ns: 5,
            duration_ns: 7,
            message_count: 3,
            topics: vec![topic],
            custom_data: custom.into_iter().collect(),
            ros_distro: if distribution.metadata_version() >= 8 { distribution.to_string() } else { String::new() },
            ..Metadata::empty(distribution)
        }
    }

    #[test]
    fn every_distributions_file_is_written_and_read() {
        for distribution in Distribution::ALL {
            let metadata = metadata(distribution);
            let text = metadata.to_yaml().unwrap();
            assert_eq!(Metadata::parse(&text).unwrap(), metadata, "{text}");
            assert_eq!(text.contains("ros_distro"), distribution.metadata_version() >= 8);
            assert_eq!(text.contains("type_description_hash"), distribution.metadata_version() >= 7);
            assert_eq!(text.contains("custom_data"), distribution.metadata_version() >= 6);
        }
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_its_reason() {
        let good = metadata(Distribution::Jazzy).to_yaml().unwrap();
        for (from, to, reason) in [
            ("version: 9", "version: 10", "version 10"),
            ("storage_identifier: mcap", "storage_identifier: sqlite3", "ros2 bag convert"),
            ("rosbag2_bagfile_information", "something_else", "rosbag2_bagfile_information"),
            ("reliability: reliable", "reliability: perhaps", "perhaps"),
            ("version: 9", "version: many", "many"),
        ] {
            assert!(good.contains(from), "{good}");
            let error = Metadata::parse(&good.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
        assert!(Metadata::parse("").is_err());
    }
}
