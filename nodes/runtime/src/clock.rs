//! Stamps.

use std::{sync::Arc, time::SystemTime};

use minifactory_msgs::builtin_interfaces::msg::Time;

/// Where stamps come from: the wall clock, or a run's simulated time.
pub type TimeSource = Arc<dyn Fn() -> Time + Send + Sync>;

/// The wall clock. It stands still after the year 2038, where the seconds of a ROS stamp end.
#[must_use]
pub fn wall_clock() -> Time {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    Time { sec: i32::try_from(since_1970.as_secs()).unwrap_or(i32::MAX), nanosec: since_1970.subsec_nanos() }
}
