//! What goes over the wire: both halves of every message's codec, and the topics.

pub mod area;
pub mod delivery;
pub mod frames;
mod interface;
pub mod joints;
mod numbered;
pub mod odometry;
pub mod part_candidates;
pub mod pose;
pub mod services;
pub mod topics;
pub mod trajectory;
pub mod tray_motion;
pub mod waveform;

pub use interface::{PLATEN_NAMESPACE, nodes};
