//! A part that the feeder does not know, by its file alone: with its own friction it is fed and carried without sliding,
//! however the nodes are started.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use feeder_runtime::launch::run_real;
use feeder_runtime::testing::TestDomain;
use feeder_scenario::plan::{RunMonitorConfig, load_plan};
use feeder_wire::topics;
use run_monitor::RunMonitor;
use tempfile::TempDir;

use crate::common::{Up, feeder, output, wait_for};
use crate::wall_clock::{hear, lead_driver, participant};

/// Largest slip of a part that is carried with its own friction in mind, m.
const SLIP_M_MAX: f64 = 10e-6;

/// Writes the grommet with another friction, and the built-in scenario with that part, to a folder.
fn scenario_with_friction(folder: &Path, friction: f64) -> PathBuf {
    let launch_configs = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("launch_configs");
    let read = |name: &str| fs::read_to_string(launch_configs.join(name)).unwrap();
    let part = read("parts/grommet.yaml");
    // How it was dropped belongs to the friction it had.
    let (part, _) = part.split_once("# Printed by").unwrap();
    let part = part.replace("friction_static: 0.2", &format!("friction_static: {friction}"));
    let part = part.replace("friction_kinetic: 0.2", &format!("friction_kinetic: {friction}"));
    fs::write(folder.join("part.yaml"), part).unwrap();
    fs::create_dir_all(folder.join("models")).unwrap();
    fs::write(folder.join("models/grommet.yaml"), read("models/grommet.yaml")).unwrap();
    let scenario = folder.join("scenario.yaml");
    fs::write(&scenario, read("default.yaml").replace("\npart: grommet\n", "\npart: part.yaml\n")).unwrap();
    scenario
}

#[track_caller]
fn delivered_again_from_a_recording(friction: f64, duration_s: u32) {
    let folder = TempDir::new().unwrap();
    let scenario = scenario_with_friction(folder.path(), friction);
    let bag = folder.path().join("bag");
    let run = Up::new(&format!("--duration {duration_s} --composed --record-exclude camera/(image_raw|annotated)$"))
        .scenario_file(&scenario)
        .record(&bag)
        .success();
    assert!(run.number("delivered") >= 2.0, "{}", run.summary());
    assert!(run.number("max_slip_m") < SLIP_M_MAX, "{}", run.summary());
    assert_eq!(run.summary()["wrong_pose_delivered"], 0, "{}", run.summary());

    let domain = TestDomain::claim();
    let again = output([
        OsStr::new("bag"),
        OsStr::new("rerun"),
        bag.as_ref(),
        OsStr::new("--domain"),
        domain.id.to_string().as_ref(),
    ]);
    let said = String::from_utf8_lossy(&again.stdout);
    assert!(again.status.success() && said.contains(" 0 differ"), "{said}{}", String::from_utf8_lossy(&again.stderr));
}

#[test]
fn a_part_more_slippery_than_any_of_the_catalogue_is_carried_without_sliding() {
    delivered_again_from_a_recording(0.12, 45);
}

#[test]
fn a_part_that_grips_twice_as_well_is_carried_without_sliding() {
    delivered_again_from_a_recording(0.4, 25);
}

/// The nodes of a run, each in a process that somebody started by hand. Dropped, they are killed.
struct Nodes(Vec<Child>);

impl Nodes {
    fn start(scenario: &Path, domain: &TestDomain) -> Self {
        let plan = load_plan(Some(scenario)).unwrap();
        let kinds = plan.nodes.iter().map(|planned| planned.node.kind()).filter(|kind| *kind != "run_monitor");
        let started = kinds.map(|kind| {
            let mut node: Command = feeder();
            node.args(["node", kind, "--config"]).arg(scenario).stdin(Stdio::null()).stderr(Stdio::null());
            node.env("ROS_DOMAIN_ID", domain.id.to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
            node.spawn().unwrap()
        });
        Self(started.collect())
    }
}

impl Drop for Nodes {
    fn drop(&mut self) {
        for node in &mut self.0 {
            // One that has ended already cannot be killed.
            let _ = node.kill();
            let _ = node.wait();
        }
    }
}

/// As on hardware: every node in its process, paced by the wall clock, and the courier made active by hand.
#[test]
fn nodes_started_by_hand_deliver_a_slippery_part_without_sliding() {
    let folder = TempDir::new().unwrap();
    let scenario = scenario_with_friction(folder.path(), 0.12);
    let domain = TestDomain::claim();
    let _nodes = Nodes::start(&scenario, &domain);
    let plan = load_plan(Some(&scenario)).unwrap();
    let (_, monitor) = plan.of_kind::<RunMonitorConfig>().next().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let monitor = std::thread::spawn({
        let (domain, config, stop) = (*domain, monitor.clone(), Arc::clone(&stop));
        move || run_real::<RunMonitor>(&domain, "/feeder", &config, &stop)
    });

    let here = participant(&domain);
    let (_reader, progress) = hear(&here, &topics::PROGRESS, "/feeder");
    lead_driver(&here, &["configure", "activate"]);
    let far = wait_for("a delivery", || progress.try_iter().find(|far| far.delivered >= 1));
    stop.store(true, Ordering::Relaxed);
    monitor.join().unwrap().unwrap();
    assert_eq!(far.wrong_pose_delivered, 0);
    assert!((0.0..SLIP_M_MAX).contains(&far.max_slip_m), "{far:?}");
}
