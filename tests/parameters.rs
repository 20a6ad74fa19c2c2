//! Parameters of the feeder's nodes: given at the start, dumped and loaded, set while they run.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use feeder_runtime::cdr;
use feeder_runtime::dds::{NodeName, Participant};
use feeder_runtime::parameters::Value;
use feeder_runtime::testing::TestDomain;
use feeder_wire::topics::{CLOCK, DIAGNOSTICS, WAVEFORM};
use minifactory_msgs::Service;
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticArray;
use minifactory_msgs::msg::Waveform;
use minifactory_msgs::rcl_interfaces::msg::{Parameter, SetParametersResult};
use minifactory_msgs::rcl_interfaces::srv::{
    GetParameters, GetParametersRequest, ListParameters, ListParametersRequest, SetParameters, SetParametersRequest,
};
use minifactory_msgs::rosgraph_msgs::msg::Clock;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use tempfile::TempDir;

use crate::common::{FEEDER, Up, feeder};

const PATIENCE: Duration = Duration::from_secs(60);

fn participant(domain: &TestDomain) -> Participant {
    Participant::open(domain, &NodeName::new("/", "test").unwrap()).unwrap()
}

fn call<S: Service>(here: &Participant, service: &str, request: &S::Request) -> S::Response {
    here.service_client::<S>(service).unwrap().call(request, PATIENCE).wait().unwrap()
}

/// All parameters of a node, as `ros2 param dump` asks for them.
fn dump(here: &Participant, node: &str) -> BTreeMap<String, Value> {
    let list = ListParametersRequest::default();
    let names = call::<ListParameters>(here, &format!("{node}/list_parameters"), &list).result.names;
    let request = GetParametersRequest { names: names.clone() };
    let values = call::<GetParameters>(here, &format!("{node}/get_parameters"), &request).values;
    names.into_iter().zip(values.into_iter().map(|value| Value::from_message(value).unwrap())).collect()
}

fn set(here: &Participant, node: &str, name: &str, value: &Value) -> SetParametersResult {
    let parameters = vec![Parameter { name: name.to_owned(), value: value.to_message() }];
    let service = format!("{node}/set_parameters");
    call::<SetParameters>(here, &service, &SetParametersRequest { parameters }).results.remove(0)
}

/// A node in a process of its own, told to go when dropped.
struct Node(Child);

impl Node {
    fn start(domain: &TestDomain, name: &str, ros_args: &[&str]) -> Self {
        Self(command(domain, name, ros_args).stderr(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let pid = Pid::from_raw(self.0.id().try_into().unwrap()).unwrap();
        kill_process(pid, Signal::TERM).unwrap();
        self.0.wait().unwrap();
    }
}

fn command(domain: &TestDomain, name: &str, ros_args: &[&str]) -> Command {
    let mut command = feeder();
    command.args(["node", name, "--ros-args"]).args(ros_args);
    command.env("ROS_DOMAIN_ID", domain.id.to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    command.stdin(Stdio::null());
    command
}

fn write(folder: &TempDir, name: &str, text: &str) -> PathBuf {
    let file = folder.path().join(name);
    std::fs::write(&file, text).unwrap();
    file
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What `ros2 param dump` makes of values: dots become maps. YAML includes JSON.
fn dumped(node: &str, values: &BTreeMap<String, Value>) -> String {
    let mut tree = json!({});
    for (name, value) in values {
        let place = name.split('.').fold(&mut tree, |tree, key| &mut tree[key]);
        *place = match value {
            Value::Bool(value) => json!(value),
            Value::Integer(value) => json!(value),
            Value::Double(value) => json!(value),
            Value::Text(value) => json!(value),
            Value::Bytes(value) => json!(value),
            Value::Bools(value) => json!(value),
            Value::Integers(value) => json!(value),
            Value::Doubles(value) => json!(value),
            Value::Texts(value) => json!(value),
        };
    }
    json!({ node: { "ros__parameters": tree } }).to_string()
}

#[test]
fn what_is_given_takes_effect_and_what_is_dumped_can_be_given_again() {
    let node = "/feeder/vision_selector";
    let work = TempDir::new().unwrap();
    let file = "
/**:
  ros__parameters: {camera_period_ms: 200, selector.confidence_min: 0.9}
/feeder:
  vision_selector:
    ros__parameters:
      selector: {confidence_min: 0.8, contrast_min_levels: 12.5}
/*/waveform_generator:
  ros__parameters: {nobody: 1}
";
    let file = write(&work, "params.yaml", file);
    let domain = TestDomain::claim();
    let here = participant(&domain);
    let arguments = ["--params-file", text(&file), "-p", "part_class:=bush", "-p", "courier_driver:x:=1"];
    let first = {
        let _running = Node::start(&domain, "vision_selector", &arguments);
        dump(&here, node)
    };
    for (name, value) in [
        ("camera_period_ms", Value::Integer(200)),
        ("selector.confidence_min", Value::Double(0.8)),
        ("selector.contrast_min_levels", Value::Double(12.5)),
        ("part_class", Value::Text("bush".to_owned())),
        ("use_sim_time", Value::Bool(false)),
    ] {
        assert_eq!(first.get(name), Some(&value), "{name}");
    }
    let dump_file = write(&work, "dump.yaml", &dumped(node, &first));
    let again = {
        let _running = Node::start(&domain, "vision_selector", &["--params-file", text(&dump_file)]);
        dump(&here, node)
    };
    assert_eq!(again, first);
}

#[test]
fn a_node_with_parameters_that_make_no_sense_does_not_start_and_says_why() {
    let work = TempDir::new().unwrap();
    let domain = TestDomain::claim();
    let yaml = |name: &str, parameters: &str| {
        let file = write(&work, name, &format!("/**: {{ros__parameters: {{{parameters}}}}}"));
        vec!["--params-file".to_owned(), text(&file).to_owned()]
    };
    let given = |parameter: &str| vec!["-p".to_owned(), parameter.to_owned()];
    for (arguments, says) in [
        (
            yaml("unknown.yaml", "courier.limits.x_m_mni: 0.1"),
            ["unknown.yaml: there is no parameter courier.limits.x_m_mni", "courier.limits.x_m_min"],
        ),
        (yaml("type.yaml", "seed: many"), ["type.yaml: parameter seed cannot be", "\"many\" is not an integer"]),
        (yaml("range.yaml", "tick_ms: 1000"), ["range.yaml: parameter tick_ms cannot be 1000", "1 to 100"]),
        (yaml("broken.yaml", "a: ["), ["broken.yaml", "parameter file"]),
        (given("courier.fade_periods:=2.0"), ["--param courier.fade_periods:=2.0", "is not an integer"]),
        (given("use_sim_time:=3"), ["parameter use_sim_time cannot be 3", "is not a bool"]),
        (given("log_level:=loud"), ["log_level", "debug, info, warn, error, fatal"]),
    ] {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = command(&domain, "courier_driver", &arguments).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{arguments:?}");
        assert!(says.iter().all(|says| error.contains(says)), "{arguments:?}: {error}");
    }
}

#[test]
fn a_running_node_takes_what_may_be_set_and_the_clocks_speed_too() {
    let run = Up::new("--duration 20 --speed 0.1").start();
    let here = Participant::open(run.domain(), &NodeName::new("/", "test").unwrap()).unwrap();
    let node = "/feeder/vision_selector";
    assert!(set(&here, node, "selector.confidence_min", &Value::Double(0.7)).successful);
    assert!(set(&here, node, "log_level", &Value::Text("warn".to_owned())).successful);
    let values = dump(&here, node);
    assert_eq!(values["selector.confidence_min"], Value::Double(0.7));
    assert_eq!(values["log_level"], Value::Text("warn".to_owned()));
    for (name, value, says) in [
        ("selector.confidence_min", Value::Double(1.5), "1.5 is not in 0.0 … 1.0"),
        ("selector.miss_max", Value::Double(0.1), "read-only"),
        ("use_sim_time", Value::Bool(false), "read-only"),
    ] {
        let refused = set(&here, node, name, &value);
        assert!(!refused.successful && refused.reason.contains(says), "{refused:?}");
    }
    assert!(!set(&here, "/feeder_up", "speed", &Value::Double(-1.0)).successful);
    assert!(set(&here, "/feeder_up", "speed", &Value::Double(0.0)).successful);
    let outcome = run.outcome();
    assert!(outcome.status.success(), "{}", outcome.stderr);
    // At speed 0.1 it would have been 200 s.
    assert!(outcome.number("wall_s") < 150.0, "{}", outcome.summary());
}

#[test]
fn a_node_outside_a_run_goes_by_somebody_elses_clock() {
    let domain = TestDomain::claim();
    let here = participant(&domain);
    let (sender, heard) = std::sync::mpsc::channel();
    let _reader = here.topic_reader(&WAVEFORM, FEEDER, move |sample| {
        let _ = sender.send(sample.decode::<Waveform>().unwrap());
    });
    let clock = here.writer("/sim/clock", &CLOCK.dds_type(), &CLOCK.qos()).unwrap();
    let _node = Node::start(&domain, "waveform_generator", &["-p", "use_sim_time:=true", "-r", "/clock:=/sim/clock"]);
    crate::common::wait_for("the node to listen to the clock", || (clock.matched_readers() > 0).then_some(()));
    let stamp = Time { sec: 1234, nanosec: 560_000_000 };
    let waveform = crate::common::wait_for("the waveform", || {
        clock.publish(cdr::encode(&Clock { clock: stamp }).unwrap()).unwrap();
        heard.recv_timeout(Duration::from_millis(20)).ok()
    });
    assert_eq!(waveform.header.stamp, stamp);
}

#[test]
fn a_nodes_help_tells_its_parameters() {
    for name in ["vision_selector", "platen_arbiter"] {
        let output = crate::common::output(["node", name, "--", "--help"]);
        let said = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && said.contains("--ros-args") && said.contains("--config"), "{said}");
        // The built-in run has no arbiter whose values there would be to show.
        assert_eq!(said.contains("* selector.confidence_min = "), name == "vision_selector", "{said}");
    }
}

/// On the wall clock, where no camera is.
#[test]
fn a_selector_that_never_saw_an_image_does_not_say_that_the_camera_stopped() {
    let domain = TestDomain::claim();
    let here = participant(&domain);
    let (sender, heard) = std::sync::mpsc::channel();
    let _reader = here.topic_reader(&DIAGNOSTICS, "", move |sample| {
        let _ = sender.send(sample.decode::<DiagnosticArray>().unwrap());
    });
    let _node = Node::start(&domain, "vision_selector", &[]);
    let said = crate::common::wait_for("word of the camera", || {
        let array = heard.recv_timeout(Duration::from_millis(20)).ok()?;
        let said = array.status.into_iter().map(|status| status.message);
        said.into_iter().find(|said| said.contains("no image") || said.contains("camera"))
    });
    assert!(said.contains("no image has come yet"), "{said}");
}
