//! What goes over the wire: both halves of every message's codec, and the topics.
//!
//! A codec stands between a message and a plain type of ours, in a module named after the topic, service or action. What
//! viewers alone hear has its outgoing half only. Messages whose fields are used as they are have no codec: the score of
//! a run, the factsheet, requests of a single number.

pub mod area;
pub mod courier_state;
pub mod deliver_part;
pub mod delivery_state;
pub mod detections;
pub mod entity;
pub mod feeder_state;
pub mod frames;
pub mod hand_over;
mod interface;
pub mod joints;
pub mod markers;
mod numbered;
pub mod odometry;
pub mod part_candidates;
pub mod parts;
pub mod pick;
pub mod pictures;
pub mod pose;
pub mod response;
pub mod robot_description;
pub mod services;
pub mod topics;
pub mod trajectory;
pub mod tray_motion;
pub mod waveform;

use std::time::Duration;

use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::stamp_of_ns;

pub use interface::nodes;
pub use numbered::UnknownNumber;

/// A time after the start of the run's clock as a stamp.
#[must_use]
pub fn stamp_of(since_start: Duration) -> Time {
    stamp_of_ns(u64::try_from(since_start.as_nanos()).unwrap_or(u64::MAX))
}
