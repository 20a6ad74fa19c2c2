//! From scenario files to plans: what is derived, what is refused, and that every reader gets the same.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use feeder_scenario::Scenario;
use feeder_scenario::plan::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, PartSimulatorConfig, PlatenArbiterConfig,
    RunMonitorConfig, RunPlan, VisionSelectorConfig, WaveformGeneratorConfig, load_node, load_plan,
};

fn launch_configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch_configs")
}

/// All scenarios that come with the feeder.
fn scenarios() -> Vec<PathBuf> {
    let files = launch_configs().read_dir().unwrap().map(|entry| entry.unwrap().path());
    let mut scenarios: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|kind| kind == "yaml")).collect();
    scenarios.sort();
    assert!(scenarios.len() >= 3, "{scenarios:?}");
    scenarios
}

#[test]
fn every_scenario_makes_a_sound_plan_which_survives_its_file() {
    let folder = tempfile::tempdir().unwrap();
    for scenario in scenarios() {
        let plan = load_plan(Some(&scenario)).unwrap();
        plan.check().unwrap();
        let file = folder.path().join("plan.yaml");
        std::fs::write(&file, plan.to_yaml().unwrap()).unwrap();
        assert!(load_plan(Some(&file)).unwrap() == plan, "{}", scenario.display());
        assert_eq!(plan.provenance.scenario, std::fs::read_to_string(&scenario).unwrap());
    }
}

#[test]
fn every_node_finds_itself_in_a_scenario_and_in_its_plan() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = launch_configs().join("three_feeders.yaml");
    let plan = load_plan(Some(&scenario)).unwrap();
    let file = folder.path().join("plan.yaml");
    std::fs::write(&file, plan.to_yaml().unwrap()).unwrap();
    for file in [&scenario, &file] {
        let file = Some(file.as_path());
        assert_eq!(load_node::<WaveformGeneratorConfig>(file, None).unwrap().0, "/feeder_1");
        assert_eq!(load_node::<CourierDriverConfig>(file, Some("/feeder_2")).unwrap().1.feeder, "feeder_2");
        assert_eq!(load_node::<PartSimulatorConfig>(file, Some("/feeder_3")).unwrap().1.pick_namespaces.len(), 3);
        assert_eq!(load_node::<VisionSelectorConfig>(file, Some("/feeder_3")).unwrap().1.part_class, "grommet");
        assert!(load_node::<DeliveryPlannerConfig>(file, None).unwrap().1.arbitrated);
        assert_eq!(load_node::<OverheadManipulatorConfig>(file, None).unwrap().0, "/station_1");
        assert_eq!(load_node::<PlatenArbiterConfig>(file, None).unwrap().0, "/platen");
        assert_eq!(load_node::<RunMonitorConfig>(file, None).unwrap().1.feeders.len(), 3);
        let refused = load_node::<CourierDriverConfig>(file, Some("/feeder_4")).unwrap_err().to_string();
        assert!(refused.contains("no courier_driver in /feeder_4; it has /feeder_1/waveform_generator"), "{refused}");
    }
}

#[test]
fn a_plan_with_a_value_out_of_range_is_refused() {
    let mut plan = Scenario::default().plan().unwrap();
    plan.provenance.scenario.clear();
    let wrong = plan.to_yaml().unwrap().replacen("fade_periods: 2", "fade_periods: 0", 1);
    let refused = RunPlan::from_yaml(&wrong).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("fade_periods = 0 is outside its range"), "{refused}");
}
