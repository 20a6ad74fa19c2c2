//! How late the force really is, from the phase of the motion against what was commanded.

use super::super::response::NominalLoop;
use super::lesson::Lesson;

/// An estimate of the loop's delay.
///
/// A plant that answers Δ later than the nominal one turns harmonic k by −ω_k Δ. Δ is fitted to the phases of a window by
/// least squares, each harmonic weighted by how well its phase is known, and windows are averaged with slow forgetting.
#[derive(Clone, Debug)]
pub(super) struct DelayEstimate {
    delay_s: f64,
    /// Inverse variance of the estimate, 1/s².
    information_per_s2: f64,
}

impl DelayEstimate {
    /// Standard deviation of the nominal delay, s.
    const NOMINAL_SPREAD_S: f64 = 0.2e-3;
    /// Phase errors that no noise explains, such as a ripple's, rad rms.
    const MODEL_PHASE_RAD: f64 = 0.05;
    /// Share of what earlier windows said that the next one keeps.
    const MEMORY: f64 = 0.97;
    /// Longest delay believed, s.
    const DELAY_S_MAX: f64 = 0.02;

    pub(super) fn new(nominal_s: f64) -> Self {
        Self { delay_s: nominal_s, information_per_s2: Self::NOMINAL_SPREAD_S.powi(-2) }
    }

    pub(super) fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Takes in a full window of `lesson`, which `nominal` with the present estimate explains.
    pub(super) fn observe(&mut self, lesson: &Lesson, nominal: &NominalLoop) {
        let seen: Vec<_> = lesson.observe(nominal).collect();
        // The highest harmonics move so little that their errors are the sensor's noise.
        let noisy = &seen[seen.len() * 2 / 3..];
        let noise_m2 = noisy.iter().map(|seen| seen.error.norm_sqr()).sum::<f64>() / noisy.len().max(1) as f64;
        let (mut information_per_s2, mut moment_per_s) = (0.0, 0.0);
        for seen in &seen {
            let (position, expected) = (seen.position, seen.response.position * seen.command);
            let variance = Self::MODEL_PHASE_RAD.powi(2) + noise_m2 / position.norm_sqr();
            // A phase known no better than this may be off by a turn.
            if variance < 0.1 && expected.norm_sqr() > 0.0 {
                let phase_rad = (position / expected).arg();
                let omega_rad_s = seen.response.omega_rad_s;
                information_per_s2 += omega_rad_s * omega_rad_s / variance;
                moment_per_s -= omega_rad_s * phase_rad / variance;
            }
        }
        self.information_per_s2 = Self::MEMORY * self.information_per_s2 + information_per_s2;
        let step_s = moment_per_s / self.information_per_s2;
        self.delay_s = (self.delay_s + step_s).clamp(0.0, Self::DELAY_S_MAX);
    }
}
