//! The run monitor: scores a run against ground truth. It is the only node besides viewers that hears the truth, and
//! nobody in the feeders hears what it finds.

mod feed;
mod feeder;
mod platen;
mod presented;
mod progress;
mod score;
mod trips;
mod truth;
mod whereabouts;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use feeder_model::part::PartType;
use feeder_runtime::node::{Declare, FeederNode, NodeError, StepIo};
use feeder_scenario::plan::{NodeConfig, RunMonitorConfig};
use feeder_wire::nodes;

pub use feed::Feed;
use feeder::FeederMonitor;
use platen::PlatenMonitor;
pub use presented::YAW_ERROR_MAX_RAD;
pub use progress::{Activity, FeederProgress, Progress};
pub use trips::{Oracle, Trips};
pub use whereabouts::OdometryScore;

/// Ticks between progress messages.
const PROGRESS_TICKS: u64 = 10;

/// Handles of the monitor's ports.
pub struct Ports {
    feeders: Vec<(String, feeder::Ports)>,
    platen: Option<platen::Ports>,
}

/// The run monitor: one for all feeders of a run, in the namespace of the first.
pub struct RunMonitor {
    feeders: Vec<FeederMonitor>,
    platen: Option<PlatenMonitor>,
    goal_delivered: Option<u32>,
    progress: Progress,
    shown: Option<Arc<Mutex<Progress>>>,
}

impl FeederNode for RunMonitor {
    const NAME: &'static str = nodes::RUN_MONITOR;
    type Config = RunMonitorConfig;
    type Ports = Ports;

    fn tick(config: &RunMonitorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &RunMonitorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, config: &RunMonitorConfig) -> Ports {
        let feeders = config.feeders.iter().map(|name| (name.clone(), feeder::Ports::declare(io, name)));
        Ports { feeders: feeders.collect(), platen: platen::Ports::declare(io, config) }
    }

    fn open(ports: Ports, config: &RunMonitorConfig) -> Result<Self, NodeError> {
        Self::new(ports, config)
    }

    fn not_parameters() -> &'static [&'static str] {
        &["part"]
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for feeder in &mut self.feeders {
            feeder.hear(io);
        }
        if let Some(platen) = &mut self.platen {
            platen.watch(io, self.feeders.iter().map(FeederMonitor::place_m), &mut self.progress);
        }
        if let Some(shown) = &self.shown {
            let feeders = self.feeders.iter().map(|feeder| feeder.progress().clone()).collect();
            *shown.lock().unwrap_or_else(PoisonError::into_inner) = Progress { feeders, ..self.progress.clone() };
        }
        if io.tick().is_multiple_of(PROGRESS_TICKS) {
            for feeder in &self.feeders {
                feeder.publish(io);
            }
        }
        let delivered: u32 = self.feeders.iter().map(|feeder| feeder.progress().delivered).sum();
        if self.goal_delivered.is_some_and(|goal| delivered >= goal) {
            io.reach_goal();
        }
        Ok(())
    }
}

impl RunMonitor {
    /// A monitor that also shows its findings in `shown`, and ends the run when so many parts are delivered.
    ///
    /// # Errors
    /// If the configuration has no part.
    pub fn watched(
        ports: Ports,
        config: &RunMonitorConfig,
        goal_delivered: Option<u32>,
        shown: Arc<Mutex<Progress>>,
    ) -> Result<Self, NodeError> {
        Ok(Self { shown: Some(shown), goal_delivered, ..Self::new(ports, config)? })
    }

    fn new(ports: Ports, config: &RunMonitorConfig) -> Result<Self, NodeError> {
        let part = PartType::new(&config.part).map_err(NodeError::new)?;
        let feeders = ports.feeders.into_iter().map(|(name, ports)| FeederMonitor::new(ports, &name, config, &part));
        Ok(Self {
            feeders: feeders.collect(),
            platen: ports.platen.map(|ports| PlatenMonitor::new(ports, config)),
            goal_delivered: None,
            progress: Progress::default(),
            shown: None,
        })
    }
}
