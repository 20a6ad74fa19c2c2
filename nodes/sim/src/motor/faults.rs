//! What can be made to go wrong with the simulated motor, for tests.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::OutOfRange;
use feeder_model::range::check_range;

/// A stretch of the plant's own time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Its start, s since the plant's start.
    pub from_s: f64,
    /// Its end, s since the plant's start.
    pub to_s: f64,
}

/// A stretch of the plant's own time in which something is so bad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizedWindow {
    /// Its start, s since the plant's start.
    pub from_s: f64,
    /// Its end, s since the plant's start.
    pub to_s: f64,
    /// How bad it is; see the fields of [`FaultHooks`].
    pub size: f64,
}

/// The faults of a simulated motor; the driver is told of none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FaultHooks {
    /// The courier stands still whatever the forcers do, as when the air fails.
    pub freeze: Option<Window>,
    /// The sensor gives no number.
    pub sensor_dropout: Option<Window>,
    /// The forcers give at most this share of their force.
    pub saturation: Option<SizedWindow>,
    /// Commands arrive this much later, s.
    pub latency: Option<SizedWindow>,
    /// This share of the commands is lost; the one before it stays in force.
    pub message_loss: Option<SizedWindow>,
}

impl FaultHooks {
    /// Nothing goes wrong.
    pub const NONE: Self =
        Self { freeze: None, sensor_dropout: None, saturation: None, latency: None, message_loss: None };

    pub(super) fn validate(&self) -> Result<(), OutOfRange> {
        const DAY_S: f64 = 86_400.0;
        let windows = [self.freeze, self.sensor_dropout].into_iter().flatten();
        let sized = [
            ("motor.faults.saturation.size", self.saturation, 0.0, 1.0),
            ("motor.faults.latency.size", self.latency, 0.0, 0.1),
            ("motor.faults.message_loss.size", self.message_loss, 0.0, 1.0),
        ];
        let ranges = windows.map(|window| (window.from_s, window.to_s));
        let ranges = ranges.chain(sized.iter().filter_map(|(_, fault, ..)| fault.map(|f| (f.from_s, f.to_s))));
        for (from_s, to_s) in ranges {
            check_range("motor.faults from_s", from_s, 0.0, DAY_S)?;
            check_range("motor.faults to_s", to_s, from_s, DAY_S)?;
        }
        for (name, fault, min, max) in sized {
            fault.map_or(Ok(()), |fault| check_range(name, fault.size, min, max))?;
        }
        Ok(())
    }

    pub(super) fn frozen(&self, time_s: f64) -> bool {
        self.freeze.is_some_and(|window| window.covers(time_s))
    }

    pub(super) fn blind(&self, time_s: f64) -> bool {
        self.sensor_dropout.is_some_and(|window| window.covers(time_s))
    }

    /// Share of their force that the forcers give at most.
    pub(super) fn force_share(&self, time_s: f64) -> f64 {
        size(self.saturation, time_s).unwrap_or(1.0)
    }

    pub(super) fn extra_delay_s(&self, time_s: f64) -> f64 {
        size(self.latency, time_s).unwrap_or(0.0)
    }

    /// Probability that a command is lost.
    pub(super) fn loss(&self, time_s: f64) -> f64 {
        size(self.message_loss, time_s).unwrap_or(0.0)
    }
}

impl Window {
    fn covers(&self, time_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&time_s)
    }
}

fn size(fault: Option<SizedWindow>, time_s: f64) -> Option<f64> {
    fault.filter(|fault| (fault.from_s..fault.to_s).contains(&time_s)).map(|fault| fault.size)
}
