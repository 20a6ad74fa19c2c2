//! Quality of service as bags carry it: YAML, with numbers up to version 8 of the metadata, with words from 9.

use serde::{Deserialize, Serialize};

use crate::distribution::METADATA_WITH_WORDS;

/// A policy with its name and its number in `rmw/types.h`.
macro_rules! policy {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $number:literal $word:literal,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum $name { $($(#[$variant_doc])* $variant,)* }

        impl $name {
            fn yaml(self, version: u32) -> Policy {
                match self {
                    $(Self::$variant if version < METADATA_WITH_WORDS => Policy::Number($number),)*
                    $(Self::$variant => Policy::Word($word.to_owned()),)*
                }
            }

            fn parse(policy: &Policy) -> Result<Self, String> {
                match policy {
                    $(Policy::Number($number) => Ok(Self::$variant),)*
                    $(Policy::Word(word) if word == $word => Ok(Self::$variant),)*
                    other => Err(format!("{} is no {}", other, stringify!($name))),
                }
            }

            /// Its name as ROS writes it.
            #[must_use]
            pub fn word(self) -> &'static str {
                match self { $(Self::$variant => $word,)* }
            }
        }
    };
}

policy!(
    /// Which samples a writer keeps for readers.
    History {
        /// What the middleware does without being told.
        SystemDefault = 0 "system_default",
        /// The last few.
        KeepLast = 1 "keep_last",
        /// All.
        KeepAll = 2 "keep_all",
        /// Not known: discovery does not carry it.
        Unknown = 3 "unknown",
    }
);

policy!(
    /// Whether lost samples are sent again.
    Reliability {
        /// What the middleware does without being told.
        SystemDefault = 0 "system_default",
        /// Yes.
        Reliable = 1 "reliable",
        /// No.
        BestEffort = 2 "best_effort",
        /// Not known.
        Unknown = 3 "unknown",
        /// As the other end offers.
        BestAvailable = 4 "best_available",
    }
);

policy!(
    /// Whether late readers get earlier samples.
    Durability {
        /// What the middleware does without being told.
        SystemDefault = 0 "system_default",
        /// Yes, as long as the writer lives.
        TransientLocal = 1 "transient_local",
        /// No.
        Volatile = 2 "volatile",
        /// Not known.
        Unknown = 3 "unknown",
        /// As the other end offers.
        BestAvailable = 4 "best_available",
    }
);

policy!(
    /// How a writer shows that it lives.
    Liveliness {
        /// What the middleware does without being told.
        SystemDefault = 0 "system_default",
        /// By being there.
        Automatic = 1 "automatic",
        /// By the node's word; deprecated.
        ManualByNode = 2 "manual_by_node",
        /// By the writer's word.
        ManualByTopic = 3 "manual_by_topic",
        /// Not known.
        Unknown = 4 "unknown",
        /// As the other end offers.
        BestAvailable = 5 "best_available",
    }
);

/// A duration of a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct PolicyTime {
    /// Seconds.
    pub sec: u64,
    /// Nanoseconds.
    pub nsec: u64,
}

impl PolicyTime {
    /// `RMW_DURATION_INFINITE`.
    pub const INFINITE: Self = Self { sec: 9_223_372_036, nsec: 854_775_807 };
}

impl Default for PolicyTime {
    fn default() -> Self {
        Self::INFINITE
    }
}

/// The quality of service that a publisher offers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct QosProfile {
    /// Which samples are kept.
    pub history: History,
    /// How many, with [`History::KeepLast`].
    pub depth: u64,
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// Whether late readers get earlier samples.
    pub durability: Durability,
    /// Longest time between samples.
    pub deadline: PolicyTime,
    /// How long a sample is good for.
    pub lifespan: PolicyTime,
    /// How a writer shows that it lives.
    pub liveliness: Liveliness,
    /// Longest time between signs of life.
    pub liveliness_lease_duration: PolicyTime,
    /// Whether the topic's DDS name is its ROS name.
    pub avoid_ros_namespace_conventions: bool,
}

impl Default for QosProfile {
    /// `rmw_qos_profile_default`: reliable, volatile, the last 10.
    fn default() -> Self {
        Self {
            history: History::KeepLast,
            depth: 10,
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            deadline: PolicyTime::INFINITE,
            lifespan: PolicyTime::INFINITE,
            liveliness: Liveliness::Automatic,
            liveliness_lease_duration: PolicyTime::INFINITE,
            avoid_ros_namespace_conventions: false,
        }
    }
}

/// A policy in YAML.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
enum Policy {
    Number(u32),
    Word(String),
}

impl std::fmt::Display for Policy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Word(word) => write!(f, "{word:?}"),
        }
    }
}

/// A profile in YAML, in the order in which rosbag2 writes it. In a file of overrides any key may be left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct QosYaml {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    history: Option<Policy>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    depth: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reliability: Option<Policy>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    durability: Option<Policy>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    deadline: Option<PolicyTime>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lifespan: Option<PolicyTime>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    liveliness: Option<Policy>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    liveliness_lease_duration: Option<PolicyTime>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    avoid_ros_namespace_conventions: Option<bool>,
}

impl QosYaml {
    pub(crate) fn new(profile: &QosProfile, version: u32) -> Self {
        Self {
            history: Some(profile.history.yaml(version)),
            depth: Some(profile.depth),
            reliability: Some(profile.reliability.yaml(version)),
            durability: Some(profile.durability.yaml(version)),
            deadline: Some(profile.deadline),
            lifespan: Some(profile.lifespan),
            liveliness: Some(profile.liveliness.yaml(version)),
            liveliness_lease_duration: Some(profile.liveliness_lease_duration),
            avoid_ros_namespace_conventions: Some(profile.avoid_ros_namespace_conventions),
        }
    }

    /// The profile that this makes of `base`.
    ///
    /// # Errors
    /// The policy that is none.
    pub(crate) fn over(&self, base: QosProfile) -> Result<QosProfile, String> {
        fn parsed<T>(yaml: Option<&Policy>, base: T, parse: fn(&Policy) -> Result<T, String>) -> Result<T, String> {
            yaml.map_or(Ok(base), parse)
        }
        let avoid = self.avoid_ros_namespace_conventions.unwrap_or(base.avoid_ros_namespace_conventions);
        Ok(QosProfile {
            history: parsed(self.history.as_ref(), base.history, History::parse)?,
            depth: self.depth.unwrap_or(base.depth),
            reliability: parsed(self.reliability.as_ref(), base.reliability, Reliability::parse)?,
            durability: parsed(self.durability.as_ref(), base.durability, Durability::parse)?,
            deadline: self.deadline.unwrap_or(base.deadline),
            lifespan: self.lifespan.unwrap_or(base.lifespan),
            liveliness: parsed(self.liveliness.as_ref(), base.liveliness, Liveliness::parse)?,
            liveliness_lease_duration: self.liveliness_lease_duration.unwrap_or(base.liveliness_lease_duration),
            avoid_ros_namespace_conventions: avoid,
        })
    }
}

/// Profiles as the text that channels carry.
///
/// # Errors
/// What the YAML library says.
pub(crate) fn to_text(profiles: &[QosProfile], version: u32) -> Result<String, String> {
    let yaml: Vec<QosYaml> = profiles.iter().map(|profile| QosYaml::new(profile, version)).collect();
    serde_saphyr::to_string(&yaml).map_err(|error| error.to_string())
}

/// The profiles in a channel's text; none when it is empty.
///
/// # Errors
/// What is wrong with it.
pub fn parse_profiles(text: &str) -> Result<Vec<QosProfile>, String> {
    if text.trim().is_empty() {
        return Ok(Vec::new());
    }
    let yaml: Vec<QosYaml> = serde_saphyr::from_str(text).map_err(|error| error.to_string())?;
    yaml.iter().map(|profile| profile.over(QosProfile::default())).collect()
}

/// The profiles in a file that overrides those of a bag: topic → profile, as rosbag2 reads it.
///
/// # Errors
/// What is wrong with it.
pub fn parse_overrides(text: &str) -> Result<std::collections::BTreeMap<String, QosOverride>, String> {
    let yaml: std::collections::BTreeMap<String, QosYaml> =
        serde_saphyr::from_str(text).map_err(|error| error.to_string())?;
    yaml.into_iter()
        .map(|(topic, profile)| {
            profile.over(QosProfile::default()).map_err(|error| format!("{topic}: {error}"))?;
            Ok((topic, QosOverride(profile)))
        })
        .collect()
}

/// What a file says of one topic.
#[derive(Debug, Clone, PartialEq)]
pub struct QosOverride(QosYaml);

impl QosOverride {
    /// `base` with what the file says in its place.
    #[must_use]
    pub fn over(&self, base: QosProfile) -> QosProfile {
        // Checked when it was parsed.
        self.0.over(base).unwrap_or(base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn latched() -> QosProfile {
        QosProfile { depth: 1, durability: Durability::TransientLocal, ..QosProfile::default() }
    }

    #[test]
    fn both_forms_are_written_and_read() {
        let profiles = [latched(), QosProfile { reliability: Reliability::BestEffort, ..QosProfile::default() }];
        for version in [5, 7, 9] {
            let text = to_text(&profiles, version).unwrap();
            assert_eq!(parse_profiles(&text).unwrap(), profiles, "{text}");
            assert_eq!(text.contains("transient_local"), version == 9, "{text}");
            assert_eq!(text.contains("durability: 1"), version != 9, "{text}");
        }
        assert_eq!(parse_profiles(" \n").unwrap(), []);
    }

    #[test]
    fn what_is_no_policy_is_refused_by_name() {
        let error = parse_profiles("- history: 1\n  reliability: sometimes\n").unwrap_err();
        assert!(error.contains("sometimes") && error.contains("Reliability"), "{error}");
        for text in ["{", "3", "- 3"] {
            assert!(parse_profiles(text).is_err(), "{text}");
        }
    }

    #[test]
    fn overrides_change_what_they_name() {
        let overrides = parse_overrides("/x:\n  reliability: best_effort\n  depth: 3\n").unwrap();
        let changed = overrides["/x"].over(latched());
        assert_eq!(changed, QosProfile { reliability: Reliability::BestEffort, depth: 3, ..latched() });
        let error = parse_overrides("/x:\n  durability: forever\n").unwrap_err();
        assert!(error.contains("/x") && error.contains("forever"), "{error}");
    }
}
