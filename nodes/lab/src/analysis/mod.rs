//! Subcommands that compute rather than run: feed rates, tray maps, the paper's figures, experiments, and design.

mod arguments;
pub(crate) mod chart;
pub(crate) mod experiment;
pub(crate) mod feed_rate;
pub(crate) mod figures;
pub(crate) mod identify;
pub(crate) mod optimize;
mod paper;
pub(crate) mod tray_map;

use anyhow::Result;
use serde::Serialize;

pub use identify::fuzz as fuzz_recording;

/// Prints a result as JSON on standard output.
fn print_json(value: &impl Serialize) -> Result<()> {
    println!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}
