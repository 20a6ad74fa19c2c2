//! Throughput and singulation against the load.

use std::f64::consts::PI;

use anyhow::{Context as _, Result};
use feeder_model::part::PartType;
use feeder_sim::parts::{BulkSettings, FeedObserver, FeedReport, PartBulk, Sighting};

use super::{Args, Shaking, block_s, scenario, waveforms};
use crate::analysis::chart::{Chart, Series};

/// Parts circulate for this long before anything is counted, s: several laps of the optimal waveform, two of the paper's.
const SETTLING_S: f64 = 300.0;

/// Blocks between looks: a part does not cross its own length in this time.
const BLOCKS_PER_LOOK: u64 = 5;

/// How a run went.
struct Outcome {
    loaded: usize,
    report: FeedReport,
    jams: u64,
    stranded: usize,
    speed: f64,
}

pub(super) fn run(args: &Args, part: &PartType, duration_s: f64) -> Result<()> {
    let mut charts = [("passing", vec![]), ("good", vec![]), ("singulated", vec![])];
    println!("{} on the paper's tray, {duration_s} s after {SETTLING_S} s to settle", part.name);
    for (name, waveform) in waveforms(part) {
        println!("\n{name}");
        println!(
            "{:>5} {:>6} {:>9} {:>9} {:>9} {:>11} {:>8} {:>8} {:>6} {:>9} {:>9}",
            "load",
            "parts",
            "pass/min",
            "right/min",
            "good/min",
            "singulated",
            "gap",
            "lap*",
            "jams",
            "stranded",
            "sim-s/s"
        );
        let (scenario, waveform, settings) = scenario(part, &waveform)?;
        let settings = BulkSettings { load_plateau: true, ..settings };
        let mut curves = [vec![], vec![], vec![]];
        for &share in &args.area_fraction {
            let inner_m = settings.loading_inner_radius_m.unwrap_or(scenario.tray.geometry.inner_radius_m);
            let area_m2 = PI * (scenario.tray.geometry.outer_radius_m.powi(2) - inner_m.powi(2));
            let mean_m2: f64 = part.poses.iter().zip(&part.poured).map(|(pose, p)| p * pose.outline.area_m2()).sum();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
            let count = (share * area_m2 / mean_m2).round() as usize;
            let mut bulk = PartBulk::new(scenario.tray.geometry, part.clone(), settings, args.seed)?;
            let loaded = bulk.load(count).loaded;
            let outcome =
                observe(bulk, loaded, Shaking::new(waveform.clone()), duration_s, scenario.part_gap_m_min(part))?;
            let report = outcome.report;
            println!(
                "{share:>5.2} {:>6} {:>9.1} {:>9.1} {:>9.1} {:>9.0} % {:>5.1} mm {:>6.1} s {:>6} {:>9} {:>9.1}",
                outcome.loaded,
                report.per_minute(report.passed),
                report.per_minute(report.right),
                report.per_minute(report.good),
                100.0 * report.singulation,
                1e3 * report.gap_m,
                report.recirculation_s,
                outcome.jams,
                outcome.stranded,
                outcome.speed
            );
            curves[0].push((share, report.per_minute(report.passed)));
            curves[1].push((share, report.per_minute(report.good)));
            curves[2].push((share, 100.0 * report.singulation));
        }
        for ((_, series), curve) in charts.iter_mut().zip(curves) {
            series.push(Series::line(name, curve));
        }
    }
    println!(
        "\nload: share of the area outside the loading radius; pass, right: past the middle of the plateau, of these in a \
         wanted pose; good: could be picked on the plateau, right and with room for a gripper;\nsingulated: share of the parts on the plateau \
         apart by a length, over time; gap: to the nearest on the plateau; lap*: from the plateau's end to its begin"
    );
    let Some(folder) = &args.out else { return Ok(()) };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    for (stem, series) in charts {
        let y = if stem == "singulated" { "parts on the plateau apart by a length, %" } else { "parts per minute" };
        let title = format!("{}: parts {stem} against the load", part.name);
        Chart { title, x: "share of the loading area covered".to_owned(), y: y.to_owned(), series }
            .write(folder, &format!("{}_{stem}", part.name))?;
    }
    Ok(())
}

/// Lets a loaded tray settle and watches it.
fn observe(mut bulk: PartBulk, loaded: usize, mut shaking: Shaking, duration_s: f64, room_m: f64) -> Result<Outcome> {
    let began = std::time::Instant::now();
    let mut observer = FeedObserver::new(*bulk.tray(), bulk.part_type(), room_m);
    let blocks = |seconds: f64| -> u64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be within a day")]
        let blocks = (seconds / block_s()).round() as u64;
        blocks
    };
    for _ in 0..blocks(SETTLING_S) {
        bulk.step(&shaking.next_block())?;
    }
    let jams = bulk.counters().jams;
    for index in 0..blocks(duration_s) {
        bulk.step(&shaking.next_block())?;
        if index % BLOCKS_PER_LOOK == 0 {
            observer.observe(index as f64 * block_s(), bulk.parts().iter().map(Sighting::from));
        }
    }
    anyhow::ensure!(bulk.is_conserved(), "parts were lost or doubled: {:?}", bulk.counters());
    Ok(Outcome {
        loaded,
        report: observer.report(),
        jams: bulk.counters().jams - jams,
        stranded: bulk.parts().iter().filter(|part| part.stranded).count(),
        speed: (SETTLING_S + duration_s) / began.elapsed().as_secs_f64(),
    })
}
