//! `feeder-lab figures`: the figures of the paper from this model, and what becomes of its claims.

mod claims;
mod incline;
mod motion;
mod tray;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::slope::{Drive, LinearTrack};
use feeder_model::waveform::Waveform;
use indicatif::{ProgressBar, ProgressStyle};

use super::chart::Chart;

/// Draw Figs 4, 6, 7, 8, 11, 12, 13 and 15 of the paper as SVG and CSV, with its printed and measured values beside the
/// model's, and write claims.md: claim by claim, reproduced, refuted or not decidable.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Folder for the figures; made if need be.
    #[arg(long)]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let folder: &Path = &args.out;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    type Figure = (&'static str, fn() -> Result<Chart>);
    let figures: [Figure; 11] = [
        ("fig04_stick_slip_motion", motion::stick_slip_speeds),
        ("fig06_stick_slip_experiment", motion::stick_slip_travel),
        ("fig07_coulomb_pump_motion", motion::coulomb_pump_speeds),
        ("fig08_coulomb_pump_experiment", motion::coulomb_pump_travel),
        ("fig08_coulomb_pump_cycle_means", motion::coulomb_pump_cycle_means),
        ("fig11_stick_slip_on_a_slope", incline::stick_slip),
        ("fig12_coulomb_pump_on_a_slope", incline::coulomb_pump),
        ("fig12_zero_feed_slope", incline::zero_feed_slopes),
        ("fig13_running_surface", tray::running_surface),
        ("fig15_speed_against_radius", tray::speed_against_radius),
        ("fig15_parts_after_five_seconds", tray::parts_after_five_seconds),
    ];
    let bar = ProgressBar::new(u64::try_from(figures.len())? + 1);
    bar.set_style(ProgressStyle::with_template("{msg:>32} [{bar:40}] {pos}/{len}")?.progress_chars("=> "));
    for (stem, draw) in figures {
        bar.set_message(stem);
        draw()?.write(folder, stem)?;
        bar.inc(1);
    }
    bar.set_message("claims.md");
    let path = folder.join("claims.md");
    std::fs::write(&path, claims::page()?).with_context(|| format!("cannot write {}", path.display()))?;
    bar.finish_and_clear();
    println!("{}", path.display());
    Ok(())
}

/// A waveform on a straight track.
fn drive(waveform: &Waveform, mu: f64, slope_deg: f64) -> Result<Drive> {
    let track = LinearTrack::new(Friction::uniform(mu)?, slope_deg.to_radians(), STANDARD_GRAVITY_M_S2)?;
    Ok(track.drive(waveform, 1.0)?)
}

/// Steady feed, mm/s; NaN where parts slide down without end.
fn feed_mm_s(waveform: &Waveform, mu: f64, slope_deg: f64) -> Result<f64> {
    Ok(drive(waveform, mu, slope_deg)?.steady().map_or(f64::NAN, |steady| steady.feed_m_s * 1e3))
}
