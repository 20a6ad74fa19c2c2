//! Parts in bulk on the annular tray, moved by the tray's motion at servo rate.
//!
//! Seen from above a part is the convex outline of its pose. Its centre of mass moves like a point mass under Coulomb
//! friction (Quaid Eqs 18–29, corrected, with the courier's translation), it turns about the vertical, and it touches
//! walls and other parts with friction. All parts of a bulk are of one type. They climb the ramp, cross the plateau, fall
//! off its end and land at the foot of the ramp, lying in a pose drawn from the part's drop table.
//!
//! A servo sample holds the tray's acceleration constant. The instant at which a part stops or turns round within it is
//! solved for, and the static friction is tried there; no speed is ever taken for zero.
//!
//! Assumed: friction resists turning with the radius of gyration for its lever; a part goes from one surface to the next
//! when its centre of mass does; parts on the ramp touch each other as seen from above, and do not climb on each other.
//! Not modelled: flight, where the tray accelerates uphill by more than g/tan φ; the normal force is taken as zero there.
//!
//! The same seed, calls and motion give bit-identical results.

mod body;
mod bulk;
mod contact;
mod gripper;
mod impulse;
mod motion_check;
mod observer;
mod part;
mod placement;
mod settings;
mod stepping;
#[cfg(test)]
mod tests;
mod touch;
mod track;
mod walls;

pub use feeder_model::tray::Place;

pub use bulk::{Counters, Loaded, PartBulk, PutError};
pub use gripper::{Missed, OpenGripper};
pub use motion_check::{
    LARGEST_ACCELERATION_M_S2, LARGEST_YAW_ACCELERATION_RAD_S2, LARGEST_YAW_RATE_RAD_S, LONGEST_SAMPLE_PERIOD_S,
};
pub use observer::{Departure, FeedObserver, FeedReport, Sighting};
pub use part::{Part, PickedPart};
pub use settings::{BulkSettings, check_fit};
