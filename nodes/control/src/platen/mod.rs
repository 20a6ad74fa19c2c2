//! The platen that several agents share: areas on it, and who may be in which of them.

mod arbiter;

pub use arbiter::{Answer, Arbiter, Granted, Lease, LeaseId, Refusal, Reservation, Ticket, UnknownLease};
pub use feeder_model::area::{Area, segment_distance_m};
