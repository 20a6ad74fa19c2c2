//! What goes over the wire: both halves of every message's codec, and the topics.

pub mod pose;
pub mod tray_motion;
pub mod waveform;
