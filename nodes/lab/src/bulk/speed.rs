//! Simulated seconds per wall second, of this project's bulk and of a rigid-body engine.

use std::time::Instant;

use anyhow::Result;
use feeder_model::part::PartType;
use feeder_sim::parts::{BulkSettings, PartBulk};

use super::{Args, Shaking, block_s, rapier, scenario, waveforms};

pub(super) fn run(args: &Args, part: &PartType, duration_s: f64) -> Result<()> {
    let mut rows = Vec::new();
    for &count in &args.count {
        for (name, waveform) in waveforms(part) {
            let (scenario, waveform, settings) = scenario(part, &waveform)?;
            let settings = BulkSettings { load_plateau: true, ..settings };
            let mut bulk = PartBulk::new(scenario.tray.geometry, part.clone(), settings, args.seed)?;
            let loaded = bulk.load(count).loaded;
            let mut shaking = Shaking::new(waveform.clone());
            let mut step = |seconds: f64| -> Result<f64> {
                let began = Instant::now();
                let mut done_s = 0.0;
                while done_s < seconds {
                    bulk.step(&shaking.next_block())?;
                    done_s += block_s();
                }
                Ok(done_s / began.elapsed().as_secs_f64())
            };
            // Until parts are where they go by themselves.
            step(duration_s)?;
            let own = step(duration_s)?;
            let other = if args.rapier {
                Some(rapier::speed(
                    part,
                    &scenario.tray.geometry,
                    settings,
                    count,
                    args.seed,
                    &waveform,
                    duration_s / 100.0,
                )?)
            } else {
                None
            };
            rows.push(serde_json::json!({
                "part": part.name, "waveform": name, "parts": loaded,
                "sim_s_per_wall_s": own, "rapier3d_sim_s_per_wall_s": other,
            }));
        }
    }
    println!("{}", serde_json::to_string_pretty(&rows)?);
    Ok(())
}
