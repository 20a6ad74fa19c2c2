//! `feeder identify-friction`: friction from a recording of how a part slips.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use feeder_core::gravity::STANDARD_GRAVITY_M_S2;
use feeder_core::mechanics::identify::{VelocitySample, kinetic_friction};
use serde::Serialize;

use super::print_json;

/// Columns of a recording.
const COLUMNS: [&str; 3] = ["time_s", "tray_velocity_m_s", "part_velocity_m_s"];

/// Kinetic friction from a recording of a part that slips on a level tray, as JSON.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// The recording: a CSV file with the columns time_s, tray_velocity_m_s and part_velocity_m_s, both in the world
    recording: PathBuf,
    /// Gravity, m/s².
    #[arg(long, default_value_t = STANDARD_GRAVITY_M_S2, allow_negative_numbers = true)]
    gravity: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    kinetic_friction: f64,
    standard_error: f64,
    slips: usize,
    samples: usize,
    noise_m_s: f64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let samples = read_csv(&args.recording).with_context(|| format!("in {}", args.recording.display()))?;
    let found = kinetic_friction(&samples, args.gravity).with_context(|| format!("in {}", args.recording.display()))?;
    print_json(&Report {
        kinetic_friction: found.kinetic,
        standard_error: found.standard_error,
        slips: found.slips,
        samples: found.samples,
        noise_m_s: found.noise_m_s,
    })
}

fn read_csv(file: &Path) -> Result<Vec<VelocitySample>> {
    let mut reader = csv::Reader::from_path(file)?;
    let headers = reader.headers()?.clone();
    let place = |name: &str| headers.iter().position(|header| header.trim() == name);
    let [Some(time), Some(tray), Some(part)] = COLUMNS.map(place) else {
        bail!("the columns are {:?}, wanted are {COLUMNS:?}", headers.iter().collect::<Vec<_>>());
    };
    let mut samples = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record?;
        let number = |column: usize| {
            let text = record.get(column).unwrap_or_default().trim();
            text.parse::<f64>()
                .with_context(|| format!("row {}: {} = {text:?} is no number", row + 2, &headers[column]))
        };
        samples.push(VelocitySample { time_s: number(time)?, tray_m_s: number(tray)?, part_m_s: number(part)? });
    }
    Ok(samples)
}

/// Writes a recording as it is read.
pub(crate) fn write_csv(file: &Path, samples: &[VelocitySample]) -> Result<()> {
    let mut writer = csv::Writer::from_path(file).with_context(|| format!("cannot write {}", file.display()))?;
    writer.write_record(COLUMNS)?;
    for sample in samples {
        writer.serialize((sample.time_s, sample.tray_m_s, sample.part_m_s))?;
    }
    Ok(writer.flush()?)
}
