//! Simulated time in lockstep: a static dataflow with a grant window.
//!
//! Time advances in ticks. A node's outputs of a tick travel to each of its consumers in *bundles*, one ordered stream
//! per pair of nodes, and a bundle says through which tick it is complete. What is sent in tick k is consumed in tick
//! k + d, with d fixed for the pair by the [`LoopContract`]; so step k runs as soon as every stream is complete through
//! k − d and the clock has granted k, and what it sees depends on nothing but the contract. The clock is off the fast
//! path: it grants a window ahead of the slowest node, and pacing is nothing but grants.
//!
//! Invariants: nothing here does I/O or reads a clock; a gap in a stream ends the run; results never depend on arrival
//! order, on the window or on how bundles were cut.

mod clock;
mod clock_runner;
mod contract;
mod control;
mod engine;
mod hub;
mod links;
mod routing;
mod runner;

pub use clock::{ClockError, LoopClock, STALL_LIMIT, Speed};
pub use clock_runner::{ClockRunner, RunEnd, clock_interface};
pub use contract::{Channel, ContractError, LoopContract, LoopEdge, LoopTiming};
pub use control::ResetRefusal;
pub use engine::{Blocked, Engine, Input, LoopError, Route};
pub use hub::Hub;
pub(crate) use links::DdsLinks;
pub use runner::RunError;
pub(crate) use runner::{Incoming, Links, Runner};

/// Largest payload a loop message may have, bytes: with its bundle's header it still fits one UDP datagram.
pub const MESSAGE_BYTES_MAX: usize = 60_000;
