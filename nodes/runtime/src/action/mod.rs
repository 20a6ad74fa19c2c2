//! Actions: goals that take a while, give feedback, can be cancelled, and end with a result.
//!
//! On the wire an action is three services and two topics below `<name>/_action`: `send_goal`,
//! `cancel_goal`, `get_result`, `feedback`, and `status` (latched: the goals and how each fares).
//! [`goals::Goals`] is what a server knows of its goals and may do with them, free of I/O;
//! [`node::ActionServer`](crate::node::ActionServer) and [`node::ActionClient`](crate::node::ActionClient) put it on
//! a node's ports.

pub mod goals;

pub use goals::{GoalId, GoalStatus};
