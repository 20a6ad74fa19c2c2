//! Learning a periodic feed-forward: after every few periods, the force that would have removed the error is added.
//!
//! With plain feedback, delay and lag leave errors of the waveform's own size, which decide whether parts climb or slide
//! back. They repeat every period, so they can be learned. The error is projected onto the waveform's harmonics; each
//! harmonic's force is corrected through the nominal loop, U_k += γ_j E_k / P_k. The gain γ_j is constant at first and
//! then falls as 1/j, so that the sensor's noise is averaged and not learned.

use nalgebra::{Complex, Vector3};
use serde::{Deserialize, Serialize};

use super::control::ControlParameters;
use super::fourier::basis;
use super::limits::check_range;
use super::plant::Wrench;
use super::response::NominalLoop;
use crate::range::OutOfRange;
use crate::waveform::Waveform;

/// How waveforms are learned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LearningParameters {
    /// Whether to learn at all. If so, the set point of a vibration is its waveform up to the cut-off.
    pub enabled: bool,
    /// Highest frequency of the set point and of what is learned, Hz.
    pub cutoff_hz: f64,
    /// Share of the error that the first updates remove.
    pub gain: f64,
    /// Number of updates before the gain falls.
    pub constant_updates: u32,
    /// How much one update more lowers the gain: γ_j = gain/(1 + decay (j − constant updates)).
    pub decay: f64,
    /// The gain's floor, which keeps following slow changes.
    pub gain_min: f64,
    /// The plant's delay as far as known, s.
    pub nominal_delay_s: f64,
    /// The plant's lag as far as known, s.
    pub nominal_lag_s: f64,
}

impl Default for LearningParameters {
    fn default() -> Self {
        Self {
            enabled: false,
            cutoff_hz: 840.0,
            gain: 0.5,
            constant_updates: 10,
            decay: 0.5,
            gain_min: 0.015,
            nominal_delay_s: 0.5e-3,
            nominal_lag_s: 0.5e-3,
        }
    }
}

impl LearningParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("learning.cutoff_hz", self.cutoff_hz, 10.0, 2000.0)?;
        check_range("learning.gain", self.gain, 0.0, 1.0)?;
        check_range("learning.decay", self.decay, 0.0, 10.0)?;
        check_range("learning.gain_min", self.gain_min, 0.0, 1.0)?;
        check_range("learning.nominal_delay_s", self.nominal_delay_s, 0.0, 0.02)?;
        check_range("learning.nominal_lag_s", self.nominal_lag_s, 0.0, 0.02)
    }
}

/// A vibration at one servo tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant<'a> {
    pub(crate) waveform: &'a Waveform,
    pub(crate) fundamental_rad_s: f64,
    pub(crate) harmonics: usize,
    /// Tick at which it began, which names this run of it.
    pub(crate) start_tick: u64,
    pub(crate) elapsed_s: f64,
    /// The envelope, 1 when steady.
    pub(crate) scale: f64,
    pub(crate) steady: bool,
}

type Harmonic = Vector3<Complex<f64>>;

/// What was learned of one waveform.
#[derive(Clone, Debug)]
struct Lesson {
    waveform: Waveform,
    /// The constant part, then the harmonics.
    force: Vec<Harmonic>,
    /// Force per error, likewise.
    inverse: Vec<Harmonic>,
    /// Ticks over which the error is projected: a nearly whole number of periods.
    window_ticks: u32,
    updates: u32,
    /// Sums of the present window.
    error: Vec<Harmonic>,
    ticks: u32,
}

/// The learner of a driver: lessons by waveform, the least recently used one first.
#[derive(Clone, Debug)]
pub(crate) struct Learner {
    parameters: LearningParameters,
    control: ControlParameters,
    mass: Vector3<f64>,
    period_s: f64,
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
        parameters.validate()?;
        Ok(Self { parameters, control, mass, period_s, lessons: Vec::new(), run: None })
    }

    /// Takes another mass, mass and inertia. What was learned stays as a start, and is learned anew at full gain.
    pub(crate) fn set_mass(&mut self, mass: Vector3<f64>) {
        let ratio = mass.component_div(&self.mass).map(Complex::from);
        self.mass = mass;
        for lesson in &mut self.lessons {
            lesson.updates = 0;
            for inverse in &mut lesson.inverse {
                inverse.component_mul_assign(&ratio);
            }
        }
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
        let Some(lesson) = self.lessons.last_mut() else { return Wrench::zeros() };
        let learning = vibration.steady && !disturbed;
        let force = lesson.force(&vibration, error, learning);
        if learning {
            lesson.update(&self.parameters);
        } else {
            lesson.forget_window();
        }
        force * vibration.scale
    }

    /// Makes the waveform's lesson the last one.
    fn recall(&mut self, vibration: &Instant) {
        let known = self.lessons.iter().position(|lesson| lesson.waveform == *vibration.waveform);
        let mut lesson = match known {
            Some(index) => self.lessons.remove(index),
            None => self.begin(vibration),
        };
        lesson.forget_window();
        self.lessons.push(lesson);
        if self.lessons.len() > Self::LESSONS_MAX {
            self.lessons.remove(0);
        }
    }

    fn begin(&self, vibration: &Instant) -> Lesson {
        let LearningParameters { nominal_delay_s: delay_s, nominal_lag_s: lag_s, .. } = self.parameters;
        let nominal = NominalLoop { control: &self.control, delay_s, lag_s, period_s: self.period_s };
        // A constant force, which a ripple that beats with the vibration asks for, is met by the stiffness alone. Its
        // projection takes the mean, half of what a harmonic's takes.
        let constant = Complex::from(0.5 * nominal.stiffness_per_s2());
        let harmonics =
            (1..=vibration.harmonics).map(|k| nominal.response(vibration.fundamental_rad_s * k as f64).inv());
        let inverse: Vec<Harmonic> =
            std::iter::once(constant).chain(harmonics).map(|per_mass| self.mass.map(|mass| per_mass * mass)).collect();
        let zeros = vec![Harmonic::zeros(); inverse.len()];
        Lesson {
            waveform: vibration.waveform.clone(),
            force: zeros.clone(),
            inverse,
            window_ticks: window_ticks(vibration.waveform.period_s() / self.period_s),
            updates: 0,
            error: zeros,
            ticks: 0,
        }
    }
}

impl Lesson {
    /// Evaluates the learned force, and adds the error to the window's sums on the way.
    fn force(&mut self, vibration: &Instant, error: &Vector3<f64>, learning: bool) -> Wrench {
        let mut force = Wrench::zeros();
        let harmonics = basis(vibration.fundamental_rad_s, vibration.elapsed_s);
        let powers = std::iter::once(Complex::from(1.0)).chain(harmonics);
        for ((learned, sum), power) in self.force.iter().zip(&mut self.error).zip(powers) {
            for axis in 0..3 {
                force[axis] += (learned[axis] * power).re;
                if learning {
                    sum[axis] += power.conj() * error[axis];
                }
            }
        }
        force
    }

    /// Counts a tick; at the end of a window, corrects the force.
    fn update(&mut self, parameters: &LearningParameters) {
        self.ticks += 1;
        if self.ticks < self.window_ticks {
            return;
        }
        let late = f64::from(self.updates.saturating_sub(parameters.constant_updates));
        let gain = (parameters.gain / (1.0 + parameters.decay * late)).max(parameters.gain_min);
        let share = Complex::from(gain * 2.0 / f64::from(self.window_ticks));
        for ((force, inverse), sum) in self.force.iter_mut().zip(&self.inverse).zip(&self.error) {
            *force += inverse.component_mul(sum) * share;
        }
        self.updates = self.updates.saturating_add(1);
        self.forget_window();
    }

    fn forget_window(&mut self) {
        if self.ticks > 0 {
            self.ticks = 0;
            self.error.fill(Harmonic::zeros());
        }
    }
}

/// The fewest ticks, of three periods or more, that are nearly a whole number of periods of `period_ticks` each.
///
/// Over a window that is off by δ of n ticks a harmonic leaks δ/n of itself into the others; what is tolerated here is
/// less than the updates correct.
fn window_ticks(period_ticks: f64) -> u32 {
    const OFF_TICKS_MAX: f64 = 0.05;
    let windows = (3..=60).map(|periods| f64::from(periods) * period_ticks);
    let off = |ticks: &f64| (ticks - ticks.round()).abs();
    let whole = windows.clone().find(|ticks| off(ticks) <= OFF_TICKS_MAX);
    let ticks = whole.or_else(|| windows.min_by(|a, b| off(a).total_cmp(&off(b)))).unwrap_or(period_ticks);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 60 periods of 1 s")]
    let ticks = ticks.round() as u32;
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_whole_periods() {
        assert_eq!(window_ticks(200.0 / 3.0), 200);
        assert_eq!(window_ticks(100.0), 300);
        assert_eq!(window_ticks(66.6), 333);
        // √2: 7 · 99/7 …, the best of sixty is within a few hundredths.
        let ticks = window_ticks(100.0 * 2.0_f64.sqrt());
        let periods = f64::from(ticks) / (100.0 * 2.0_f64.sqrt());
        assert!((periods - periods.round()).abs() < 1e-3);
    }
}
