//! What every node offers beside its own ports: `/rosout`, `/diagnostics`, parameters, and descriptions of its types.

use std::sync::mpsc::Sender;
use std::time::Duration;

use minifactory_msgs::interface::standard::DIAGNOSTICS;
use minifactory_msgs::std_msgs::msg::Header;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::args::LogLevel;
use crate::clock::TimeSource;
use crate::configuration::{Configuration, changed};
use crate::dds::{BackgroundTask, DdsError, Loss, Participant, Server, Writer};
use crate::health::{Health, HealthLevel};
use crate::logging;
use crate::node::NodeError;
use crate::parameters::{Declaration, ParameterServer, Store, Value};
use crate::rosout::Rosout;
use crate::type_description;

/// Whether a node takes its time from `/clock`.
pub(crate) const USE_SIM_TIME: &str = "use_sim_time";
/// Whether a node with a lifecycle becomes active by itself; the name is that of Nav2's lifecycle manager.
pub(crate) const AUTOSTART: &str = "autostart";
/// Whether a node describes its types; the name is rclcpp's.
const DESCRIBE_TYPES: &str = "start_type_description_service";
/// From which gravity on messages are logged.
const LOG_LEVEL: &str = "log_level";
/// Between reports of what was lost, wall time.
const REPORT_PERIOD: Duration = Duration::from_secs(1);

/// The parameters every node has, and [`AUTOSTART`] with this default for one with a lifecycle.
pub(crate) fn own_parameters(use_sim_time: bool, autostart: Option<bool>) -> Vec<Declaration> {
    let level = logging::level();
    let words = LogLevel::ALL.map(LogLevel::word).join(", ");
    let autostart = autostart.map(|autostart| {
        let meaning = "Whether the node becomes active by itself, or when its lifecycle is led there";
        Declaration::new(AUTOSTART, Value::Bool(autostart), meaning).read_only()
    });
    let own = [
        Declaration::new(USE_SIM_TIME, Value::Bool(use_sim_time), "Whether time is that of /clock").read_only(),
        Declaration::new(DESCRIBE_TYPES, Value::Bool(true), "Whether get_type_description is offered").read_only(),
        Declaration::new(LOG_LEVEL, Value::Text(level.word().to_owned()), "Least gravity of what this process logs")
            .constraints(&words),
    ];
    own.into_iter().chain(autostart).collect()
}

/// What a node offers beside its ports, until dropped.
pub(crate) struct Housekeeping {
    parameters: ParameterServer,
    _types: Option<Server>,
    _reporting: BackgroundTask,
    _diagnostics: Writer,
    _rosout: Option<Rosout>,
}

impl Housekeeping {
    /// Opens everything. `accept` is asked about changes of parameters other than [`own_parameters`].
    pub(crate) fn open(
        participant: &Participant,
        parameters: Store,
        clock: &TimeSource,
        accept: impl FnMut(&[(String, Value)]) -> Result<(), String> + Send + 'static,
    ) -> Result<Self, DdsError> {
        let describes = parameters.get(DESCRIBE_TYPES) != Some(&Value::Bool(false));
        let diagnostics = participant.topic_writer(&DIAGNOSTICS, "")?;
        let reporting = participant.background(report(participant, &diagnostics, clock.clone()));
        Ok(Self {
            _rosout: logging::rosout().map(|layer| layer.attach(participant, clock.clone())).transpose()?,
            parameters: ParameterServer::new(participant, parameters, clock.clone(), with_own(accept))?,
            _types: describes.then(|| type_description::serve(participant)).transpose()?,
            _reporting: reporting,
            _diagnostics: diagnostics,
        })
    }

    /// Sets a parameter as `ros2 param set` would.
    ///
    /// # Errors
    /// The reason for which it may not be set.
    pub(crate) fn set(&self, name: &str, value: Value) -> Result<(), String> {
        self.parameters.set(name, value)
    }
}

/// Sets what a node's own parameters were given at the start.
///
/// # Errors
/// The reason for which one of them cannot be so.
pub(crate) fn apply_own(parameters: &Store) -> Result<(), NodeError> {
    let level = parameters.get(LOG_LEVEL).map_or(Ok(logging::level()), level_of).map_err(NodeError::new)?;
    logging::set_level(level).map_err(NodeError::new)
}

fn level_of(value: &Value) -> Result<LogLevel, String> {
    let word = if let Value::Text(word) = value { word.as_str() } else { "" };
    let words = || LogLevel::ALL.map(LogLevel::word).join(", ");
    LogLevel::parse(word).ok_or_else(|| format!("parameter {LOG_LEVEL}: {word:?} is no level, allowed are {}", words()))
}

/// Takes changes of the node's own parameters, and of others if `accept` does.
fn with_own(
    mut accept: impl FnMut(&[(String, Value)]) -> Result<(), String> + Send + 'static,
) -> impl FnMut(&[(String, Value)]) -> Result<(), String> + Send + 'static {
    move |changes| {
        let (own, others): (Vec<_>, Vec<_>) = changes.iter().cloned().partition(|(name, _)| name == LOG_LEVEL);
        let level = own.last().map(|(_, value)| level_of(value)).transpose()?;
        if !others.is_empty() {
            accept(&others)?;
        }
        level.map_or(Ok(()), logging::set_level)
    }
}

/// Takes changes of a configuration that are valid, and hands the whole on to the node by `sender`.
pub(crate) fn reconfiguring<C>(
    configuration: &Configuration<C>,
    sender: Sender<C>,
) -> impl FnMut(&[(String, Value)]) -> Result<(), String> + Send + 'static
where
    C: Serialize + DeserializeOwned + Clone + Send + 'static,
{
    let (mut config, check) = (configuration.config.clone(), configuration.check);
    move |changes: &[(String, Value)]| {
        config = changed(&config, check, changes)?;
        sender.send(config.clone()).map_err(|_| "the node is about to leave".to_owned())
    }
}

/// Publishes what the participant's endpoints have lost or refused.
fn report(
    participant: &Participant,
    diagnostics: &Writer,
    clock: TimeSource,
) -> impl Future<Output = ()> + Send + 'static {
    let (losses, outlet, node) = (participant.watch_losses(), diagnostics.outlet(), participant.node().to_string());
    async move {
        let mut known = 0;
        loop {
            tokio::time::sleep(REPORT_PERIOD).await;
            let losses = losses();
            let total = losses.iter().map(|loss| loss.count).sum();
            let header = Header { stamp: clock(), frame_id: String::new() };
            let health = communication(&node, &losses, total > known);
            known = total;
            outlet.publish_message(&health.into_message(header));
        }
    }
}

/// How communication fares: a warning while losses are fresh, and all counts.
fn communication(node: &str, losses: &[Loss], fresh: bool) -> Health {
    let (level, message) = match (losses.is_empty(), fresh) {
        (true, _) => (HealthLevel::Good, "nothing lost or refused"),
        (false, false) => (HealthLevel::Good, "nothing more lost or refused"),
        (false, true) => (HealthLevel::Warning, "samples, requests or replies lost or refused"),
    };
    let value = |loss: &Loss| (format!("{}: {}", loss.endpoint, loss.what), loss.count.to_string());
    Health {
        name: format!("{node}: communication"),
        level,
        message: message.to_owned(),
        hardware_id: String::new(),
        values: losses.iter().map(value).collect(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn fresh_losses_are_a_warning_and_counts_stay() {
        let loss = Loss { endpoint: "rt/a".into(), what: "samples lost", count: 3 };
        let ok = communication("/n", &[], false);
        assert_eq!((ok.level, ok.name.as_str(), ok.values.len()), (HealthLevel::Good, "/n: communication", 0));
        let fresh = communication("/n", std::slice::from_ref(&loss), true);
        assert_eq!((fresh.level, fresh.values[0].0.as_str()), (HealthLevel::Warning, "rt/a: samples lost"));
        let later = communication("/n", &[loss], false);
        assert_eq!((later.level, later.values[0].1.as_str()), (HealthLevel::Good, "3"));
    }

    #[test]
    fn nothing_is_changed_when_one_change_is_refused() {
        let mut seen = 0;
        let (sender, asked) = channel();
        let mut accept = with_own(move |changes| {
            seen += changes.len();
            let _ = sender.send(seen);
            Err("no".to_owned())
        });
        let text = |name: &str, value: &str| (name.to_owned(), Value::Text(value.to_owned()));
        assert_eq!(accept(&[text("x", "y"), text(LOG_LEVEL, "debug")]), Err("no".to_owned()));
        assert_eq!(asked.try_recv(), Ok(1));
        let refused = accept(&[text("x", "y"), text(LOG_LEVEL, "loud")]).unwrap_err();
        assert!(refused.contains("debug, info, warn, error, fatal"), "{refused}");
        assert!(asked.try_recv().is_err(), "nobody is asked about what cannot be done");
    }
}
