//! Names of nodes, topics and services, checked, and as DDS spells them.

use std::fmt;

use super::DdsError;

/// A node's name and namespace, checked against ROS 2's rules (REP-144).
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct NodeName(ros2_client::NodeName);

impl NodeName {
    /// A node called `name` in `namespace` (`/` or `/feeder` or deeper).
    ///
    /// # Errors
    /// [`DdsError::Name`] when one of them is empty, has characters other than letters, digits and
    /// underscores, begins with a digit, or has misplaced slashes.
    pub fn new(namespace: &str, name: &str) -> Result<Self, DdsError> {
        let refuse = |what, value: &str, reason: String| DdsError::Name { what, value: value.to_owned(), reason };
        if namespace != "/" {
            check_absolute("namespace", namespace)?;
        }
        ros2_client::NodeName::new(namespace, name)
            .map(Self)
            .map_err(|error| refuse("node name", name, error.to_string()))
    }

    /// The name without its namespace.
    #[must_use]
    pub fn name(&self) -> &str {
        self.0.base_name()
    }

    /// The namespace, with a slash in front.
    #[must_use]
    pub fn namespace(&self) -> &str {
        self.0.namespace()
    }

    pub(super) fn inner(&self) -> &ros2_client::NodeName {
        &self.0
    }
}

impl fmt::Display for NodeName {
    /// The fully qualified name, e.g. `/feeder/courier_driver`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.fully_qualified_name())
    }
}

/// Checks an absolute ROS name such as `/feeder/waveform`.
pub(crate) fn check_absolute(what: &'static str, name: &str) -> Result<(), DdsError> {
    let refuse = |reason: String| DdsError::Name { what, value: name.to_owned(), reason };
    let parsed = ros2_client::Name::parse(name).map_err(|error| refuse(error.to_string()))?;
    if parsed.is_absolute() { Ok(()) } else { Err(refuse("it must begin with a slash".to_owned())) }
}

/// The DDS name of an absolute ROS name: `rt` for topics, `rq` and `rr` for requests and replies.
pub(super) fn dds_name(what: &'static str, prefix: &str, ros_name: &str, suffix: &str) -> Result<String, DdsError> {
    check_absolute(what, ros_name)?;
    Ok(format!("{prefix}{ros_name}{suffix}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_names() {
        let node = NodeName::new("/feeder", "courier_driver").expect("good");
        assert_eq!((node.namespace(), node.name()), ("/feeder", "courier_driver"));
        assert_eq!(node.to_string(), "/feeder/courier_driver");
        assert_eq!(NodeName::new("/", "clock").expect("good").to_string(), "/clock");
        assert_eq!(dds_name("topic", "rt", "/a/_action/status", "").expect("good"), "rt/a/_action/status");
    }

    #[test]
    fn bad_names() {
        for (namespace, name) in [
            ("", "a"),
            ("a", "a"),
            ("/a/", "a"),
            ("//a", "a"),
            ("/a//b", "a"),
            ("/1a", "a"),
            ("/", ""),
            ("/", "1a"),
            ("/", "a-b"),
            ("/", "a/b"),
        ] {
            assert!(NodeName::new(namespace, name).is_err(), "{namespace:?} {name:?}");
        }
        for topic in ["", "/", "waveform", "/a//b", "/a/", "/a b", "/ä", "/1"] {
            assert!(dds_name("topic", "rt", topic, "").is_err(), "{topic:?}");
        }
    }
}
