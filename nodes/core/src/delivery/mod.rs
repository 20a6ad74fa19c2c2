//! Delivery: carrying a chosen part under a station without disturbing it.
//!
//! A [`MovePlanner`] finds the fastest straight move in which no protected part slides (`hold` says what friction
//! holds, `profile` makes a motion of it). The [`choice`] of a part works on what the vision selector saw. The
//! [`DeliverySequencer`] strings it together: feed, stop, settle, look, move, present, return.

pub mod choice;
mod config;
mod hold;
mod plan;
mod profile;
mod protocol;
mod sequencer;

pub use choice::{Candidate, CandidateFrame, Choice};
pub use config::{DeliveryConfig, Policy};
pub use hold::{holding_acceleration_m_s2, ramp_parts};
pub use plan::{GentleParameters, MovePlan, MovePlanner, PlanError};
pub use protocol::{
    CourierReport, Delivered, DeliveryId, DeliveryRequest, Failure, MoveId, Output, Phase, Refusal, Stamp, Warning,
};
pub use sequencer::DeliverySequencer;
