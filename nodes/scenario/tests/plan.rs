//! From scenario files to plans: what is derived, what is refused, and that every reader gets the same.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use feeder_control::delivery::FeedRate;
use feeder_scenario::Scenario;
use feeder_scenario::plan::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, PartSimulatorConfig, PlatenArbiterConfig,
    RunMonitorConfig, RunPlan, VisionSelectorConfig, WaveformGeneratorConfig, load_node, load_plan,
};
use feeder_sim::motor::MotorParameters;

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

/// The built-in scenario with a part of this friction, stated in a file beside it, and what is written to that file.
fn with_part(folder: &Path, friction: f64, more: &str) -> PathBuf {
    let part = std::fs::read_to_string(launch_configs().join("parts/grommet.yaml")).unwrap();
    // How it was dropped belongs to the friction it had.
    let (part, _) = part.split_once("# Printed by").unwrap();
    let part = part.replace("friction_static: 0.2", &format!("friction_static: {friction}"));
    let part = part.replace("friction_kinetic: 0.2", &format!("friction_kinetic: {friction}"));
    std::fs::write(folder.join("bush.yaml"), part).unwrap();
    std::fs::create_dir_all(folder.join("models")).unwrap();
    std::fs::copy(launch_configs().join("models/grommet.yaml"), folder.join("models/grommet.yaml")).unwrap();
    std::fs::copy(launch_configs().join("plants/assumed.yaml"), folder.join("motor.yaml")).unwrap();
    let scenario = std::fs::read_to_string(launch_configs().join("default.yaml")).unwrap();
    let scenario = scenario.replace("part: grommet", "part: bush.yaml").replace("motor: assumed", "motor: motor.yaml");
    let file = folder.join("scenario.yaml");
    std::fs::write(&file, scenario + more).unwrap();
    file
}

/// Puts a waveform in the place of a scenario's own.
fn put_waveform(file: &Path, waveform: &str) {
    let mut scenario: Vec<String> = std::fs::read_to_string(file).unwrap().lines().map(str::to_owned).collect();
    let begins = scenario.iter().position(|line| line == "waveform:").unwrap();
    let ends = begins + 1 + scenario[begins + 1..].iter().position(|line| !line.starts_with(' ')).unwrap();
    scenario.splice(begins + 1..ends, [format!("  {waveform}")]);
    std::fs::write(file, scenario.join("\n")).unwrap();
}

#[test]
fn moves_reckon_with_the_least_friction_that_the_part_may_have() {
    let folder = tempfile::tempdir().unwrap();
    for friction in [0.12, 0.4] {
        let file = with_part(folder.path(), friction, "");
        let (_, planner) = load_node::<DeliveryPlannerConfig>(Some(&file), None).unwrap();
        // The part's file says ± 10 %.
        assert!((planner.delivery().gentle.friction - 0.9 * friction).abs() < 1e-12, "{planner:?}");
        let (_, simulator) = load_node::<PartSimulatorConfig>(Some(&file), None).unwrap();
        assert!((simulator.part.friction_static - friction).abs() < 1e-12);
        let (_, driver) = load_node::<CourierDriverConfig>(Some(&file), None).unwrap();
        assert_eq!(driver.motor, feeder_scenario::assumed_motor());
    }
    let file = with_part(folder.path(), 0.4, "believed: { part_friction: 0.3 }\n");
    let (_, planner) = load_node::<DeliveryPlannerConfig>(Some(&file), None).unwrap();
    assert!((planner.delivery().gentle.friction - 0.9 * 0.3).abs() < 1e-12);
    let part = std::fs::read_to_string(folder.path().join("bush.yaml")).unwrap();
    for (stated, least) in [("friction_uncertainty_ratio: 0.25", 0.4 * (1.0 - 0.25)), ("", 0.4 * (1.0 - 0.1))] {
        let file = with_part(folder.path(), 0.4, "");
        let part = part.replace("friction_uncertainty_ratio: 0.1", stated);
        std::fs::write(folder.path().join("bush.yaml"), part).unwrap();
        let (_, planner) = load_node::<DeliveryPlannerConfig>(Some(&file), None).unwrap();
        assert!((planner.delivery().gentle.friction - least).abs() < 1e-12, "{stated}: {planner:?}");
        let waveform = |friction: &str| {
            let optimal = "kind: optimal, period_s: 0.1, radius_m: 0.085, surface: ramp, limit_rad_s2: 130.0";
            put_waveform(&file, &format!("{{ {optimal}{friction} }}"));
            load_node::<WaveformGeneratorConfig>(Some(&file), None).unwrap().1.waveform
        };
        let designed = waveform("");
        assert_ne!(designed, waveform(", friction: 0.4"));
        assert_eq!(designed, waveform(&format!(", friction: {least}")), "an optimal waveform is designed for it too");
    }
}

/// A stick-slip that states no more than its larger acceleration suits parts that one with stated values does not climb with.
#[test]
fn a_stick_slip_is_designed_for_the_part_unless_its_values_are_stated() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |friction: f64, stated: &str| {
        let file = with_part(folder.path(), friction, "");
        put_waveform(&file, &format!("{{ kind: stick_slip, a_max_rad_s2: 300.0{stated} }}"));
        load_plan(Some(&file)).map_err(|error| error.to_string())
    };
    let stated = ", a_min_rad_s2: 15.0, period_s: 0.17";
    assert!(plan(0.2, stated).is_ok());
    let refused = plan(0.12, stated).unwrap_err();
    assert!(refused.contains("parts climb nowhere"), "{refused}");
    for friction in [0.12, 0.16, 0.2, 0.5] {
        plan(friction, "").unwrap_or_else(|refused| panic!("{friction}: {refused}"));
    }
    let refused = plan(0.08, "").unwrap_err();
    assert!(refused.contains("least friction of the part"), "{refused}");
}

/// The waveform that runs is designed for what is believed; how far in parts climb under it is the world's affair.
#[test]
fn with_less_friction_in_the_world_than_believed_parts_climb_on_less_of_the_ramp() {
    let folder = tempfile::tempdir().unwrap();
    let critical_m = |ratio: f64| {
        let file = with_part(folder.path(), 0.2, "");
        let text = std::fs::read_to_string(&file).unwrap();
        let differs = format!("motor: motor.yaml\n  differences: {{ friction_ratio: {ratio} }}");
        std::fs::write(&file, text.replace("motor: motor.yaml", &differs)).unwrap();
        let (_, simulator) = load_node::<PartSimulatorConfig>(Some(&file), None).unwrap();
        simulator.bulk.critical_radius_m.unwrap()
    };
    let [less, as_believed, more] = [0.95, 1.0, 1.05].map(critical_m);
    assert!(less > as_believed + 0.002 && as_believed > more + 0.002, "{less}, {as_believed}, {more} m");
}

/// Camera, light, noise and friction of what is simulated are near to what selector and planner believe, but not the same.
#[test]
fn the_world_differs_a_little_from_what_control_was_told() {
    for file in scenarios() {
        let plan = load_plan(Some(&file)).unwrap();
        let scenario = Scenario::read(&plan.provenance.scenario, &mut |name| {
            std::fs::read(launch_configs().join(name)).map_err(|error| error.to_string())
        });
        let scenario = scenario.unwrap();
        let part = scenario.part_type().unwrap();
        let taught = scenario.scene(&part);
        for (namespace, simulator) in plan.of_kind::<PartSimulatorConfig>() {
            let (_, selector) = load_node::<VisionSelectorConfig>(Some(&file), Some(namespace)).unwrap();
            let (told, is) = (&simulator.camera.calibrated, &simulator.camera.model);
            assert_eq!(*told, selector.camera, "everybody is told of the camera that the selector knows");
            let (told, is) = (told.pose(), is.pose());
            for off_m in [is.x_m - told.x_m, is.y_m - told.y_m] {
                assert!((1e-5..1e-4).contains(&off_m.abs()), "{}: {off_m} m", file.display());
            }
            for (what, is, told) in [
                ("height", is.height_m, told.height_m),
                ("light", simulator.camera.light.white_level, taught.light.white_level),
                ("lamp", simulator.camera.light.azimuth_rad, taught.light.azimuth_rad),
                ("noise", simulator.camera.sensor.noise_sigma_levels, taught.sensor.noise_sigma_levels),
                (
                    "friction",
                    simulator.part_type().unwrap().friction.static_coefficient(),
                    part.friction.static_coefficient(),
                ),
            ] {
                let off = (is / told - 1.0).abs();
                assert!((1e-4..0.2).contains(&off), "{}: {what} is {is}, told is {told}", file.display());
            }
        }
    }
}

#[test]
fn differences_are_added_to_what_is_stated_and_kept_in_range() {
    let world = |stated: &str| {
        changed("world:\n", &format!("world:\n  differences: {{ {stated} }}\n"))
            .and_then(|scenario| scenario.plan())
            .map_err(|error| error.to_string())
    };
    let simulator = |stated: &str| world(stated).unwrap().of_kind::<PartSimulatorConfig>().next().unwrap().1.clone();
    let camera = |stated: &str| simulator(stated).camera;
    let none = camera("camera_x_m: 0.0");
    let moved =
        camera("camera_x_m: 0.002, camera_y_m: -0.001, camera_height_m: 0.01, camera_yaw_rad: 0.1, lens_k1: -0.05");
    let (from, to) = (none.calibrated.pose(), moved.model.pose());
    assert!((to.x_m - from.x_m - 0.002).abs() < 1e-12 && (to.y_m - from.y_m + 0.001).abs() < 1e-12);
    assert!((to.height_m - from.height_m - 0.01).abs() < 1e-12 && (to.yaw_rad - from.yaw_rad - 0.1).abs() < 1e-12);
    assert!((moved.model.distortion().k1 + 0.05).abs() < 1e-12);
    assert_eq!(moved.calibrated, none.calibrated);
    let lit = camera("light_ratio: 0.5, lamp_azimuth_rad: 1.0, noise_ratio: 3.0");
    assert!((lit.light.white_level - 0.5 * 235.0).abs() < 1e-9 && (lit.light.azimuth_rad - 3.2).abs() < 1e-9);
    assert!((lit.sensor.noise_sigma_levels - 6.0).abs() < 1e-9);
    let slippery = simulator("friction_ratio: 0.95");
    assert!((slippery.part_type().unwrap().friction.static_coefficient() - 0.19).abs() < 1e-12);
    assert!((slippery.part.friction_static - 0.2).abs() < 1e-12, "the part's file says what it said");
    for (stated, named) in
        [("friction_ratio: 0.01", "differences.friction_ratio = 0.01"), ("light_ratio: -1", "light_ratio = -1")]
    {
        let refused = world(stated).unwrap_err();
        assert!(refused.contains(named), "{stated}: {refused}");
    }
}

#[test]
fn what_control_believes_of_a_motor_is_about_a_tenth_off() {
    let mut motors = 0;
    for scenario in scenarios() {
        let plan = load_plan(Some(&scenario)).unwrap();
        for (_, CourierDriverConfig { motor, courier, .. }) in plan.of_kind::<CourierDriverConfig>() {
            if *motor == MotorParameters::IDEAL {
                continue;
            }
            motors += 1;
            let believed = [
                ("mass", courier.limits.mass_kg, motor.mass_kg),
                ("inertia", courier.limits.inertia_kg_m2, motor.inertia_kg_m2),
                ("delay", courier.learning.nominal_delay_s, motor.delay_s),
                ("lag", courier.learning.nominal_lag_s, motor.lag_s),
            ];
            for (what, believed, is) in believed {
                let off = (believed / is - 1.0).abs();
                assert!((0.03..0.15).contains(&off), "{}: {what} {believed}, is {is}", scenario.display());
            }
        }
    }
    assert!(motors >= 5, "{motors}");
}

#[test]
fn the_planner_knows_how_fast_the_plateau_should_feed() {
    let folder = tempfile::tempdir().unwrap();
    let feed = |believed: &str| {
        let file = with_part(folder.path(), 0.2, believed);
        let (_, planner) = load_node::<DeliveryPlannerConfig>(Some(&file), None).unwrap();
        let (period_s, feed) = (planner.recipes[0].period_s, &planner.recipes[0].plateau_feed);
        assert!(feed.is_sorted_by(|inner, outer| inner.radius_m < outer.radius_m) && feed.len() > 10, "{feed:?}");
        let at = |rate: &&FeedRate| (rate.radius_m - 0.085).abs() < 1e-6;
        (period_s, feed.iter().find(at).unwrap().rate_rad_s)
    };
    // 0.32138 rad/s at 85 mm, as `feeder-lab tray-map` has it.
    let (period_s, rate_rad_s) = feed("");
    assert!((period_s - 0.191).abs() < 1e-12 && (rate_rad_s - 0.32138).abs() < 1e-4, "{period_s} {rate_rad_s}");
    // It is what is believed of the friction that counts, for which the waveform is designed too.
    let (period_s, rate_rad_s) = feed("believed: { part_friction: 0.25 }\n");
    assert!(period_s < 0.18 && rate_rad_s > 0.35, "{period_s} {rate_rad_s}");
}

#[test]
fn a_key_that_has_moved_is_refused_with_its_new_place() {
    let built_in = std::fs::read_to_string(launch_configs().join("default.yaml")).unwrap();
    for (was, written, says) in [
        (
            "courier:\n",
            "courier:\n  plant: assumed\n",
            "courier: plant is not stated here any more, but in world.motor",
        ),
        ("camera:\n", "camera:\n  light: {}\n", "world.light"),
        ("camera:\n", "camera:\n  sensor: {}\n", "world.sensor"),
        ("camera:\n", "camera:\n  tray: {}\n", "world.tray"),
        ("delivery:\n", "delivery:\n  gentle: { friction: 0.2 }\n", "believed.part_friction"),
        ("delivery:\n", "delivery:\n  stations_m: {}\n", "stations"),
        (
            "delivery:\n",
            "delivery:\n  tether: { anchor_m: [0.0, 0.8], length_m: 1.4 }\n",
            "courier.limits.tether_anchor_m",
        ),
        ("delivery:\n", "selector: { wanted_poses: [1] }\ndelivery:\n", "the part's wanted_poses"),
        ("delivery:\n", "delivery:\n  nonsense: 1\n", "nonsense"),
    ] {
        let scenario = built_in.replacen(&format!("\n{was}"), &format!("\n{written}"), 1);
        assert!(scenario != built_in, "{was}");
        let refused = scenario.parse::<Scenario>().unwrap_err().to_string();
        assert!(refused.contains(says), "{written}: {refused}");
    }
}

#[test]
fn the_selector_seeks_the_poses_that_the_part_is_wanted_in() {
    let plan = load_plan(Some(&launch_configs().join("default.yaml"))).unwrap();
    let (_, selector) = plan.of_kind::<VisionSelectorConfig>().next().unwrap();
    assert_eq!(
        (selector.poses.as_slice(), selector.wanted_poses.as_slice()),
        (&["hole_up".to_owned(), "boss_up".to_owned()][..], &[0][..])
    );
    let (_, manipulator) = plan.of_kind::<OverheadManipulatorConfig>().next().unwrap();
    assert_eq!(manipulator.pose_class, "hole_up");
}

/// The built-in scenario, with `changed` in place of what is `written` there.
fn changed(written: &str, changed: &str) -> Result<Scenario, feeder_scenario::ScenarioError> {
    let built_in = std::fs::read_to_string(launch_configs().join("default.yaml")).unwrap();
    assert!(built_in.contains(written), "{written}");
    Scenario::read(&built_in.replacen(written, changed, 1), &mut |file| {
        std::fs::read(launch_configs().join(file)).map_err(|error| error.to_string())
    })
}

#[test]
fn a_value_or_a_key_that_is_wrong_is_told_once_with_what_is_allowed() {
    let refused = |written: &str, wrong: &str| changed(written, wrong).unwrap_err().to_string();
    let count = refused("parts_loaded: 60", "parts_loaded: -3");
    assert!(count.contains("not a whole number from 0 to 4294967295"), "{count}");
    assert!(count.contains("parts_loaded: -3") && count.starts_with("line "), "{count}");
    let key = refused("parts_loaded: 60", "parts_looaded: 60");
    assert!(key.contains("parts_looaded"), "{key}");
    assert_eq!(key.matches("further_feeders").count(), 1, "{key}");
}

#[test]
fn what_a_run_could_never_do_is_refused_before_it() {
    let period = |ms: u64| changed("period_ms: 100", &format!("period_ms: {ms}"));
    let refused = period(510).unwrap_err().to_string();
    assert!(refused.contains("camera: period_ms = 510 is outside its range: 10 to 500"), "{refused}");
    period(500).unwrap();
    let tolerance =
        |m: f64| changed("      goals_open: 4\n", &format!("      goals_open: 4\n      tolerance_m: {m}\n"));
    let refused = tolerance(0.000_19).unwrap_err().to_string();
    assert!(refused.contains("station_1.manipulator.tolerance_m = 0.00019"), "{refused}");
    assert!(refused.contains("tolerance_m_min = 0.0002"), "{refused}");
    tolerance(0.000_2).unwrap();
}

#[test]
fn parts_that_slide_down_the_ramp_at_rest_are_refused_where_moves_must_hold_them() {
    let with = |friction: f64, policy: &str| {
        let at_feeding = "  feeding_place: [-0.1, 0.0, 0.0]\n";
        let believed = format!("  policy: {policy}\n{at_feeding}believed: {{ part_friction: {friction} }}\n");
        changed(&format!("  policy: all\n{at_feeding}"), &believed)
    };
    // Known to 10 %; the ramp rises by 20 mm over half a turn, which is 0.1061 at 60 mm.
    let refused = with(0.1178, "all").unwrap_err().to_string();
    assert!(refused.contains("delivery") && refused.contains("0.1060, allowed is above 0.1061"), "{refused}");
    with(0.118, "all").unwrap();
    // Under another policy, or further in, they may slide.
    with(0.1178, "selected").unwrap();
    with(0.1178, "all\n  protected_ramp_radius_m: 0.065").unwrap();
}

#[test]
fn feeders_stand_on_the_platen_where_nothing_is_kept_out() {
    let platen =
        |keep_out: &str| changed("parts_loaded:", &format!("platen:\n  keep_out:\n    - {keep_out}\nparts_loaded:"));
    let refused = platen("{ points_m: [[-0.05, 0.0]], radius_m: 0.05 }").unwrap_err().to_string();
    assert!(refused.contains("platen: keep_out[0] lies over the place where feeder feeds"), "{refused}");
    platen("{ points_m: [[0.0, 0.4]], radius_m: 0.05 }").unwrap();

    let further = |x_m: f64| {
        changed(
            "parts_loaded:",
            &format!("further_feeders:\n  - {{ name: feeder_2, x_m: {x_m}, y_m: 0.0 }}\nparts_loaded:"),
        )
    };
    let refused = further(7.0).unwrap_err().to_string();
    assert!(refused.contains("further_feeders: feeder_2.x_m = 7 is outside its range: "), "{refused}");
    assert!(refused.contains("(courier.limits)"), "{refused}");
}

#[test]
fn a_gripper_opens_for_the_part_and_needs_room_for_its_jaws() {
    let manipulator = |gripper: &str| {
        let scenario = changed("    y_m: 0.0\n", &format!("    y_m: 0.0\n{gripper}")).unwrap();
        let plan = scenario.plan().unwrap();
        let (_, manipulator) = plan.of_kind::<OverheadManipulatorConfig>().next().unwrap();
        (scenario.part_type().unwrap().poses[0].outline.narrowest().0, manipulator.clone())
    };
    // Half a millimetre of play on either side, and jaws half a millimetre thick.
    let (width_m, derived) = manipulator("");
    assert!((derived.gripper_opening_m - width_m - 1e-3).abs() < 1e-12, "{derived:?}");
    assert!((derived.part_gap_m_min - 1e-3).abs() < 1e-12, "{derived:?}");
    // Of a part that is not round the jaws close on the narrow side of the pose asked for, however narrow others are.
    let blocks = std::fs::read_to_string(launch_configs().join("blocks.yaml")).unwrap();
    let model = std::fs::read_to_string(launch_configs().join("models/block.yaml")).unwrap();
    let blocks = Scenario::read(&blocks, &mut |_| Ok(model.clone().into_bytes())).unwrap();
    let plan = blocks.plan().unwrap();
    let (_, block) = plan.of_kind::<OverheadManipulatorConfig>().next().unwrap();
    assert!((block.gripper_opening_m - 0.005).abs() < 1e-12, "{block:?}");
    assert!((block.jaws_yaw_rad.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-9, "{block:?}");
    let (width_m, stated) = manipulator("    gripper: { opening_m: 0.014, jaw_thickness_m: 0.002 }\n");
    assert!((stated.gripper_opening_m - 0.014).abs() < 1e-12);
    assert!((stated.part_gap_m_min - (0.5 * (0.014 - width_m) + 0.002)).abs() < 1e-12, "{stated:?}");

    let narrow =
        changed("    y_m: 0.0\n", "    y_m: 0.0\n    gripper: { opening_m: 0.001 }\n").unwrap_err().to_string();
    assert!(narrow.contains("stations: station_1.gripper.opening_m = 0.001 is outside its range: 0.00"), "{narrow}");
}

#[test]
fn the_parts_are_a_load_that_driver_and_planner_know() {
    let grommet_kg = Scenario::default().part_type().unwrap().mass_kg;
    for (loaded, more, parts) in [("60", "", 60.0), ("1", "refill_below: 30\n", 30.0), ("0", "", 0.0)] {
        let scenario = changed("parts_loaded: 60\n", &format!("parts_loaded: {loaded}\n{more}")).unwrap();
        let plan = scenario.plan().unwrap();
        let (_, driver) = plan.of_kind::<CourierDriverConfig>().next().unwrap();
        let (_, planner) = plan.of_kind::<DeliveryPlannerConfig>().next().unwrap();
        assert_eq!(driver.courier.load, planner.load);
        assert!((planner.load.mass_kg - parts * grommet_kg).abs() < 1e-12, "{planner:?}");
        // Spread evenly between radii of 30 and 90 mm.
        let gyration_m2 = 0.5 * (0.03_f64.powi(2) + 0.09_f64.powi(2));
        assert!((planner.load.inertia_kg_m2 - parts * grommet_kg * gyration_m2).abs() < 1e-12, "{planner:?}");
    }
}

#[test]
fn the_planner_keeps_to_the_tether_that_the_driver_watches() {
    let scenario = changed("courier:\n", "courier:\n  limits: { tether_anchor_m: [0.1, 0.7], tether_length_m: 1.1 }\n");
    let plan = scenario.unwrap().plan().unwrap();
    let (_, planner) = plan.of_kind::<DeliveryPlannerConfig>().next().unwrap();
    let tether = planner.delivery().tether.unwrap();
    assert_eq!((tether.anchor_m.x, tether.anchor_m.y, tether.length_m), (0.1, 0.7, 1.1));
}
