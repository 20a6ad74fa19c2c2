//! The plan of a run: every node with its namespace and configuration, the loop's timing, and where all that comes from.
//!
//! A [`Scenario`](crate::Scenario) and the files it names are resolved once into a plan ([`Scenario::resolve`](crate::Scenario::resolve)); whatever runs, checks,
//! records or repeats a run goes by the plan alone.

mod kinds;
mod load;
mod nodes;
mod resolve;

use serde::{Deserialize, Serialize};

use crate::error::yaml_problem;
use crate::{RunSection, ScenarioError, TimeSection};

pub use kinds::{NodeConfig, PlannedConfig};
pub use load::{LoadError, Loaded, load, load_node, load_plan, load_untaught, load_with_model, named};
pub use nodes::{
    CourierDriverConfig, DeliveryPlannerConfig, ImageTransport, OverheadManipulatorConfig, PartSimulatorConfig,
    PlannedRecipe, PlannedStation, PlatenArbiterConfig, RunMonitorConfig, ServedFeeder, SimulatedCamera,
    VisionSelectorConfig, WatchedGripper, WaveformGeneratorConfig,
};

/// Everything that runs, and how. Nothing is left to be looked up or derived.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunPlan {
    /// Where the plan comes from. By this key a file is known as a plan.
    pub provenance: Provenance,
    /// When the run ends.
    pub run: RunSection,
    /// Ticks and delays of the simulated loop.
    pub time: TimeSection,
    /// The nodes, in the order in which they are listed and started.
    pub nodes: Vec<PlannedNode>,
}

/// Where a plan comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the program that made it.
    pub version: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Text of the scenario.
    pub scenario: String,
}

/// A node of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedNode {
    /// The namespace it lives in, such as `/feeder`.
    pub namespace: String,
    /// Its kind, and what it is configured by.
    pub node: PlannedConfig,
}

impl RunPlan {
    /// Reads a plan from YAML and checks it.
    ///
    /// # Errors
    /// A text that is no plan, or a value out of range.
    pub fn from_yaml(yaml: &str) -> Result<Self, ScenarioError> {
        let plan: Self = serde_saphyr::from_str(yaml).map_err(|error| ScenarioError::Yaml(yaml_problem(&error)))?;
        plan.check()?;
        Ok(plan)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// What is out of range, and what the range is.
    pub fn check(&self) -> Result<(), ScenarioError> {
        self.run.check()?;
        self.time.check()?;
        self.nodes.iter().try_for_each(|planned| planned.node.check())
    }

    /// As YAML, every value spelled out.
    ///
    /// # Errors
    /// A value that YAML cannot hold.
    pub fn to_yaml(&self) -> Result<String, ScenarioError> {
        serde_saphyr::to_string(self).map_err(|error| ScenarioError::Yaml(error.to_string()))
    }

    /// The nodes of a kind, each with its namespace.
    pub fn of_kind<C: NodeConfig + 'static>(&self) -> impl Iterator<Item = (&str, &C)> {
        self.nodes.iter().filter_map(|planned| Some((planned.namespace.as_str(), C::of(&planned.node)?)))
    }
}
