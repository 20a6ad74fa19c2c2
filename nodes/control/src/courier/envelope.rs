//! Which waveforms a courier can run.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::limits::{CourierLimits, Extent};
use super::rejection::Rejection;
use super::vibrator::{Vibrator, prepare};
use feeder_model::motor::Load;
use feeder_model::range::{OutOfRange, check_range};
use feeder_model::waveform::Waveform;

/// What decides whether a courier that rests at its start can run a waveform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaveformEnvelope {
    /// The envelope of commands.
    pub limits: CourierLimits,
    /// What the tray carries.
    pub load: Load,
    /// Where the courier rests: x, y (m) and yaw (rad).
    #[schemars(with = "[f64; 3]")]
    pub start: Vector3<f64>,
    /// Fewest periods over which a vibration fades in and out; more are taken where the envelope asks for it.
    pub fade_periods: u32,
    /// Highest frequency of the waveform that is run, Hz; without it the waveform is run exactly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cutoff_hz: Option<f64>,
}

impl WaveformEnvelope {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        self.limits.validate()?;
        self.load.validate()?;
        let (min, max) = (self.limits.position_min(), self.limits.position_max());
        for (axis, name) in ["start x", "start y", "start yaw"].into_iter().enumerate() {
            check_range(name, self.start[axis], min[axis], max[axis])?;
        }
        check_range("fade_periods", f64::from(self.fade_periods), 1.0, f64::from(Vibrator::FADE_PERIODS_MAX))?;
        self.cutoff_hz.map_or(Ok(()), |cutoff_hz| check_range("cutoff_hz", cutoff_hz, 10.0, f64::MAX))
    }

    /// Checks that a waveform could run, as the driver does before it takes one.
    ///
    /// # Errors
    /// A waveform with a period out of range, or one that leaves the envelope even when faded in slowly.
    pub fn check(&self, waveform: &Waveform) -> Result<(), Rejection> {
        let rest = Extent { position: self.start, ..Extent::default() };
        let check = |vibration: Extent| self.limits.check(&rest, &vibration, &self.load, 0.0);
        prepare(waveform, self.cutoff_hz, self.fade_periods, check).map(|_| ())
    }
}
