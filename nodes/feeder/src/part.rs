//! `feeder part`: shows a part, its stable poses and what its shape makes likely.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use feeder_model::part::{PartSpec, PartType};
use feeder_scenario::{PartSource, catalogue_names};

/// Show a part, its stable poses with their probabilities, and what its shape makes likely; without a name, list the
/// catalogue. Whatever is wrong with a part file is named.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Name of a part of the catalogue, or a part file (YAML)
    part: Option<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let Some(name) = &args.part else { return list() };
    let spec = load(name)?;
    show(&PartType::new(&spec)?, &spec);
    Ok(())
}

/// A part of the catalogue, or of a file with the files it names.
pub fn load(name: &str) -> Result<PartSpec> {
    let mut source = PartSource::Name(name.to_owned());
    let path = PathBuf::from(name);
    let mut read = |file: &str| std::fs::read(Path::new(file)).map_err(|error| error.to_string());
    source.load(&mut read).with_context(|| format!("part {}", path.display()))?;
    Ok(source.spec()?)
}

fn list() -> Result<()> {
    println!("{:<12} {:>9} {:>9} {:>6} {:>7}  poses (wanted ones with *)", "part", "mass", "size", "poses", "wanted");
    for name in catalogue_names() {
        let part = PartSource::Name(name.to_owned()).part_type()?;
        let poses = part.poses.iter().enumerate().map(|(index, pose)| {
            let mark = if part.wanted_poses.contains(&index) { "*" } else { "" };
            format!("{}{mark}", pose.name)
        });
        let wanted: f64 = part.wanted_poses.iter().map(|&pose| part.poured[pose]).sum();
        println!(
            "{name:<12} {:>6.0} mg {:>6.1} mm {:>6} {:>5.0} %  {}",
            1e6 * part.mass_kg,
            2e3 * part.mesh.radius_m(),
            part.poses.len(),
            100.0 * wanted,
            poses.collect::<Vec<_>>().join(", ")
        );
    }
    Ok(())
}

fn show(part: &PartType, spec: &PartSpec) {
    println!(
        "{}: {:.1} mg, {:.1} mm across, μ {} at rest and {} sliding, {} triangles",
        part.name,
        1e6 * part.mass_kg,
        2e3 * part.mesh.radius_m(),
        part.friction.static_coefficient(),
        part.friction.kinetic_coefficient(),
        part.mesh.triangles().len()
    );
    println!(
        "\n{:<12} {:>9} {:>8} {:>8} {:>8} {:>10} {:>9}  up in the shape's axes",
        "pose", "estimate", "poured", "height", "tips at", "width", "yaw"
    );
    for (index, pose) in part.poses.iter().enumerate() {
        let (least, most) = pose.outline.width_range_m();
        let yaw = match pose.yaw_symmetry {
            0 => "any".to_owned(),
            1 => "once".to_owned(),
            fold => format!("{fold}-fold"),
        };
        let up = pose.up[0];
        println!(
            "{:<12} {:>7.1} % {:>6.1} % {:>5.2} mm {:>7.0}° {:>4.1}–{:.1} mm {yaw:>8}  [{:.3}, {:.3}, {:.3}]{}{}",
            pose.name,
            100.0 * pose.probability,
            100.0 * part.poured[index],
            1e3 * pose.height_m,
            pose.tip_angle_rad.to_degrees(),
            1e3 * least,
            1e3 * most,
            up.x + 0.0,
            up.y + 0.0,
            up.z + 0.0,
            if part.wanted_poses.contains(&index) { "  wanted" } else { "" },
            if pose.rolls { "  rolls" } else { "" },
        );
    }
    match &spec.drops {
        None => {
            println!("\nno drop data: `feeder-lab drop` makes them from the part or its file; the estimate stands in");
        }
        Some(drops) => {
            println!(
                "\nover the drop-off ({}, {} drops each from {} mm, seed {}), from row to column:",
                drops.engine,
                drops.drops,
                1e3 * drops.height_m,
                drops.seed
            );
            let columns: Vec<String> = part.poses.iter().map(|pose| format!("{:>12}", pose.name)).collect();
            println!("{:<12} {}", "", columns.join(" "));
            for (pose, row) in part.poses.iter().zip(&part.dropoff) {
                let row: Vec<String> = row.iter().map(|share| format!("{:>10.1} %", 100.0 * share)).collect();
                println!("{:<12} {}", pose.name, row.join(" "));
            }
        }
    }
    for hazard in part.hazards() {
        println!("\nlikely in bulk, and not modelled: {hazard}");
    }
}
