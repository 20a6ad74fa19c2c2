//! Parameter files: YAML that gives values to the parameters of some nodes.

use std::fmt;
use std::sync::Arc;

use serde::{
    Deserialize, Deserializer,
    de::{Error, MapAccess, SeqAccess, Visitor, value::SeqAccessDeserializer},
};

use super::GivenValue;
use crate::{dds::NodeName, parameters::Value};

/// The key below which a node's parameters lie.
const PARAMETERS: &str = "ros__parameters";

/// A value given to a parameter of some nodes.
#[derive(Debug, Clone)]
pub(super) struct Given {
    nodes: Nodes,
    pub(super) name: String,
    pub(super) given: GivenValue,
}

/// Which nodes a value is for.
#[derive(Debug, Clone)]
enum Nodes {
    /// Nodes of this name in any namespace.
    Named(String),
    /// Nodes whose full name matches: `*` is any part of it, `**` any number of parts.
    Matching(String),
}

impl Given {
    /// Reads `[node:]name:=value`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let source = format!("--param {text}").into();
        let (name, value) = text.split_once(":=").ok_or("there is no := in it")?;
        let (nodes, name) = match name.split_once(':') {
            Some((node, name)) if node.starts_with('/') => (Nodes::Matching(node.to_owned()), name),
            Some((node, name)) => (Nodes::Named(node.to_owned()), name),
            None => (Nodes::Matching("/**".to_owned()), name),
        };
        if name.is_empty() {
            return Err("the parameter's name is empty".to_owned());
        }
        let value = serde_saphyr::from_str(value).map_err(|error| error.to_string())?;
        Ok(Self { nodes, name: name.to_owned(), given: GivenValue { value, source } })
    }

    pub(super) fn is_for(&self, node: &NodeName) -> bool {
        match &self.nodes {
            Nodes::Named(name) => name == node.name(),
            Nodes::Matching(pattern) => {
                let (full, mut parts) = (node.to_string(), Vec::new());
                parts.extend(full.split('/').skip(1));
                matches(&pattern.split('/').skip(1).collect::<Vec<_>>(), &parts)
            }
        }
    }
}

fn matches(pattern: &[&str], parts: &[&str]) -> bool {
    match (pattern, parts) {
        ([], []) => true,
        (["**", rest @ ..], _) => (0..=parts.len()).any(|skipped| matches(rest, &parts[skipped..])),
        ([first, rest @ ..], [part, parts @ ..]) => (*first == "*" || first == part) && matches(rest, parts),
        _ => false,
    }
}

/// Reads a parameter file: namespaces and nodes, nested or written as one key, with `ros__parameters` below.
pub(super) fn read(source: &str, text: &str) -> Result<Vec<Given>, String> {
    let tree: Tree = serde_saphyr::from_str(text).map_err(|error| error.to_string())?;
    let mut given = Vec::new();
    collect_nodes("", tree, &source.into(), &mut given)?;
    Ok(given)
}

fn collect_nodes(node: &str, tree: Tree, source: &Arc<str>, given: &mut Vec<Given>) -> Result<(), String> {
    let Tree::Map(entries) = tree else {
        return Err(format!("{:?} holds no map with {PARAMETERS}", if node.is_empty() { "the file" } else { node }));
    };
    for (key, below) in entries {
        if key == PARAMETERS {
            if !matches!(below, Tree::Map(_)) {
                return Err(format!("{PARAMETERS} of {node:?} is no map of names and values"));
            }
            collect_values(node, String::new(), below, source, given);
        } else {
            collect_nodes(&format!("{node}/{}", key.trim_matches('/')), below, source, given)?;
        }
    }
    Ok(())
}

fn collect_values(node: &str, name: String, tree: Tree, source: &Arc<str>, given: &mut Vec<Given>) {
    match tree {
        Tree::Value(value) => {
            let nodes = Nodes::Matching(node.to_owned());
            given.push(Given { nodes, name, given: GivenValue { value, source: source.clone() } });
        }
        Tree::Map(entries) => {
            for (key, below) in entries {
                let name = if name.is_empty() { key } else { format!("{name}.{key}") };
                collect_values(node, name, below, source, given);
            }
        }
    }
}

/// YAML as far as parameter files use it, in the order of the file.
enum Tree {
    Value(Value),
    Map(Vec<(String, Tree)>),
}

impl<'de> Deserialize<'de> for Tree {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TreeVisitor;

        impl<'de> Visitor<'de> for TreeVisitor {
            type Value = Tree;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a map, or a parameter's value")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Tree, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Tree::Map(entries))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, elements: A) -> Result<Tree, A::Error> {
                Value::deserialize(SeqAccessDeserializer::new(elements)).map(Tree::Value)
            }

            fn visit_bool<E: Error>(self, value: bool) -> Result<Tree, E> {
                Ok(Tree::Value(Value::Bool(value)))
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<Tree, E> {
                Ok(Tree::Value(Value::Integer(value)))
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Tree, E> {
                Value::deserialize(serde::de::value::U64Deserializer::new(value)).map(Tree::Value)
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Tree, E> {
                Ok(Tree::Value(Value::Double(value)))
            }

            fn visit_str<E: Error>(self, value: &str) -> Result<Tree, E> {
                Ok(Tree::Value(Value::Text(value.to_owned())))
            }
        }

        deserializer.deserialize_any(TreeVisitor)
    }
}
