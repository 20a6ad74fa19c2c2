//! One harmonic on one axis: how the plant answers there, what disturbs it, and how sure that is.

use nalgebra::Complex;

/// A Kalman filter over the plant's answer P and a disturbance d, both complex: position = P · command + d.
///
/// A command that never changes tells their sum only; what a changed command does tells them apart. Until then it is the
/// prior that shares out what is seen, so that noise is not taken for an answer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Harmonic {
    plant: Complex<f64>,
    disturbance: Complex<f64>,
    /// Variances of both, and the expectation of the one's error times the conjugate of the other's.
    plant_variance: f64,
    disturbance_variance: f64,
    covariance: Complex<f64>,
    /// Mean of what is seen beyond the answer of a rigid plant; nothing before a window was.
    beyond_rigid: Option<Complex<f64>>,
}

/// What a harmonic is expected to do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    pub(super) plant: Complex<f64>,
    pub(super) plant_variance: f64,
    pub(super) disturbance_variance: f64,
}

impl Harmonic {
    /// Errors larger than so many standard deviations are of something that is not in the model.
    const SURPRISE: f64 = 4.0;
    /// Share of a new window in the mean of what is beyond the answer of a rigid plant.
    const BEYOND_GAIN: f64 = 0.2;

    pub(super) fn new(prior: Prior) -> Self {
        Self {
            plant: prior.plant,
            disturbance: Complex::from(0.0),
            plant_variance: prior.plant_variance,
            disturbance_variance: prior.disturbance_variance,
            covariance: Complex::from(0.0),
            beyond_rigid: None,
        }
    }

    pub(super) fn plant(&self) -> Complex<f64> {
        self.plant
    }

    pub(super) fn disturbance(&self) -> Complex<f64> {
        self.disturbance
    }

    /// What of the disturbance's square is surely not its own uncertainty, nor more than what is seen, on average over windows,
    /// beyond the answer of a rigid plant.
    ///
    /// Noise that the feedback turns into commands pulls the estimate of the plant's answer away, and that of the disturbance
    /// makes up for it, the longer the more. What the sensor shows beyond a rigid plant, which is fitted to all harmonics at
    /// once, has a mean only where it comes again every period.
    pub(super) fn sure_disturbance_square(&self) -> f64 {
        let sure = self.disturbance.norm_sqr() - Self::SURPRISE * Self::SURPRISE * self.disturbance_variance;
        sure.min(self.beyond_rigid.unwrap_or_default().norm_sqr()).max(0.0)
    }

    /// Notes what a window shows beyond the answer of a rigid plant.
    pub(super) fn note_beyond_rigid(&mut self, beyond: Complex<f64>) {
        let mean = self.beyond_rigid.map_or(beyond, |mean| mean + (beyond - mean) * Self::BEYOND_GAIN);
        self.beyond_rigid = Some(mean);
    }

    /// Standard deviation of the plant's answer, relative.
    pub(super) fn uncertainty(&self) -> f64 {
        self.plant_variance.sqrt() / self.plant.norm()
    }

    /// Standard deviation of the position under a command.
    pub(super) fn position_deviation(&self, command: Complex<f64>) -> f64 {
        self.expected_variance(command).max(0.0).sqrt()
    }

    /// The position that a command is expected to give.
    pub(super) fn predict(&self, command: Complex<f64>) -> Complex<f64> {
        self.plant * command + self.disturbance
    }

    /// Takes over an answer that was measured apart from the command and its disturbances, with its variance; `spread` is how
    /// far the plant may have been off before.
    pub(super) fn believe(&mut self, plant: Complex<f64>, variance: f64, spread: f64) {
        let before = spread * spread;
        self.plant += (plant - self.plant) * (before / (before + variance));
        self.plant_variance = before * variance / (before + variance);
    }

    /// Takes over a model that has changed by `ratio`.
    pub(super) fn rescale(&mut self, ratio: Complex<f64>) {
        self.plant *= ratio;
        self.plant_variance *= ratio.norm_sqr();
        self.covariance *= ratio;
    }

    /// Lets time pass in which the disturbance may have changed by so much variance.
    pub(super) fn drift(&mut self, variance: f64) {
        self.disturbance_variance += variance;
    }

    /// Doubts all that was found: it may be as far off again as before anything was measured.
    pub(super) fn doubt(&mut self, prior: &Prior) {
        self.disturbance_variance += prior.disturbance_variance;
        self.plant_variance += 0.25 * prior.plant_variance;
    }

    /// Takes in a position measured under a command, of which noise has the variance `noise`.
    pub(super) fn observe(&mut self, command: Complex<f64>, position: Complex<f64>, noise: f64) {
        let off = position - self.predict(command);
        let expected = self.expected_variance(command) + noise;
        if off.norm_sqr() > Self::SURPRISE * Self::SURPRISE * expected {
            // Half of it may be the plant's, half the disturbance's.
            self.disturbance_variance += 0.5 * off.norm_sqr();
            if command.norm_sqr() > 0.0 {
                self.plant_variance += 0.5 * off.norm_sqr() / command.norm_sqr();
            }
        }
        let expected = self.expected_variance(command) + noise;
        let plant_gain = (command.conj() * self.plant_variance + self.covariance) / expected;
        let disturbance_gain = (command.conj() * self.covariance.conj() + self.disturbance_variance) / expected;
        self.plant += plant_gain * off;
        self.disturbance += disturbance_gain * off;
        self.plant_variance = (self.plant_variance - plant_gain.norm_sqr() * expected).max(0.0);
        self.disturbance_variance = (self.disturbance_variance - disturbance_gain.norm_sqr() * expected).max(0.0);
        self.covariance -= plant_gain * disturbance_gain.conj() * expected;
    }

    fn expected_variance(&self, command: Complex<f64>) -> f64 {
        command.norm_sqr() * self.plant_variance + 2.0 * (command * self.covariance).re + self.disturbance_variance
    }

    /// How much nearer to what it should be the command is to go, of the way that the estimate says: 1/(1 + σ²), σ being the
    /// plant's relative uncertainty. On average over that uncertainty no other share leaves less of the error.
    pub(super) fn caution(&self) -> f64 {
        let sigma = self.uncertainty();
        (1.0 + sigma * sigma).recip()
    }

    /// Whether a step of that share brings the error down wherever within two standard deviations the plant is.
    pub(super) fn contracts(&self) -> bool {
        let share = self.caution();
        (1.0 - share) + 2.0 * share * self.uncertainty() < 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn harmonic(plant: Complex<f64>) -> Harmonic {
        let plant_variance = 0.09 * plant.norm_sqr();
        Harmonic::new(Prior { plant, plant_variance, disturbance_variance: 0.01 * plant.norm_sqr() })
    }

    #[test]
    fn verif_a_changed_command_tells_plant_and_disturbance_apart() {
        let (plant, disturbance) = (Complex::new(-1.2, 0.4), Complex::new(0.05, -0.1));
        let mut harmonic = harmonic(Complex::from(-1.0));
        for command in [Complex::new(1.0, 0.0), Complex::new(0.6, 0.3), Complex::new(0.9, -0.2)] {
            harmonic.observe(command, plant * command + disturbance, 1e-8);
        }
        assert!((harmonic.plant() - plant).norm() < 1e-3 && (harmonic.disturbance() - disturbance).norm() < 1e-3);
        assert!(harmonic.uncertainty() < 1e-3 && harmonic.contracts());
    }

    #[test]
    fn noise_alone_changes_nothing_but_the_share_it_deserves() {
        // A command that stays: all that is seen is noise of a size that the prior explains as noise.
        let mut harmonic = harmonic(Complex::from(-1.0));
        let command = Complex::from(0.01);
        for index in 0..200 {
            let noise = Complex::from_polar(1.0, f64::from(index * index));
            harmonic.observe(command, harmonic.plant() * command + noise, 1.0);
        }
        assert!((harmonic.plant() + 1.0).norm() < 0.02, "{harmonic:?}");
        assert!(harmonic.disturbance().norm() < 0.15, "{harmonic:?}");
    }

    #[test]
    fn a_disturbance_counts_as_far_as_it_comes_again_every_window() {
        let off = Complex::from(5.0);
        let seen = |beyond: fn(i32) -> f64| {
            let mut harmonic =
                Harmonic { disturbance: off, disturbance_variance: 1e-6, ..harmonic(Complex::from(-1.0)) };
            (0..40).for_each(|window| harmonic.note_beyond_rigid(off * beyond(window)));
            harmonic.sure_disturbance_square() / off.norm_sqr()
        };
        assert!(seen(|_| 1.0) > 0.99);
        // A sign that changes stands for noise.
        assert!(seen(|window| if window % 2 == 0 { 1.0 } else { -1.0 }) < 0.02);
    }

    #[test]
    fn a_plant_that_answers_wholly_otherwise_is_found_in_a_few_windows() {
        // At a resonance the answer is twenty times as large, and turned.
        let plant = Complex::new(3.0, 20.0);
        let mut harmonic = harmonic(Complex::from(-1.0));
        let wanted = Complex::from(-1.0);
        let mut command = wanted / harmonic.plant();
        for _ in 0..6 {
            harmonic.observe(command, plant * command, 1e-6);
            let target = (wanted - harmonic.disturbance()) / harmonic.plant();
            command += (target - command) * harmonic.caution();
        }
        assert!((plant * command - wanted).norm() < 0.02, "{harmonic:?} {command}");
    }

    #[test]
    fn the_less_is_known_the_less_is_done() {
        let unsure = Harmonic { plant_variance: 1.0, ..harmonic(Complex::from(-1.0)) };
        let sure = Harmonic { plant_variance: 1e-4, ..unsure };
        assert!((unsure.caution() - 0.5).abs() < 1e-12 && sure.caution() > 0.99);
        assert!(sure.contracts() && !unsure.contracts());
    }
}
