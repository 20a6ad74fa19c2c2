//! What an agent asks for, and what requests, moves and areas are called.

use std::time::Duration;

/// A point in time, since the start of the run's clock.
pub type Stamp = Duration;

/// Names an accepted request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DeliveryId(pub u64);

/// Names a commanded move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MoveId(pub u64);

/// Names a request for an area of the platen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ReserveId(pub u64);

/// What a request for an area came to: the name of the lease and when it ends, or why there is none.
pub type LeaseAnswer = Result<(String, Stamp), String>;

/// What an agent asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct DeliveryRequest {
    /// The station to bring a part to.
    pub station: String,
    /// Class of part wanted, as the catalogue names it.
    pub part_class: String,
    /// Resting poses that will do, as the catalogue names them; none: any.
    pub pose_classes: Vec<String>,
    /// Largest horizontal distance allowed between part and tool axis, m.
    pub tolerance_m: f64,
    /// Least free gap from the part's outline to that of the nearest other part, m; nothing: what the gripper needs will do.
    pub part_gap_m_min: Option<f64>,
    /// When to give up, from the request on; nothing: never.
    pub timeout: Option<Duration>,
}

impl DeliveryRequest {
    /// Whether a resting pose will do.
    #[must_use]
    pub fn accepts(&self, pose_class: &str) -> bool {
        self.pose_classes.is_empty() || self.pose_classes.iter().any(|accepted| accepted == pose_class)
    }
}
