//! Delivery: carrying a chosen part under a station without disturbing it.
//!
//! A [`MovePlanner`] finds the fastest move in which no protected part slides: `hold` says what friction holds, `profile`
//! makes a motion along a line of it, [`Surroundings`] find the way round keep-out areas, `legs` joins lines into one
//! motion. The [`choice`] of parts works on what the vision selector saw and on where parts will come to rest (`drift`),
//! and a [`tour`] brings several stations their parts on one trip. The [`DeliverySequencer`] strings it together: feed,
//! stop, settle, look, reserve, move, present, return.

pub mod choice;
mod config;
mod drift;
mod held;
mod hold;
mod leases;
mod legs;
mod plan;
mod profile;
mod protocol;
mod sequencer;
mod surroundings;
pub mod tour;

pub use choice::{Candidate, CandidateFrame, Choice};
pub use config::{DeliveryConfig, Policy};
pub use hold::{holding_acceleration_m_s2, ramp_parts};
pub use plan::{GentleParameters, MovePlan, MovePlanner, PlanError};
pub use protocol::{
    CourierReport, Delivered, DeliveryId, DeliveryRequest, Failure, HandOver, LeaseAnswer, MoveId, Output, Phase,
    Refusal, ReserveId, Stamp, Warning,
};
pub use sequencer::DeliverySequencer;
pub use surroundings::{Surroundings, Tether};
