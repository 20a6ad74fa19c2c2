//! Starts and ends vibrations: one runs at a time, and each ends at the end of a period before the next begins.

use nalgebra::Vector3;

use super::learning::Instant;
use super::limits::{Extent, LimitViolation};
use super::rejection::Rejection;
use super::report::VibrationPhase;
use super::vibration::Vibration;
use feeder_model::waveform::Waveform;

/// A vibration under way.
#[derive(Clone, Debug)]
struct Running {
    vibration: Vibration,
    start_tick: u64,
    /// When fading out begins, since the start, s; infinite until a stop is asked for.
    fade_out_s: f64,
}

/// The waveform last accepted.
#[derive(Clone, Debug)]
struct Wanted {
    vibration: Vibration,
    enabled: bool,
}

/// Makes a vibration of a waveform with the shortest fade, from `fade_periods` on, that passes `check`. It follows the
/// waveform's harmonics up to `cutoff_hz`, or exactly.
pub(crate) fn prepare(
    waveform: &Waveform,
    cutoff_hz: Option<f64>,
    fade_periods: u32,
    check: impl Fn(Extent) -> Result<(), LimitViolation>,
) -> Result<Vibration, Rejection> {
    let mut vibration = Vibration::new(waveform.clone(), cutoff_hz)?;
    let mut fade_periods = fade_periods;
    loop {
        vibration.set_fade_periods(fade_periods);
        match check(vibration.extent()) {
            Ok(()) => return Ok(vibration),
            Err(violation) if fade_periods >= Vibrator::FADE_PERIODS_MAX => return Err(violation.into()),
            Err(_) => fade_periods = (2 * fade_periods).min(Vibrator::FADE_PERIODS_MAX),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Vibrator {
    period_s: f64,
    running: Option<Running>,
    wanted: Option<Wanted>,
}

impl Vibrator {
    /// A fade of so many periods adds next to nothing to the waveform's own acceleration.
    pub(crate) const FADE_PERIODS_MAX: u32 = 32;

    pub(crate) fn new(period_s: f64) -> Self {
        Self { period_s, running: None, wanted: None }
    }

    pub(crate) fn set(&mut self, vibration: Vibration, enabled: bool, tick: u64) {
        let same = self.wanted.as_ref().is_some_and(|wanted| wanted.vibration.waveform() == vibration.waveform());
        if !(same && enabled) {
            self.stop(tick);
        }
        self.wanted = Some(Wanted { vibration, enabled });
    }

    pub(crate) fn wanted(&self) -> Option<(&Waveform, bool)> {
        self.wanted.as_ref().map(|wanted| (wanted.vibration.waveform(), wanted.enabled))
    }

    pub(crate) fn disable(&mut self, tick: u64) {
        self.stop(tick);
        if let Some(wanted) = &mut self.wanted {
            wanted.enabled = false;
        }
    }

    /// Ends the vibration at once, in the middle of its period.
    pub(crate) fn abort(&mut self) {
        self.running = None;
        if let Some(wanted) = &mut self.wanted {
            wanted.enabled = false;
        }
    }

    /// Fades out from the end of the present period, and not before fading in has ended.
    fn stop(&mut self, tick: u64) {
        let period_s = self.period_s;
        if let Some(running) = self.running.as_mut().filter(|running| running.fade_out_s.is_infinite()) {
            let elapsed_s = running.elapsed_s(tick, period_s);
            let waveform_s = running.vibration.waveform().period_s();
            running.fade_out_s = ((elapsed_s / waveform_s).ceil() * waveform_s).max(running.vibration.fade_s());
        }
    }

    /// Drops a vibration that has ended.
    pub(crate) fn end(&mut self, tick: u64) {
        let period_s = self.period_s;
        self.running.take_if(|running| running.elapsed_s(tick, period_s) >= running.end_s());
    }

    /// The vibration that may start now.
    fn waiting(&self) -> Option<&Vibration> {
        let wanted = self.wanted.as_ref().filter(|wanted| wanted.enabled && self.running.is_none());
        wanted.map(|wanted| &wanted.vibration)
    }

    /// What the learner needs to know of a vibration of harmonics that may start now.
    pub(crate) fn waiting_instant(&self, tick: u64) -> Option<Instant<'_>> {
        self.waiting().and_then(|vibration| vibration.instant(tick, 0.0, f64::INFINITY))
    }

    /// Starts the vibration that may start, at a servo tick.
    pub(crate) fn start(&mut self, tick: u64) {
        if let Some(vibration) = self.waiting().cloned() {
            self.running = Some(Running { vibration, start_tick: tick, fade_out_s: f64::INFINITY });
        }
    }

    pub(crate) fn phase(&self, tick: u64) -> VibrationPhase {
        let Some(running) = &self.running else {
            return VibrationPhase::Off;
        };
        let elapsed_s = running.elapsed_s(tick, self.period_s);
        if elapsed_s >= running.end_s() {
            VibrationPhase::Off
        } else if elapsed_s >= running.fade_out_s {
            VibrationPhase::FadingOut
        } else if elapsed_s < running.vibration.fade_s() {
            VibrationPhase::FadingIn
        } else {
            VibrationPhase::Steady
        }
    }

    /// Position and velocity at a servo tick, to be added to the nominal motion.
    pub(crate) fn at(&self, tick: u64) -> (Vector3<f64>, Vector3<f64>) {
        self.running.as_ref().map_or_else(Default::default, |running| {
            running.vibration.at(running.elapsed_s(tick, self.period_s), running.fade_out_s)
        })
    }

    /// What the learner needs to know at a servo tick of a vibration that follows harmonics.
    pub(crate) fn instant(&self, tick: u64) -> Option<Instant<'_>> {
        self.running.as_ref().and_then(|running| {
            let elapsed_s = running.elapsed_s(tick, self.period_s);
            running.vibration.instant(running.start_tick, elapsed_s, running.fade_out_s)
        })
    }

    /// What may be added to the nominal motion from now on.
    pub(crate) fn extent(&self) -> Extent {
        let running = self.running.as_ref().map(|running| running.vibration.extent());
        let wanted = self.wanted.as_ref().filter(|wanted| wanted.enabled).map(|wanted| wanted.vibration.extent());
        running.unwrap_or_default().union(&wanted.unwrap_or_default())
    }
}

impl Running {
    fn elapsed_s(&self, tick: u64, period_s: f64) -> f64 {
        tick.saturating_sub(self.start_tick) as f64 * period_s
    }

    fn end_s(&self) -> f64 {
        self.fade_out_s + self.vibration.fade_s()
    }
}
