//! Which topics of a bag or of a run are meant.

use regex::Regex;

/// Which topics are meant. Without any positive choice: all that are not hidden.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// These, by name.
    pub topics: Vec<String>,
    /// Those whose name this pattern is found in.
    pub regex: Option<Regex>,
    /// Those of these types, `package/msg/Name`.
    pub types: Vec<String>,
    /// Not these, by name.
    pub exclude_topics: Vec<String>,
    /// Not those whose name this pattern is found in.
    pub exclude_regex: Option<Regex>,
    /// Hidden ones too, which have a part that begins with an underscore, when they are not named.
    pub hidden: bool,
}

impl Selection {
    /// These topics and no others.
    #[must_use]
    pub fn of(topics: Vec<String>) -> Self {
        Self { topics, ..Self::default() }
    }

    /// Whether the topic `name` of type `ros_type` is meant.
    #[must_use]
    pub fn takes(&self, name: &str, ros_type: &str) -> bool {
        let excluded = self.exclude_topics.iter().any(|topic| topic == name)
            || self.exclude_regex.as_ref().is_some_and(|regex| regex.is_match(name));
        if excluded {
            return false;
        }
        if self.topics.iter().any(|topic| topic == name) {
            return true;
        }
        if !self.hidden && name.split('/').any(|part| part.starts_with('_')) {
            return false;
        }
        let everything = self.topics.is_empty() && self.regex.is_none() && self.types.is_empty();
        everything
            || self.regex.as_ref().is_some_and(|regex| regex.is_match(name))
            || self.types.iter().any(|ty| ty == ros_type)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regex(text: &str) -> Option<Regex> {
        Some(Regex::new(text).unwrap())
    }

    #[test]
    fn topics_are_chosen_by_name_pattern_and_type() {
        let all = Selection::default();
        assert!(all.takes("/a", "x/msg/Y") && !all.takes("/a/_action/status", "x/msg/Y"));
        let hidden = Selection { hidden: true, ..Selection::default() };
        assert!(hidden.takes("/a/_action/status", "x/msg/Y"));
        let named = Selection::of(vec!["/a/_action/status".to_owned()]);
        assert!(named.takes("/a/_action/status", "x/msg/Y") && !named.takes("/a", "x/msg/Y"));
        let some = Selection { regex: regex("camera"), types: vec!["x/msg/Y".to_owned()], ..Selection::default() };
        assert!(some.takes("/feeder/camera/info", "z/msg/Z") && some.takes("/b", "x/msg/Y"));
        assert!(!some.takes("/b", "z/msg/Z"));
        let but = Selection { exclude_regex: regex("raw$"), exclude_topics: vec!["/b".to_owned()], ..all };
        assert!(but.takes("/a", "") && !but.takes("/b", "") && !but.takes("/image_raw", ""));
    }
}
