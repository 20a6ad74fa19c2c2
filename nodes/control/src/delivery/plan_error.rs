//! Why there is no move.

use thiserror::Error;

use feeder_model::range::OutOfRange;

/// Why there is no such move.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlanError {
    /// A coordinate is not finite, or out of the courier's reach.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The move is too short to be one.
    #[error("the courier is there already: the distance is {distance_m:e} m")]
    NoDistance {
        /// The distance, m.
        distance_m: f64,
    },
    /// The tether is too short.
    #[error("the tether would have to be {needed_m:.4} m long, but is {length_m} m")]
    Tether {
        /// Distance from where it is fixed, m.
        needed_m: f64,
        /// Its length, m.
        length_m: f64,
    },
    /// The courier would stand in a keep-out area.
    #[error("at ({x_m:.4}, {y_m:.4}) m the courier would reach into keep-out area {index}")]
    KeepOut {
        /// Number of the area, from 0.
        index: usize,
        /// Where the courier's centre would be, m.
        x_m: f64,
        /// Where the courier's centre would be, m.
        y_m: f64,
    },
    /// Keep-out areas and bounds leave no way.
    #[error("no way leads from {from_m:?} m to {to_m:?} m round the keep-out areas")]
    NoRoute {
        /// Start.
        from_m: [f64; 2],
        /// End.
        to_m: [f64; 2],
    },
    /// A part that slides even on a courier at rest.
    #[error("friction {friction:.4} does not hold the part at ({x_m:.4}, {y_m:.4}) m in the tray even at rest")]
    CannotHold {
        /// The coefficient of friction.
        friction: f64,
        /// Where the part lies in the tray, m.
        x_m: f64,
        /// Where the part lies in the tray, m.
        y_m: f64,
    },
}
