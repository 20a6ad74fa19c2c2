//! A node with the lifecycle that it says it has.

use std::time::Duration;

use super::lifecycle::{Lifecycle, LifecyclePorts};
use super::{Declare, FeederNode, NodeError, Start, StepIo};

/// Node `N`, and its lifecycle if it has one.
pub(crate) struct Managed<N> {
    node: N,
    lifecycle: Option<Lifecycle>,
    /// Whether the node becomes active in its first step.
    autostart: bool,
}

impl<N: FeederNode> Managed<N> {
    /// Has the node become active by itself, or wait for somebody who asks.
    pub(crate) fn autostart(self, autostart: bool) -> Self {
        Self { autostart, ..self }
    }
}

impl<N: FeederNode> FeederNode for Managed<N> {
    const NAME: &'static str = N::NAME;
    const START: Option<Start> = N::START;
    type Config = N::Config;
    type Ports = (Option<LifecyclePorts>, N::Ports);

    fn check(config: &N::Config) -> Result<(), NodeError> {
        N::check(config)
    }

    fn tick(config: &N::Config) -> Duration {
        N::tick(config)
    }

    fn declare(io: &mut Declare, config: &N::Config) -> Self::Ports {
        (N::START.map(|_| io.lifecycle(N::NAME)), N::declare(io, config))
    }

    fn open((lifecycle, ports): Self::Ports, config: &N::Config) -> Result<Self, NodeError> {
        Ok(Self { node: N::open(ports, config)?, lifecycle: lifecycle.map(Lifecycle::new), autostart: true })
    }

    fn settable() -> &'static [&'static str] {
        N::settable()
    }

    fn not_parameters() -> &'static [&'static str] {
        N::not_parameters()
    }

    fn reconfigure(&mut self, config: &N::Config) {
        self.node.reconfigure(config);
    }

    fn attend(&mut self, io: &mut StepIo) {
        if let Some(lifecycle) = &mut self.lifecycle {
            // Before its first step it is not yet what it is to be.
            if self.autostart {
                return;
            }
            lifecycle.poll(io);
        }
        self.node.attend(io);
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        if let Some(lifecycle) = &mut self.lifecycle {
            if std::mem::take(&mut self.autostart) {
                lifecycle.start(io);
            }
            lifecycle.poll(io);
        }
        self.node.step(io)
    }
}
