//! Stamps as numbers, and back.

use crate::builtin_interfaces::msg::Time;

/// `ns` since the start of the run as a ROS stamp.
#[must_use]
pub fn stamp_of_ns(ns: u64) -> Time {
    const NS_PER_S: u64 = 1_000_000_000;
    Time { sec: i32::try_from(ns / NS_PER_S).unwrap_or(i32::MAX), nanosec: u32::try_from(ns % NS_PER_S).unwrap_or(0) }
}

/// A ROS stamp as ns since the start of the run; one before the start counts as the start.
#[must_use]
pub fn ns_of_stamp(stamp: &Time) -> u64 {
    u64::try_from(stamp.sec).unwrap_or(0) * 1_000_000_000 + u64::from(stamp.nanosec)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_survives_the_round_trip() {
        for ns in [0, 1, 999_999_999, 1_000_000_000, 1_700_000_000_123_456_789] {
            assert_eq!(ns_of_stamp(&stamp_of_ns(ns)), ns);
        }
        assert_eq!(ns_of_stamp(&Time { sec: -1, nanosec: 5 }), 5);
    }
}
