//! The view of a running suite: what it shows, what it controls, and that the run is the same with it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

use crate::common::{Process, Up, feeder, wait_for};
use crate::system::{REFERENCE, REPEATED};

/// Longest wait for what is looked for. It only keeps a failing test from hanging.
const PATIENCE: Duration = Duration::from_secs(120);

/// The address that a view has printed.
fn address(stderr: &str) -> Option<SocketAddr> {
    let (_, rest) = stderr.split_once("see it live at http://")?;
    rest.split_once('/')?.0.parse().ok()
}

/// Somebody who looks.
struct Viewer(WebSocket<TcpStream>);

impl Viewer {
    fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self(tungstenite::client(format!("ws://{address}/ws"), stream).unwrap().0)
    }

    fn say(&mut self, message: &Value) {
        self.0.send(Message::text(message.to_string())).unwrap();
    }

    fn subscribe(&mut self, channels: &[&str]) {
        self.say(&json!({ "type": "subscribe", "channels": channels }));
    }

    /// The next message, pictures as their headers; nothing at the end.
    fn read(&mut self) -> Option<Value> {
        loop {
            return match self.0.read().unwrap() {
                Message::Text(text) => Some(serde_json::from_str(&text).unwrap()),
                Message::Binary(bytes) => {
                    let (length, rest) = bytes.split_at(4);
                    let length = u32::from_le_bytes(length.try_into().unwrap()) as usize;
                    let mut header: Value = serde_json::from_slice(&rest[..length]).unwrap();
                    assert!(rest[length..].starts_with(&[0xff, 0xd8]), "no JPEG");
                    header["bytes"] = json!(rest.len() - length);
                    Some(header)
                }
                Message::Close(_) => None,
                _ => continue,
            };
        }
    }

    /// The first message from now on of which this holds.
    #[track_caller]
    fn until(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        loop {
            // The view says how it is once a second whatever happens, so that reading alone never ends.
            assert!(since.elapsed() < PATIENCE, "the view does not show {what}");
            let message = self.read().unwrap_or_else(|| panic!("the view has ended without {what}"));
            if holds(&message) {
                return message;
            }
        }
    }

    #[track_caller]
    fn next(&mut self, kind: &str) -> Value {
        self.until(kind, |message| message["type"] == kind)
    }

    /// The first frame of which this holds.
    #[track_caller]
    fn frame(&mut self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        self.until(what, |message| message["type"] == "frame" && holds(message))
    }

    #[track_caller]
    fn control(&mut self, name: &str, arguments: &Value) {
        self.say(&json!({ "type": "control", "id": 1, "name": name, "arguments": arguments }));
        let reply = self.next("reply");
        assert_eq!(reply["ok"], true, "{name}: {reply}");
    }

    /// The time at which simulated time stands still.
    #[track_caller]
    fn standstill_s(&mut self) -> f64 {
        let mut last = self.next("status")["time_s"].clone();
        loop {
            let now = self.next("status")["time_s"].clone();
            if now == last {
                return now.as_f64().unwrap();
            }
            last = now;
        }
    }
}

fn time_s(message: &Value) -> f64 {
    message["time_s"].as_f64().unwrap_or(-1.0)
}

#[test]
fn a_run_is_shown_and_controlled() {
    let run = Up::new("--duration 3600 --view=0").start();
    let loaded = Scenario::default().parts_loaded as usize;
    let mut viewer = Viewer::connect(wait_for("the view's address", || address(&run.stderr())));
    let hello = viewer.next("hello");
    assert_eq!((&hello["source"], &hello["end_s"]), (&json!("run"), &json!(3600.0)));
    viewer.subscribe(&["frame", "event", "motion", "picture"]);
    let frame = viewer.frame("a frame of everything", |frame| {
        let feeder = &frame["feeders"]["feeder"];
        let parts = |key: &str| feeder[key]["id"].as_array().map_or(0, Vec::len);
        parts("truth") == loaded && feeder["courier_state"]["vibrating"] == true && !feeder["candidates"].is_null()
    });
    assert!(frame["speed"].is_null() || frame["speed"] == json!(1.0), "{}", frame["speed"]);
    assert_eq!(frame["feeders"]["feeder"]["delivery"]["phase"], "feeding");
    let truth = &frame["feeders"]["feeder"]["truth"];
    assert_eq!(truth["position_m"].as_array().unwrap().len(), 3 * loaded);
    assert_eq!(truth["orientation_xyzw"].as_array().unwrap().len(), 4 * loaded);
    let motion = viewer.until("a period of the waveform", |message| {
        message["type"] == "motion" && !message["commanded_velocity"].is_null()
    });
    let scenario = Scenario::default();
    let ticks = scenario.waveform().unwrap().period_s() / scenario.courier.servo_period_s;
    let sent = motion["actual_acceleration"].as_array().unwrap().len() as f64;
    assert!((sent - ticks).abs() < 1e-6, "{sent} {ticks}");
    let picture = viewer.until("a picture with marks", |message| {
        message["type"] == "picture" && message["marks"].as_array().is_some_and(|marks| !marks.is_empty())
    });
    let mark = &picture["marks"][0];
    assert!((0.0..640.0).contains(&mark["u_px"].as_f64().unwrap()), "{mark}");

    viewer.control("pause", &json!({}));
    viewer.frame("that the run is paused", |frame| frame["paused"] == true);
    let stopped_s = viewer.standstill_s();
    viewer.control("step", &json!({ "ticks": 5 }));
    let stepped = viewer.frame("the step", |frame| time_s(frame) > stopped_s + 0.0499);
    assert!((time_s(&stepped) - stopped_s - 0.05).abs() < 1e-6, "{stopped_s} {}", stepped["time_s"]);
    assert!((viewer.standstill_s() - time_s(&stepped)).abs() < 1e-6);

    viewer.control("speed", &json!({ "speed": 0.1 }));
    viewer.subscribe(&["frame", "servo"]);
    viewer.control("resume", &json!({}));
    let blocks: Vec<f64> = (0..3)
        .map(|_| {
            let block = viewer.next("servo");
            assert_eq!(block["yaw_rate_rad_s"].as_array().unwrap().len(), 20);
            block["start_s"].as_f64().unwrap()
        })
        .collect();
    assert!(blocks.windows(2).all(|pair| (pair[1] - pair[0] - 0.01).abs() < 1e-6), "{blocks:?}");

    viewer.control("full_speed", &json!({}));
    // More than are taken meanwhile.
    viewer.control("load_parts", &json!({ "count": 20 }));
    viewer.frame("the new parts", |frame| {
        frame["feeders"]["feeder"]["truth"]["id"].as_array().is_some_and(|parts| parts.len() > loaded)
    });
    viewer.control("emergency_stop", &json!({}));
    viewer.frame("the stop", |frame| !frame["feeders"]["feeder"]["courier_state"]["fault"].is_null());
    viewer.control("reset_fault", &json!({}));
    viewer.frame("the end of the stop", |frame| frame["feeders"]["feeder"]["courier_state"]["fault"].is_null());
    run.process().signal(Signal::INT);
    while viewer.read().is_some() {}
    assert!(run.outcome().status.success());
}

#[test]
fn a_run_is_the_same_whoever_looks() {
    let run = Up::new(&format!("{REPEATED} --speed max --view=0")).digest().start();
    let address = wait_for("the view's address", || address(&run.stderr()));
    let all = ["frame", "event", "motion", "servo", "picture"];
    // Never reads a word.
    let mut stalled = Viewer::connect(address);
    stalled.subscribe(&all);
    let looking: Vec<_> = (0..3)
        .map(|_| {
            let mut viewer = Viewer::connect(address);
            viewer.subscribe(&all);
            std::thread::spawn(move || {
                let mut last_s = -1.0;
                while let Some(message) = viewer.read() {
                    if message["type"] == "frame" {
                        last_s = time_s(&message).max(last_s);
                    }
                }
                last_s
            })
        })
        .collect();
    let outcome = run.outcome();
    assert!(outcome.status.success(), "{}", outcome.stderr);
    assert_eq!(outcome.digest(), REFERENCE.digest());
    for viewer in looking {
        assert!(viewer.join().unwrap() > 12.0, "a viewer has seen too little");
    }
}

/// A reset in mid-run, of processes and of one process, at another speed and while it stands still.
#[test]
fn a_run_that_is_started_again_is_the_same_run() {
    for form in ["", " --composed"] {
        let run = Up::new(&format!("{REPEATED}{form} --speed max --view=0")).digest().start();
        let mut viewer = Viewer::connect(wait_for("the view's address", || address(&run.stderr())));
        viewer.subscribe(&["frame"]);
        viewer.frame("the run", |frame| time_s(frame) > 3.0);
        viewer.control("speed", &json!({ "speed": 500.0 }));
        viewer.control("pause", &json!({}));
        viewer.frame("the pause", |frame| frame["paused"] == true);
        let stopped_s = viewer.standstill_s();
        assert!((3.0..14.0).contains(&stopped_s), "the run came to {stopped_s} s before it was paused");
        viewer.control("reset", &json!({}));
        let begun = viewer.frame("the run's beginning", |frame| time_s(frame) < 1.0 && frame["paused"] == true);
        assert!(viewer.standstill_s() < 0.015 && begun["speed"] == 500.0, "{begun}");
        viewer.control("resume", &json!({}));
        let outcome = run.outcome();
        assert!(outcome.status.success(), "{}", outcome.stderr);
        assert_eq!(outcome.digest(), REFERENCE.digest(), "run again{form}");
    }
}

#[test]
fn a_run_that_is_recorded_is_not_started_again() {
    let work = TempDir::new().unwrap();
    let run = Up::new("--composed --duration 3600 --speed 1 --view=0").record(&work.path().join("bag")).start();
    let mut viewer = Viewer::connect(wait_for("the view's address", || address(&run.stderr())));
    viewer.subscribe(&["frame"]);
    let seen_s = time_s(&viewer.frame("the run", |frame| time_s(frame) > 0.5));
    viewer.say(&json!({ "type": "control", "id": 1, "name": "reset", "arguments": {} }));
    let reply = viewer.next("reply");
    let told = reply["message"].as_str().unwrap_or_default();
    assert!(reply["ok"] == false && told.contains("recorded") && told.contains("start another"), "{reply}");
    assert!(time_s(&viewer.frame("that it goes on", |frame| time_s(frame) > seen_s + 0.5)) > 1.0);
    run.process().signal(Signal::INT);
    assert!(run.outcome().status.success());
}

/// A `feeder view` of its own. Dropped, it is ended.
struct Page {
    child: Child,
    stderr: PathBuf,
    _work: TempDir,
}

impl Page {
    fn open(domain: &TestDomain, arguments: &[&str]) -> Self {
        let work = TempDir::new().unwrap();
        let stderr = work.path().join("stderr");
        let mut command = quiet(domain, "view");
        let child = command.arg("0").args(arguments).stderr(File::create(&stderr).unwrap()).spawn().unwrap();
        Self { child, stderr, _work: work }
    }

    fn viewer(&self) -> Viewer {
        let printed = || address(&std::fs::read_to_string(&self.stderr).unwrap());
        Viewer::connect(wait_for("the view's address", printed))
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        Process::new(self.child.id()).signal(Signal::INT);
        // It ends at once: waiting only takes it off the list of processes.
        let _ = self.child.wait();
    }
}

/// A subcommand in this domain that says nothing.
fn quiet(domain: &TestDomain, subcommand: &str) -> Command {
    let mut command = feeder();
    command.args(subcommand.split(' ')).args(["--domain", &domain.id.to_string()]);
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

#[test]
fn a_viewer_stays_while_the_suite_is_started_again() {
    let domain = TestDomain::claim();
    let page = Page::open(&domain, &[]);
    let mut viewer = page.viewer();
    assert_eq!(viewer.next("hello")["source"], "graph");
    for run in 0..2 {
        let mut suite = quiet(&domain, "up");
        let mut suite = suite.args(["--composed", "--duration", "3600", "--speed", "10"]).spawn().unwrap();
        if run > 0 {
            viewer.next("hello");
        }
        viewer.frame("the run", |frame| time_s(frame) > 3.0 && !frame["feeders"]["feeder"]["truth"].is_null());
        Process::new(suite.id()).signal(Signal::INT);
        assert!(suite.wait().unwrap().success());
    }
}

#[test]
fn a_scenario_that_is_not_what_runs_is_noticed() {
    let domain = TestDomain::claim();
    let mut suite = quiet(&domain, "up");
    let mut suite = suite.args(["--composed", "--duration", "3600", "--speed", "1"]).spawn().unwrap();
    let told = |scenario: &str, until: &dyn Fn(&str) -> bool| {
        let page = Page::open(&domain, &["--scenario", scenario]);
        let of = |message: &Value| message["feeders"]["feeder"]["mismatch"].as_str().unwrap_or_default().to_owned();
        let said = page.viewer().until("a word on the scenario", |message| {
            let heard_of_parts = !message["feeders"]["feeder"]["counts"].is_null();
            message["type"] == "status" && heard_of_parts && until(&of(message))
        });
        of(&said)
    };
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs");
    let other = told(&format!("{folder}/blocks.yaml"), &|said| said.contains("it feeds"));
    assert!(other.contains("grommet, not block"), "{other}");
    let work = TempDir::new().unwrap();
    let changed_file = work.path().join("changed.yaml");
    let changed = std::fs::read_to_string(format!("{folder}/default.yaml")).unwrap();
    let changed = changed.replace("rise_m: 0.020", "rise_m: 0.019").replace("name: station_1", "name: station_2");
    std::fs::write(&changed_file, changed.replace("models/", &format!("{folder}/models/"))).unwrap();
    let other = told(changed_file.to_str().unwrap(), &|said| said.contains("tray") && said.contains("station_2"));
    assert!(!other.contains("feeds"), "{other}");
    told(&format!("{folder}/default.yaml"), &str::is_empty);
    Process::new(suite.id()).signal(Signal::INT);
    assert!(suite.wait().unwrap().success());
}

/// What a frame says of the parts of a feeder that does not depend on when it was looked at, by the time it is for.
fn by_stamp(frame: &Value) -> [(&'static str, i64, Value); 3] {
    let feeder = &frame["feeders"]["feeder"];
    let fields = |key: &str, wanted: &[&str]| -> Value {
        let wanted = wanted.iter().map(|field| ((*field).to_owned(), feeder[key][*field].clone()));
        Value::Object(wanted.collect())
    };
    #[expect(clippy::cast_possible_truncation, reason = "a run is short")]
    let ms = |key: &str| (1e3 * feeder[key]["stamp_s"].as_f64().unwrap_or(-1.0)).round() as i64;
    let truth = ["id", "surface", "pose", "position_m", "orientation_xyzw", "sticking", "stranded"];
    let courier = ["x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "yaw_rate_rad_s"];
    [
        ("truth", ms("truth"), fields("truth", &truth)),
        ("candidates", ms("candidates"), fields("candidates", &["parts"])),
        ("courier", ms("courier"), fields("courier", &courier)),
    ]
}

#[test]
fn a_bag_that_is_played_shows_the_same_as_the_run() {
    let work = TempDir::new().unwrap();
    let bag = work.path().join("bag");
    let run = Up::new("--composed --duration 12 --speed 1 --view=0").record(&bag);
    let run = run.start();
    let mut viewer = Viewer::connect(wait_for("the view's address", || address(&run.stderr())));
    viewer.subscribe(&["frame"]);
    let mut shown = BTreeMap::new();
    while let Some(message) = viewer.read() {
        if message["type"] == "frame" {
            shown.extend(by_stamp(&message).map(|(what, at_ms, said)| ((what, at_ms), said)));
        }
    }
    assert!(run.outcome().status.success());
    let domain = TestDomain::claim();
    let page = Page::open(&domain, &["--scenario", bag.to_str().unwrap()]);
    let mut viewer = page.viewer();
    viewer.subscribe(&["frame"]);
    let mut player = play(&domain, &bag);
    let mut compared: BTreeMap<&str, BTreeSet<i64>> = BTreeMap::new();
    while compared.len() < 3 || compared.values().any(|stamps| stamps.len() < 20) {
        let frame = viewer.frame("what was", |frame| !frame["feeders"]["feeder"]["truth"].is_null());
        for (what, at_ms, said) in by_stamp(&frame) {
            if at_ms >= 0
                && let Some(in_run) = shown.get(&(what, at_ms))
            {
                assert_eq!(said, *in_run, "{what} at {at_ms} ms");
                compared.entry(what).or_default().insert(at_ms);
            }
        }
    }
    Process::new(player.id()).signal(Signal::INT);
    player.wait().unwrap();
}

#[test]
fn a_bag_that_is_played_shows_what_was() {
    let work = TempDir::new().unwrap();
    let bag = work.path().join("bag");
    Up::new("--composed --duration 6").record(&bag).success();
    let domain = TestDomain::claim();
    let page = Page::open(&domain, &["--scenario", bag.to_str().unwrap()]);
    let mut viewer = page.viewer();
    viewer.next("hello");
    viewer.subscribe(&["frame", "picture"]);
    let mut player = play(&domain, &bag);
    viewer.until("that it is a bag", |message| message["type"] == "hello" && message["source"] == "bag");
    viewer.frame("what was", |frame| time_s(frame) > 1.0 && !frame["feeders"]["feeder"]["truth"].is_null());
    viewer.next("picture");
    viewer.control("pause", &json!({}));
    viewer.frame("the pause", |frame| frame["paused"] == true);
    let stopped_s = viewer.standstill_s();
    viewer.control("speed", &json!({ "speed": 2.0 }));
    viewer.control("resume", &json!({}));
    viewer.frame("what comes then", |frame| time_s(frame) > stopped_s && frame["speed"] == 2.0);
    viewer.say(&json!({ "type": "control", "id": 2, "name": "load_parts" }));
    let reply = viewer.next("reply");
    assert!(reply["message"].as_str().unwrap().contains("bag"), "{reply}");
    Process::new(player.id()).signal(Signal::INT);
    player.wait().unwrap();
}

fn play(domain: &TestDomain, bag: &Path) -> Child {
    let mut command = quiet(domain, "bag play");
    command.arg(bag).args(["--loop", "--disable-keyboard-controls"]).spawn().unwrap()
}
