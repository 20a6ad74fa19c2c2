//! The distributions of ROS 2 whose tools a bag is written for, and what their versions of `metadata.yaml` differ in.

use std::fmt;
use std::str::FromStr;

/// A distribution of ROS 2 whose tools are to read a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Distribution {
    /// Humble Hawksbill, 2022.
    Humble,
    /// Iron Irwini, 2023.
    Iron,
    /// Jazzy Jalisco, 2024.
    #[default]
    Jazzy,
    /// Kilted Kaiju, 2025.
    Kilted,
    /// Lyrical Luth, 2026.
    Lyrical,
}

/// The newest version of metadata.yaml that is known, and read.
pub(crate) const NEWEST_METADATA: u32 = 9;
/// The first version with quality of service as a list with words; before, it is a text with numbers.
pub(crate) const METADATA_WITH_WORDS: u32 = 9;

impl Distribution {
    /// All of them, oldest first.
    pub const ALL: [Self; 5] = [Self::Humble, Self::Iron, Self::Jazzy, Self::Kilted, Self::Lyrical];

    /// Its name as ROS writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Humble => "humble",
            Self::Iron => "iron",
            Self::Jazzy => "jazzy",
            Self::Kilted => "kilted",
            Self::Lyrical => "lyrical",
        }
    }

    /// Version of the metadata.yaml that its rosbag2 writes (`BagMetadata::version` in `rosbag2_storage`).
    #[must_use]
    pub fn metadata_version(self) -> u32 {
        match self {
            Self::Humble => 5,
            Self::Iron => 7,
            Self::Jazzy | Self::Kilted | Self::Lyrical => 9,
        }
    }
}

impl fmt::Display for Distribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Distribution {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|known| known.name() == text).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("{text:?} is no distribution that is known here: {names}")
        })
    }
}
