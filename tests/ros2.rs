//! The feeder in the hands of a real ROS 2: its command line, its client library and its recorder, under every middleware
//! that is installed of the two that matter. Prints what was tried, with the command.
//!
//! Not part of the plain test command, as few machines have a ROS 2:
//! `cargo test -p feeder_tests --test ros2`, in a shell that has sourced one with `minifactory_msgs` (colcon, `msgs/`)
//! and `simulation_interfaces` 2.1.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[expect(dead_code, unused_imports, reason = "the suite uses the rest")]
mod common;

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use rustix::process::Signal;
use tempfile::TempDir;

use common::{Run, Up, feeder};

const MIDDLEWARES: [&str; 2] = ["rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"];

const NODES: [&str; 8] = [
    "/feeder/courier_driver",
    "/feeder/delivery_planner",
    "/feeder/part_simulator",
    "/feeder/run_monitor",
    "/feeder/vision_selector",
    "/feeder/waveform_generator",
    "/station_1/overhead_manipulator",
    "/feeder_up",
];

/// Nodes with a lifecycle.
const MANAGED: [&str; 5] = [
    "/feeder/part_simulator",
    "/feeder/courier_driver",
    "/feeder/waveform_generator",
    "/feeder/vision_selector",
    "/feeder/delivery_planner",
];

/// Longest wait for a command. It only keeps a failing check from hanging.
const PATIENCE: Duration = Duration::from_secs(120);
/// How often a command that only looks is tried: discovery may not have come round yet.
const LOOKS_MAX: u32 = 4;

/// A command and what it must say.
struct Check {
    /// The verb of `ros2`, or what is shown.
    feature: String,
    /// For the shell. `{work}` is a folder for files, `{other}` a domain in which nobody is yet, `{launch}` where the launch
    /// files are; `feeder` is on the path.
    command: String,
    /// All of it must come on its standard output.
    said: Vec<String>,
    /// When it is over.
    end: End,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    /// By itself, and well. It only looks, or is refused without effect, and may be tried again.
    Look,
    /// By itself, and well. It changes something.
    Act,
    /// By itself, as it is refused.
    Refused,
    /// By Ctrl-C, when it has said everything.
    Stopped,
}

fn check(end: End, feature: &str, command: &str, said: &[&str]) -> Check {
    let said = said.iter().map(|text| (*text).to_owned()).collect();
    Check { feature: feature.to_owned(), command: command.to_owned(), said, end }
}

/// What must work in the order in which it is tried.
fn checks(python: &str) -> Vec<Check> {
    use End::{Act, Look, Refused, Stopped};
    let selector = "/feeder/vision_selector";
    let confidence = "selector.confidence_min";
    let driver = "/feeder/courier_driver";
    let deliver = "/feeder/deliver_part";
    let goal = format!("ros2 action send_goal --feedback {deliver} minifactory_msgs/action/DeliverPart");
    let script = |name: &str| format!("{python} {}/ros2/{name}", env!("CARGO_MANIFEST_DIR"));
    let launch = |file: &str, format: &str, arguments: &str| {
        format!("ROS_DOMAIN_ID={{other}} ros2 launch {{launch}}/{file}.launch.{format} {arguments} 2>&1")
    };
    let package = |command: &str| format!(". {{work}}/install/setup.bash && ROS_DOMAIN_ID={{other}} {command}");
    let mut checks = vec![
        check(Look, "node list", "ros2 node list", &NODES),
        check(
            Look,
            "node info",
            &format!("ros2 node info {driver}"),
            &[
                "/feeder/joint_states: sensor_msgs/msg/JointState",
                "/feeder/follow_joint_trajectory: control_msgs/action/FollowJointTrajectory",
                "/feeder/courier_driver/get_state: lifecycle_msgs/srv/GetState",
            ],
        ),
        check(
            Look,
            "topic list",
            "ros2 topic list -t",
            &[
                "/clock [rosgraph_msgs/msg/Clock]",
                "/tf [tf2_msgs/msg/TFMessage]",
                "/feeder/state [minifactory_msgs/msg/FeederState]",
            ],
        ),
        check(Look, "topic info", "ros2 topic info -v /rosout", &["Lifespan: 10000000000 nanoseconds"]),
        check(Look, "topic type", "ros2 topic type /feeder/factsheet", &["minifactory_msgs/msg/Factsheet"]),
        check(Look, "topic find", "ros2 topic find sensor_msgs/msg/JointState", &["/feeder/joint_states"]),
        check(Look, "topic echo, latched", "ros2 topic echo --once /feeder/factsheet", &["protocol_version: '3.1'"]),
        check(Look, "topic echo", "ros2 topic echo --once /feeder/joint_states", &["position:"]),
        check(Look, "topic echo, large", "ros2 topic echo --once --field height /feeder/camera/image_raw", &["\n---"]),
        check(Stopped, "topic hz", "ros2 topic hz /feeder/camera/image_raw/compressed", &["average rate"]),
        check(Stopped, "topic bw", "ros2 topic bw /feeder/camera/image_raw/compressed", &["KB/s from"]),
        check(Stopped, "topic delay", "ros2 topic delay --use-sim-time /feeder/joint_states", &["average delay"]),
        check(
            Look,
            "service list",
            "ros2 service list -t",
            &["/feeder/report_handover [minifactory_msgs/srv/ReportHandover]"],
        ),
        check(Look, "service type", "ros2 service type /feeder/purge", &["minifactory_msgs/srv/Purge"]),
        check(
            Act,
            "service call",
            &format!("ros2 service call {driver}/get_state lifecycle_msgs/srv/GetState"),
            &["label='active'"],
        ),
        check(
            Act,
            "service call, refused",
            "ros2 service call /feeder/change_recipe minifactory_msgs/srv/ChangeRecipe '{recipe: nonsense}'",
            &["changed=False"],
        ),
        check(
            Look,
            "action list",
            "ros2 action list -t",
            &["/feeder/deliver_part [minifactory_msgs/action/DeliverPart]"],
        ),
        check(Look, "action info", &format!("ros2 action info {deliver}"), &["Action servers: 1"]),
        check(
            Act,
            "action send_goal",
            &format!("{goal} '{{station: station_1, tolerance_m: 0.001, timeout_s: 4.0}}'"),
            &["Goal accepted", "Feedback:", "Goal finished with status"],
        ),
        check(
            Stopped,
            "action, left by Ctrl-C",
            &format!("{goal} '{{station: station_1, tolerance_m: 0.001, timeout_s: 600.0}}'"),
            &["Goal accepted", "Feedback:"],
        ),
        check(Act, "action, rejected", &format!("{goal} '{{station: nowhere}}'"), &["Goal was rejected"]),
        check(Look, "lifecycle nodes", "ros2 lifecycle nodes", &MANAGED),
        check(Look, "param list, all nodes", "ros2 param list", &NODES),
    ];
    for node in MANAGED {
        let of = |verb: &str| format!("lifecycle {verb} {node}");
        let run = |verb: &str, rest: &str| format!("ros2 lifecycle {verb} {node}{rest}");
        let set = |to: &str| check(Act, &of(to), &run("set", &format!(" {to}")), &["Transitioning successful"]);
        checks.extend([
            check(Look, &of("list"), &run("list", ""), &["deactivate", "shutdown"]),
            check(Look, &of("list -a"), &run("list", " -a"), &["configure", "cleanup", "activate", "deactivate"]),
            check(Look, &of("get"), &run("get", ""), &["active [3]"]),
            check(Refused, &of("set, refused"), &run("set", " configure"), &[]),
            set("deactivate"),
            check(Look, &of("get, inactive"), &run("get", ""), &["inactive [2]"]),
            set("activate"),
        ]);
    }
    for node in NODES {
        let of = |verb: &str| format!("param {verb} {node}");
        let run = |verb: &str, rest: &str| format!("ros2 param {verb} {node}{rest}");
        checks.push(check(Look, &of("list"), &run("list", ""), &["use_sim_time"]));
        checks.push(check(Look, &of("dump"), &run("dump", ""), &[&format!("{node}:"), "use_sim_time: "]));
        checks.push(check(Look, &of("get"), &run("get", " log_level"), &["String value is"]));
        checks.push(check(Look, &of("describe"), &run("describe", " log_level"), &["Type: string", "Description:"]));
    }
    checks.extend([
        check(Act, "param set", &format!("ros2 param set {selector} {confidence} 0.65"), &["Set parameter successful"]),
        check(Look, "param get", &format!("ros2 param get {selector} {confidence}"), &["Double value is: 0.65"]),
        check(
            Act,
            "param load",
            &format!(
                "ros2 param dump {selector} > {{work}}/params.yaml && sed -i 's/confidence_min: .*/confidence_min: 0.7/' \
                 {{work}}/params.yaml && ros2 param load {selector} {{work}}/params.yaml"
            ),
            &[&format!("Set parameter {confidence} successful")],
        ),
        check(Look, "param get, loaded", &format!("ros2 param get {selector} {confidence}"), &["Double value is: 0.7"]),
        check(
            Act,
            "param set, refused",
            &format!("ros2 param set {selector} {confidence} 7.0 2>&1 || true"),
            &["Setting parameter failed"],
        ),
    ]);
    checks.extend(simulation_checks());
    checks.extend([
        check(Look, "interface show", "ros2 interface show minifactory_msgs/action/DeliverPart", &["string station"]),
        check(Look, "interface list", "ros2 interface list", &["minifactory_msgs/msg/Factsheet"]),
        check(Look, "doctor", "ros2 doctor", &["checks passed"]),
        check(Look, "rclpy with use_sim_time", &script("clock.py"), &["simulated time passes"]),
        // Longer than the bag needs to hold something; what it holds is asked next.
        check(
            Act,
            "bag record",
            "timeout -s INT 10 ros2 bag record -o {work}/bag --topics /clock /feeder/joint_states; [ $? = 124 ]",
            &[],
        ),
        check(Look, "bag info", "ros2 bag info {work}/bag", &["Topic: /feeder/joint_states", "Topic: /clock"]),
        check(Look, "its bag, read by feeder", "feeder bag check {work}/bag", &[]),
        check(Act, "launch, XML", &launch("feeder", "xml", "duration:=2 speed:=max"), &["simulated time"]),
        check(Act, "launch, YAML", &launch("feeder", "yaml", "duration:=2 speed:=max"), &["simulated time"]),
        check(Act, "launch, Python", &launch("feeder", "py", "duration:=2 speed:=max"), &["simulated time"]),
        check(
            Stopped,
            "launch, managed",
            &launch("managed", "py", ""),
            &["Transitioning successful", "[activate_delivery_planner-16]: process has finished cleanly"],
        ),
        check(
            Act,
            "launch, refused",
            &launch("feeder", "xml", "scenario:=/nowhere.yaml"),
            &["cannot read /nowhere.yaml"],
        ),
        check(
            Act,
            "package, built",
            "cd {work} && colcon build --base-paths {launch}/.. --cmake-args -DFEEDER_COMMAND=$(command -v feeder)",
            &["1 package finished"],
        ),
        check(
            Act,
            "package, ros2 run",
            &package(
                "ros2 run minifactory_feeder feeder check $(ros2 pkg prefix --share minifactory_feeder)/default.yaml",
            ),
            &["ok"],
        ),
        check(
            Act,
            "package, launched",
            &package("ros2 launch minifactory_feeder feeder.launch.xml duration:=2 speed:=max 2>&1"),
            &["simulated time"],
        ),
        check(Act, "bag of feeder up", "feeder up --plain --duration 2 --record {work}/ours --domain {other}", &[]),
        check(Look, "bag info of it", "ros2 bag info {work}/ours", &["Topic: /feeder/joint_states"]),
        check(Act, "bag play of it", "ros2 bag play {work}/ours --topics /feeder/waveform", &[]),
    ]);
    checks
}

/// A simulator as `simulation_interfaces` has it.
fn simulation_checks() -> Vec<Check> {
    use End::{Act, Look, Stopped};
    let call = |end, feature: &str, name: &str, kind: &str, request: &str, said: &[&str]| {
        check(end, feature, &format!("ros2 service call {name} simulation_interfaces/srv/{kind} '{request}'"), said)
    };
    let set = |feature: &str, state: u8, said: &str| {
        let request = format!("{{state: {{state: {state}}}}}");
        call(Act, feature, "/set_simulation_state", "SetSimulationState", &request, &[said])
    };
    let steps = "ros2 action send_goal --feedback /simulate_steps simulation_interfaces/action/SimulateSteps";
    let to = |x: f64, y: f64| format!("header: {{frame_id: feeder/tray}}, pose: {{position: {{x: {x}, y: {y}}}}}");
    let spawn = format!("{{name: mine, entity_resource: {{uri: grommet}}, initial_pose: {{{}}}}}", to(0.017, -0.0575));
    let moved = format!("{{entity: mine, set_pose: true, state: {{{}}}}}", to(0.038, -0.0464));
    let entity = |feature: &str, name: &str, kind: &str, request: &str, said: &[&str]| {
        call(Act, &format!("simulation, entity {feature}"), name, kind, request, said)
    };
    vec![
        call(Look, "simulation, features", "/get_simulator_features", "GetSimulatorFeatures", "{}", &["31, 32, 33"]),
        call(Look, "simulation, state", "/get_simulation_state", "GetSimulationState", "{}", &["state=1"]),
        call(Act, "simulation, step refused", "/step_simulation", "StepSimulation", "{steps: 1}", &["not paused"]),
        set("simulation, pause", 2, "result=1,"),
        set("simulation, pause again", 2, "result=101"),
        call(Act, "simulation, step", "/step_simulation", "StepSimulation", "{steps: 10}", &["result=1"]),
        check(Act, "simulation, steps", &format!("{steps} '{{steps: 50}}'"), &["completed_steps: 50", "SUCCEEDED"]),
        check(
            Stopped,
            "simulation, steps left by Ctrl-C",
            &format!("{steps} '{{steps: 100000}}'"),
            &["Goal accepted", "completed_steps"],
        ),
        // Jazzy's ros2 action leaves its goal alone where it is left; being asked to pause ends that.
        set("simulation, pause in steps", 2, "result=1"),
        call(Act, "simulation, step after that", "/step_simulation", "StepSimulation", "{steps: 1}", &["result=1,"]),
        entity("spawnables", "/get_spawnables", "GetSpawnables", "{}", &["uri='grommet'"]),
        entity("spawn", "/spawn_entity", "SpawnEntity", &spawn, &["result=1,", "entity_name='mine'"]),
        entity("spawn, refused", "/spawn_entity", "SpawnEntity", &spawn, &["result=101,"]),
        entity("list", "/get_entities", "GetEntities", "{filters: {filter: ^mine$}}", &["entities=['mine']"]),
        entity("move", "/set_entity_state", "SetEntityState", &moved, &["result=1,"]),
        entity("state", "/get_entity_state", "GetEntityState", "{entity: mine}", &["frame_id='platen'"]),
        entity("info", "/get_entity_info", "GetEntityInfo", "{entity: mine}", &["'plateau'"]),
        entity("states", "/get_entities_states", "GetEntitiesStates", "{filters: {filter: ^mine$}}", &["['mine']"]),
        entity("delete", "/delete_entity", "DeleteEntity", "{entity: mine}", &["result=1,"]),
        entity("unknown", "/delete_entity", "DeleteEntity", "{entity: mine}", &["result=2,"]),
        set("simulation, stop", 0, "result=1,"),
        call(Look, "simulation, stopped", "/get_simulation_state", "GetSimulationState", "{}", &["state=0"]),
        set("simulation, play", 1, "result=1,"),
        // Refused while a part is carried to a station.
        call(Look, "simulation, reset", "/reset_simulation", "ResetSimulation", "{}", &["result=1,"]),
        call(Look, "simulation, playing again", "/get_simulation_state", "GetSimulationState", "{}", &["state=1"]),
        call(Act, "simulation, reset in part", "/reset_simulation", "ResetSimulation", "{scope: 1}", &["result=0,"]),
    ]
}

/// What is checked against a scenario of its own: the agent's station is the agent's.
fn agent_check(python: &str) -> Check {
    let script = format!("{}/ros2/agent.py", env!("CARGO_MANIFEST_DIR"));
    check(End::Act, "ten deliveries by rclpy", &format!("{python} {script} feeder station_1 10"), &["all delivered"])
}

/// Where and how the commands run.
struct Shell {
    middleware: String,
    domain: u16,
    other: TestDomain,
    work: TempDir,
}

impl Shell {
    fn command(&self, text: &str) -> Command {
        let work = self.work.path().to_str().unwrap();
        let text = text
            .replace("{work}", work)
            .replace("{other}", &self.other.id.to_string())
            .replace("{launch}", concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs/launch"));
        let mut command = Command::new("bash");
        command.args(["-c", &format!("PATH={work}:$PATH; {text}")]);
        command.env("RMW_IMPLEMENTATION", &self.middleware).env("ROS_DOMAIN_ID", self.domain.to_string());
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").env("ROS_LOG_DIR", self.work.path());
        for variable in ["ROS_LOCALHOST_ONLY", "CYCLONEDDS_URI", "FASTRTPS_DEFAULT_PROFILES_FILE", "RUST_LOG"] {
            command.env_remove(variable);
        }
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command
    }

    /// Runs a check; what was wrong, if anything.
    fn run(&self, check: &Check) -> Result<(), String> {
        let looks = if matches!(check.end, End::Look | End::Stopped) { LOOKS_MAX } else { 1 };
        let mut outcome = Ok(());
        for _ in 0..looks {
            outcome = self.run_once(check);
            if outcome.is_ok() {
                break;
            }
        }
        outcome
    }

    fn run_once(&self, check: &Check) -> Result<(), String> {
        let (out, err) = (self.work.path().join("out"), self.work.path().join("err"));
        let open = |path: &PathBuf| File::create(path).unwrap();
        let mut child = self
            .command(&check.command)
            .env("PYTHONUNBUFFERED", "1")
            .stdin(Stdio::null())
            .stdout(open(&out))
            .stderr(open(&err))
            .spawn()
            .unwrap();
        let read = |path: &Path| String::from_utf8_lossy(&std::fs::read(path).unwrap_or_default()).into_owned();
        let missing_of = |said: &[String]| -> Vec<String> {
            let text = read(&out);
            said.iter().filter(|said| !text.contains(said.as_str())).cloned().collect()
        };
        let enough = match check.end {
            End::Stopped => Some(check.said.len()),
            End::Look | End::Act | End::Refused => None,
        };
        let since = Instant::now();
        let mut interrupted = false;
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break Some(status);
            }
            if !interrupted && enough.is_some_and(|count| missing_of(&check.said[..count]).is_empty()) {
                signal_group(&child, "INT");
                interrupted = true;
            }
            if since.elapsed() > PATIENCE * if check.feature.contains("deliveries") { 5 } else { 1 } {
                signal_group(&child, "KILL");
                child.wait().unwrap();
                break None;
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        let missing = missing_of(&check.said);
        let ended_right = match (check.end, status) {
            (_, None) => false,
            (End::Look | End::Act, Some(status)) => status.success(),
            (End::Refused, Some(status)) => !status.success(),
            (End::Stopped, Some(_)) => interrupted,
        };
        if ended_right && missing.is_empty() {
            return Ok(());
        }
        // rmw_cyclonedds says of every endpoint that it has no type hash.
        let told: Vec<String> =
            read(&err).lines().filter(|line| !line.contains("parse type hash")).map(str::to_owned).collect();
        let said: Vec<String> = read(&out).lines().map(str::to_owned).collect();
        let last = |lines: &[String]| lines[lines.len().saturating_sub(3)..].join(" / ");
        let ended = status.map_or_else(|| format!("did not end in {PATIENCE:?}"), |status| status.to_string());
        Err(format!("{ended}; not said: {missing:?}; said last: {}; errors: {}", last(&said), last(&told)))
    }
}

/// Signals a command and what it has started.
fn signal_group(child: &Child, signal: &str) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill").args([&format!("-{signal}"), "--", &group]).status();
}

/// The interpreter that `ros2` itself runs with: the one that has rclpy.
///
/// # Panics
/// Where there is no `ros2`.
fn interpreter() -> String {
    let ros2 = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
        .map(|folder| folder.join("ros2"))
        .find(|file| file.is_file())
        .expect("no ros2 on the PATH: source a ROS 2 with minifactory_msgs first, or leave this target out");
    let mut first = String::new();
    BufReader::new(File::open(ros2).unwrap()).read_line(&mut first).unwrap();
    first.trim().strip_prefix("#!").map_or_else(|| "python3".to_owned(), str::to_owned)
}

fn installed_middlewares() -> Vec<&'static str> {
    let prefixes = std::env::var("AMENT_PREFIX_PATH").unwrap_or_default();
    let has = |middleware: &&str| {
        prefixes.split(':').any(|prefix| Path::new(prefix).join("lib").join(format!("lib{middleware}.so")).is_file())
    };
    MIDDLEWARES.into_iter().filter(has).collect()
}

fn started(up: Up) -> Run {
    let mut run = up.start();
    run.wait_until_simulated(Duration::from_millis(500));
    run
}

/// What one middleware made of the checks.
struct Trial {
    /// Feature, command, and how long it took or that it failed.
    rows: Vec<(String, String, String)>,
    failures: String,
}

impl Trial {
    /// Tries all checks whose feature has `wanted` in its name.
    fn new(middleware: &str, python: &str, wanted: &str) -> Self {
        let mut trial = Self { rows: Vec::new(), failures: String::new() };
        let mut note = |check: &Check, shell: &Shell| {
            if !check.feature.contains(wanted) {
                return;
            }
            let since = Instant::now();
            let outcome = shell.run(check);
            let cell = match &outcome {
                Ok(()) => format!("{:.1} s", since.elapsed().as_secs_f64()),
                Err(_) => "FAILED".to_owned(),
            };
            println!("{middleware}: {}: {cell}", check.feature);
            if let Err(why) = outcome {
                writeln!(trial.failures, "{middleware}: {}: {}\n    {why}", check.feature, check.command).unwrap();
            }
            trial.rows.push((check.feature.clone(), check.command.clone(), cell));
        };
        let run = started(Up::new("--duration 86400 --speed 1 --plain"));
        let shell = shell(middleware, &run);
        for check in checks(python) {
            note(&check, &shell);
        }
        let _ = shell.command("ros2 daemon stop").output();
        gone_is_gone(&shell, run, &mut note);
        let mut scenario = Scenario::default();
        scenario.stations[0].external = true;
        // Simulated: an agent in Python on a busy machine needs longer than a machine's gripper.
        scenario.delivery.hand_over_timeout_s = 60.0;
        let run = started(Up::new("--duration 86400 --speed 2 --plain").scenario(&scenario));
        note(&agent_check(python), &self::shell(middleware, &run));
        run.process().signal(Signal::INT);
        let outcome = run.outcome();
        assert!(outcome.status.success(), "{}", outcome.stderr);
        trial
    }
}

/// One row for each command, with what each middleware made of it. They are tried side by side, as commands mostly wait.
#[test]
fn the_feeder_is_a_citizen_of_ros_2() {
    let python = interpreter();
    let middlewares = installed_middlewares();
    assert!(!middlewares.is_empty(), "neither of {MIDDLEWARES:?} is below AMENT_PREFIX_PATH");
    let wanted = std::env::var("ROS2_FEATURE").unwrap_or_default();
    let trials: Vec<Trial> = std::thread::scope(|scope| {
        let each = middlewares.iter().map(|middleware| scope.spawn(|| Trial::new(middleware, &python, &wanted)));
        each.collect::<Vec<_>>().into_iter().map(|trial| trial.join().unwrap()).collect()
    });
    println!("\n| feature | command | {} |\n|---|---|{}", middlewares.join(" | "), "---|".repeat(middlewares.len()));
    for (index, (feature, command, _)) in trials[0].rows.iter().enumerate() {
        let cells: Vec<&str> = trials.iter().map(|trial| trial.rows[index].2.as_str()).collect();
        println!("| {feature} | `{}` | {} |", command.replace('|', "\\|"), cells.join(" | "));
    }
    let failures: String = trials.into_iter().map(|trial| trial.failures).collect();
    assert!(failures.is_empty(), "{failures}");
}

fn shell(middleware: &str, run: &Run) -> Shell {
    let work = TempDir::new().unwrap();
    std::os::unix::fs::symlink(feeder().get_program(), work.path().join("feeder")).unwrap();
    Shell { middleware: middleware.to_owned(), domain: run.domain().id, other: TestDomain::claim(), work }
}

/// A run that was ended leaves nothing behind: a daemon that has seen it forgets its topics at once.
fn gone_is_gone(shell: &Shell, run: Run, note: &mut impl FnMut(&Check, &Shell)) {
    let watched = "ros2 topic list";
    let seen = check(End::Look, "the daemon sees the topics", watched, &["/feeder/waveform"]);
    note(&seen, shell);
    run.process().signal(Signal::INT);
    let outcome = run.outcome();
    assert!(outcome.status.success(), "{}", outcome.stderr);
    // The lease of a participant that left without a word is 50 s.
    let forgets =
        "for i in $(seq 20); do ros2 topic list | grep -q /feeder || { echo forgotten; break; }; sleep 0.5; done";
    note(&check(End::Act, "no ghosts after the end", forgets, &["forgotten"]), shell);
    let _ = shell.command("ros2 daemon stop").output();
}
