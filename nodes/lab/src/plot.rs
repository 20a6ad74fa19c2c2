//! How well a run fed, second by second, as charts.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use feeder::up::{self, UpArgs};
use run_monitor::{Feed, Progress};

use crate::analysis::chart::{Chart, Series};

/// Run a scenario and draw how well the feeder fed, second by second (SVG and CSV).
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    run: UpArgs,
    /// Folder for the charts; made if need be
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

/// Runs and draws.
///
/// # Errors
/// A scenario that cannot run, or a folder that cannot be written.
pub(crate) fn run(args: &Args) -> Result<()> {
    let plan = up::load_plan(&args.run)?;
    let options = UpArgs { composed: true, plain: true, ..args.run.clone() };
    let ended = up::execute(&plan, &options, &up::stop_on_signals()?)?;
    write(&args.out, &ended.progress)?;
    print!("{}", ended.summary);
    ended.outcome
}

/// Draws the history of a run into a folder; that of each feeder into one of its own where there are several.
fn write(folder: &Path, progress: &Progress) -> Result<()> {
    match progress.feeders.as_slice() {
        [feeder] => write_feeder(folder, &feeder.history),
        feeders => feeders.iter().try_for_each(|feeder| write_feeder(&folder.join(&feeder.name), &feeder.history)),
    }
}

fn write_feeder(folder: &Path, history: &[(f64, Feed)]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let line = |name: &str, value: &dyn Fn(&Feed) -> f64| {
        Series::line(name, history.iter().map(|(time_s, feed)| (*time_s, value(feed))).collect())
    };
    let charts = [
        (
            "parts_per_minute",
            "parts past the camera since the start, per minute",
            vec![
                line("passed", &|feed| feed.report.per_minute(feed.report.passed)),
                line("could be picked", &|feed| feed.report.per_minute(feed.report.good)),
            ],
        ),
        (
            "selections",
            "selections, jams and stranded parts since the start",
            vec![
                line("right", &|feed| feed.right_selections.into()),
                line("wrong", &|feed| feed.wrong_selections.into()),
                line("missed", &|feed| feed.missed_selections.into()),
                line("jams", &|feed| feed.jams.into()),
                line("stranded", &|feed| feed.stranded.into()),
            ],
        ),
        (
            "plateau",
            "mean gap, mm; singulation, %; recirculation, s",
            vec![
                line("gap to the next part, mm", &|feed| 1e3 * feed.report.gap_m),
                line("apart by a length, %", &|feed| 100.0 * feed.report.singulation),
                line("recirculation, s", &|feed| feed.report.recirculation_s),
            ],
        ),
    ];
    for (stem, y, series) in charts {
        let chart = Chart { title: stem.replace('_', " "), x: "simulated time, s".to_owned(), y: y.to_owned(), series };
        chart.write(folder, stem)?;
    }
    Ok(())
}
