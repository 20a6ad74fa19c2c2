//! Why the driver refuses a command.

use thiserror::Error;

use super::limits::LimitViolation;
use super::report::Fault;
use feeder_model::range::OutOfRange;
use feeder_model::trajectory::AXES;

/// Why a command was refused. A refused command changes nothing.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Rejection {
    /// The trajectory has no points.
    #[error("the trajectory has no points")]
    Empty,
    /// A number of a point is not finite, or its time is negative.
    #[error("point {index}: {field} is not a finite number, or negative where it must not be")]
    NotFinite {
        /// Which point.
        index: usize,
        /// Which of its fields.
        field: &'static str,
    },
    /// The times do not increase.
    #[error("point {index} at {time_s} s does not come after the point before it")]
    Unsorted {
        /// The offending point.
        index: usize,
        /// Its time, s.
        time_s: f64,
    },
    /// The trajectory is too short or too long.
    #[error("the trajectory lasts {duration_s} s, allowed are {min_s} to {max_s} s")]
    Duration {
        /// Its duration, s.
        duration_s: f64,
        /// The shortest allowed, s.
        min_s: f64,
        /// The longest allowed, s.
        max_s: f64,
    },
    /// The first point is not where the courier is, or not as fast.
    #[error("the trajectory starts {difference:.6} from the present {quantity} of {}, allowed is {allowed}", AXES[*axis])]
    Start {
        /// `position` or `velocity`.
        quantity: &'static str,
        /// Index of the axis.
        axis: usize,
        /// The difference, m, rad, m/s or rad/s.
        difference: f64,
        /// The difference allowed.
        allowed: f64,
    },
    /// The motion would end with the courier moving.
    #[error("the last point has a velocity, so the courier would not stop there")]
    MovingEnd,
    /// The motion leaves the courier's envelope.
    #[error("{0}")]
    Envelope(#[from] LimitViolation),
    /// A parameter of the command is out of its range.
    #[error("{0}")]
    OutOfRange(#[from] OutOfRange),
    /// Another client's trajectory is being executed.
    #[error("client {holder} commands the courier until its goal ends")]
    Busy {
        /// The client that holds the courier.
        holder: u64,
    },
    /// The driver is not active.
    #[error("the driver is not active")]
    Inactive,
    /// A tolerance has no meaning.
    #[error("{tolerance} of {} = {value} is outside its range: -1 (none), 0 (the default) or a positive number", AXES[*axis])]
    Tolerance {
        /// Which tolerance.
        tolerance: &'static str,
        /// Index of the axis.
        axis: usize,
        /// Its value.
        value: f64,
    },
    /// A fault is latched.
    #[error("the driver is in fault: {0}")]
    Faulted(#[from] Fault),
}
