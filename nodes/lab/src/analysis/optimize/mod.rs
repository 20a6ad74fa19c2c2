//! `feeder-lab optimize`: the best waveform, and the best tray with its waveform.

mod tray;
mod waveform;

use std::fs;
use std::path::{Path, PathBuf};

use crate::design::Effort;
use anyhow::{Context, Result};
use clap::{Args as ClapArgs, Subcommand};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::range::OutOfRange;
use serde::Serialize;

/// Find the best waveform, or the best tray together with its waveform.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Waveform(waveform::Args),
    Tray(tray::Args),
}

pub(crate) fn run(args: &Args) -> Result<()> {
    match &args.what {
        What::Waveform(args) => waveform::run(args),
        What::Tray(args) => tray::run(args),
    }
}

/// How hard to search, and where the results go.
#[derive(Clone, Debug, ClapArgs)]
struct SearchArgs {
    /// Segments of a searched waveform.
    #[arg(long, default_value_t = 5)]
    segments: usize,
    /// Random starts of the search.
    #[arg(long, default_value_t = 12)]
    starts: u32,
    /// Steps of the search from each start.
    #[arg(long, default_value_t = 2000)]
    steps: u64,
    /// Seed of the random starts.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the results as YAML files.
    #[arg(long)]
    out: Option<PathBuf>,
}

impl SearchArgs {
    fn effort(&self) -> Effort {
        Effort { starts: self.starts, steps: self.steps, seed: self.seed }
    }
}

/// An interval of friction, and gravity.
#[derive(Clone, Debug, ClapArgs)]
struct FrictionRange {
    /// Coefficient of friction expected.
    #[arg(long, default_value_t = 0.2, allow_negative_numbers = true)]
    mu: f64,
    /// How far friction may be off either way, as a share of --mu, 0 to 1; robust designs are for the worst of it.
    #[arg(long, default_value_t = 0.25, allow_negative_numbers = true)]
    mu_tolerance: f64,
    /// Gravity, m/s².
    #[arg(long, default_value_t = STANDARD_GRAVITY_M_S2, allow_negative_numbers = true)]
    gravity: f64,
}

impl FrictionRange {
    /// The coefficients a robust design is made for: the ends of the interval, its middle, and between.
    fn robust(&self) -> Result<Vec<f64>> {
        let Self { mu, mu_tolerance, .. } = *self;
        OutOfRange::unless((0.0..1.0).contains(&mu_tolerance), "--mu-tolerance", mu_tolerance, "0 to below 1")?;
        Ok([-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| mu * (1.0 + share * mu_tolerance)).to_vec())
    }
}

fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("cannot create the folder {}", path.display()))
}

fn write_yaml(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_saphyr::to_string(value)?;
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
