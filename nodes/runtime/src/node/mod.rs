//! What a node is: ports declared once, and a step from stamped inputs to outputs.

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

mod action;
mod lifecycle;
mod managed;
mod ports;
mod step;

use std::time::Duration;

pub use crate::action::GoalId;
pub use crate::health::{Health, HealthLevel};
pub use action::{
    ActionClient, ActionClientPorts, ActionServer, ActionServerPorts, ClientEvent, GoalEnd, GoalRequest, ServerEvent,
};
pub use lifecycle::{LifecycleState, Start};
pub(crate) use managed::Managed;
pub use minifactory_msgs::{ns_of_stamp, stamp_of_ns};
pub use ports::{Client, Declare, Interface, Latency, NotStated, Port, PortKind, Publisher, Server, Subscriber};
pub(crate) use step::{Arrival, AskerInner, Output, split_call, with_call};
pub use step::{Asker, CallId, StepIo};

/// Why a node cannot start or go on.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct NodeError(#[from] Box<dyn std::error::Error + Send + Sync>);

impl NodeError {
    /// Wraps any error.
    pub fn new(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self(error.into())
    }
}

/// A node of the feeder, or of an agent beside it.
///
/// A node is a function from the inputs of a tick to its outputs, and knows neither threads nor middleware: the same
/// node runs in lockstep, in its own process or with others in one, and against the wall clock.
pub trait FeederNode: Sized + Send + 'static {
    /// Name of the node, of its crate and of its executable.
    const NAME: &'static str;
    /// Whether it has a lifecycle, and when it becomes active. A node that is not active steps all the same, and asks
    /// [`StepIo::is_active`].
    const START: Option<Start> = None;
    /// What it is configured by: its parameters, which its schema describes.
    type Config: Serialize + DeserializeOwned + JsonSchema + Clone + Send + 'static;
    /// Handles of its ports.
    type Ports: Send;

    /// Checks a configuration, which may be one with parameters that somebody gave.
    ///
    /// # Errors
    /// What is out of range, and what the range is.
    fn check(_config: &Self::Config) -> Result<(), NodeError> {
        Ok(())
    }

    /// How often the node steps: in a simulated run as its clock says, against the wall clock in real time.
    fn tick(config: &Self::Config) -> Duration;

    /// Declares its ports. [`Declare::namespace`] tells which namespace the node lives in.
    fn declare(io: &mut Declare, config: &Self::Config) -> Self::Ports;

    /// Makes the node.
    ///
    /// # Errors
    /// When the configuration cannot work.
    fn open(ports: Self::Ports, config: &Self::Config) -> Result<Self, NodeError>;

    /// The values of its configuration that may be changed while it runs, by the keys that lead to them with dots between;
    /// all others are read-only.
    #[must_use]
    fn settable() -> &'static [&'static str] {
        &[]
    }

    /// The keys of its configuration that are no parameters: too large for anybody to read or set value by value.
    #[must_use]
    fn not_parameters() -> &'static [&'static str] {
        &[]
    }

    /// Takes over a valid configuration that differs from the last one in [`settable`](Self::settable) values alone.
    /// Called between two steps.
    fn reconfigure(&mut self, _config: &Self::Config) {}

    /// Answers requests that need no time to pass, while the node waits for its next tick: a paused simulation is looked
    /// at and changed, too. It is a part of the step to come; what is not taken here is there for that.
    fn attend(&mut self, _io: &mut StepIo) {}

    /// Runs one tick.
    ///
    /// # Errors
    /// When the node cannot go on; in a simulated run this ends the run. Bad input is no such reason.
    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError>;
}
