//! What a feeder and the agents it delivers to tell each other.

/// Where the planner stands in its sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing is asked for.
    Idle,
    /// Vibrating so that parts come onto the plateau.
    Feeding,
    /// Feeding was switched off, the vibration ends.
    Stopping,
    /// Parts come to rest.
    Settling,
    /// Waiting for an image of the parts at rest.
    Looking,
    /// Waiting for the platen area of the trip.
    Reserving,
    /// Carrying the chosen part to the station.
    Moving,
    /// The part waits under the station's tool.
    Presented,
    /// Driving back to the feeding place.
    Returning,
    /// Feeding to empty the plateau.
    Purging,
    /// Given up; waiting for a reset.
    Fault,
}

/// What a manipulator reports of a hand-over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandOver {
    /// The part is in the gripper.
    Taken,
    /// The part is not in the gripper and will not be.
    NotTaken,
    /// The tool is clear of the feeder.
    Released,
}

/// How a delivery ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The agent has the part.
    Delivered,
    /// The agent cancelled it.
    Cancelled,
    /// The request's own time ran out.
    TimedOut,
    /// Feeding could not be switched, or the courier did not stop vibrating.
    FeedingFailed,
    /// No image of the plateau came.
    NoImage,
    /// There is no gentle move to the station, or it could not be finished.
    MoveFailed,
    /// The area of the trip was not granted, or its lease was lost.
    AreaRefused,
    /// The part did not arrive as it was chosen.
    PartLost,
    /// The agent did not report.
    NoHandOver,
    /// The agent did not take the part.
    NotTaken,
    /// The planner is in fault.
    Fault,
}
