//! What goes wrong must be said by name: nodes that die or hang, a blind camera, bad input.

use std::collections::BTreeSet;
use std::process::Output;
use std::time::{Duration, Instant};

use feeder_scenario::{BUILT_IN, Scenario};
use rustix::process::Signal;
use tempfile::TempDir;

use crate::common::{Outcome, Run, Up, feeder, output, wait_for, write};

const NODES: [&str; 6] = [
    "waveform_generator",
    "courier_driver",
    "part_simulator",
    "vision_selector",
    "delivery_planner",
    "overhead_manipulator",
];

/// Longest time from a fault to the end of the run, wall time: a promise to the user.
const REACTION_LIMIT: Duration = Duration::from_secs(5);

/// A run that goes on until something happens to it.
fn running() -> Run {
    let mut run = Up::new("--duration 3600 --speed 10").start();
    run.wait_until_simulated(Duration::from_millis(500));
    run
}

/// Sends `signal` to a node of a run, which must end the run and name the node.
#[track_caller]
fn strike(node: &str, signal: Signal) -> Outcome {
    let run = running();
    let nodes = run.nodes();
    assert_eq!(nodes.len(), NODES.len());
    let struck_at = Instant::now();
    run.node(node).signal(signal);
    let outcome = run.outcome();
    let took = struck_at.elapsed();
    assert!(!outcome.status.success(), "the run without {node} went well");
    assert!(outcome.error().contains(&format!("/{node} ")), "{node}: {}", outcome.stderr);
    assert!(took < REACTION_LIMIT, "without {node} the run went on for {took:?}: {}", outcome.stderr);
    assert!(nodes.iter().all(|node| !node.is_running()), "a node is left without {node}");
    outcome
}

#[test]
fn a_killed_node_ends_the_run_and_is_named() {
    for node in NODES {
        let outcome = strike(node, Signal::KILL);
        let named: Vec<&str> = NODES.into_iter().filter(|name| outcome.error().contains(name)).collect();
        assert_eq!(named, [node]);
    }
}

#[test]
fn a_hung_node_ends_the_run_and_is_named() {
    for node in NODES {
        strike(node, Signal::STOP);
    }
}

#[test]
fn a_node_that_never_comes_up_is_named() {
    let run = Up::new("--duration 1").start();
    let node = wait_for("the selector's process", || {
        run.nodes().into_iter().find(|node| node.arguments().iter().any(|argument| argument == "vision_selector"))
    });
    node.signal(Signal::STOP);
    let outcome = run.outcome();
    assert!(!outcome.status.success());
    assert!(outcome.error().contains("/feeder/vision_selector"), "{}", outcome.stderr);
    assert!(!node.is_running());
}

/// A thread that has locked up ends with its process alone: the process makes way for another.
#[test]
fn a_composed_run_whose_node_never_comes_up_is_started_again() {
    let run = Up::new("--composed --duration 1").start();
    let selector = wait_for("the selector's thread", || run.process().hold_thread("vision_selector"));
    wait_for("the selector's thread to go", || selector.is_gone().then_some(()));
    let outcome = run.outcome();
    assert!(outcome.status.success(), "{}", outcome.stderr);
    let said: Vec<&str> = outcome.stderr.lines().filter(|line| line.contains("started again")).collect();
    let [said] = said[..] else { panic!("{said:?}") };
    assert!(said.contains("/feeder/vision_selector") && said.contains("start 2 of 3"), "{said}");
    assert!(outcome.number("sim_s") >= 1.0);
}

/// As Ctrl-Z and `fg` do. The DDS library may lose its threads by it: then the run ends and says why; it never hangs.
#[test]
fn a_run_that_was_stopped_and_goes_on_ends_well_or_with_the_reason() {
    for form in ["", "--composed"] {
        let mut run = Up::new(&format!("--duration 3 --speed 1 {form}")).start();
        run.wait_until_simulated(Duration::from_millis(500));
        let processes: Vec<_> = run.nodes().into_iter().chain([run.process()]).collect();
        for (signal, stopped) in [(Signal::STOP, true), (Signal::CONT, false)] {
            processes.iter().for_each(|process| process.signal(signal));
            wait_for("them to obey", || processes.iter().all(|process| process.is_stopped() == stopped).then_some(()));
        }
        let outcome = run.outcome();
        let said = outcome.stderr.contains("has ended, and nothing is heard or sent any more");
        assert!(outcome.status.success() || said, "{form}: {}", outcome.stderr);
        wait_for("them to leave", || processes.iter().all(|process| !process.is_running()).then_some(()));
    }
}

#[test]
fn nodes_leave_when_feeder_up_is_killed() {
    let run = running();
    let nodes = run.nodes();
    run.process().signal(Signal::KILL);
    wait_for("the nodes to leave", || nodes.iter().all(|node| !node.is_running()).then_some(()));
    assert!(!run.outcome().status.success());
}

/// The selector has nothing but the image: without light nothing is selected, although parts go by; and nobody counts them.
#[test]
fn a_blind_camera_stops_selection() {
    let mut scenario = Scenario::default();
    scenario.world.light.white_level = 0.0;
    let outcome = Up::new("--duration 30 --composed").scenario(&scenario).success();
    for (key, expected) in [("selected", 0.0), ("delivered", 0.0)] {
        assert!((outcome.number(key) - expected).abs() < 0.5, "{}", outcome.summary());
    }
    assert!(outcome.number("fed") >= 3.0, "{}", outcome.summary());
    let missed = &outcome.summary()["feeding"][0]["missed_selections"];
    assert!(missed.as_u64().unwrap() >= 1, "{}", outcome.summary());
    assert!(outcome.stderr.contains("nothing is selected: the plateau is black"), "{}", outcome.stderr);
    assert!(!outcome.stderr.contains("come up the ramp"), "{}", outcome.stderr);
}

#[test]
fn a_busy_domain_is_refused_and_its_run_goes_on() {
    let mut run = running();
    let domain = run.domain().id.to_string();
    let second = feeder().args(["up", "--duration", "1", "--domain", &domain]).output().unwrap();
    assert_refused("a second run", &second, &["busy", &domain, "--domain", "0 to 232"]);
    run.wait_until_simulated(Duration::from_secs(10));
    run.process().signal(Signal::INT);
    let outcome = run.outcome();
    assert!(outcome.status.success(), "{}", outcome.stderr);
}

/// A scenario that cannot run: the built-in one with another text for the first value of a section that begins with
/// `key`, and what must be said about it.
struct Bad {
    what: &'static str,
    section: &'static str,
    key: &'static str,
    new: &'static str,
    said: &'static [&'static str],
}

impl Bad {
    fn scenario(&self) -> String {
        let mut lines: Vec<String> = BUILT_IN.lines().map(str::to_owned).collect();
        let section = lines.iter().position(|line| *line == format!("{}:", self.section)).unwrap_or(0);
        let holds_key = |line: &String| line.trim_start_matches([' ', '-']).starts_with(self.key);
        let line = lines[section..].iter_mut().find(|line| holds_key(line));
        let line = line.unwrap_or_else(|| panic!("{}: the built-in scenario has no {}", self.what, self.key));
        let indent = line.find(self.key).unwrap();
        line.replace_range(indent.., self.new);
        lines.join("\n")
    }
}

const BAD_SCENARIOS: &[Bad] = &[
    Bad {
        what: "an unknown key",
        section: "",
        key: "parts_loaded",
        new: "parts_loadde: 30",
        said: &["parts_loadde", "parts_loaded", "line"],
    },
    Bad {
        what: "an unknown key further down",
        section: "tray",
        key: "outer_radius_m",
        new: "outer_radius_mm: 90",
        said: &["outer_radius_mm", "outer_radius_m", "line"],
    },
    Bad { what: "a missing key", section: "", key: "seed", new: "", said: &["seed", "missing"] },
    Bad {
        what: "a key given twice",
        section: "",
        key: "seed",
        new: "seed: 1\nseed: 2",
        said: &["seed", "duplicate", "line"],
    },
    Bad {
        what: "a text for a number",
        section: "",
        key: "part",
        new: "part: { name: p, density_kg_m3: heavy, friction_static: 0.2, friction_kinetic: 0.2, reflectance: 0.5, \
              shape: { solids: [{ extruded: { outline: { circle: { radius_m: 0.003 } }, z_m: [0, 0.001] } }] }, wanted_poses: [pose_1] }",
        said: &["heavy", "line"],
    },
    Bad {
        what: "a fraction for a count",
        section: "",
        key: "parts_loaded",
        new: "parts_loaded: 30.5",
        said: &["parts_loaded: 30.5", "line"],
    },
    Bad {
        what: "a part placed in no pose of its own",
        section: "",
        key: "parts_loaded",
        new: "parts_placed: [{ pose: upright, radius_m: 0.06, angle_rad: 4.2, yaw_rad: 0.0 }]\nparts_loaded: 20",
        said: &["parts_placed", "upright", "hole_up"],
    },
    Bad {
        what: "a part placed in a wall",
        section: "",
        key: "parts_loaded",
        new: "parts_placed: [{ pose: hole_up, radius_m: 0.089, angle_rad: 4.2, yaw_rad: 0.0 }]\nparts_loaded: 20",
        said: &["parts_placed", "0.089"],
    },
    Bad { what: "a negative seed", section: "", key: "seed", new: "seed: -1", said: &["seed: -1", "line"] },
    Bad {
        what: "no number",
        section: "run",
        key: "duration_s",
        new: "duration_s: .nan",
        said: &["run", "duration_s", "NaN", "above 0"],
    },
    Bad {
        what: "a duration out of range",
        section: "run",
        key: "duration_s",
        new: "duration_s: -3",
        said: &["run", "duration_s", "-3", "above 0", "86400"],
    },
    Bad {
        what: "a quality out of range",
        section: "camera",
        key: "jpeg_quality",
        new: "jpeg_quality: 0",
        said: &["camera", "jpeg_quality", "0", "1 to 100"],
    },
    Bad {
        what: "a frame period that is no multiple of the tick",
        section: "camera",
        key: "period_ms",
        new: "period_ms: 105",
        said: &["camera", "period_ms", "105", "tick_ms"],
    },
    Bad {
        what: "a window that readers cannot hold",
        section: "time",
        key: "window_ticks",
        new: "window_ticks: 56",
        said: &["time", "window_ticks", "56", "4 to "],
    },
    Bad {
        what: "a tray with its hole outside",
        section: "tray",
        key: "inner_radius_m",
        new: "inner_radius_m: 0.195",
        said: &["tray", "inner_radius_m", "0.195", "outer_radius_m"],
    },
    Bad {
        what: "a part of no size",
        section: "",
        key: "part",
        new: "part: { name: p, density_kg_m3: 1000, friction_static: 0.2, friction_kinetic: 0.2, reflectance: 0.5, \
              shape: { solids: [{ extruded: { outline: { circle: { radius_m: 0 } }, z_m: [0, 0.001] } }] }, wanted_poses: [pose_1] }",
        said: &["part", "radius_m = 0", "above 0"],
    },
    Bad {
        what: "a part without friction",
        section: "",
        key: "part",
        new: "part: { name: p, density_kg_m3: 1000, friction_static: 0, friction_kinetic: 0, reflectance: 0.5, \
              shape: { solids: [{ extruded: { outline: { circle: { radius_m: 0.003 } }, z_m: [0, 0.001] } }] }, wanted_poses: [pose_1] }",
        said: &["part", "friction_kinetic = 0", "above 0"],
    },
    Bad {
        what: "a part larger than the path",
        section: "",
        key: "part",
        new: "part: { name: p, density_kg_m3: 1000, friction_static: 0.2, friction_kinetic: 0.2, reflectance: 0.5, \
              shape: { solids: [{ extruded: { outline: { circle: { radius_m: 0.04 } }, z_m: [0, 0.001] } }] }, wanted_poses: [pose_1] }",
        said: &["bulk", "0.08", "width of the tray's path"],
    },
    Bad { what: "a part that nobody knows", section: "", key: "part", new: "part: gromet", said: &["part", "gromet"] },
    Bad {
        what: "a pose that the part does not have",
        section: "",
        key: "part",
        new: "part: { name: p, density_kg_m3: 1000, friction_static: 0.2, friction_kinetic: 0.2, reflectance: 0.5, \
              shape: { solids: [{ extruded: { outline: { circle: { radius_m: 0.003 } }, z_m: [0, 0.001] } }] }, wanted_poses: [sideways] }",
        said: &["wanted_poses", "sideways", "pose_1"],
    },
    Bad {
        what: "a waveform the courier cannot follow",
        section: "waveform",
        key: "a_max_rad_s2",
        new: "a_max_rad_s2: 200.0\n  period_s: 0.4",
        said: &["waveform", "courier_yaw", "rad", "allowed is"],
    },
    Bad {
        what: "a waveform that cannot be",
        section: "waveform",
        key: "a_max_rad_s2",
        new: "a_max_rad_s2: 200.0\n  period_s: 0",
        said: &["waveform", "period_s", "0", "above 0"],
    },
    Bad {
        what: "a station off the platen",
        section: "stations",
        key: "x_m",
        new: "x_m: 5.5",
        said: &["stations", "station_1.x_m", "5.5", "platen", " to "],
    },
    Bad {
        what: "two stations of one name",
        section: "stations",
        key: "name",
        new: "{ name: twin, x_m: 0.0, y_m: 0.0 }\n  - name: twin",
        said: &["stations", "twin", "twice"],
    },
    Bad {
        what: "a name that ROS does not take",
        section: "",
        key: "feeder",
        new: "feeder: my-feeder",
        said: &["feeder", "my-feeder", "letters"],
    },
];

#[test]
fn bad_scenarios_are_refused_with_file_key_value_and_range() {
    let folder = TempDir::new().unwrap();
    for bad in BAD_SCENARIOS {
        let file = write(folder.path(), "scenario.yaml", &bad.scenario());
        let file = file.to_str().unwrap();
        let said: Vec<&str> = bad.said.iter().copied().chain([file]).collect();
        assert_refused(&format!("checking {}", bad.what), &output(["check", file]), &said);
        assert_refused(&format!("running {}", bad.what), &output(["up", "--scenario", file]), &said);
    }
}

#[test]
fn files_that_are_no_scenario_are_refused() {
    let folder = TempDir::new().unwrap();
    let (cut, _) = BUILT_IN.split_at(BUILT_IN.len() / 3);
    for (name, text) in [("empty.yaml", ""), ("list.yaml", "- 1\n- 2\n"), ("cut.yaml", cut), ("open.yaml", "seed: [1")]
    {
        let file = write(folder.path(), name, text);
        assert_refused(name, &output(["check".as_ref(), file.as_os_str()]), &[name]);
    }
    let untaught = BUILT_IN.replace("part_model: models/grommet.yaml", "");
    let untaught = write(folder.path(), "untaught.yaml", &untaught);
    for command in [vec!["check".as_ref()], vec!["up".as_ref(), "--scenario".as_ref()]] {
        let arguments = command.into_iter().chain([untaught.as_os_str()]);
        assert_refused("a part never taught", &output(arguments), &["untaught.yaml", "part_model", "feeder teach"]);
    }
    let mistaken = write(folder.path(), "mistaken.yaml", &BUILT_IN.replace("part: grommet", "part: coin"));
    let refused = output(["check".as_ref(), mistaken.as_os_str()]);
    assert_refused("a model of another part", &refused, &["mistaken.yaml", "part_model", "coin", "feeder teach"]);
    let nowhere = folder.path().join("nowhere.yaml");
    for command in [vec!["check".as_ref()], vec!["up".as_ref(), "--scenario".as_ref()]] {
        let arguments = command.into_iter().chain([nowhere.as_os_str()]);
        assert_refused("a missing file", &output(arguments), &["nowhere.yaml", "cannot read"]);
    }
}

#[test]
fn bad_options_are_refused_with_value_and_range() {
    for (options, said) in [
        ("--speed 0", ["--speed", "0", "positive"]),
        ("--speed -2", ["--speed", "-2", "max"]),
        ("--speed NaN", ["--speed", "NaN", "max"]),
        ("--speed quick", ["--speed", "quick", "max"]),
        ("--duration 0", ["duration", "0", "above 0"]),
        ("--duration -1", ["duration", "-1", "above 0"]),
        ("--duration 1e9", ["duration", "1000000000", "86400"]),
        ("--domain 233", ["--domain", "233", "232"]),
        ("--seed -1", ["--seed", "-1", "invalid"]),
        ("--scenrio x", ["--scenrio", "--scenario", "unexpected"]),
        ("--summary nowhere/s.json", ["nowhere/s.json", "no such folder", "error"]),
        ("--digest nowhere/d.txt", ["nowhere/d.txt", "no such folder", "error"]),
    ] {
        let arguments = std::iter::once("up").chain(options.split(' '));
        assert_refused(options, &output(arguments), &said);
    }
    for (variable, value, said) in [
        ("ROS_DOMAIN_ID", "300", "0 to 232"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "EVERYWHERE", "LOCALHOST"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "LOCALHOST"),
    ] {
        let refused = feeder().args(["up", "--duration", "1"]).env(variable, value).output().unwrap();
        assert_refused(variable, &refused, &[variable, value, said]);
    }
}

/// A refusal is an exit code and a message with all of `said`, and nothing was started.
#[track_caller]
fn assert_refused(what: &str, output: &Output, said: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{what} went well");
    let missing: BTreeSet<&&str> = said.iter().filter(|word| !text.contains(**word)).collect();
    assert!(missing.is_empty(), "{what}: {missing:?} missing in: {text}");
    assert!(!text.contains("panicked"), "{what}: {text}");
    assert!(output.stdout.is_empty(), "{what}: {}", String::from_utf8_lossy(&output.stdout));
}
