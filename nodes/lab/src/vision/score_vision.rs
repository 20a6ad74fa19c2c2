//! `feeder-lab score-vision`: the selector against rendered frames whose truth is known.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use feeder_model::camera::{CameraModel, CameraPose, CameraSpec};
use feeder_model::seed::generator;
use feeder_scenario::Scenario;
use feeder_scenario::{PartSource, catalogue_names};
use feeder_sim::camera::{Renderer, TrayShot};
use feeder_vision::{Candidate, Selector, TrackedCandidate, draw_overlay};
use image::GrayImage;
use nalgebra::{Isometry2, Vector2};

use super::score::{Circumstances, Score, Trial};
use feeder::lesson;

/// Shares of the plateau that parts cover: sparse and crowded.
const AREA_FRACTIONS: [f64; 2] = [0.1, 0.5];
/// Standard deviations of the noise, grey levels of 255.
const NOISE_SIGMAS: [f64; 3] = [2.0, 6.0, 12.0];
/// Noise with which parts are taught.
const TAUGHT_SIGMA: f64 = 2.0;

/// Score the selector against rendered frames, part by part
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Parts of the catalogue; all of them if none is named
    parts: Vec<String>,
    /// Frames per part, spread evenly over two crowds and three noise levels
    #[arg(long, default_value_t = 5000)]
    frames: u32,
    /// Size of a pixel at the height of the plateau, m
    #[arg(long, default_value_t = 0.0004)]
    m_per_px: f64,
    /// Seed of placement and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the first frame of each kind, as seen and annotated, and one without parts (PNG), and for the model (JSON)
    #[arg(long, value_name = "FOLDER")]
    save: Option<PathBuf>,
}

/// Prints a table: a line for each part and kind of frames, and one for each part.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let names: Vec<String> = if args.parts.is_empty() {
        catalogue_names().into_iter().map(str::to_owned).collect()
    } else {
        args.parts.clone()
    };
    println!("{HEADER}");
    let mut failed = Vec::new();
    for name in &names {
        if let Err(error) = score(name, args) {
            eprintln!("{name}: {error:#}");
            failed.push(name.as_str());
        }
    }
    anyhow::ensure!(failed.is_empty(), "not scored: {}", failed.join(", "));
    Ok(())
}

const HEADER: &str = "part      cover sigma frames parts/frame found% in pose% selected wrong isolated recall% \
                      p95 mm p95 deg render ms select ms";

/// The scenario with a part of the catalogue under a camera of this resolution, straight above the plateau's middle.
fn scenario(name: &str, m_per_px: f64) -> anyhow::Result<Scenario> {
    let mut scenario = Scenario { part: PartSource::Name(name.to_owned()), part_model: None, ..Scenario::default() };
    let spec = CameraSpec::from(scenario.camera.model.clone());
    let height_m = spec.pose.height_m;
    let plateau_m = scenario.tray.plateau_height_m();
    let place = scenario.delivery.feeding_place;
    let middle_m = 0.5 * scenario.tray.geometry.outer_radius_m;
    scenario.camera.model = CameraModel::new(CameraSpec {
        focal_length_px: Some((height_m - plateau_m) / m_per_px),
        platen_m_per_px: None,
        pose: CameraPose { x_m: place.x, y_m: place.y - middle_m, ..spec.pose },
        ..spec
    })?;
    scenario.world.sensor.noise_sigma_levels = TAUGHT_SIGMA;
    Ok(scenario)
}

fn score(name: &str, args: &Args) -> anyhow::Result<Score> {
    let scenario = scenario(name, args.m_per_px)?;
    let part = scenario.part_type()?;
    let scene = scenario.scene(&part);
    let place = scenario.delivery.feeding_place;
    let platen_from_tray = Isometry2::new(place.xy(), place.z);
    let config = scenario.selector(&part);
    let mut random = generator(args.seed, &format!("score {name}"));
    let model = lesson::taught(&scene, &part.poses, &platen_from_tray, config.contrast_min_levels, &mut random)?;
    if let Some(folder) = &args.save {
        std::fs::create_dir_all(folder)?;
        std::fs::write(folder.join(format!("{name}.model.json")), serde_json::to_string(&model)?)?;
        let mut bare = GrayImage::default();
        Renderer::new(&scene)?.render(&TrayShot::still(platen_from_tray), &[], &mut random, &mut bare)?;
        bare.save(folder.join(format!("{name}_bare.png")))?;
    }
    let world = scenario.world_scene(&part)?;
    let trial = Trial {
        scene: &scene,
        world: &world,
        blur_px: 0.0,
        poses: &part.poses,
        platen_from_tray,
        config: &config,
        model: &model,
    };
    let kinds = u32::try_from(AREA_FRACTIONS.len() * NOISE_SIGMAS.len())?;
    let mut total = Score::default();
    for area_fraction in AREA_FRACTIONS {
        for noise_sigma_levels in NOISE_SIGMAS {
            let circumstances =
                Circumstances { area_fraction, noise_sigma_levels, frames: args.frames.div_ceil(kinds) };
            let mut first = true;
            let score = trial.run(circumstances, &mut random, |image, selector, candidates| {
                if let (true, Some(folder)) = (std::mem::take(&mut first), &args.save) {
                    let stem = format!("{name}_{area_fraction}_{noise_sigma_levels}");
                    save(&folder.join(stem), image, selector, candidates, &platen_from_tray)?;
                }
                Ok(())
            })?;
            println!("{}", line(name, &format!("{noise_sigma_levels}"), &score));
            total.add(&score);
        }
    }
    println!("{}", line(name, "all", &total));
    Ok(total)
}

fn line(name: &str, sigma: &str, score: &Score) -> String {
    let share = |count: u32, of: u32| 100.0 * f64::from(count) / f64::from(of.max(1));
    let frames = f64::from(score.frames.max(1));
    let yaw = if score.yaw_errors_rad.is_empty() {
        "      -".to_owned()
    } else {
        format!("{:7.2}", Score::p95(&score.yaw_errors_rad).to_degrees())
    };
    format!(
        "{name:9} {:5.3} {sigma:>5} {:6} {:11.1} {:6.2} {:8.2} {:8} {:5} {:8} {:7.2} {:6.3} {yaw} {:9.2} {:9.2}",
        score.covered / frames,
        score.frames,
        f64::from(score.parts) / frames,
        share(score.found, score.parts),
        share(score.posed, score.parts),
        score.selected,
        score.wrong,
        score.isolated,
        100.0 * score.recall(),
        1e3 * Score::p95(&score.position_errors_m),
        1e3 * score.render.as_secs_f64() / frames,
        1e3 * score.select.as_secs_f64() / frames,
    )
}

/// Writes a frame, and the same annotated.
fn save(
    stem: &Path,
    image: &GrayImage,
    selector: &Selector,
    candidates: &[Candidate],
    platen_from_tray: &Isometry2<f64>,
) -> anyhow::Result<()> {
    let tracked: Vec<TrackedCandidate> = candidates
        .iter()
        .zip(0..)
        .map(|(candidate, id)| TrackedCandidate {
            id,
            stamp_s: 0.0,
            candidate: *candidate,
            position_m: candidate.centre(),
            velocity_m_s: Vector2::zeros(),
            yaw_rad: candidate.yaw_rad,
            yaw_rate_rad_s: 0.0,
            pose: candidate.pose,
            confidence: candidate.confidence,
            frames_seen: 1,
        })
        .collect();
    let file = |ending: &str| {
        let mut name = stem.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    };
    image.save(file(".png")).with_context(|| format!("cannot write {}", stem.display()))?;
    draw_overlay(image, &tracked, selector, platen_from_tray).save(file("_annotated.png"))?;
    Ok(())
}
