//! The kinds of nodes that a plan can hold.

use serde::{Deserialize, Serialize};

use super::nodes::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, PartSimulatorConfig, PlatenArbiterConfig,
    RunMonitorConfig, VisionSelectorConfig, WaveformGeneratorConfig,
};
use crate::error::{ScenarioError, check_tick};

/// The configuration of a kind of node.
pub trait NodeConfig: Sized {
    /// Name of the kind: of its crate, its executable and its nodes.
    const KIND: &'static str;

    /// The configuration in a planned node, if that is of this kind.
    fn of(planned: &PlannedConfig) -> Option<&Self>;

    /// Checks the values, each and together.
    ///
    /// # Errors
    /// What is out of range, and what the range is.
    fn check(&self) -> Result<(), ScenarioError>;
}

/// The kinds of nodes, each with the type that configures it.
macro_rules! kinds {
    ($($kind:ident($config:ident) = $name:literal,)*) => {
        /// A node's kind, and what it is configured by.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum PlannedConfig {
            $(
                #[doc = concat!("A `", $name, "`.")]
                $kind(Box<$config>),
            )*
        }

        impl PlannedConfig {
            /// Name of the kind.
            #[must_use]
            pub fn kind(&self) -> &'static str {
                match self {
                    $(Self::$kind(_) => $config::KIND,)*
                }
            }

            pub(super) fn check(&self) -> Result<(), ScenarioError> {
                match self {
                    $(Self::$kind(config) => config.check(),)*
                }
            }
        }

        $(
            impl NodeConfig for $config {
                const KIND: &'static str = $name;

                fn of(planned: &PlannedConfig) -> Option<&Self> {
                    match planned {
                        PlannedConfig::$kind(config) => Some(&**config),
                        _ => None,
                    }
                }

                fn check(&self) -> Result<(), ScenarioError> {
                    check_tick(self.tick_ms)?;
                    self.check_values()
                }
            }
        )*
    };
}

kinds! {
    WaveformGenerator(WaveformGeneratorConfig) = "waveform_generator",
    CourierDriver(CourierDriverConfig) = "courier_driver",
    PartSimulator(PartSimulatorConfig) = "part_simulator",
    VisionSelector(VisionSelectorConfig) = "vision_selector",
    DeliveryPlanner(DeliveryPlannerConfig) = "delivery_planner",
    OverheadManipulator(OverheadManipulatorConfig) = "overhead_manipulator",
    PlatenArbiter(PlatenArbiterConfig) = "platen_arbiter",
    RunMonitor(RunMonitorConfig) = "run_monitor",
}
