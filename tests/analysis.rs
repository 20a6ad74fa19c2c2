//! The subcommands that compute, run as a user runs them.
use std::path::PathBuf;
use std::process::Output;

use serde_json::Value;

fn lab(arguments: &str) -> Output {
    crate::common::lab().args(arguments.split_whitespace()).output().unwrap()
}

/// The JSON that a successful run prints.
#[track_caller]
fn json(arguments: &str) -> Value {
    let output = lab(arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[track_caller]
fn assert_near(value: &Value, expected: f64, tolerance: f64) {
    let number = value.as_f64().unwrap_or_else(|| panic!("{value} is no number"));
    assert!((number - expected).abs() <= tolerance, "{number} instead of {expected}");
}

fn scratch_file(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn val_feed_rate_of_fig_6_and_fig_8() {
    let fig6 = json("feed-rate --waveform stick-slip --period 0.05 --a-min 1.6 --a-max 10.1 --mu 0.2");
    assert_near(&fig6["feed_m_s"], 12.497_348_555_742_7e-3, 1e-14);
    assert_near(&fig6["equation_m_s"], 12.497_348_555_742_7e-3, 1e-14);
    assert_near(&fig6["min_normal_over_weight"], 1.0, 0.0);
    assert!(fig6["cycle_mean_m_s"].is_null() && fig6["cycles"].is_u64());

    let fig8 = json("feed-rate --waveform coulomb-pump --period 0.05 --a-max 10.3 --z 0.37 --from-rest world");
    assert_near(&fig8["feed_m_s"], 17.625_875e-3, 1e-14);
    let means = fig8["cycle_mean_m_s"].as_array().unwrap();
    assert!(means.len() >= 20);
    for (mean, mm_s) in means.iter().zip([8.84, 13.56, 15.74, 16.76, 17.22]) {
        assert_near(mean, mm_s * 1e-3, 5e-6);
    }
}

#[test]
fn closed_forms_are_null_outside_their_range() {
    let beyond = json("feed-rate --waveform stick-slip --period 0.05 --a-min 2.5 --a-max 10.1 --mu 0.2");
    assert!(beyond["equation_m_s"].is_null() && beyond["feed_m_s"].is_f64());
    let ramp = json("feed-rate --waveform stick-slip --period 0.05 --a-min 1.6 --a-max 10.1 --slope-deg 2");
    assert!(ramp["equation_m_s"].is_null() && ramp["feed_m_s"].is_f64());
    let runaway = json("feed-rate --waveform stick-slip --period 0.05 --a-min 1.6 --a-max 10.1 --slope-deg 20");
    assert!(runaway["feed_m_s"].is_null());
    let optimal = json("feed-rate --waveform optimal --period 0.0333 --a-max 11.772 --slope-deg 4");
    assert_near(&optimal["equation_m_s"], optimal["feed_m_s"].as_f64().unwrap(), 1e-13);
}

#[test]
fn feed_rate_reads_a_waveform_from_a_file() {
    let text =
        "axis: x\nsegments:\n  - {duration_s: 0.03, acceleration: 1.0}\n  - {duration_s: 0.01, acceleration: -3.0}\n";
    let path = scratch_file("waveform.yaml", text);
    let report = json(&format!("feed-rate --waveform {}", path.display()));
    let same = json("feed-rate --waveform stick-slip --period 0.04 --a-min 1 --a-max 3");
    assert_near(&report["feed_m_s"], same["feed_m_s"].as_f64().unwrap(), 1e-15);

    let output = lab(&format!("tray-map --waveform {} --radius 0.08", path.display()));
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("yaw"));
    let open = scratch_file("open.yaml", &text.replace("-3.0", "-2.9"));
    let output = lab(&format!("feed-rate --waveform {}", open.display()));
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("velocity"));
}

#[test]
fn val_tray_map_of_fig_15() {
    let map = json(
        "tray-map --inner-radius 0.03 --outer-radius 0.09 --rise 0.02 --ramp-deg 180 --mu 0.2 --waveform stick-slip \
         --period 0.03333333333333333 --a-min 17.658 --a-max 130.8654 --radius 0.09,0.06,0.0301",
    );
    assert_near(&map["critical_radius_m"], 57.605e-3, 1e-6);
    let radii = map["radii"].as_array().unwrap();
    // Along the slope the table has 2.197 and 0.292 mm/s; ψ̇ = v cos φ/r.
    assert_near(&radii[0]["radius_m"], 0.09, 0.0);
    assert_near(&radii[0]["ramp_rad_s"], 1.395_041_951_f64.to_radians(), 1e-9);
    assert_near(&radii[0]["plateau_rad_s"], 5.541_297_313_f64.to_radians(), 1e-9);
    assert_near(&radii[1]["ramp_rad_s"], 0.276_934_907_f64.to_radians(), 1e-9);
    assert_near(&radii[1]["radial_drift_m_s"], 0.8e-6, 0.2e-6);
    assert!(radii[2]["ramp_rad_s"].is_null(), "below 31.8 mm parts slide even at rest");
}

#[test]
fn bad_input_names_the_parameter_and_its_range() {
    let stick_slip = "feed-rate --waveform stick-slip --period 0.05 --a-min 1.6";
    let map = "tray-map --waveform stick-slip --period 0.05 --a-min 9 --a-max 66";
    for (arguments, parameter) in [
        (format!("{stick_slip} --a-max 1.6"), "a_max"),
        (format!("{stick_slip} --a-max NaN"), "a_max"),
        (stick_slip.to_string(), "--a-max"),
        (format!("{stick_slip} --a-max 10 --mu 0"), "friction"),
        (format!("{stick_slip} --a-max 10 --mu -0.2"), "friction"),
        (format!("{stick_slip} --a-max 10 --mu 0.2 --mu-static 0.1"), "friction_static"),
        (format!("{stick_slip} --a-max 10 --slope-deg 90"), "slope"),
        (format!("{stick_slip} --a-max 10 --slope-deg NaN"), "slope"),
        (format!("{stick_slip} --a-max 10 --gravity 0"), "gravity"),
        ("feed-rate --waveform stick-slip --period 0 --a-min 1.6 --a-max 10".into(), "period"),
        ("feed-rate --waveform coulomb-pump --period 0.05 --a-max 10 --z 0".into(), "z = 0"),
        ("feed-rate --waveform coulomb-pump --period 0.05 --a-max 10 --z 1".into(), "z = 1"),
        ("feed-rate --waveform optimal --period 0.05 --a-max 1".into(), "limit"),
        ("feed-rate --waveform nowhere.yaml".into(), "nowhere.yaml"),
        (format!("{map} --radius 0.1"), "radius"),
        (format!("{map} --radius NaN"), "radius"),
        (format!("{map} --inner-radius 0.1 --radius 0.08"), "radius"),
        (format!("{map} --ramp-deg 400 --radius 0.08"), "ramp_angle"),
        ("optimize waveform --period 0 --a-max 11".into(), "period"),
        ("optimize waveform --period 0.05 --a-max 11 --slope-deg 12".into(), "slope"),
        ("optimize waveform --period 0.05 --a-max 11 --mu-tolerance 1".into(), "--mu-tolerance"),
        ("optimize waveform --period 0.05 --a-max 100 --radius 0.2".into(), "radius"),
        ("optimize tray --part-length 0.1".into(), "length_m"),
        ("optimize tray --spacing 0".into(), "spacing"),
        (format!("{map} --rise NaN --radius 0.08"), "rise"),
    ] {
        let output = lab(&arguments);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{arguments} succeeded");
        assert!(text.contains(parameter), "{arguments}: {text}");
        let has_range = ["range", "needs", "readable"].iter().any(|word| text.contains(word));
        assert!(has_range && output.stdout.is_empty(), "{arguments}: {text}");
    }
}

/// An empty folder of this test's own.
fn scratch_folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    path
}

#[test]
fn optimized_waveforms_come_as_files_that_feed_as_reported() {
    let folder = scratch_folder("waveforms");
    let limits = "--slope-deg 4 --period 0.0333 --a-max 11.772 --starts 3 --steps 600";
    let output = lab(&format!("optimize waveform {limits} --out {}", folder.display()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_saphyr::from_slice(&output.stdout).unwrap();
    assert_eq!(report["nominal"]["proven"], true);
    assert_near(&report["nominal"]["share_of_bound"], 1.0, 1e-12);
    for (name, mu) in [("nominal", 0.2), ("robust", 0.15)] {
        let file = folder.join(format!("waveform_{name}.yaml"));
        let feed = json(&format!("feed-rate --waveform {} --slope-deg 4 --mu {mu}", file.display()));
        assert_near(&report[name]["feeds_m_s"][0], feed["feed_m_s"].as_f64().unwrap(), 1e-12);
    }
}

#[test]
fn optimized_trays_come_with_a_front_and_are_the_same_for_the_same_seed() {
    let search = "optimize tray --spacing 2,3 --period 0.0333 --mu-tolerance 0.1 --starts 1 --steps 60 --seed 3";
    let folder = scratch_folder("trays");
    let output = lab(&format!("{search} --out {}", folder.display()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_saphyr::from_slice(&output.stdout).unwrap();
    assert_near(&report["paper"]["parts_per_min"], 25.24, 0.01);
    for point in report["nominal"].as_array().unwrap() {
        let wanted = point["spacing_parts"].as_f64().unwrap();
        assert!(point["times_paper"].as_f64().unwrap() > 1.0);
        assert!(point["spacing_in_two_dimensions"].as_f64().unwrap() > 0.999 * wanted);
    }
    for file in ["tray_robust_spacing_2.yaml", "waveform_nominal_spacing_3.yaml", "pareto.svg", "pareto.csv"] {
        assert!(folder.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    assert_eq!(lab(search).stdout, output.stdout);
}

#[test]
fn figures_come_with_their_numbers_and_a_page_of_claims() {
    let folder = scratch_folder("figures");
    let output = lab(&format!("figures --out {}", folder.display()));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files: Vec<String> =
        folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    for figure in ["fig04", "fig06", "fig07", "fig08", "fig11", "fig12", "fig13", "fig15"] {
        for kind in ["svg", "csv"] {
            assert!(files.iter().any(|file| file.starts_with(figure) && file.ends_with(kind)), "{figure} as {kind}");
        }
    }
    let page = std::fs::read_to_string(folder.join("claims.md")).unwrap();
    for number in
        ["12.497", "0.2147", "0.202", "17.626", "8.54, 7.87, 5.60, 3.00, 0.23, -2.69", "57.6 mm", "31.8 mm", "34 %"]
    {
        assert!(page.contains(number), "{number} in\n{page}");
    }
    for verdict in ["| reproduced |", "| refuted |", "| not decidable |"] {
        assert!(page.contains(verdict), "{verdict}");
    }
}

/// The lines of a table that a successful run prints.
#[track_caller]
fn lines(arguments: &str) -> Vec<String> {
    let output = lab(arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn val_the_rig_with_the_courier_in_the_loop_feeds_as_the_outside_reference_says() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("rig");
    let out = out.to_str().unwrap();
    // What the paper measured lies where courier_tracking.csv, from a simulator of its own, has PD from 25 to 60 Hz.
    for (figure, measured, ideal_mm_s) in [("fig6", 12.4, 12.497), ("fig8", 22.5, 17.626)] {
        let lines = lines(&format!("experiment {figure} --duration 4 --out {out}"));
        let row = |name: &str| {
            let line =
                lines.iter().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name} in {lines:?}"));
            line[24..].split_whitespace().map(str::to_owned).collect::<Vec<_>>()
        };
        let feed_mm_s = |name: &str| row(name)[0].parse::<f64>().unwrap();
        assert!((feed_mm_s("ideal tray") - ideal_mm_s).abs() < 6e-3);
        // The set point's cut-off and the servo's ticks take up to 4 %.
        assert!((feed_mm_s("learning") / ideal_mm_s - 1.0).abs() < 0.05, "{}", feed_mm_s("learning"));
        assert!((feed_mm_s("PD 40 Hz ") / ideal_mm_s - 1.0).abs() > 0.05, "{}", feed_mm_s("PD 40 Hz "));
        assert!(lines.iter().any(|line| line.contains(&format!("the {measured} mm/s measured"))));
        for name in ["PD 25 Hz", "PD 60 Hz", "learning"] {
            let mu: f64 = row(name)[3].parse().unwrap();
            assert!((mu / 0.2 - 1.0).abs() < 0.01, "{name}: {mu}");
        }
    }
    for (file, least) in [("fig06_travel.svg", 2000), ("fig08_travel.csv", 2000), ("fig08_velocities_pd.svg", 2000)] {
        assert!(std::fs::metadata(folder.path().join("rig").join(file)).unwrap().len() > least, "{file}");
    }
    let found = json(&format!("identify-friction {out}/fig06_recording_pd"));
    assert_near(&found["kinetic_friction"], 0.2, 0.002);
}

#[test]
fn friction_is_found_in_a_csv_file_and_what_is_wrong_with_one_is_said() {
    // 0.05 s periods at 1 kHz: the tray shakes at ±3 m/s² and the part slips all the time, by turns.
    let mut text = "part_velocity_m_s,time_s,tray_velocity_m_s\n".to_owned();
    let mut part_m_s = 0.0;
    for tick in 0..400 {
        let time_s = f64::from(tick) * 1e-3;
        let phase = (time_s / 0.05).fract();
        let tray_m_s = 0.3 * (4.0 * (phase - 0.5).abs() - 1.0);
        text += &format!("{part_m_s},{time_s},{tray_m_s}\n");
        part_m_s += 0.15 * 9.81 * 1e-3 * if tray_m_s > part_m_s { 1.0 } else { -1.0 };
    }
    let file = scratch_file("slip.csv", &text);
    assert_near(&json(&format!("identify-friction {}", file.display()))["kinetic_friction"], 0.15, 0.0015);
    let file = scratch_file("columns.csv", "time,tray,part\n0,0,0\n");
    let output = lab(&format!("identify-friction {}", file.display()));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("tray_velocity_m_s") && said.contains("columns.csv"), "{said}");
}

#[test]
fn the_learning_grid_keeps_its_bounds() {
    // What the default cut-off leaves out lacks on the plateau.
    for (cutoff, plateau_max, ratios_min) in [("", 3.3, [20.0, 6.0]), (" --cutoff-hz 930", 1.25, [40.0, 15.0])] {
        let lines = lines(&format!("experiment learning --coarse --seeds 2{cutoff}"));
        let numbers = |start: &str| -> Vec<f64> {
            let line =
                lines.iter().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{start} in {lines:?}"));
            line[start.len()..]
                .split(|c: char| c.is_whitespace() || c == ',')
                .filter_map(|word| word.parse().ok())
                .filter(|number: &f64| number.fract() != 0.0)
                .collect()
        };
        let [ramp, plateau, ..] = numbers("largest deviation of a single run:")[..] else { panic!("{lines:?}") };
        assert!(ramp < 3.0 && plateau < plateau_max, "{lines:?}");
        let ratios: Vec<f64> =
            lines.last().unwrap().split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse().ok()).collect();
        assert!(ratios[0] >= ratios_min[0] && ratios[1] >= ratios_min[1], "{ratios:?}");
    }
}

#[test]
fn every_fault_is_survived() {
    let lines = lines("experiment faults");
    let rows: Vec<Vec<&str>> = lines[2..].iter().map(|line| line.split('|').map(str::trim).collect()).collect();
    assert_eq!(rows.len(), 20);
    for row in rows {
        let [_, fault, doing, noticed, safe, way, works, reaction, ..] = row[..] else { panic!("{row:?}") };
        assert_eq!(works, "yes", "{fault} while {doing}");
        let ms = |text: &str| text.strip_suffix(" ms").map(|number| number.parse::<f64>().unwrap());
        let way_mm: f64 = way.strip_suffix(" mm").unwrap().parse().unwrap();
        assert_eq!(ms(noticed).is_none(), reaction == "carries on", "{row:?}");
        // Silence is noticed after two seconds, everything else within a quarter of one: a courier that gets 1 % of its
        // force takes that long to be a few millimetres off.
        let limit_ms = if fault.contains("falls silent") { 2200.0 } else { 250.0 };
        assert!(ms(noticed).is_none_or(|ms| ms < limit_ms), "{row:?}");
        assert!(ms(safe).is_none_or(|ms| ms < limit_ms + 300.0) && way_mm < 110.0, "{row:?}");
    }
}

#[test]
fn arguments_that_would_do_nothing_are_refused() {
    for (arguments, says) in [
        ("try-motors --only nosuch", "--only: no motor's name contains \"nosuch\"; there are as assumed, lag x 0"),
        ("identify-motor --plant nosuch", "--plant: no motor's name contains \"nosuch\"; there are as assumed"),
        ("plan-move --distance 0.3 --turn 0.5 --policy selected", "--turn = 0.5 is outside its range: 0 with"),
    ] {
        let output = lab(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && output.stdout.is_empty() && said.contains(says), "{arguments}: {said}");
    }
}
