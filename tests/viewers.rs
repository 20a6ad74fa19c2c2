//! The layouts for RViz and Foxglove name topics, types, fields and frames that the built-in scenario has.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};

use feeder_runtime::dds::{NodeName, Participant, Reliability};
use feeder_wire::topics;
use minifactory_msgs::Message as _;
use minifactory_msgs::msg::{CourierState, DeliveryState, FeedMetrics, FeederState, RunProgress};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use serde_json::Value;

use crate::common::{Run, Up, wait_for};

/// What a display of RViz shows.
const DISPLAYS: [(&str, &str); 5] = [
    ("rviz_default_plugins/RobotModel", "std_msgs/msg/String"),
    ("rviz_default_plugins/MarkerArray", "visualization_msgs/msg/MarkerArray"),
    ("rviz_default_plugins/Odometry", "nav_msgs/msg/Odometry"),
    ("rviz_default_plugins/Camera", "sensor_msgs/msg/Image"),
    ("rviz_default_plugins/Image", "sensor_msgs/msg/Image"),
];

fn read(file: &str) -> String {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs/viewers"));
    std::fs::read_to_string(folder.join(file)).unwrap()
}

/// What is on the graph: topics with their types and whether they are reliable, and frames.
struct Seen {
    topics: BTreeMap<String, (String, Reliability)>,
    frames: BTreeSet<String>,
}

/// Looks until everything that is wanted has been found, or says what has not.
#[track_caller]
fn find(run: &Run, topics: &BTreeSet<String>, frames: &BTreeSet<String>) -> Seen {
    let participant = Participant::open(run.domain(), &NodeName::new("/test", "onlooker").unwrap()).unwrap();
    let heard = Arc::new(Mutex::new(BTreeSet::new()));
    let hear = |topic| {
        let heard = Arc::clone(&heard);
        let take = move |sample: feeder_runtime::dds::Sample| {
            let message: TFMessage = sample.decode().unwrap();
            for transform in message.transforms {
                heard.lock().unwrap().extend([transform.header.frame_id, transform.child_frame_id]);
            }
        };
        participant.topic_reader(topic, "", take).unwrap()
    };
    let _readers = [hear(&topics::TF), hear(&topics::TF_STATIC)];
    wait_for(&format!("{topics:?} and {frames:?}"), || {
        let graph = participant.discovered();
        let found = graph.writers.into_iter().filter_map(|writer| {
            let name = writer.topic.strip_prefix("rt")?.to_owned();
            let ros_type = writer.dds_type.replace("::dds_::", "::").replace("::", "/");
            Some((name, (ros_type.trim_end_matches('_').to_owned(), writer.reliability)))
        });
        let seen = Seen { topics: found.collect(), frames: heard.lock().unwrap().clone() };
        (topics.iter().all(|topic| seen.topics.contains_key(topic)) && frames.is_subset(&seen.frames)).then_some(seen)
    })
}

/// Every text in a value.
fn texts(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => vec![text],
        Value::Array(values) => values.iter().flat_map(texts).collect(),
        Value::Object(fields) => fields.values().flat_map(texts).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn rviz_shows_what_there_is() {
    let config: Value = serde_saphyr::from_str(&read("feeder.rviz")).unwrap();
    let manager = &config["Visualization Manager"];
    let mut shown = Vec::new();
    for display in manager["Displays"].as_array().unwrap() {
        let topic =
            if display["Description Topic"].is_null() { &display["Topic"] } else { &display["Description Topic"] };
        if let Some(name) = topic["Value"].as_str() {
            let class = display["Class"].as_str().unwrap();
            let wanted = DISPLAYS.iter().find(|(known, _)| *known == class);
            let (_, ros_type) = wanted.unwrap_or_else(|| panic!("what does {class} show?"));
            shown.push((name, *ros_type, topic["Reliability Policy"].as_str().unwrap()));
        }
    }
    assert_eq!(shown.len(), 9);
    let mut topics: BTreeSet<String> = shown.iter().map(|(topic, ..)| (*topic).to_owned()).collect();
    // Where RViz looks for the calibration of a camera's pictures.
    topics.insert("/feeder/camera/camera_info".to_owned());
    let frames = [&manager["Global Options"]["Fixed Frame"], &manager["Views"]["Current"]["Target Frame"]];
    let frames = frames.map(|frame| frame.as_str().unwrap().to_owned()).into();
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let seen = find(&run, &topics, &frames);
    for (topic, ros_type, reliability) in shown {
        let (offered, as_sent) = &seen.topics[topic];
        assert_eq!(offered, ros_type, "{topic}");
        assert!(reliability == "Best Effort" || *as_sent == Reliability::Reliable, "{topic} is sent as {as_sent:?}");
    }
}

/// Whether a path of fields leads through the definitions of a type and those it refers to.
fn leads(definition: &str, path: &[&str]) -> bool {
    let sections: Vec<&str> = definition.split("\n================").collect();
    // A type of the same package may be named without it.
    let is = |heading: &str, name: &str| {
        heading.strip_prefix("MSG: ").is_some_and(|full| full == name || full.ends_with(&format!("/{name}")))
    };
    let of =
        |name: &str| sections.iter().find(|text| text.lines().nth(1).is_some_and(|heading| is(heading, name))).copied();
    let mut here = Some(sections[0]);
    for field in path {
        let Some(text) = here else { return false };
        let line = text.lines().find_map(|line| {
            let mut words = line.split_whitespace();
            let (kind, name) = (words.next()?, words.next()?);
            (name == *field && !kind.starts_with('#')).then_some(kind)
        });
        let Some(kind) = line else { return false };
        here = of(kind);
    }
    true
}

#[test]
fn foxglove_shows_what_there_is() {
    let layout: Value = serde_json::from_str(&read("feeder.foxglove.json")).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    for panel in texts(&layout["layout"]) {
        assert!(panel == "row" || panel == "column" || panels.contains_key(panel), "there is no panel {panel}");
    }
    let mut paths: BTreeSet<&str> = panels.values().flat_map(texts).filter(|text| text.starts_with('/')).collect();
    for panel in panels.values() {
        paths.extend(panel["topics"].as_object().into_iter().flatten().map(|(topic, _)| topic.as_str()));
    }
    assert!(paths.len() > 15, "{paths:?}");
    let topics = paths.iter().map(|path| path.split('.').next().unwrap().to_owned()).collect();
    let tray = &panels["3D!tray"];
    let frames = [&tray["followTf"], &tray["layers"]["platen"]["frameId"]];
    let frames = frames.map(|frame| frame.as_str().unwrap().to_owned()).into();
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let seen = find(&run, &topics, &frames);
    let plotted = [
        Odometry::INFO,
        CourierState::INFO,
        DeliveryState::INFO,
        FeederState::INFO,
        FeedMetrics::INFO,
        RunProgress::INFO,
    ];
    let definitions: BTreeMap<String, &str> = plotted.iter().map(|info| (info.ros_type(), info.definition)).collect();
    for path in paths {
        let (topic, fields) = path.split_once('.').unwrap_or((path, ""));
        let fields: Vec<&str> = fields.split('.').filter(|field| !field.is_empty()).collect();
        let definition = definitions.get(&seen.topics[topic].0).copied().unwrap_or_default();
        assert!(leads(definition, &fields), "{path}: no such field in {}", seen.topics[topic].0);
    }
}
