//! Delivery: carrying a chosen part under a station without disturbing it.
//!
//! A [`MovePlanner`] finds the fastest move in which no protected part slides: `holding` says what friction holds, `profile`
//! makes a motion along a line of it, [`Surroundings`] find the way round keep-out areas, `legs` joins lines into one
//! motion. The [`choice`] of parts works on what the vision selector saw and on where parts will come to rest (`drift`),
//! and a [`tour`] brings several stations their parts on one trip. The [`DeliverySequencer`] strings it together: feed,
//! stop, settle, look, reserve, move, present, return. While it feeds, `feed_watch` compares how parts move with how the
//! waveform should move them, and `arrival_watch` how many come with how many should; `slip_watch` tells when they slide on
//! a trip.

mod arrival_watch;
pub mod choice;
mod config;
mod drift;
mod feed_watch;
mod gentle;
mod holding;
mod leases;
mod leg_limits;
mod legs;
mod plan;
mod plan_error;
mod planner;
mod profile;
mod protocol;
mod request;
mod sequencer;
mod slip_watch;
mod surroundings;
pub mod tour;

pub use choice::{CandidateFrame, Choice, OfferedPart};
pub use config::{DeliveryConfig, Policy};
pub use feed_watch::FeedRate;
pub use gentle::GentleParameters;
pub use holding::{holding_acceleration_m_s2, ramp_parts};
pub use plan::MovePlan;
pub use plan_error::PlanError;
pub use planner::MovePlanner;
pub use protocol::{CourierReport, Delivered, Failure, HandOver, Output, Phase, Refusal, Warning};
pub use request::{DeliveryId, DeliveryRequest, LeaseAnswer, MoveId, ReserveId, Stamp};
pub use sequencer::DeliverySequencer;
pub use slip_watch::Slip;
pub use surroundings::{Surroundings, Tether};
