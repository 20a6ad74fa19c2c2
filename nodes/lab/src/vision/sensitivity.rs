//! `feeder-lab vision-sensitivity`: the selector where the world differs a little from what it was taught.

use feeder_model::camera::{CameraModel, CameraPose, CameraSpec, Distortion};
use feeder_model::geometry::PartMesh;
use feeder_model::seed::generator;
use feeder_scenario::{PartSource, Scenario};
use feeder_sim::camera::{LightModel, Scene, SensorModel};
use nalgebra::Isometry2;

use super::score::{Circumstances, Score, Trial};
use feeder::lesson;

/// Share of the plateau that parts cover.
const AREA_FRACTION: f64 = 0.1;
/// The renderer's own blur, and the one that a lens out of focus makes of it, px.
const BLUR_PX: f64 = 0.5;
const OUT_OF_FOCUS_PX: f64 = 1.0;

/// Score the selector where part, light, lens or calibration differ a little from what was taught
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Parts of the catalogue
    #[arg(default_values_t = ["grommet".to_owned(), "hex_nut".to_owned()])]
    parts: Vec<String>,
    /// Frames for each difference
    #[arg(long, default_value_t = 20)]
    frames: u32,
    /// Seed of placement and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Something that differs from what was taught.
struct Difference {
    name: &'static str,
    change: fn(&mut Scene) -> anyhow::Result<()>,
    blur_px: f64,
}

const DIFFERENCES: [Difference; 14] = [
    Difference { name: "none", change: |_| Ok(()), blur_px: 0.0 },
    Difference { name: "part 3 % darker", change: |scene| lit(scene, 0.97), blur_px: 0.0 },
    Difference { name: "part 3 % brighter", change: |scene| lit(scene, 1.03), blur_px: 0.0 },
    Difference { name: "part 20 % darker", change: |scene| lit(scene, 0.8), blur_px: 0.0 },
    Difference { name: "part 20 % brighter", change: |scene| lit(scene, 1.2), blur_px: 0.0 },
    Difference { name: "lamp at 45 deg", change: lower_lamp, blur_px: 0.0 },
    Difference { name: "exposure -30 %", change: |scene| exposed(scene, 0.7), blur_px: 0.0 },
    Difference { name: "exposure +30 %", change: |scene| exposed(scene, 1.3), blur_px: 0.0 },
    Difference { name: "blur 1 px", change: |_| Ok(()), blur_px: OUT_OF_FOCUS_PX },
    Difference { name: "k1 -0.05", change: |scene| camera(scene, |spec| spec.distortion = bent()), blur_px: 0.0 },
    Difference {
        name: "camera 0.5 mm off",
        change: |scene| camera(scene, |spec| spec.pose.x_m += 0.000_5),
        blur_px: 0.0,
    },
    Difference { name: "camera 1 mm off", change: |scene| camera(scene, |spec| spec.pose.x_m += 0.001), blur_px: 0.0 },
    Difference {
        name: "camera 0.5 deg",
        change: |scene| camera(scene, |spec| spec.pose.yaw_rad += 0.5_f64.to_radians()),
        blur_px: 0.0,
    },
    Difference { name: "scale 1 %", change: |scene| camera(scene, larger), blur_px: 0.0 },
];

/// A part that gives back so many times the light.
fn lit(scene: &mut Scene, ratio: f64) -> anyhow::Result<()> {
    let mesh = &scene.part.mesh;
    let reflectance = mesh.reflectance().iter().map(|share| (share * ratio).min(1.0)).collect();
    scene.part.mesh = PartMesh::new(mesh.vertices().to_vec(), mesh.triangles().to_vec(), reflectance)?;
    Ok(())
}

fn lower_lamp(scene: &mut Scene) -> anyhow::Result<()> {
    scene.light.elevation_rad = 45_f64.to_radians();
    Ok(())
}

fn exposed(scene: &mut Scene, ratio: f64) -> anyhow::Result<()> {
    scene.light = LightModel { white_level: scene.light.white_level * ratio, ..scene.light };
    Ok(())
}

fn bent() -> Distortion {
    Distortion { k1: -0.05, ..Distortion::default() }
}

fn larger(spec: &mut CameraSpec) {
    spec.focal_length_px = spec.focal_length_px.map(|focal_px| 1.01 * focal_px);
    spec.platen_m_per_px = spec.platen_m_per_px.map(|m_per_px| m_per_px / 1.01);
}

fn camera(scene: &mut Scene, change: impl Fn(&mut CameraSpec)) -> anyhow::Result<()> {
    let mut spec = CameraSpec::from(scene.camera.clone());
    change(&mut spec);
    scene.camera = CameraModel::new(CameraSpec { pose: CameraPose { ..spec.pose }, ..spec })?;
    Ok(())
}

/// Prints a table: a line for each part and difference.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    println!(
        "part      difference          frames warned refused isolated recall% selected wrong p95 mm p95 deg select ms"
    );
    for name in &args.parts {
        let scenario = Scenario { part: PartSource::Name(name.clone()), part_model: None, ..Scenario::default() };
        let part = scenario.part_type()?;
        let scene = scenario.scene(&part);
        let place = scenario.delivery.feeding_place;
        let platen_from_tray = Isometry2::new(place.xy(), place.z);
        let config = scenario.selector(&part);
        let mut random = generator(args.seed, &format!("sensitivity {name}"));
        let model = lesson::taught(&scene, &part.poses, &platen_from_tray, config.contrast_min_levels, &mut random)?;
        for Difference { name: difference, change, blur_px } in &DIFFERENCES {
            let mut world = scene.clone();
            change(&mut world)?;
            let blur_px = feeder_model::camera::single((blur_px * blur_px - BLUR_PX * BLUR_PX).max(0.0).sqrt());
            let trial = Trial {
                scene: &scene,
                world: &world,
                blur_px,
                poses: &part.poses,
                platen_from_tray,
                config: &config,
                model: &model,
            };
            let SensorModel { noise_sigma_levels, .. } = scene.sensor;
            let circumstances = Circumstances { area_fraction: AREA_FRACTION, noise_sigma_levels, frames: args.frames };
            // The same parts in the same places for each difference.
            let mut random = generator(args.seed, &format!("sensitivity {name} crowd"));
            let score = trial.run(circumstances, &mut random, |_, _, _| Ok(()))?;
            println!(
                "{name:9} {difference:19} {:6} {:6} {:7} {:8} {:7.1} {:8} {:5} {:6.3} {:7.2} {:9.2}",
                score.frames,
                score.warned,
                score.refused,
                score.isolated,
                100.0 * score.recall(),
                score.selected,
                score.wrong,
                1e3 * Score::p95(&score.position_errors_m),
                Score::p95(&score.yaw_errors_rad).to_degrees(),
                1e3 * score.select.as_secs_f64() / f64::from(score.frames.max(1)),
            );
        }
    }
    Ok(())
}
