//! A node's configuration as parameters: declared with dotted names, given at the start, some set while it runs.

use std::collections::BTreeMap;
use std::fmt::Display;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use crate::args::GivenValue;
use crate::node::NodeError;
use crate::parameters::{Declaration, ParameterError, Store, Value};
use crate::schema::ConfigSchema;

/// Why a node cannot start with the parameters given to it.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GivenError {
    /// A parameter that does not exist, or cannot have this value.
    #[error("{given_by}: {error}")]
    Parameter { given_by: String, error: ParameterError },
    /// The configuration with this parameter makes no sense.
    #[error("{given_by}: parameter {name} cannot be {value}: {reason}")]
    Refused { given_by: String, name: String, value: Value, reason: String },
    /// Each parameter would do, but not all of them.
    #[error("the parameters given by {given_by} do not go together: {reason}")]
    Together { given_by: String, reason: String },
}

/// A configuration, and the parameters that show it.
pub(crate) struct Configuration<C> {
    pub(crate) config: C,
    pub(crate) store: Store,
    pub(crate) check: CheckConfig<C>,
}

/// Says what is wrong with a configuration.
pub(crate) type CheckConfig<C> = fn(&C) -> Result<(), NodeError>;

impl<C: Serialize + DeserializeOwned + JsonSchema + Clone> Configuration<C> {
    /// `config` with the values given at the start, if that passes `check`. `own` are parameters beside it.
    pub(crate) fn new(
        config: &C,
        check: CheckConfig<C>,
        settable: &[&str],
        not_parameters: &[&str],
        own: Vec<Declaration>,
        given: &BTreeMap<String, GivenValue>,
    ) -> Result<Self, NodeError> {
        let own_names: Vec<String> = own.iter().map(|declaration| declaration.name.clone()).collect();
        let mut declarations = own;
        declarations.extend(declarations_of(config, settable, not_parameters)?);
        let mut store = Store::new(declarations).map_err(NodeError::new)?;
        let mut changes = Vec::new();
        for (name, GivenValue { value, source }) in given {
            let before = store.get(name).cloned();
            let refuse = |error| GivenError::Parameter { given_by: source.to_string(), error };
            store.give(name, value).map_err(refuse).map_err(NodeError::new)?;
            let value = store.get(name).cloned().filter(|_| !own_names.contains(name));
            changes.extend(value.filter(|value| before.as_ref() != Some(value)).map(|value| (name.clone(), value)));
        }
        let config =
            changed(config, check, &changes).map_err(|reason| blame(config, check, &changes, given, reason))?;
        Ok(Self { config, store, check })
    }
}

/// The values of a configuration as parameters, described as its schema describes them.
pub(crate) fn declarations_of<C: Serialize + JsonSchema>(
    config: &C,
    settable: &[&str],
    not_parameters: &[&str],
) -> Result<Vec<Declaration>, NodeError> {
    let mut tree = serde_json::to_value(config).map_err(NodeError::new)?;
    if let Json::Object(fields) = &mut tree {
        fields.retain(|key, _| !not_parameters.contains(&key.as_str()));
    }
    let mut values = Vec::new();
    flatten("", &tree, &mut values);
    let schema = ConfigSchema::of::<C>();
    let declaration = |(name, default): (String, Value)| {
        let (description, range) = schema.of_value(&name, &default);
        let read_only = !settable.contains(&name.as_str());
        let description = description.unwrap_or_default();
        Declaration { name, default, description, range, constraints: String::new(), read_only }
    };
    Ok(values.into_iter().map(declaration).collect())
}

/// Who gave the value that a configuration refuses: one parameter, or several that do not go together.
fn blame<C: Serialize + DeserializeOwned + Clone>(
    config: &C,
    check: CheckConfig<C>,
    changes: &[(String, Value)],
    given: &BTreeMap<String, GivenValue>,
    reason: String,
) -> NodeError {
    let given_by = |name: &String| given.get(name).map(|given| given.source.to_string()).unwrap_or_default();
    for change in changes {
        if let Err(reason) = changed(config, check, std::slice::from_ref(change)) {
            let (name, value) = change.clone();
            return NodeError::new(GivenError::Refused { given_by: given_by(&name), name, value, reason });
        }
    }
    let mut sources: Vec<String> = changes.iter().map(|(name, _)| given_by(name)).collect();
    sources.dedup();
    NodeError::new(GivenError::Together { given_by: sources.join(", "), reason })
}

/// The configuration with some values changed, if it is valid.
///
/// # Errors
/// Why not, as the configuration says it.
pub(crate) fn changed<C: Serialize + DeserializeOwned + Clone>(
    config: &C,
    check: CheckConfig<C>,
    changes: &[(String, Value)],
) -> Result<C, String> {
    if changes.is_empty() {
        return Ok(config.clone());
    }
    let mut tree = serde_json::to_value(config).map_err(|error| error.to_string())?;
    for (name, value) in changes {
        let leaf = leaf(&mut tree, name).ok_or_else(|| format!("{name} is not part of the configuration"))?;
        *leaf = json(value).ok_or_else(|| format!("{name} = {value} is not finite"))?;
    }
    let config = C::deserialize(tree).map_err(|error| error.to_string())?;
    check(&config).map_err(|error| error.to_string())?;
    Ok(config)
}

/// The value of a parameter in the tree.
fn leaf<'a>(tree: &'a mut Json, name: &str) -> Option<&'a mut Json> {
    name.split('.').try_fold(tree, |branch, key| match branch {
        Json::Object(fields) => fields.get_mut(key),
        Json::Array(values) => values.get_mut(key.parse::<usize>().ok()?),
        _ => None,
    })
}

fn json(value: &Value) -> Option<Json> {
    let number = |value: &f64| serde_json::Number::from_f64(*value).map(Json::Number);
    Some(match value {
        Value::Bool(value) => (*value).into(),
        Value::Integer(value) => (*value).into(),
        Value::Double(value) => number(value)?,
        Value::Text(text) => text.as_str().into(),
        Value::Bytes(bytes) => bytes.as_slice().into(),
        Value::Bools(values) => values.as_slice().into(),
        Value::Integers(values) => values.as_slice().into(),
        Value::Doubles(values) => Json::Array(values.iter().map(number).collect::<Option<_>>()?),
        Value::Texts(texts) => texts.as_slice().into(),
    })
}

fn flatten(name: &str, tree: &Json, leaves: &mut Vec<(String, Value)>) {
    let below = |key: &dyn Display| if name.is_empty() { key.to_string() } else { format!("{name}.{key}") };
    match tree {
        Json::Object(fields) => fields.iter().for_each(|(key, value)| flatten(&below(key), value, leaves)),
        Json::Array(values) => match list(values) {
            Some(value) => leaves.push((name.to_owned(), value)),
            None => values.iter().enumerate().for_each(|(index, value)| flatten(&below(&index), value, leaves)),
        },
        scalar => leaves.extend(value(scalar).map(|value| (name.to_owned(), value))),
    }
}

/// A scalar as a parameter; null has no type and is none.
fn value(json: &Json) -> Option<Value> {
    match json {
        Json::Bool(value) => Some(Value::Bool(*value)),
        Json::String(text) => Some(Value::Text(text.clone())),
        Json::Number(number) => number.as_i64().map(Value::Integer).or_else(|| number.as_f64().map(Value::Double)),
        Json::Null | Json::Array(_) | Json::Object(_) => None,
    }
}

/// A list of numbers or of texts as one parameter.
fn list(values: &[Json]) -> Option<Value> {
    let integers = || values.iter().map(Json::as_i64).collect::<Option<Vec<_>>>();
    let numbers = || values.iter().map(Json::as_f64).collect::<Option<Vec<_>>>();
    let texts = || values.iter().map(|value| value.as_str().map(str::to_owned)).collect::<Option<Vec<_>>>();
    if values.is_empty() {
        return Some(Value::Texts(Vec::new()));
    }
    integers().map(Value::Integers).or_else(|| numbers().map(Value::Doubles)).or_else(|| texts().map(Value::Texts))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Config {
        name: String,
        count: u32,
        on: bool,
        none: Option<u32>,
        limits: Limits,
        places: Vec<f64>,
        faces: Vec<usize>,
        stations: Vec<Station>,
        bulky: Vec<f64>,
    }

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Limits {
        /// The lower one
        #[schemars(range(min = 0.0, max = 1.0))]
        low_m: f64,
        high_m: f64,
    }

    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Station {
        name: String,
    }

    fn check(config: &Config) -> Result<(), NodeError> {
        let Limits { low_m, high_m } = config.limits;
        let problem = || NodeError::new(format!("low_m = {low_m} is not below high_m = {high_m}"));
        if low_m < high_m { Ok(()) } else { Err(problem()) }
    }

    fn config() -> Config {
        Config {
            name: "feeder: 1".into(),
            count: 3,
            on: true,
            none: None,
            limits: Limits { low_m: 1e-7, high_m: 0.5 },
            places: vec![0.1, 2.0],
            faces: vec![0, 1],
            stations: ["a", "b"].map(|name| Station { name: name.into() }).into(),
            bulky: vec![1.0; 1000],
        }
    }

    fn configured(given: &[(&str, Value)]) -> Result<Configuration<Config>, String> {
        let given = given.iter().map(|(name, value)| {
            let given = GivenValue { value: value.clone(), source: "good.yaml".into() };
            ((*name).to_owned(), given)
        });
        let own = vec![Declaration::new("use_sim_time", Value::Bool(false), "").read_only()];
        Configuration::new(&config(), check, &["limits.low_m"], &["bulky"], own, &given.collect())
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_configuration_becomes_dotted_parameters() {
        let Configuration { store, config: same, .. } = configured(&[]).unwrap();
        assert_eq!(same, config());
        assert_eq!(store.get("name"), Some(&Value::Text("feeder: 1".into())));
        assert_eq!(store.get("count"), Some(&Value::Integer(3)));
        assert_eq!(store.get("limits.high_m"), Some(&Value::Double(0.5)));
        assert_eq!(store.get("places"), Some(&Value::Doubles(vec![0.1, 2.0])));
        assert_eq!(store.get("faces"), Some(&Value::Integers(vec![0, 1])));
        assert_eq!(store.get("stations.1.name"), Some(&Value::Text("b".into())));
        assert_eq!(store.get("none"), None);
        assert_eq!(store.get("bulky"), None);
        assert!(store.check("count", &Value::Integer(4)).is_err());
        assert!(store.check("limits.low_m", &Value::Double(0.25)).is_ok());
    }

    #[test]
    fn what_is_given_takes_effect() {
        let given = [
            ("count", Value::Integer(7)),
            ("faces", Value::Texts(vec![])),
            ("limits.high_m", Value::Double(2.5)),
            ("limits.low_m", Value::Double(1e-9)),
            ("name", Value::Text("\"quoted\" 'ü'\n".into())),
            ("stations.0.name", Value::Text("c".into())),
            ("use_sim_time", Value::Bool(true)),
        ];
        let Configuration { store, config: taken, .. } = configured(&given).unwrap();
        let mut expected = config();
        expected.count = 7;
        expected.faces.clear();
        expected.limits = Limits { low_m: 1e-9, high_m: 2.5 };
        expected.name = "\"quoted\" 'ü'\n".into();
        expected.stations[0].name = "c".into();
        assert_eq!(taken, expected);
        assert_eq!(store.get("use_sim_time"), Some(&Value::Bool(true)));
        assert_eq!(store.get("limits.low_m"), Some(&Value::Double(1e-9)));
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_its_name_and_file() {
        for (given, says) in [
            (vec![("cuont", Value::Integer(1))], "good.yaml: there is no parameter cuont"),
            (vec![("count", Value::Double(1.0))], "good.yaml: parameter count cannot be 1.0: 1.0 is not an integer"),
            (vec![("count", Value::Integer(-1))], "good.yaml: parameter count cannot be -1: "),
            (vec![("limits.low_m", Value::Double(2.0))], "2.0 is not in 0.0 … 1.0"),
            (vec![("limits.high_m", Value::Double(f64::NAN))], "is not finite"),
            (
                vec![("limits.high_m", Value::Double(-1.0)), ("count", Value::Integer(1))],
                "good.yaml: parameter limits.high_m cannot be -1.0: low_m = 0.0000001 is not below high_m = -1",
            ),
            (
                vec![("limits.high_m", Value::Double(0.2)), ("limits.low_m", Value::Double(0.4))],
                "the parameters given by good.yaml do not go together: low_m = 0.4",
            ),
        ] {
            let error = configured(&given).map(|taken| taken.config).expect_err(says);
            assert!(error.contains(says), "{error}");
        }
    }

    proptest! {
        /// Numbers must not change on their way into the configuration.
        #[test]
        fn numbers_arrive_as_they_were(low_m in -1e300..1e300_f64, count in any::<u32>()) {
            let changes = [("limits.low_m".to_owned(), Value::Double(low_m)), ("limits.high_m".to_owned(), Value::Double(f64::MAX)), ("count".to_owned(), Value::Integer(count.into()))];
            let taken = changed(&config(), check, &changes).unwrap();
            prop_assert_eq!(taken.limits.low_m.to_bits(), low_m.to_bits());
            prop_assert_eq!(taken.count, count);
        }
    }
}
