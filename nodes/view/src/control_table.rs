//! The controls there are, what they take, and whether they may be used.

use serde::Serialize;
use serde_json::{Map, Value};

use crate::description::{Description, Feeder, Source};

/// Speeds that can be asked for, simulated s per wall s.
const SPEEDS: (f64, f64) = (0.001, 1000.0);
/// How much a waveform may be scaled at least, and at most where the motor would do more.
const SCALES: (f64, f64) = (0.05, 4.0);

/// What an argument may be.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum Kind {
    /// Any number from `min` to `max`.
    Number { min: f64, max: f64, unit: &'static str },
    /// Any whole number from `min` to `max`.
    Integer { min: u32, max: u32, unit: &'static str },
    /// True or false.
    Boolean,
    /// One of these.
    Choice { choices: Vec<String> },
}

/// An argument of a control.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Argument {
    name: &'static str,
    #[serde(flatten)]
    kind: Kind,
    /// What it is unless stated.
    default: Value,
    /// It has a meaning when it is left out, too.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    optional: bool,
}

/// Something that a viewer can ask for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Control {
    /// Its name.
    pub(crate) name: &'static str,
    /// Whether it is about the run or a feeder.
    pub(crate) scope: Scope,
    permitted: bool,
    /// Why it may not be used.
    reason: Option<String>,
    arguments: Vec<Argument>,
}

/// What a control is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Scope {
    /// The run.
    Run,
    /// One feeder.
    Feeder,
}

impl Argument {
    fn new(name: &'static str, kind: Kind, default: impl Into<Value>) -> Self {
        Self { name, kind, default: default.into(), optional: false }
    }

    /// Checks a value.
    fn check(&self, value: &Value) -> Result<(), String> {
        let allowed = match &self.kind {
            Kind::Number { min, max, .. } => match value.as_f64() {
                Some(number) if (*min..=*max).contains(&number) => return Ok(()),
                _ => format!("{min} to {max}"),
            },
            Kind::Integer { min, max, .. } => match value.as_u64() {
                Some(number) if (u64::from(*min)..=u64::from(*max)).contains(&number) => return Ok(()),
                _ => format!("whole numbers from {min} to {max}"),
            },
            Kind::Boolean if value.is_boolean() => return Ok(()),
            Kind::Boolean => "true and false".to_owned(),
            Kind::Choice { choices } if choices.iter().any(|choice| value.as_str() == Some(choice)) => return Ok(()),
            Kind::Choice { choices } => format!("{choices:?}"),
        };
        Err(format!("{} = {value}, allowed are {allowed}", self.name))
    }
}

impl Control {
    /// Checks what is given, and adds what is left out.
    ///
    /// # Errors
    /// Why the control may not be used, or not so.
    pub(crate) fn arguments(&self, mut given: Map<String, Value>) -> Result<Map<String, Value>, String> {
        if let Some(reason) = &self.reason {
            return Err(reason.clone());
        }
        if let Some(unknown) = given.keys().find(|name| self.arguments.iter().all(|argument| argument.name != **name)) {
            let known: Vec<&str> = self.arguments.iter().map(|argument| argument.name).collect();
            return Err(format!("{unknown:?} is no argument of {}, allowed are {known:?}", self.name));
        }
        for argument in &self.arguments {
            match given.get(argument.name) {
                Some(value) => argument.check(value)?,
                None if argument.optional => {}
                None => _ = given.insert(argument.name.to_owned(), argument.default.clone()),
            }
        }
        Ok(given)
    }
}

/// The largest factor by which the courier could run the feeder's waveform.
fn scale_max(feeder: &Feeder) -> f64 {
    let runs =
        |scale: f64| feeder.waveform.scaled(scale).is_ok_and(|waveform| feeder.envelope.check(&waveform).is_ok());
    let (mut low, mut high) = (1.0, SCALES.1);
    if runs(high) {
        return high;
    }
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if runs(middle) { low = middle } else { high = middle }
    }
    (low * 1000.0).floor() / 1000.0
}

/// All controls, as they are for this source.
pub(crate) fn controls(cell: &Description, source: Source, read_only: bool) -> Vec<Control> {
    let number = |min, max, unit| Kind::Number { min, max, unit };
    let integer = |min, max, unit| Kind::Integer { min, max, unit };
    let scale = cell.feeders.iter().map(scale_max).fold(SCALES.1, f64::min);
    let period_s = cell.feeders.first().map_or(0.1, |feeder| feeder.waveform.period_s());
    let stations: Vec<String> = cell.stations.iter().map(|station| station.name.clone()).collect();
    let poses: Vec<String> = std::iter::once("").chain(cell.pose_classes()).map(str::to_owned).collect();
    let wanted = cell.part.wanted_poses.first().map(|pose| cell.part.poses[*pose].name.clone()).unwrap_or_default();
    let station = stations.first().cloned().unwrap_or_default();
    let period = Argument { optional: true, ..Argument::new("period_s", number(0.01, 1.0, "s"), period_s) };
    let (run, feeder) = (Scope::Run, Scope::Feeder);
    let table: Vec<(&'static str, Scope, Vec<Argument>)> = vec![
        ("pause", run, vec![]),
        ("resume", run, vec![]),
        ("step", run, vec![Argument::new("ticks", integer(1, 1000, "ticks"), 1)]),
        ("speed", run, vec![Argument::new("speed", number(SPEEDS.0, SPEEDS.1, "s/s"), 1.0)]),
        ("full_speed", run, vec![]),
        ("reset", run, vec![]),
        ("load_parts", feeder, vec![Argument::new("count", integer(1, 100, "parts"), 5)]),
        ("set_feeding", feeder, vec![Argument::new("enabled", Kind::Boolean, true)]),
        ("set_waveform", feeder, vec![Argument::new("scale", number(SCALES.0, scale, ""), 1.0), period]),
        (
            "deliver",
            feeder,
            vec![
                Argument::new("station", Kind::Choice { choices: stations }, station),
                Argument::new("pose_class", Kind::Choice { choices: poses }, wanted),
                Argument::new("tolerance_m", number(1e-4, 0.05, "m"), 1e-3),
                Argument::new("timeout_s", number(0.0, 3600.0, "s"), 120.0),
            ],
        ),
        ("hand_over", feeder, vec![Argument::new("taken", Kind::Boolean, true)]),
        ("cancel", feeder, vec![]),
        ("emergency_stop", feeder, vec![]),
        ("reset_fault", feeder, vec![]),
        ("reset_planner", feeder, vec![]),
    ];
    let control = |(name, scope, arguments): (&'static str, Scope, Vec<Argument>)| {
        let reason = if read_only {
            Some("this view only shows")
        } else {
            match (source, name) {
                (Source::Bag, "pause" | "resume" | "step" | "speed") => None,
                (Source::Bag, _) => Some("a bag is played: what was done cannot be changed"),
                _ => None,
            }
        };
        Control { name, scope, permitted: reason.is_none(), reason: reason.map(str::to_owned), arguments }
    };
    table.into_iter().map(control).collect()
}

#[cfg(test)]
mod tests {
    use feeder_scenario::plan::load_plan;
    use serde_json::json;

    use super::*;

    fn cell() -> Description {
        Description::new(&load_plan(None).unwrap(), "default").unwrap()
    }

    fn arguments(control: &str, given: Value) -> Result<Value, String> {
        let all = controls(&cell(), Source::Run, false);
        let control = all.iter().find(|one| one.name == control).unwrap();
        let Value::Object(given) = given else { panic!("{given} is no object") };
        control.arguments(given).map(Value::Object)
    }

    #[test]
    fn values_out_of_range_are_refused_by_name_and_range() {
        for (control, given, words) in [
            ("speed", json!({ "speed": 5000 }), ["speed = 5000", "0.001 to 1000"]),
            ("speed", json!({ "speed": "fast" }), ["speed = \"fast\"", "0.001 to 1000"]),
            ("speed", json!({ "speed": null }), ["speed = null", "0.001 to 1000"]),
            ("load_parts", json!({ "count": 0 }), ["count = 0", "whole numbers from 1 to 100"]),
            ("load_parts", json!({ "count": 1.5 }), ["count = 1.5", "whole numbers"]),
            ("set_feeding", json!({ "enabled": 1 }), ["enabled = 1", "true and false"]),
            ("deliver", json!({ "station": "moon" }), ["station = \"moon\"", "station_1"]),
            ("pause", json!({ "hard": true }), ["\"hard\" is no argument", "pause"]),
        ] {
            let error = arguments(control, given).unwrap_err();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        }
        let asked = arguments("deliver", json!({ "timeout_s": 5 })).unwrap();
        assert_eq!((&asked["station"], &asked["timeout_s"]), (&json!("station_1"), &json!(5)));
        assert_eq!(arguments("set_waveform", json!({})).unwrap(), json!({ "scale": 1.0 }));
    }

    #[test]
    fn the_largest_scale_is_the_largest_that_runs() {
        let cell = cell();
        let feeder = &cell.feeders[0];
        let scale = scale_max(feeder);
        assert!(scale >= 1.0 && scale < SCALES.1, "{scale}");
        let runs = |scale: f64| feeder.envelope.check(&feeder.waveform.scaled(scale).unwrap()).is_ok();
        assert!(runs(scale) && !runs(scale + 0.01));
    }

    #[test]
    fn who_only_looks_or_plays_a_bag_changes_nothing() {
        let permitted = |source, read_only| -> Vec<&'static str> {
            let all = controls(&cell(), source, read_only).into_iter();
            all.filter(|control| control.arguments(Map::new()).is_ok()).map(|control| control.name).collect()
        };
        assert_eq!(permitted(Source::Run, true), [""; 0]);
        assert_eq!(permitted(Source::Bag, false), ["pause", "resume", "step", "speed"]);
        assert_eq!(permitted(Source::Graph, false), permitted(Source::Run, false));
    }
}
