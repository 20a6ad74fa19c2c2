//! Rules that give another name to a topic, a service or a node.

use crate::dds::{DdsError, NodeName, check_absolute};

/// What a name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the words say it")]
pub enum NameKind {
    Topic,
    Service,
}

/// A rule `[node:][rostopic://|rosservice://]from:=to`.
#[derive(Debug, Clone)]
pub(super) struct Rule {
    node: Option<String>,
    kind: Option<NameKind>,
    from: String,
    to: String,
}

impl Rule {
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let (from, to) = text.split_once(":=").ok_or("there is no := in it")?;
        let (from, kind) = match (from.strip_prefix("rostopic://"), from.strip_prefix("rosservice://")) {
            (Some(from), _) => (from, Some(NameKind::Topic)),
            (_, Some(from)) => (from, Some(NameKind::Service)),
            _ => (from, None),
        };
        let (node, from) = from.split_once(':').map_or((None, from), |(node, from)| (Some(node.to_owned()), from));
        if from.is_empty() || to.is_empty() {
            return Err("a name is empty".to_owned());
        }
        // Two words for one thing.
        let from = if from == "__name" { "__node" } else { from };
        Ok(Self { node, kind, from: from.to_owned(), to: to.to_owned() })
    }

    fn is_for(&self, node: &NodeName) -> bool {
        self.node.as_deref().is_none_or(|name| name == node.name())
    }

    /// Whether this renames the node itself, by the word `__node` or `__ns`.
    pub(super) fn names_node(&self, word: &str, node: &NodeName) -> bool {
        self.from == word && self.is_for(node)
    }

    pub(super) fn to(&self) -> &str {
        &self.to
    }
}

/// The first rule that fits is applied, once.
pub(super) fn resolve(rules: &[Rule], node: &NodeName, name: &str, kind: NameKind) -> Result<String, DdsError> {
    let full = expand(name, node)?;
    let fits = |rule: &&Rule| {
        rule.is_for(node)
            && rule.kind.is_none_or(|of| of == kind)
            && expand(&rule.from, node).is_ok_and(|from| from == full)
    };
    rules.iter().find(fits).map_or(Ok(full.clone()), |rule| expand(&rule.to, node))
}

/// The absolute form of a name.
fn expand(name: &str, node: &NodeName) -> Result<String, DdsError> {
    let full = match name.strip_prefix('~') {
        Some(rest) => format!("{node}{rest}"),
        None if name.starts_with('/') => name.to_owned(),
        None => format!("{}/{name}", node.namespace().trim_end_matches('/')),
    };
    if name.starts_with('~') && !name.starts_with("~/") {
        let reason = "~ stands for the node's name and is followed by a slash".to_owned();
        return Err(DdsError::Name { what: "name", value: name.to_owned(), reason });
    }
    check_absolute("name", &full).map(|()| full)
}
