//! What becomes of the paper's claims about parts in bulk.

use std::f64::consts::TAU;

use anyhow::{Context as _, Result};
use feeder_model::part::PartType;
use feeder_sim::parts::{BulkSettings, PartBulk, Place};

use super::{Args, Shaking, block_s, scenario, waveforms};

/// Parts for the claims about many.
const PARTS: usize = 30;

pub(super) fn run(args: &Args, part: &PartType, duration_s: f64) -> Result<()> {
    println!("{} on the paper's tray", part.name);
    for (name, waveform) in waveforms(part) {
        println!("\n{name}");
        let (scenario, waveform, settings) = scenario(part, &waveform)?;
        let bulk = |settings| PartBulk::new(scenario.tray.geometry, part.clone(), settings, args.seed);
        arcs_not_tangents(bulk(settings)?, Shaking::new(waveform.clone()))?;
        let many = BulkSettings { load_plateau: true, ..settings };
        many_parts(bulk(many)?, Shaking::new(waveform), duration_s)?;
    }
    Ok(())
}

/// A lone part is followed over the plateau.
fn arcs_not_tangents(mut bulk: PartBulk, mut shaking: Shaking) -> Result<()> {
    let tray = *bulk.tray();
    let start_m = tray.outer_radius_m - 2.5 * bulk.part_type().outline_radius_m();
    let start_rad = tray.ramp_angle_rad + 0.3;
    bulk.put(start_m, start_rad, 0.0, 0).context("no room on the plateau")?;
    let yaw_rad = bulk.parts()[0].yaw_rad;
    let (mut angle_rad, mut radius_m, mut turned_rad) = (start_rad, start_m, 0.0);
    let mut steps = 0_u32;
    while angle_rad < TAU - 0.3 && steps < 60_000 {
        bulk.step(&shaking.next_block())?;
        let part = bulk.parts()[0];
        (angle_rad, radius_m) = (part.angle_rad(), part.radius_m());
        let turned = part.yaw_rad - yaw_rad - turned_rad;
        turned_rad += turned - TAU * (turned / TAU).round();
        steps += 1;
    }
    let swept_rad = angle_rad - start_rad;
    let tangent_m = start_m / (0.5_f64).cos() - start_m;
    println!(
        "  arcs, not tangents: over {:.0}° of the plateau a lone part drifts outwards by {:.2} mm and turns by {:.0}°; \
         along a tangent it would have gained {:.1} mm in the first 29°",
        swept_rad.to_degrees(),
        1e3 * (radius_m - start_m),
        turned_rad.to_degrees(),
        1e3 * tangent_m
    );
    Ok(())
}

/// What a population does over a long time.
fn many_parts(mut bulk: PartBulk, mut shaking: Shaking, duration_s: f64) -> Result<()> {
    let loaded = bulk.load(PARTS).loaded;
    let tray = *bulk.tray();
    let at_the_wall = |bulk: &PartBulk| {
        let near = bulk.parts().iter().filter(|part| part.place != Place::Falling).filter(|part| {
            let radius_m = bulk.part_type().poses[part.pose].outline.radius_m;
            tray.outer_radius_m - part.radius_m() - radius_m < radius_m
        });
        near.count() as f64 / bulk.parts().len().max(1) as f64
    };
    let before = at_the_wall(&bulk);
    let (mut falls, mut turned) = (0_u32, 0_u32);
    let (mut ramp, mut plateau, mut looks) = (0_usize, 0_usize, 0_u32);
    let (mut ramp_speed, mut plateau_speed) = (Mean::default(), Mean::default());
    let mut last: Vec<_> = bulk.parts().to_vec();
    let blocks_per_second = (1.0 / block_s()).round();
    let mut seconds = 0.0;
    while seconds < duration_s {
        let mut block = 0.0;
        let second_ago: Vec<_> = bulk.parts().to_vec();
        while block < blocks_per_second {
            bulk.step(&shaking.next_block())?;
            for (old, new) in last.iter().zip(bulk.parts()) {
                if old.place != Place::Falling && new.place == Place::Falling {
                    falls += 1;
                    turned += u32::from(old.pose != new.pose);
                }
            }
            last.copy_from_slice(bulk.parts());
            block += 1.0;
        }
        seconds += 1.0;
        looks += 1;
        for (old, new) in second_ago.iter().zip(bulk.parts()) {
            let gone_m = (new.angle_rad() - old.angle_rad()) * new.radius_m();
            match (old.place, new.place) {
                (Place::Ramp, Place::Ramp) => ramp_speed.add(gone_m),
                (Place::Plateau, Place::Plateau) => plateau_speed.add(gone_m),
                _ => {}
            }
        }
        ramp += bulk.parts().iter().filter(|part| part.place == Place::Ramp).count();
        plateau += bulk.parts().iter().filter(|part| part.place == Place::Plateau).count();
    }
    let mean = |total: usize| total as f64 / f64::from(looks);
    println!(
        "  single file near the outer wall: {:.0} % of {loaded} parts within half a width of it when loaded, {:.0} % after \
         {duration_s} s",
        100.0 * before,
        100.0 * at_the_wall(&bulk)
    );
    println!(
        "  spreading on the plateau: {:.1} parts on the ramp at {:.1} mm/s, {:.1} on the plateau at {:.1} mm/s: spaced {:.2} \
         times as far",
        mean(ramp),
        1e3 * ramp_speed.value(),
        mean(plateau),
        1e3 * plateau_speed.value(),
        mean(ramp) / mean(plateau)
    );
    println!(
        "  flipping at the drop-off: {turned} of {falls} falls ({:.0} %) ended in another pose",
        100.0 * f64::from(turned) / f64::from(falls.max(1))
    );
    Ok(())
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn value(&self) -> f64 {
        self.sum / f64::from(self.count.max(1))
    }
}
