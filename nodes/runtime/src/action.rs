//! Actions: goals that take a while, give feedback, can be cancelled, and end with a result.
//!
//! On the wire an action is three services and two topics below `<name>/_action`: `send_goal`,
//! `cancel_goal`, `get_result`, `feedback`, and `status` (latched: the goals and how each fares).
//! [`goals::Goals`] is what a server knows of its goals and may do with them, free of I/O;
//! [`ActionServer`] and [`ActionClient`] put it on the wire.

pub mod goals;

mod client;
mod server;

pub use client::{ActionClient, ActionUpdate};
pub use goals::{GoalId, GoalStatus};
pub use server::{ActionServer, CancelRequest, GoalEvent, GoalHandle, GoalRequest};
