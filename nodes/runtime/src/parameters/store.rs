//! The parameters of a node, and the checks that a change must pass.

use std::collections::{BTreeMap, BTreeSet};

use minifactory_msgs::rcl_interfaces::{
    msg::{ListParametersResult, Parameter, ParameterDescriptor},
    srv::ListParametersRequest,
};

use super::{Declaration, Value};

/// Why a node's parameters make no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// Two declarations have one name.
    #[error("parameter {name} is declared twice")]
    Twice {
        /// The name.
        name: String,
    },
    /// The default value breaks the declaration's own rules.
    #[error("the default of parameter {name} is not allowed: {reason}")]
    Default {
        /// The parameter.
        name: String,
        /// The rule it breaks.
        reason: String,
    },
    /// A value was given to a parameter that does not exist.
    #[error("there is no parameter {name}; there are {count}, {like_it}")]
    Undeclared {
        /// The name.
        name: String,
        /// How many there are.
        count: usize,
        /// Those with a similar name.
        like_it: String,
    },
    /// A parameter cannot be set to the given value.
    #[error("parameter {name} cannot be {value}: {reason}")]
    Refused {
        /// The parameter.
        name: String,
        /// The value.
        value: String,
        /// The rule it breaks.
        reason: String,
    },
}

/// The parameters of a node.
#[derive(Debug, Clone)]
pub struct Store {
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug, Clone)]
struct Entry {
    declaration: Declaration,
    value: Value,
}

impl Store {
    /// Declares parameters.
    ///
    /// # Errors
    /// [`ParameterError`] names the parameter and the reason.
    pub fn new(declarations: impl IntoIterator<Item = Declaration>) -> Result<Self, ParameterError> {
        let mut entries = BTreeMap::new();
        for declaration in declarations {
            let name = declaration.name.clone();
            let value = declaration.default.clone();
            if let Err(reason) = declaration.check(&value) {
                return Err(ParameterError::Default { name, reason });
            }
            if entries.insert(name.clone(), Entry { declaration, value }).is_some() {
                return Err(ParameterError::Twice { name });
            }
        }
        Ok(Self { entries })
    }

    /// Sets a parameter before its node runs, when a read-only one can be set too.
    ///
    /// # Errors
    /// [`ParameterError`] names the parameter and the reason.
    pub fn give(&mut self, name: &str, value: &Value) -> Result<(), ParameterError> {
        let Some(entry) = self.entries.get_mut(name) else {
            let (count, like_it) = (self.entries.len(), self.like(name));
            return Err(ParameterError::Undeclared { name: name.to_owned(), count, like_it });
        };
        let value = value.clone().fit_empty_array(entry.declaration.default.kind());
        if let Err(reason) = entry.declaration.check(&value) {
            return Err(ParameterError::Refused { name: name.to_owned(), value: value.to_string(), reason });
        }
        entry.value = value;
        Ok(())
    }

    /// The parameters whose names are nearly `name`.
    fn like(&self, name: &str) -> String {
        let likeness = |known: &&str| strsim::jaro_winkler(known, name);
        let mut like_it: Vec<&str> = self.entries.keys().map(String::as_str).filter(|k| likeness(k) > 0.8).collect();
        like_it.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
        like_it.truncate(3);
        if like_it.is_empty() { "none like it".to_owned() } else { format!("like it {}", like_it.join(", ")) }
    }

    /// The value of a parameter.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.entries.get(name).map(|entry| &entry.value)
    }

    /// All parameters, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.entries.iter().map(|(name, entry)| (name.as_str(), &entry.value))
    }

    /// Whether a parameter cannot be set while its node runs.
    pub(super) fn is_read_only(&self, name: &str) -> bool {
        self.entries.get(name).is_some_and(|entry| entry.declaration.read_only)
    }

    /// Whether a running node's parameter may be set to a value; a read-only one only to the value it has.
    ///
    /// # Errors
    /// The reason, for whoever wants to set it.
    pub fn check(&self, name: &str, value: &Value) -> Result<(), String> {
        let entry = self.entries.get(name).ok_or_else(|| format!("parameter {name} is not declared"))?;
        if entry.declaration.read_only {
            // So that what was dumped can be loaded again.
            if *value == entry.value {
                return Ok(());
            }
            return Err(format!("parameter {name} is read-only: it can be set at the start of the node"));
        }
        entry.declaration.check(value).map_err(|reason| format!("parameter {name}: {reason}"))
    }

    /// Sets parameters: all of them, or none when one may not be set.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn set(&mut self, changes: &[(String, Value)]) -> Result<(), String> {
        changes.iter().try_for_each(|(name, value)| self.check(name, value))?;
        for (name, value) in changes {
            if let Some(entry) = self.entries.get_mut(name) {
                entry.value = value.clone();
            }
        }
        Ok(())
    }

    pub(super) fn descriptor(&self, name: &str) -> Option<ParameterDescriptor> {
        self.entries.get(name).map(|entry| entry.declaration.descriptor())
    }

    pub(super) fn messages(&self) -> Vec<Parameter> {
        self.iter().map(|(name, value)| Parameter { name: name.to_owned(), value: value.to_message() }).collect()
    }

    /// The names below the asked-for prefixes, at most `depth` groups deep (0: any depth), and the groups they are in.
    pub(super) fn list(&self, request: &ListParametersRequest) -> ListParametersResult {
        let deep_enough = |rest: &str| {
            let groups = rest.matches('.').count() as u64;
            request.depth == 0 || groups < request.depth
        };
        let listed = |name: &str| {
            if request.prefixes.is_empty() {
                return deep_enough(name);
            }
            request.prefixes.iter().any(|prefix| match name.strip_prefix(prefix.as_str()) {
                Some("") => true,
                Some(rest) => rest.strip_prefix('.').is_some_and(deep_enough),
                None => false,
            })
        };
        let names: Vec<_> = self.entries.keys().filter(|name| listed(name)).cloned().collect();
        let groups = names.iter().filter_map(|name| name.rsplit_once('.'));
        let prefixes: BTreeSet<_> = groups.map(|(group, _)| group.to_owned()).collect();
        ListParametersResult { names, prefixes: prefixes.into_iter().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Range;
    use super::*;
    use proptest::prelude::*;

    fn declarations() -> [Declaration; 5] {
        [
            Declaration::new("rate_hz", Value::Double(10.0), "Publishing rate, in hertz").range(Range::Double {
                from: 0.5,
                to: 100.0,
                step: 0.1,
            }),
            Declaration::new("camera.rows", Value::Integer(480), "Rows of a frame")
                .range(Range::Integer { from: 16, to: 4_096, step: 16 })
                .read_only(),
            Declaration::new("camera.lens.name", Value::Text("wide".into()), "Lens"),
            Declaration::new("gains", Value::Doubles(vec![1.0]), "Gains"),
            Declaration::new("on", Value::Bool(true), "Whether it is on"),
        ]
    }

    fn store() -> Store {
        Store::new(declarations()).expect("sound declarations")
    }

    fn given(name: &str, value: &Value) -> Result<Store, ParameterError> {
        let mut store = store();
        store.give(name, value).map(|()| store)
    }

    #[test]
    fn each_parameter_is_told_with_its_value_and_whether_it_may_be_set() {
        let store = store();
        let told: Vec<(String, String)> = store
            .messages()
            .iter()
            .map(|told| (told.name.clone(), Value::from_message(told.value.clone()).unwrap().to_string()))
            .collect();
        let known: Vec<_> = store.iter().map(|(name, value)| (name.to_owned(), value.to_string())).collect();
        assert_eq!((told.len(), told), (5, known));
        assert!(store.is_read_only("camera.rows") && !store.is_read_only("on") && !store.is_read_only("unknown"));
    }

    #[test]
    fn values_given_at_the_start_are_taken_or_refused_by_name() {
        assert_eq!(
            given("camera.rows", &Value::Integer(16)).expect("allowed").get("camera.rows"),
            Some(&Value::Integer(16))
        );
        let empty = given("gains", &Value::Texts(vec![])).expect("an empty array has no type of its own");
        assert_eq!(empty.get("gains"), Some(&Value::Doubles(vec![])));
        for (name, value, says) in [
            ("rate", Value::Double(1.0), "there is no parameter rate; there are 5, like it rate_hz"),
            ("camera.row", Value::Double(1.0), "there are 5, like it camera.rows"),
            ("lens", Value::Double(1.0), "none like it"),
            ("rate_hz", Value::Integer(1), "rate_hz cannot be 1: 1 is not a double (write 1.0, not 1)"),
            ("rate_hz", Value::Double(0.1), "0.1 is not in 0.5 … 100.0 in steps of 0.1"),
            ("rate_hz", Value::Double(f64::NAN), "NaN is not in"),
            ("rate_hz", Value::Double(0.55), "in steps of 0.1"),
            ("camera.rows", Value::Integer(17), "17 is not in 16 … 4096 in steps of 16"),
        ] {
            let message = given(name, &value).expect_err(says).to_string();
            assert!(message.contains(says), "{message}");
        }
        let twice = [declarations()[4].clone(), declarations()[4].clone()];
        assert!(matches!(Store::new(twice), Err(ParameterError::Twice { .. })));
        let bad = Declaration { default: Value::Double(0.0), ..declarations()[0].clone() };
        assert!(matches!(Store::new([bad]), Err(ParameterError::Default { .. })));
    }

    #[test]
    fn a_running_node_changes_all_or_nothing() {
        let mut store = store();
        let change = |name: &str, value| (name.to_owned(), value);
        store.set(&[change("rate_hz", Value::Double(20.3)), change("on", Value::Bool(false))]).expect("allowed");
        assert_eq!(store.get("on"), Some(&Value::Bool(false)));
        for bad in [
            change("rate_hz", Value::Double(1e9)),
            change("camera.rows", Value::Integer(32)),
            change("nothing", Value::Bool(true)),
            change("on", Value::Integer(1)),
        ] {
            let name = bad.0.clone();
            let reason = store.set(&[change("rate_hz", Value::Double(30.0)), bad]).expect_err("not allowed");
            assert!(reason.contains(&name), "{reason}");
            assert_eq!(store.get("rate_hz"), Some(&Value::Double(20.3)));
        }
        store.set(&[change("camera.rows", Value::Integer(480))]).expect("it has this value already");
    }

    #[test]
    fn lists_follow_prefixes_and_depth() {
        let list = |prefixes: &[&str], depth| {
            let prefixes = prefixes.iter().map(|prefix| (*prefix).to_owned()).collect();
            store().list(&ListParametersRequest { prefixes, depth })
        };
        assert_eq!(list(&[], 0).names.len(), 5);
        assert_eq!(list(&[], 0).prefixes, ["camera", "camera.lens"]);
        assert_eq!(list(&[], 1).names, ["gains", "on", "rate_hz"]);
        assert_eq!(list(&["camera"], 0).names, ["camera.lens.name", "camera.rows"]);
        assert_eq!(list(&["camera"], 1).names, ["camera.rows"]);
        assert_eq!(list(&["camera.rows", "on"], 1).names, ["camera.rows", "on"]);
        assert_eq!(list(&["cam"], 0).names, Vec::<String>::new());
    }

    fn any_value() -> impl Strategy<Value = Value> {
        prop_oneof![
            any::<bool>().prop_map(Value::Bool),
            any::<i64>().prop_map(Value::Integer),
            any::<f64>().prop_map(Value::Double),
            ".*".prop_map(Value::Text),
            any::<Vec<u8>>().prop_map(Value::Bytes),
            any::<Vec<f64>>().prop_map(Value::Doubles),
            any::<Vec<String>>().prop_map(Value::Texts),
        ]
    }

    proptest! {
        #[test]
        fn no_value_breaks_the_rules(name in "(rate_hz|camera.rows|gains|on|x)", value in any_value()) {
            let mut store = store();
            let _ = store.set(&[(name, value)]);
            let Some(Value::Double(rate)) = store.get("rate_hz") else { panic!("it stays a double") };
            prop_assert!((0.5..=100.0).contains(rate));
            prop_assert_eq!(store.get("camera.rows"), Some(&Value::Integer(480)));
        }

        #[test]
        fn values_survive_their_messages(value in any_value()) {
            let text = value.to_string();
            let back = Value::from_message(value.to_message()).expect("a known type");
            prop_assert_eq!(back.to_string(), text);
        }
    }
}
