//! `feeder-lab scene`: what a scenario's camera looks at, for a renderer that is not ours.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::geometry::StablePose;
use feeder_model::part::PartType;
use feeder_scenario::{PartSource, catalogue_names};
use feeder_sim::camera::{LightModel, TrayAppearance};
use serde::Serialize;

/// Print what a scenario's camera looks at as JSON, for another renderer: camera, tray and light as in the scenario, and parts in each of
/// their poses as triangles.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// Parts of the catalogue; all of it if none is named.
    parts: Vec<String>,
    /// Scenario (YAML); the built-in one without it.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Seen {
    camera: CameraModel,
    tray: MountedTray,
    tray_appearance: TrayAppearance,
    light: LightModel,
    /// Where the tray stands: x and y, m, and yaw, rad.
    feeding_place: [f64; 3],
    parts: BTreeMap<String, Shape>,
}

#[derive(Debug, Serialize)]
struct Shape {
    /// Corners of each triangle as indices of a pose's vertices, counter-clockwise seen from outside.
    triangles: Vec<[u32; 3]>,
    /// Share of light that comes back from each of them.
    reflectance: Vec<f64>,
    poses: Vec<Pose>,
}

#[derive(Debug, Serialize)]
struct Pose {
    name: String,
    is_wanted: bool,
    /// Probability after a part was poured.
    poured: f64,
    /// Corners of the part as it lies on a level floor at z = 0 at yaw 0, its centre of mass over the origin, m.
    vertices_m: Vec<[f64; 3]>,
    /// Corners of its silhouette from above, counter-clockwise, m.
    outline_m: Vec<[f64; 2]>,
}

/// Prints the scene.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let mut scenario = feeder_scenario::plan::load_untaught(args.scenario.as_deref())?;
    let place = scenario.delivery.feeding_place;
    let of_catalogue = || catalogue_names().into_iter().map(str::to_owned).collect();
    let names: Vec<String> = if args.parts.is_empty() { of_catalogue() } else { args.parts.clone() };
    let mut parts = BTreeMap::new();
    for name in names {
        scenario.part = PartSource::Name(name.clone());
        parts.insert(name, shape(&scenario.part_type()?));
    }
    let seen = Seen {
        camera: scenario.camera.model.clone(),
        tray: scenario.tray,
        tray_appearance: scenario.world.tray,
        light: scenario.world.light,
        feeding_place: [place.x, place.y, place.z],
        parts,
    };
    println!("{}", serde_json::to_string(&seen).context("the scene cannot be written as JSON")?);
    Ok(())
}

fn shape(part: &PartType) -> Shape {
    let pose = |(index, pose): (usize, &StablePose)| Pose {
        name: pose.name.clone(),
        is_wanted: part.wanted_poses.contains(&index),
        poured: part.poured[index],
        vertices_m: part
            .mesh
            .vertices()
            .iter()
            .map(|vertex| pose.orientation * vertex)
            .map(|vertex| [vertex.x, vertex.y, vertex.z + pose.com_height_m])
            .collect(),
        outline_m: pose.outline.corners_m.iter().map(|corner| [corner.x, corner.y]).collect(),
    };
    Shape {
        triangles: part.mesh.triangles().to_vec(),
        reflectance: part.mesh.reflectance().to_vec(),
        poses: part.poses.iter().enumerate().map(pose).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_of_the_catalogue_lies_on_the_floor_within_its_outline_in_each_pose() {
        for name in catalogue_names() {
            let part = PartSource::Name(name.to_owned()).part_type().unwrap();
            let shape = shape(&part);
            assert_eq!(shape.poses.len(), part.poses.len());
            assert_eq!(shape.reflectance.len(), shape.triangles.len());
            for (drawn, pose) in shape.poses.iter().zip(&part.poses) {
                let heights = drawn.vertices_m.iter().map(|vertex| vertex[2]);
                let (low, high) =
                    heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
                assert!(
                    low.abs() < 1e-6 && (high - pose.height_m).abs() < 1e-6,
                    "{name} {}: {low} to {high}",
                    pose.name
                );
                let reach_m = drawn.vertices_m.iter().map(|[x, y, _]| x.hypot(*y)).fold(0.0, f64::max);
                assert!((reach_m - pose.outline.radius_m).abs() < 1e-6, "{name} {}: {reach_m}", pose.name);
            }
            assert!(shape.poses.iter().any(|pose| pose.is_wanted), "{name}");
            assert!((shape.poses.iter().map(|pose| pose.poured).sum::<f64>() - 1.0).abs() < 1e-6, "{name}");
        }
    }
}
