//! Learning a periodic feed-forward: after every few periods, the force that would have removed the error is added.
//!
//! With plain feedback, delay and lag leave errors of the waveform's own size, which decide whether parts climb or slide
//! back. They repeat every period, so they can be learned. The error is projected onto the waveform's harmonics; each
//! harmonic's force is corrected through the nominal loop, U_k += γ_j E_k / P_k. The gain γ_j is constant at first and
//! then falls as 1/j, so that the sensor's noise is averaged and not learned.
//!
//! What feeds is the velocity at the ticks, and what is measured is the position. Near the Nyquist frequency the one
//! follows from the other only with the motion between the ticks, which depends on where in a tick the force arrives:
//! the loop's delay is estimated along with the learning ([`DelayEstimate`]).

mod delay;
mod lesson;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::delay::DelayEstimate;
use self::lesson::Lesson;
use super::control::ControlParameters;
use super::fourier::Fourier;
use super::response::NominalLoop;
use feeder_model::motor::Wrench;
use feeder_model::range::OutOfRange;
use feeder_model::range::{check_range, check_ranges};
use feeder_model::waveform::Waveform;

/// How waveforms are learned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningParameters {
    /// Whether to learn at all. If so, the set point of a vibration is its waveform up to the cut-off.
    pub enabled: bool,
    /// Highest frequency of the set point and of what is learned, Hz; below half the servo rate.
    pub cutoff_hz: f64,
    /// Highest frequency learned on the two axes that do not vibrate, Hz: what couples into them is weak, and above it
    /// less than the sensor's noise.
    pub lateral_cutoff_hz: f64,
    /// Share of the error that the first updates remove.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gain: f64,
    /// Number of updates before the gain falls.
    pub constant_updates: u32,
    /// How much one update more lowers the gain: γ_j = gain/(1 + decay (j − constant updates)).
    #[schemars(range(min = 0.0, max = 10.0))]
    pub decay: f64,
    /// The gain's floor, which keeps following slow changes.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gain_min: f64,
    /// The delay of the loop as far as known, s; what it really is, is estimated.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub nominal_delay_s: f64,
    /// The plant's lag as far as known, s.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub nominal_lag_s: f64,
}

impl Default for LearningParameters {
    fn default() -> Self {
        Self {
            enabled: false,
            cutoff_hz: 930.0,
            lateral_cutoff_hz: 200.0,
            gain: 0.5,
            constant_updates: 8,
            decay: 0.5,
            gain_min: 0.01,
            nominal_delay_s: 0.5e-3,
            nominal_lag_s: 0.5e-3,
        }
    }
}

impl LearningParameters {
    /// Highest frequency of a vibration's set point, Hz; without learning it follows its waveform exactly.
    pub(crate) fn set_point_cutoff_hz(&self) -> Option<f64> {
        self.enabled.then_some(self.cutoff_hz)
    }

    /// Checks every value; `servo_period_s` bounds the cut-off.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self, servo_period_s: f64) -> Result<(), OutOfRange> {
        check_ranges("learning.", self)?;
        // Closer to half the servo rate, force and position of the ticks say too little of each other.
        let cutoff_hz_max = if self.enabled { 0.475 / servo_period_s } else { f64::MAX };
        check_range("learning.cutoff_hz", self.cutoff_hz, 10.0, cutoff_hz_max)?;
        check_range("learning.lateral_cutoff_hz", self.lateral_cutoff_hz, 0.0, cutoff_hz_max)
    }

    /// The gain of an update, counted from 0.
    fn gain(&self, update: u32) -> f64 {
        let late = f64::from(update.saturating_sub(self.constant_updates));
        (self.gain / (1.0 + self.decay * late)).max(self.gain_min)
    }
}

/// A vibration at one servo tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant<'a> {
    pub(crate) waveform: &'a Waveform,
    pub(crate) fourier: &'a Fourier,
    /// Index of the axis that vibrates.
    pub(crate) axis: usize,
    /// Tick at which it began, which names this run of it.
    pub(crate) start_tick: u64,
    pub(crate) elapsed_s: f64,
    /// The envelope, 1 when steady.
    pub(crate) scale: f64,
    pub(crate) steady: bool,
}

/// The learner of a driver: lessons by waveform, the least recently used one first.
#[derive(Clone, Debug)]
pub(crate) struct Learner {
    parameters: LearningParameters,
    control: ControlParameters,
    mass: Vector3<f64>,
    period_s: f64,
    delay: DelayEstimate,
    lessons: Vec<Lesson>,
    run: Option<u64>,
}

impl Learner {
    /// Lessons kept.
    const LESSONS_MAX: usize = 8;

    pub(crate) fn new(
        parameters: LearningParameters,
        control: ControlParameters,
        mass: Vector3<f64>,
        period_s: f64,
    ) -> Result<Self, OutOfRange> {
        parameters.validate(period_s)?;
        let delay = DelayEstimate::new(parameters.nominal_delay_s);
        Ok(Self { parameters, control, mass, period_s, delay, lessons: Vec::new(), run: None })
    }

    /// Takes another mass, mass and inertia. What was learned is scaled by it, and learned anew at full gain.
    pub(crate) fn set_mass(&mut self, mass: Vector3<f64>) {
        let ratio = mass.component_div(&self.mass);
        self.mass = mass;
        for lesson in &mut self.lessons {
            lesson.rescale(&ratio);
        }
    }

    /// The loop's delay as estimated so far, s.
    pub(crate) fn delay_s(&self) -> f64 {
        self.delay.delay_s()
    }

    /// The learned force at this tick, at which the courier is `error` off its set point. Nothing is learned while
    /// `disturbed` or while the vibration fades.
    pub(crate) fn force(&mut self, vibration: Option<Instant>, error: &Vector3<f64>, disturbed: bool) -> Wrench {
        let Some(vibration) = vibration.filter(|_| self.parameters.enabled) else {
            self.run = None;
            return Wrench::zeros();
        };
        if self.run != Some(vibration.start_tick) {
            self.run = Some(vibration.start_tick);
            self.recall(&vibration);
        }
        let nominal = self.nominal();
        let Some(lesson) = self.lessons.last_mut() else { return Wrench::zeros() };
        let learning = vibration.steady && !disturbed;
        let force = lesson.force(&vibration, error, learning);
        if !learning {
            lesson.forget_window();
        } else if lesson.window_is_full() {
            self.delay.observe(lesson, &nominal);
            let nominal = NominalLoop { delay_s: self.delay.delay_s(), ..nominal };
            lesson.update(&nominal, &self.parameters);
        }
        force * vibration.scale
    }

    fn nominal(&self) -> NominalLoop {
        let (delay_s, lag_s) = (self.delay.delay_s(), self.parameters.nominal_lag_s);
        NominalLoop { control: self.control, delay_s, lag_s, period_s: self.period_s }
    }

    /// Makes the waveform's lesson the last one.
    fn recall(&mut self, vibration: &Instant) {
        let known = self.lessons.iter().position(|lesson| lesson.teaches(vibration.waveform));
        let mut lesson = match known {
            Some(index) => self.lessons.remove(index),
            None => Lesson::new(vibration, &self.nominal(), self.mass),
        };
        lesson.forget_window();
        self.lessons.push(lesson);
        if self.lessons.len() > Self::LESSONS_MAX {
            self.lessons.remove(0);
        }
    }
}
