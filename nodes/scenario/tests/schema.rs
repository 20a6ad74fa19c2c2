//! The JSON Schema of a scenario, against the scenarios that come with the feeder.

use std::path::Path;

use feeder_scenario::Scenario;
use serde_json::Value;

/// What of a value the schema does not allow: types, missing and unknown keys.
fn problems(root: &Value, schema: &Value, value: &Value, place: &str) -> Vec<String> {
    let mut found = Vec::new();
    if let Some(name) = schema["$ref"].as_str() {
        let referred = root.pointer(name.trim_start_matches('#')).unwrap_or_else(|| panic!("{name} is nowhere"));
        found.extend(problems(root, referred, value, place));
    }
    for key in ["anyOf", "oneOf"] {
        let Some(alternatives) = schema[key].as_array() else { continue };
        let wrong: Vec<_> = alternatives.iter().map(|schema| problems(root, schema, value, place)).collect();
        if wrong.iter().all(|problems| !problems.is_empty()) {
            found.extend(wrong.into_iter().flatten());
        }
    }
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_i64() || number.is_u64() => "integer",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let allowed: Vec<_> = match &schema["type"] {
        Value::String(kind) => vec![kind.as_str()],
        Value::Array(kinds) => kinds.iter().filter_map(Value::as_str).collect(),
        _ => vec![],
    };
    if !(allowed.is_empty() || allowed.contains(&kind) || kind == "integer" && allowed.contains(&"number")) {
        found.push(format!("{place} is {kind}, not {allowed:?}"));
    }
    if schema.get("const").is_some_and(|constant| constant != value) {
        found.push(format!("{place} is not {}", schema["const"]));
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if value.get(key).is_none() {
            found.push(format!("{place}.{key} is missing"));
        }
    }
    for (key, value) in value.as_object().into_iter().flatten() {
        match schema["properties"].get(key) {
            Some(schema) => found.extend(problems(root, schema, value, &format!("{place}.{key}"))),
            None if schema["additionalProperties"] == false => found.push(format!("{place}.{key} is unknown")),
            None => {}
        }
    }
    for (index, value) in value.as_array().into_iter().flatten().enumerate() {
        found.extend(problems(root, &schema["items"], value, &format!("{place}.{index}")));
    }
    found
}

fn schema() -> Value {
    schemars::schema_for!(Scenario).into()
}

#[test]
fn every_scenario_that_comes_with_the_feeder_follows_the_schema() {
    let schema = schema();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch_configs");
    let mut checked = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "yaml") {
            let scenario = serde_saphyr::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
            assert_eq!(problems(&schema, &schema, &scenario, "scenario"), [""; 0], "{}", path.display());
            checked += 1;
        }
    }
    assert!(checked >= 4, "{checked} scenarios");
    // Every value spelled out, too.
    let all = serde_json::to_value(Scenario::default()).unwrap();
    assert_eq!(problems(&schema, &schema, &all, "scenario"), [""; 0]);
}

#[test]
fn the_schema_refuses_what_is_missing_unknown_or_of_another_type() {
    let schema = schema();
    for (pointer, key, value, says) in [
        ("", "sede", Value::from(1), "scenario.sede is unknown"),
        ("", "tray", Value::from(1), "scenario.tray is integer, not [\"object\"]"),
        ("/courier/limits", "mas_kg", Value::from(1.0), "scenario.courier.limits.mas_kg is unknown"),
        ("/waveform", "period_s", Value::from("short"), "scenario.waveform.period_s is string, not [\"number\"]"),
    ] {
        let mut scenario = serde_json::to_value(Scenario::default()).unwrap();
        scenario.pointer_mut(pointer).unwrap()[key] = value;
        let found = problems(&schema, &schema, &scenario, "scenario");
        assert!(found.iter().any(|problem| problem == says), "{says}: {found:?}");
    }
    let mut scenario = serde_json::to_value(Scenario::default()).unwrap();
    scenario.as_object_mut().unwrap().remove("stations");
    assert_eq!(problems(&schema, &schema, &scenario, "scenario"), ["scenario.stations is missing"]);
}
