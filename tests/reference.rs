//! The reference pages are what the code says. `UPDATE=1 cargo test -p feeder_tests --test suite reference::` writes them.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use feeder::parameters_of;
use feeder_runtime::parameters::{Declaration, Range};
use feeder_scenario::Scenario;
use feeder_scenario::plan::load_plan;
use serde_json::{Map, Value};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Compares a page of `docs/reference` with what was made now, or writes it.
#[track_caller]
fn hold(page: &str, made: &str) {
    let path = Path::new(ROOT).join("docs/reference").join(page);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, made).unwrap();
    }
    let found = std::fs::read_to_string(path).unwrap_or_default();
    let stale = made.lines().zip(found.lines()).find(|(made, found)| made != found);
    assert!(made == found, "docs/reference/{page} is stale at {stale:?}; write it anew with UPDATE=1");
}

fn introduction(title: &str, source: &str, test: &str) -> String {
    format!(
        "# {title}\n\nMade from {source}; write it anew with `UPDATE=1 cargo test -p feeder_tests --test suite reference::{test}`.\n\n"
    )
}

/// A text in a cell of a table.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn commands(title: &str, test: &str, command: &clap::Command) -> String {
    let options = clap_markdown::MarkdownOptions::new().show_footer(false).show_table_of_contents(true);
    let options = options.title(title.to_owned());
    let made = clap_markdown::help_markdown_command_custom(command, &options);
    let (heading, rest) = made.split_once('\n').unwrap();
    let introduction = introduction(heading.trim_start_matches("# "), "the commands' own definition", test);
    let lines: Vec<&str> = rest.lines().map(str::trim_end).collect();
    introduction + lines.join("\n").trim_start() + "\n"
}

#[test]
fn commands_are_those_of_the_page() {
    hold("commands.md", &commands("The feeder command", "commands", &feeder::command_line()));
    hold("laboratory.md", &commands("The feeder-lab command", "commands", &feeder_lab::command_line()));
}

/// A link to the section of a type of the scenario.
fn link(name: &str) -> String {
    format!("[{name}](#{})", name.to_lowercase())
}

fn number(value: &Value) -> String {
    value.as_f64().map_or_else(|| value.to_string(), |value| format!("{value}"))
}

fn reference_of(schema: &Value) -> Option<&str> {
    schema["$ref"].as_str()?.strip_prefix("#/$defs/")
}

/// What kind of value a key takes.
fn kind(schema: &Value) -> String {
    if let Some(name) = reference_of(schema) {
        return link(name);
    }
    if let Some(value) = schema.get("const") {
        return format!("`{}`", value.as_str().map_or_else(|| value.to_string(), str::to_owned));
    }
    if let Some(values) = schema["enum"].as_array() {
        let words: Vec<String> = values.iter().map(|value| format!("`{}`", value.as_str().unwrap_or("null"))).collect();
        return words.join(", ");
    }
    for several in ["anyOf", "oneOf", "allOf"] {
        if let Some(schemas) = schema[several].as_array() {
            let kinds = schemas.iter().filter(|schema| schema["type"] != "null").map(kind);
            return kinds.collect::<Vec<_>>().join(" or ");
        }
    }
    let words: Vec<&str> = match &schema["type"] {
        Value::String(word) => vec![word],
        Value::Array(words) => words.iter().filter_map(Value::as_str).filter(|word| *word != "null").collect(),
        _ => Vec::new(),
    };
    match words[..] {
        ["array"] if schema["items"].is_object() => {
            let count = match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
                (Some(least), Some(most)) if least == most => format!("{least} "),
                _ => String::new(),
            };
            format!("list of {count}{}", kind(&schema["items"]))
        }
        ["array"] => "list".to_owned(),
        ["object"] if schema["additionalProperties"].is_object() => {
            format!("map of {}", kind(&schema["additionalProperties"]))
        }
        ["object"] if schema["properties"].is_object() => {
            let keys: Vec<String> = schema["properties"]
                .as_object()
                .unwrap()
                .iter()
                .map(|(key, schema)| format!("`{key}`: {}", kind(schema)))
                .collect();
            format!("{{ {} }}", keys.join(", "))
        }
        _ => words.join(" or "),
    }
}

fn range(schema: &Value) -> String {
    let bound = |inclusive: &str, exclusive: &str, sign: &str| {
        let bound = |key: &str, sign: &str| schema.get(key).map(|value| format!("{sign} {}", number(value)));
        bound(exclusive, sign).or_else(|| bound(inclusive, &format!("{sign}=")))
    };
    let bounds = [bound("minimum", "exclusiveMinimum", ">"), bound("maximum", "exclusiveMaximum", "<")];
    bounds.into_iter().flatten().collect::<Vec<_>>().join(", ").replace(">=", "≥").replace("<=", "≤")
}

fn default(key: &str, schema: &Value, required: &[&str]) -> String {
    match schema.get("default") {
        _ if required.contains(&key) => "must be given".to_owned(),
        None | Some(Value::Null) => String::new(),
        // Sections of their own say what their keys are when left out.
        Some(Value::Object(_)) => String::new(),
        Some(value) => format!("`{value}`"),
    }
}

fn table_of_keys(schema: &Value) -> String {
    let Some(keys) = schema["properties"].as_object() else { return String::new() };
    let required: Vec<&str> = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let mut table = "| Key | Value | Default | Range | Meaning, unit |\n|---|---|---|---|---|\n".to_owned();
    for (key, schema) in keys {
        let meaning = cell(schema["description"].as_str().unwrap_or_default());
        let (kind, default, range) = (cell(&kind(schema)), cell(&default(key, schema, &required)), range(schema));
        writeln!(table, "| `{key}` | {kind} | {default} | {range} | {meaning} |").unwrap();
    }
    table + "\n"
}

/// The keys of a type, or of each of its kinds.
fn section(schema: &Value) -> String {
    let description = schema["description"].as_str().unwrap_or_default();
    let mut section = if description.is_empty() { String::new() } else { format!("{description}\n\n") };
    section += &table_of_keys(schema);
    for several in ["oneOf", "anyOf"] {
        for schema in schema[several].as_array().into_iter().flatten() {
            let meaning = cell(schema["description"].as_str().unwrap_or_default());
            let kind = &schema["properties"]["kind"]["const"];
            match kind.as_str() {
                Some(name) => write!(section, "`kind: {name}`: {meaning}\n\n{}", table_of_keys(schema)).unwrap(),
                None if meaning.is_empty() => writeln!(section, "- {}", self::kind(schema)).unwrap(),
                None => writeln!(section, "- {}: {meaning}", self::kind(schema)).unwrap(),
            }
        }
    }
    section.trim_end().to_owned() + "\n\n"
}

#[test]
fn keys_of_a_scenario_are_those_of_the_page() {
    let schema = serde_json::to_value(schemars::schema_for!(Scenario)).unwrap();
    let source = "the JSON Schema that `feeder check --schema` prints";
    let mut page = introduction("What a scenario may hold", source, "keys");
    page += "A scenario is a YAML file. Lengths are in m, times in s, angles in rad, masses in kg, unless the key's name says \
             otherwise. An unknown key is refused, and so is a value outside its range; some ranges depend on other keys and are \
             checked by `feeder check`.\n\n";
    page += &section(&schema);
    let none = Map::new();
    for (name, schema) in schema["$defs"].as_object().unwrap_or(&none) {
        page += &format!("## {name}\n\n{}", section(schema));
    }
    hold("scenario.md", &(page.trim_end().to_owned() + "\n"));
}

fn limits(declaration: &Declaration) -> String {
    let limits = match declaration.range {
        Some(Range::Integer { from, to, .. }) => format!("{from} to {to}"),
        Some(Range::Double { from, to, .. }) => format!("{from} to {to}"),
        None => String::new(),
    };
    [limits, declaration.constraints.clone()].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("; ")
}

#[test]
fn parameters_of_the_nodes_are_those_of_the_page() {
    let mut page = introduction("Parameters", "what the nodes declare in the built-in scenario", "parameters");
    page += "Every parameter can be given at the start (`feeder node NAME --ros-args -p name:=value`, `--params-file`); those marked \
             *live* can be set while the node runs. Defaults are those of the built-in scenario. A node of another scenario has \
             that scenario's values, and lists have as many entries as that scenario gives them.\n\n";
    for planned in &load_plan(None).unwrap().nodes {
        writeln!(page, "## {}\n", planned.node.kind()).unwrap();
        page += "| Parameter | Default | Range | Meaning, unit |\n|---|---|---|---|\n";
        for declaration in parameters_of(planned).unwrap() {
            let live = if declaration.read_only { "" } else { " *live*" };
            let (name, default) = (&declaration.name, cell(&declaration.default.to_string()));
            let default = if default.len() > 60 { "…".to_owned() } else { format!("`{default}`") };
            let (limits, meaning) = (cell(&limits(&declaration)), cell(&declaration.description));
            writeln!(page, "| `{name}`{live} | {default} | {limits} | {meaning} |").unwrap();
        }
        page.push('\n');
    }
    hold("parameters.md", &(page.trim_end().to_owned() + "\n"));
}

#[test]
fn messages_are_those_of_the_page() {
    let msgs = Path::new(ROOT).join("msgs");
    let source = "the definitions in `msgs/`, the package `minifactory_msgs`";
    let mut page = introduction("Messages, services and actions of our own", source, "messages");
    page += "How they are used together is in [PROTOCOL.md](../../msgs/PROTOCOL.md), who sends them to whom in [topics](topics.md).\n";
    for folder in ["msg", "srv", "action"] {
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(msgs.join(folder)).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        for file in files {
            let name = file.file_stem().unwrap().to_str().unwrap().to_owned();
            let text = std::fs::read_to_string(&file).unwrap();
            write!(page, "\n## {folder}/{name}\n\n```text\n{}\n```\n", text.trim_end()).unwrap();
        }
    }
    hold("messages.md", &page);
}
