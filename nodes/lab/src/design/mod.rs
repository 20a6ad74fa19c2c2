//! Design: the best waveform for a track, and the best tray with its waveform.
//!
//! Closed forms serve where they are proven; elsewhere a seeded multi-start search looks for the best waveform of a given
//! number of segments, and the result is reported beside the proven bound.

mod confirm;
mod flow;
mod search;
mod shape;
mod singulation;
mod tray;
mod tray_search;
mod waveform;

pub use confirm::flow_in_two_dimensions;
pub use flow::{Flow, Loading, lane_flow};
pub use search::Effort;
pub use tray::{DesignedTray, PartKind, Period, TrayGoal};
pub use waveform::{DesignedWaveform, WaveformGoal};
