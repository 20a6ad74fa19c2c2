//! What every node offers beside its own ports: `/rosout`, and its configuration as parameters.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::Serialize;
use serde_json::Value as Json;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::args::LogLevel;
use crate::clock::Clock;
use crate::dds::{DdsError, Participant};
use crate::node::NodeError;
use crate::parameters::{Declaration, ParameterServer, Store, Value};
use crate::rosout::{Rosout, RosoutLayer};

/// What the DDS library reports as errors are mostly peers that come and go.
const DDS_FILTER: &str = "rustdds=off,ros2_client=off,mio=off";

static ROSOUT: OnceLock<RosoutLayer> = OnceLock::new();

/// Sends log messages to standard error, and those of nodes to `/rosout`: those that `RUST_LOG` chooses, else those of
/// `level` and graver, from info where none is given. To be called once, by `main`.
pub fn start_logging(level: Option<LogLevel>) {
    let level = match level {
        Some(LogLevel::Debug) => "debug",
        None | Some(LogLevel::Info) => "info",
        Some(LogLevel::Warn) => "warn",
        Some(LogLevel::Error | LogLevel::Fatal) => "error",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(format!("{level},{DDS_FILTER}")));
    let terminal = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
    let rosout = ROSOUT.get_or_init(RosoutLayer::new).clone();
    tracing_subscriber::registry().with(filter).with(terminal).with(rosout).init();
}

/// A node's `/rosout` and parameter services, until dropped.
pub(crate) struct Housekeeping {
    _parameters: ParameterServer,
    _rosout: Option<Rosout>,
}

impl Housekeeping {
    pub(crate) fn open(participant: &Participant, parameters: Store, clock: &Clock) -> Result<Self, DdsError> {
        let rosout = ROSOUT.get().map(|layer| layer.attach(participant, clock.clone())).transpose()?;
        // Every parameter is read-only, so nothing is ever accepted here.
        let refuse = |_: &[(String, Value)]| Err("parameters are read-only".to_owned());
        let parameters = ParameterServer::new(participant, parameters, clock.clone(), refuse)?;
        Ok(Self { _parameters: parameters, _rosout: rosout })
    }
}

/// A configuration as read-only parameters, with dotted names, and `use_sim_time`.
pub(crate) fn parameters_of<C: Serialize>(config: &C, use_sim_time: bool) -> Result<Store, NodeError> {
    let mut declarations =
        vec![Declaration::new("use_sim_time", Value::Bool(use_sim_time), "Whether time is that of /clock").read_only()];
    flatten("", &serde_json::to_value(config).map_err(NodeError::new)?, &mut declarations);
    Store::new(declarations, &BTreeMap::new()).map_err(NodeError::new)
}

fn flatten(name: &str, json: &Json, declarations: &mut Vec<Declaration>) {
    let below = |key: &dyn std::fmt::Display| if name.is_empty() { key.to_string() } else { format!("{name}.{key}") };
    match json {
        Json::Object(fields) => fields.iter().for_each(|(key, value)| flatten(&below(key), value, declarations)),
        Json::Array(values) => match list(values) {
            Some(value) => declarations.push(Declaration::new(name, value, "From the scenario").read_only()),
            None => values.iter().enumerate().for_each(|(index, value)| flatten(&below(&index), value, declarations)),
        },
        scalar => {
            let value = value(scalar);
            declarations.extend(value.map(|value| Declaration::new(name, value, "From the scenario").read_only()));
        }
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
    let numbers: Option<Vec<f64>> = values.iter().map(Json::as_f64).collect();
    let texts = || values.iter().map(|value| value.as_str().map(str::to_owned)).collect::<Option<Vec<_>>>();
    numbers.map(Value::Doubles).or_else(|| texts().map(Value::Texts))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_becomes_dotted_parameters() {
        let config = serde_json::json!({
            "name": "feeder", "on": true, "count": 3, "size": 0.5, "none": null,
            "places": [0.1, 0.2], "stations": [{ "name": "a" }, { "name": "b" }],
        });
        let store = parameters_of(&config, true).unwrap();
        assert_eq!(store.get("name"), Some(&Value::Text("feeder".into())));
        assert_eq!(store.get("count"), Some(&Value::Integer(3)));
        assert_eq!(store.get("size"), Some(&Value::Double(0.5)));
        assert_eq!(store.get("places"), Some(&Value::Doubles(vec![0.1, 0.2])));
        assert_eq!(store.get("stations.1.name"), Some(&Value::Text("b".into())));
        assert_eq!(store.get("use_sim_time"), Some(&Value::Bool(true)));
        assert_eq!(store.get("none"), None);
        assert!(store.check("count", &Value::Integer(4)).is_err());
    }
}
