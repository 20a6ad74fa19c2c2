//! Moves against theory and table, and whole deliveries with a courier, a camera and a manipulator around the sequencer.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

mod arbiter;
mod by_hand;
mod ends;
mod moves;
mod rules;
mod sequences;
mod shared_platen;
mod slips;
mod stopping;
mod ways;
mod world;
