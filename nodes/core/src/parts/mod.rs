//! Parts in bulk on the annular tray, moved by the tray's motion at servo rate.
//!
//! A part is a point mass under Coulomb friction (Quaid Eqs 18–29, corrected, with the courier's translation) and a disc
//! where it meets walls and other parts. All parts of a bulk are of one type. They climb the ramp, cross the plateau,
//! fall off its end and land at the foot of the ramp, lying in a pose drawn from the part's transition matrix.
//!
//! A servo sample holds the tray's acceleration constant. The instant at which a part stops or turns round within it is
//! solved for, and the static friction is tried there; no speed is ever taken for zero.
//!
//! Assumed: a part keeps its heading relative to the tray while it slides; it does not tip at the edges; parts on the
//! ramp touch each other as seen from above. Not modelled: flight, where the tray accelerates uphill by more than
//! g/tan φ; the normal force is taken as zero there.
//!
//! The same seed, calls and motion give bit-identical results.

mod bulk;
mod contact;
mod friction;
mod motion_check;
mod part;
mod part_type;
mod placement;
mod settings;
mod stepping;
#[cfg(test)]
mod tests;
mod track;

pub use bulk::{Counters, Loaded, PartBulk, PutError};
pub use motion_check::{
    LARGEST_ACCELERATION_M_S2, LARGEST_YAW_ACCELERATION_RAD_S2, LARGEST_YAW_RATE_RAD_S, LONGEST_SAMPLE_PERIOD_S,
    MotionError,
};
pub use part::{Part, PickedPart, Place};
pub use part_type::{PartSpec, PartType, PartTypeError, RestingPose};
pub use settings::{BulkError, BulkSettings};
