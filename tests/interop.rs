//! The feeder as another DDS implementation sees it: Cyclone DDS with default settings, on the same host.

use std::time::Duration;

use feeder_scenario::Scenario;
use serde::Deserialize;

use crate::common::{Up, python};

/// Compressed images the peer receives: ten seconds' worth.
const IMAGES: usize = 100;
/// Parts the peer has loaded on the way.
const LOADED: u32 = 5;
/// Wall time after which the peer gives up.
const PATIENCE: Duration = Duration::from_secs(120);

/// What `feeder_peer.py` prints.
#[derive(Deserialize)]
struct Report {
    joint_state_stamps_ns: Vec<u64>,
    joint_names: Vec<Vec<String>>,
    joint_positions: Vec<Vec<f64>>,
    image_stamps_ns: Vec<u64>,
    image_formats: Vec<String>,
    image_frames: Vec<String>,
    image_sizes_px: Vec<Vec<u32>>,
    image_bytes_max: usize,
    part_frames: Vec<String>,
    part_counts: Vec<u32>,
    part_classes: Vec<String>,
    part_surfaces: Vec<u8>,
    part_poses: Vec<u8>,
    part_radius_m_min: f64,
    part_radius_m_max: f64,
    feeding: Feeding,
    loaded: Loaded,
}

#[derive(Debug, PartialEq, Deserialize)]
struct Feeding {
    success: bool,
    message: String,
}

#[derive(Debug, PartialEq, Deserialize)]
struct Loaded {
    loaded: u32,
    message: String,
}

#[test]
fn cyclone_dds_reads_joint_states_images_and_parts_and_calls_services() {
    // Made first, where it must be: a run is not to wait for it.
    python();
    let scenario = Scenario::default();
    let mut run = Up::new("--duration 3600 --speed 1").default_discovery_range().start();
    run.wait_until_simulated(Duration::from_millis(100));
    let arguments = ["--images", &IMAGES.to_string(), "--load", &LOADED.to_string()];
    let report: Report = run.seen_by("feeder_peer.py", PATIENCE, &arguments);

    let period_ns = scenario.camera.period_ms * 1_000_000;
    let steps = report.image_stamps_ns.windows(2).map(|pair| pair[1] - pair[0]);
    let lost: u64 = steps.map(|step| step / period_ns - 1).sum();
    assert_eq!((report.image_stamps_ns.len() >= IMAGES, lost), (true, 0), "{:?}", report.image_stamps_ns);
    assert!(report.image_stamps_ns.iter().all(|stamp| stamp.is_multiple_of(period_ns)), "{:?}", report.image_stamps_ns);
    let model = &scenario.camera.model;
    assert_eq!(report.image_sizes_px, [[model.width_px(), model.height_px()]]);
    assert_eq!(report.image_formats, ["mono8; jpeg compressed mono8"]);
    assert_eq!(report.image_frames, ["feeder/camera_optical"]);
    assert!(report.image_bytes_max < 64_000, "{}", report.image_bytes_max);

    assert_eq!(report.joint_names, [["courier_x", "courier_y", "courier_yaw"]]);
    assert!(report.joint_state_stamps_ns.len() >= IMAGES && report.joint_state_stamps_ns.is_sorted());
    let limits = scenario.courier.limits;
    for position in &report.joint_positions {
        assert_eq!(position.len(), 3);
        assert!((limits.x_m_min..=limits.x_m_max).contains(&position[0]), "{position:?}");
        assert!((limits.y_m_min..=limits.y_m_max).contains(&position[1]), "{position:?}");
    }

    assert_eq!(report.part_frames, ["feeder/tray"]);
    assert_eq!(report.part_classes, [scenario.part_type().unwrap().name.as_str()]);
    assert!(report.part_surfaces.iter().all(|surface| *surface <= 2), "{:?}", report.part_surfaces);
    assert_eq!(report.part_poses, [0, 1]);
    let tray = scenario.tray.geometry;
    assert!(report.part_radius_m_min >= tray.inner_radius_m, "{}", report.part_radius_m_min);
    assert!(report.part_radius_m_max <= tray.outer_radius_m, "{}", report.part_radius_m_max);
    assert!(report.part_counts.iter().all(|count| *count > 0), "{:?}", report.part_counts);

    assert!(report.feeding.success, "{:?}", report.feeding);
    assert_eq!(report.loaded, Loaded { loaded: LOADED, message: String::new() });
    // Delivered parts leave meanwhile.
    assert!(report.part_counts.iter().any(|count| *count > scenario.parts_loaded), "{:?}", report.part_counts);
}
