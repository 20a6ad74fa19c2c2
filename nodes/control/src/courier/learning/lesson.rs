//! What was learned of one waveform.

use std::f64::consts::TAU;

use nalgebra::{Complex, Vector3};

use super::super::fourier::basis;
use super::super::response::{NominalLoop, Response};
use super::{Instant, LearningParameters};
use feeder_model::motor::Wrench;
use feeder_model::waveform::Waveform;

type Harmonic = Vector3<Complex<f64>>;

/// The force learned for one waveform, and the window of errors from which it is corrected next.
#[derive(Clone, Debug)]
pub(super) struct Lesson {
    waveform: Waveform,
    axis: usize,
    fundamental_rad_s: f64,
    /// Coefficients of the position that the set point asks for on the vibrating axis, first harmonic first.
    position: Vec<Complex<f64>>,
    mass: Vector3<f64>,
    /// The force of each harmonic. A constant one is the controller's integral's to find.
    force: Vec<Harmonic>,
    /// Sums of the present window, likewise.
    error: Vec<Harmonic>,
    /// Ticks over which the error is projected: a nearly whole number of periods.
    window_ticks: u32,
    /// Ticks of the present window.
    ticks: u32,
    updates: u32,
}

/// One harmonic of the vibrating axis over a window.
pub(super) struct Observation {
    /// What the nominal loop does at its frequency.
    pub(super) response: Response,
    /// Position measured.
    pub(super) position: Complex<f64>,
    /// Acceleration commanded, the force over the nominal mass.
    pub(super) command: Complex<f64>,
    /// Position that gives the wanted velocity at the ticks, less the position measured.
    pub(super) error: Complex<f64>,
}

impl Lesson {
    /// A lesson that begins with the force by which the nominal loop would follow.
    pub(super) fn new(vibration: &Instant, nominal: &NominalLoop, mass: Vector3<f64>) -> Self {
        let period_ticks = vibration.waveform.period_s() / nominal.period_s;
        let position = vibration.fourier.position().to_vec();
        let zeros = vec![Harmonic::zeros(); position.len()];
        let mut lesson = Self {
            waveform: vibration.waveform.clone(),
            axis: vibration.axis,
            fundamental_rad_s: vibration.fourier.fundamental_rad_s(),
            position,
            mass,
            force: zeros.clone(),
            error: zeros,
            window_ticks: window_ticks(period_ticks),
            ticks: 0,
            updates: 0,
        };
        let follow: Vec<_> = lesson.harmonics(nominal).map(|harmonic| harmonic.force_to_follow(nominal)).collect();
        for (force, follow) in lesson.force.iter_mut().zip(follow) {
            force[vibration.axis] = follow * mass[vibration.axis];
        }
        lesson
    }

    pub(super) fn teaches(&self, waveform: &Waveform) -> bool {
        self.waveform == *waveform
    }

    pub(super) fn rescale(&mut self, ratio: &Vector3<f64>) {
        let complex = ratio.map(Complex::from);
        self.mass.component_mul_assign(ratio);
        self.force.iter_mut().for_each(|force| force.component_mul_assign(&complex));
        self.updates = 0;
    }

    /// Evaluates the learned force, and adds the error to the window's sums on the way.
    pub(super) fn force(&mut self, vibration: &Instant, error: &Vector3<f64>, learning: bool) -> Wrench {
        let mut force = Wrench::zeros();
        let powers = basis(self.fundamental_rad_s, vibration.elapsed_s);
        for ((learned, sum), power) in self.force.iter().zip(&mut self.error).zip(powers) {
            for axis in 0..3 {
                force[axis] += (learned[axis] * power).re;
                if learning {
                    sum[axis] += power.conj() * error[axis];
                }
            }
        }
        self.ticks += u32::from(learning);
        force
    }

    pub(super) fn window_is_full(&self) -> bool {
        self.ticks >= self.window_ticks
    }

    /// The harmonics of the vibrating axis over a full window, as the nominal loop explains them.
    pub(super) fn observe<'a>(&'a self, nominal: &'a NominalLoop) -> impl Iterator<Item = Observation> + 'a {
        let share = 2.0 / f64::from(self.window_ticks);
        let seen = self.error.iter().zip(&self.force);
        self.harmonics(nominal).zip(seen).map(move |(harmonic, (sum, force))| {
            let off_set_point = sum[self.axis] * share;
            let position = harmonic.position - off_set_point;
            let learned = force[self.axis] / self.mass[self.axis];
            Observation {
                response: harmonic.response,
                position,
                command: harmonic.response.feedback * off_set_point + harmonic.feed_forward(nominal) + learned,
                error: harmonic.position_for_velocity() - position,
            }
        })
    }

    /// Corrects the force by a full window's errors, and begins the next window.
    pub(super) fn update(&mut self, nominal: &NominalLoop, parameters: &LearningParameters) {
        let gain = parameters.gain(self.updates);
        let share = 2.0 / f64::from(self.window_ticks);
        let wanted: Vec<_> = self.observe(nominal).map(|seen| (seen.error, seen.response)).collect();
        for ((force, sum), (error, response)) in self.force.iter_mut().zip(&self.error).zip(wanted) {
            let lateral = response.omega_rad_s <= TAU * parameters.lateral_cutoff_hz;
            let mut error_of_axes = if lateral { sum * Complex::from(share) } else { Harmonic::zeros() };
            error_of_axes[self.axis] = error;
            let inverse = response.closed().inv() * gain;
            for axis in 0..3 {
                force[axis] += inverse * error_of_axes[axis] * self.mass[axis];
            }
        }
        self.updates = self.updates.saturating_add(1);
        self.forget_window();
    }

    pub(super) fn forget_window(&mut self) {
        if self.ticks > 0 {
            self.ticks = 0;
            self.error.fill(Harmonic::zeros());
        }
    }

    fn harmonics<'a>(&'a self, nominal: &'a NominalLoop) -> impl Iterator<Item = Wanted> + 'a {
        let orders = (1_u32..).map(f64::from);
        self.position.iter().zip(orders).map(|(&position, order)| {
            let response = nominal.at(self.fundamental_rad_s * order);
            Wanted { position, response }
        })
    }
}

/// One harmonic of the set point and the nominal loop there.
struct Wanted {
    position: Complex<f64>,
    response: Response,
}

impl Wanted {
    fn velocity(&self) -> Complex<f64> {
        Complex::new(0.0, self.response.omega_rad_s) * self.position
    }

    /// The position at the ticks of a courier that has the set point's velocity at the ticks.
    fn position_for_velocity(&self) -> Complex<f64> {
        self.velocity() * self.response.position / self.response.velocity
    }

    /// What the controller adds for the set point's acceleration.
    fn feed_forward(&self, nominal: &NominalLoop) -> Complex<f64> {
        if nominal.control.feed_forward { self.velocity() * self.response.difference } else { Complex::from(0.0) }
    }

    /// The acceleration to add to feedback and feed-forward so that the nominal plant follows.
    fn force_to_follow(&self, nominal: &NominalLoop) -> Complex<f64> {
        let off_set_point = self.position - self.position_for_velocity();
        self.velocity() / self.response.velocity - self.response.feedback * off_set_point - self.feed_forward(nominal)
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
