//! `feeder teach`: shows the selector pictures of a scenario's part in each of its resting poses, and prints the model.
//!
//! The pictures come from the scenario's camera with its noise, as a teaching session on the device would give them.

use std::f64::consts::TAU;
use std::path::PathBuf;

use anyhow::Context as _;
use feeder_core::camera::{PartView, Renderer};
use feeder_core::scenario::Scenario;
use feeder_core::seed::generator;
use feeder_core::selection::{PartModel, TeachFrame, TeachSpec, teach};
use image::GrayImage;
use nalgebra::Isometry2;

/// Pictures of each pose.
const FRAMES_PER_POSE: u32 = 8;
/// Parts laid out for each picture.
const PARTS_PER_FRAME: u32 = 9;

/// Teach the selector a scenario's part and print the model (YAML)
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct TeachArgs {
    /// Scenario file (YAML); without it the built-in scenario's part is taught
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
}

/// Prints the `part_model` section for a scenario.
pub(crate) fn run(args: &TeachArgs) -> anyhow::Result<()> {
    let scenario = crate::scenario_file::load(args.scenario.as_deref())?;
    let model = taught(&scenario)?;
    print!("{}", serde_saphyr::to_string(&serde_json::json!({ "part_model": model }))?);
    Ok(())
}

fn taught(scenario: &Scenario) -> anyhow::Result<PartModel> {
    let part = scenario.part_type()?;
    let renderer = Renderer::new(&scenario.scene(&part))?;
    let mut random = generator(scenario.seed, "teach");
    let place = scenario.delivery.feeding_place;
    let platen_from_tray = Isometry2::new(place.xy(), place.z);
    let mut pictures: Vec<(GrayImage, usize)> = Vec::new();
    for pose in 0..part.poses.len() {
        for frame in 0..FRAMES_PER_POSE {
            let mut image = GrayImage::default();
            let parts = laid_out(scenario, part.outline_radius_m(), pose, frame);
            renderer.render(&platen_from_tray, &parts, &mut random, &mut image)?;
            pictures.push((image, pose));
        }
    }
    let frames: Vec<TeachFrame<'_>> =
        pictures.iter().map(|(image, pose)| TeachFrame { image, platen_from_tray, pose: *pose }).collect();
    let spec = TeachSpec {
        diameter_m: 2.0 * part.outline_radius_m(),
        height_m: part.poses[part.wanted_poses[0]].height_m,
        contrast_min_levels: scenario.selector.contrast_min_levels,
    };
    teach(&frames, &scenario.camera.model, &scenario.tray, spec).context("cannot teach this part")
}

/// Parts of one pose, spread over the plateau: by angle within a picture, by radius from picture to picture.
fn laid_out(scenario: &Scenario, radius_m: f64, pose: usize, frame: u32) -> Vec<PartView> {
    let tray = &scenario.tray.geometry;
    let (inner_m, outer_m) = (tray.inner_radius_m + 2.0 * radius_m, tray.outer_radius_m - 1.2 * radius_m);
    let share = f64::from(frame) / f64::from(FRAMES_PER_POSE - 1);
    let r_m = inner_m + (outer_m - inner_m) * (0.4 + 0.6 * share);
    let sector_rad = TAU - tray.ramp_angle_rad;
    (0..PARTS_PER_FRAME)
        .map(|index| {
            let angle_rad = tray.ramp_angle_rad + sector_rad * (f64::from(index) + 0.5) / f64::from(PARTS_PER_FRAME);
            let (sin, cos) = angle_rad.sin_cos();
            PartView { x_m: r_m * cos, y_m: r_m * sin, z_m: tray.rise_m, yaw_rad: f64::from(index), pose }
        })
        .collect()
}
