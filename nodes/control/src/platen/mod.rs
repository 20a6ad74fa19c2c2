//! The platen that several agents share: areas on it, and who may be in which of them.

mod arbiter;
mod area;

pub use arbiter::{Answer, Arbiter, Granted, Lease, LeaseId, Refusal, Reservation, Ticket, UnknownLease};
pub use area::{Area, segment_distance_m};
