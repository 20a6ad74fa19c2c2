//! What goes into a delivery sequencer and what comes out.

use std::time::Duration;

use nalgebra::{Vector2, Vector3};
use thiserror::Error;

use super::choice::Choice;
use super::plan::MovePlan;
use super::plan_error::PlanError;
use super::request::{DeliveryId, MoveId, ReserveId, Stamp};
use super::slip_watch::Slip;
use crate::platen::Area;

pub use feeder_model::delivery::{HandOver, Phase};

/// Why a request or a report was refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Refusal {
    /// The station is not known.
    #[error("station {station:?} is unknown; known are {known:?}")]
    UnknownStation {
        /// The station asked for.
        station: String,
        /// Those there are.
        known: Vec<String>,
    },
    /// No place of the courier brings any part of the tray under the station.
    #[error("station {station:?} is {beyond_m:.4} m beyond the courier's reach")]
    OutOfReach {
        /// The station asked for.
        station: String,
        /// By how much the tray's rim misses it, m.
        beyond_m: f64,
    },
    /// No place where the courier may stand, and to which a way leads, brings any part of the plateau under the station.
    #[error(
        "station {station:?} cannot be served: bounds, tether or keep-out areas leave the courier no place for it, or no way"
    )]
    Blocked {
        /// The station asked for.
        station: String,
    },
    /// The tolerance is no finite number, negative, or finer than can be promised.
    #[error("a tolerance of {tolerance_m} m cannot be promised; allowed are {min_m} m and more")]
    Tolerance {
        /// The tolerance asked for, m.
        tolerance_m: f64,
        /// The finest that can be promised, m.
        min_m: f64,
    },
    /// The delivery does not wait for such a report.
    #[error("delivery {} does not wait for this report", .0.0)]
    NotPresented(DeliveryId),
    /// Something else must end first.
    #[error("{0} deliveries are open")]
    Busy(usize),
    /// The courier is elsewhere, or something else is under way.
    #[error("the feeder is not idle at its feeding place but {0:?}")]
    NotIdle(Phase),
    /// The planner is in fault.
    #[error("the planner is in fault: {0}")]
    Fault(String),
    /// Nothing is delivered for now.
    #[error("nothing is delivered for now: {0}")]
    Suspended(String),
}

/// What the courier driver reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CourierReport {
    /// When.
    pub stamp: Stamp,
    /// Position of the tray on the platen: x, y (m) and yaw (rad).
    pub position: Vector3<f64>,
    /// The vibration runs or fades.
    pub vibrating: bool,
    /// A trajectory is being followed.
    pub moving: bool,
}

/// A part under a station.
#[derive(Clone, Debug, PartialEq)]
pub struct Delivered {
    /// Position of the part relative to the station's tool axis, m, along the platen's axes.
    pub part_in_station_m: Vector2<f64>,
    /// Orientation of the part on the platen, rad.
    pub yaw_rad: f64,
    /// What was chosen, and from which image.
    pub choice: Choice,
}

/// Why a delivery failed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Failure {
    /// The agent cancelled it.
    #[error("cancelled")]
    Cancelled,
    /// The request's own time ran out.
    #[error("timed out while {0:?}")]
    TimedOut(Phase),
    /// The generator refused to switch feeding.
    #[error("feeding could not be switched: {0}")]
    FeedRefused(String),
    /// The courier did not come to rest after feeding was switched off.
    #[error("the courier did not stop vibrating")]
    DidNotStop,
    /// No image came.
    #[error("no image of the plateau came")]
    NoImage,
    /// There is no move to the station.
    #[error("no move to the station: {0}")]
    Plan(#[from] PlanError),
    /// The driver refused the move or could not finish it.
    #[error("the move failed: {0}")]
    Move(String),
    /// The area of the trip was not granted, or its lease was lost.
    #[error("the area of the trip: {0}")]
    Area(String),
    /// A camera at the station does not see the part as it was chosen.
    #[error("the part is not where it was on departure: {0}")]
    PartLost(String),
    /// The part came to rest beside the tool axis, or the courier never said that it had arrived.
    #[error("the part did not arrive under the station within the tolerance")]
    DidNotArrive,
    /// The manipulator did not report.
    #[error("nobody reported the hand-over")]
    NoHandOver,
    /// The manipulator did not take the part.
    #[error("the part was not taken")]
    NotTaken,
    /// The planner is in fault.
    #[error("the planner is in fault: {0}")]
    Fault(String),
    /// Nothing is delivered for now.
    #[error("nothing is delivered for now: {0}")]
    Suspended(String),
}

/// What an operator should know of.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Warning {
    /// Feeding has brought no fitting part for so long.
    #[error("no fitting part for {0:?}: load parts or check the class asked for")]
    Starved(Duration),
    /// The courier driver says that it does not feed as it should.
    #[error("the courier says: {0}")]
    Courier(String),
    /// Parts on the plateau do not move as the waveform should move them.
    #[error(
        "parts on the plateau move at {:.2} times the speed that the waveform should give them: the tray does not move as the \
         courier's sensor says, or the friction is another than believed",
        ratio
    )]
    FeedOff {
        /// Speed over that computed.
        ratio: f64,
    },
    /// Far fewer parts come up the ramp than the waveform should bring.
    #[error(
        "{:.0} % of the parts come up the ramp that the waveform should bring: the friction is lower than believed, parts \
         block each other, or there are fewer in the feeder than it is believed to hold",
        100.0 * share
    )]
    FewArrive {
        /// Parts that come over those to be expected.
        share: f64,
    },
    /// Parts slide on trips: moves are made gentler.
    #[error("{slip}: moves reckon with a friction of {friction:.3} from now on, in place of {believed:.3}")]
    Slid {
        /// What tells so.
        slip: Slip,
        /// Coefficient of friction that moves reckoned with.
        believed: f64,
        /// The one that they reckon with from now on.
        friction: f64,
    },
    /// Parts slide on trips although moves are as gentle as they can be.
    #[error("{0}, and moves are as gentle as they get")]
    SlidAllTheSame(Slip),
    /// The courier stands still while it should feed.
    #[error(
        "the tray does not vibrate although feeding is on: is the waveform generator active, was the courier halted?"
    )]
    StandsStill,
    /// The courier could not return to the feeding place.
    #[error("the return to the feeding place failed: {0}")]
    ReturnFailed(String),
    /// The manipulator took the part, but did not say that its tool is clear.
    #[error("station {0:?} took the part but did not release the feeder")]
    NotReleased(String),
    /// The place to park was refused.
    #[error("the place to park was refused: {0}")]
    NoParking(String),
    /// The generator refused to switch feeding while nothing depended on it.
    #[error("feeding could not be switched: {0}")]
    FeedRefused(String),
}

/// What the sequencer wants done or known.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Switch feeding on or off.
    Feed(bool),
    /// Execute a move.
    Move(MoveId, MovePlan),
    /// Bring a move to rest before its end.
    CancelMove(MoveId),
    /// A new phase, the delivery it serves, and when the part will be presented, as far as known.
    Phase {
        /// The phase.
        phase: Phase,
        /// The delivery under way.
        delivery: Option<DeliveryId>,
        /// Expected time of presentation.
        presented_at: Option<Stamp>,
    },
    /// The part lies under the station and waits to be taken.
    Presented(DeliveryId, Delivered),
    /// A delivery ended.
    Finished(DeliveryId, Result<Delivered, Failure>),
    /// The purge ended: the plateau is empty, or why not.
    Purged(Result<(), String>),
    /// Ask the platen's arbiter for an area.
    Reserve {
        /// Names the request.
        id: ReserveId,
        /// The area.
        area: Area,
        /// To rest there.
        parked: bool,
        /// For how long.
        duration: Duration,
        /// How long to wait for it.
        wait: Duration,
    },
    /// Ask the arbiter to make a lease last so long from now on.
    Renew {
        /// Names the request.
        id: ReserveId,
        /// The lease.
        lease: String,
        /// For how long.
        duration: Duration,
    },
    /// Give a lease back.
    Release(String),
    /// Something to tell the operator.
    Warning(Warning),
}
