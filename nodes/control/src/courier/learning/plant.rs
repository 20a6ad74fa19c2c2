//! What the plant is as a rigid body: how much it moves, how late and how sluggishly, from its motion against its commands.

use nalgebra::{Complex, Matrix3, Vector3};

use super::super::response::PlantModel;

/// Command and position measured at one frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) omega_rad_s: f64,
    /// Acceleration commanded, the force over the nominal mass.
    pub(super) command: Complex<f64>,
    pub(super) position: Complex<f64>,
    /// Variance of the position by the sensor's noise.
    pub(super) variance: f64,
}

/// An estimate of gain, delay and lag.
///
/// The logarithm of position over command is that of the gain, turns with the delay, and bends with the lag. The three are
/// fitted by weighted least squares (Gauss–Newton on the logarithm), each frequency by how well it is known; those that no
/// rigid plant explains count little. Fits add up with slow forgetting.
#[derive(Clone, Debug)]
pub(super) struct PlantEstimate {
    model: PlantModel,
    /// Inverse covariance of (ln gain, delay in ms, lag in ms).
    information: Matrix3<f64>,
}

impl PlantEstimate {
    /// Relative errors that neither noise nor a rigid plant explains, such as a ripple's, rms.
    const UNEXPLAINED: f64 = 0.05;
    /// Share of what was known that a fit keeps.
    const MEMORY: f64 = 0.97;
    /// Longest delay and lag believed, ms.
    const LATE_MS_MAX: f64 = 20.0;
    /// Least and largest gain believed.
    const GAINS: (f64, f64) = (0.1, 10.0);
    /// A phase known no better than this may be off by a turn, rad².
    const PHASE_VARIANCE_MAX: f64 = 0.1;
    /// The first round of a fit from scratch reckons with frequencies up to this, each round more with twice as many:
    /// by then the delay is known well enough for their phase.
    const FIRST_RAD_S: f64 = 100.0 * std::f64::consts::TAU;

    /// What is believed before anything is measured; `spread` is the standard deviation of ln gain, delay and lag.
    pub(super) fn new(model: PlantModel, spread: [f64; 3]) -> Self {
        let [gain, delay_s, lag_s] = spread;
        let spread = Vector3::new(gain, delay_s * 1e3, lag_s * 1e3);
        Self { model, information: Matrix3::from_diagonal(&spread.map(|spread| (spread * spread).recip())) }
    }

    pub(super) fn model(&self) -> PlantModel {
        self.model
    }

    /// Notes that the mass has become `ratio` times what the driver reckons it to be relative to before.
    pub(super) fn scale_gain(&mut self, ratio: f64) {
        self.model.gain = (self.model.gain * ratio).clamp(Self::GAINS.0, Self::GAINS.1);
    }

    /// Doubts what is known of the gain: it may have changed by about `spread`, relative.
    pub(super) fn doubt_gain(&mut self, spread: f64) {
        if let Some(mut covariance) = self.information.try_inverse() {
            covariance[(0, 0)] += spread * spread;
            self.information = covariance.try_inverse().unwrap_or(self.information);
        }
    }

    /// Fits what a first measurement shows, in widening bands, `rounds` of them; one round when the plant is known about.
    pub(super) fn fit(&mut self, seen: &[Seen], rounds: u32, period_s: f64) {
        let before = self.information * Self::MEMORY;
        let start = coordinates(&self.model);
        let mut information = before;
        for round in 1..=rounds {
            let band_rad_s =
                if round == rounds { f64::MAX } else { Self::FIRST_RAD_S * f64::from(1_u32 << round.min(16)) };
            let (mut data, mut moment) = (Matrix3::zeros(), Vector3::zeros());
            for seen in seen.iter().filter(|seen| seen.omega_rad_s <= band_rad_s) {
                let Some((residual, slopes, weight)) = self.explain(seen, period_s) else { continue };
                for part in [|value: Complex<f64>| value.re, |value: Complex<f64>| value.im] {
                    let slope = slopes.map(part);
                    data += slope * slope.transpose() * weight;
                    moment += slope * (part(residual) * weight);
                }
            }
            information = before + data;
            moment += before * (start - coordinates(&self.model));
            let Some(step) = information.cholesky().map(|factor| factor.solve(&moment)) else { return };
            self.model = model_at(&(coordinates(&self.model) + step));
        }
        self.information = information;
    }

    /// How far off the model is at one frequency: ln(measured/model), its slopes by the coordinates, and its weight.
    fn explain(&self, seen: &Seen, period_s: f64) -> Option<(Complex<f64>, Vector3<Complex<f64>>, f64)> {
        /// Step of a slope, ms.
        const STEP_MS: f64 = 1e-3;
        let z = Complex::cis(seen.omega_rad_s * period_s);
        let response = |model: &PlantModel| model.response(z, period_s).0;
        let now = response(&self.model);
        let expected = now * seen.command;
        let ratio = seen.position / expected;
        let noise = seen.variance / expected.norm_sqr();
        if !(ratio.is_finite() && ratio.norm() > 0.0 && noise < Self::PHASE_VARIANCE_MAX) {
            return None;
        }
        let residual = ratio.ln();
        let slope = |index: usize| {
            let mut there = coordinates(&self.model);
            there[index] += STEP_MS;
            (response(&model_at(&there)) / now).ln() / STEP_MS
        };
        let variance = noise + Self::UNEXPLAINED * Self::UNEXPLAINED;
        // Cauchy's weight: what is three deviations off counts half, a resonance next to nothing.
        let weight = (variance + residual.norm_sqr() / 9.0).recip();
        Some((residual, Vector3::new(Complex::from(1.0), slope(1), slope(2)), weight))
    }
}

fn coordinates(model: &PlantModel) -> Vector3<f64> {
    Vector3::new(model.gain.ln(), model.delay_s * 1e3, model.lag_s * 1e3)
}

fn model_at(coordinates: &Vector3<f64>) -> PlantModel {
    let late_s = |ms: f64| ms.clamp(0.0, PlantEstimate::LATE_MS_MAX) * 1e-3;
    let (least, most) = PlantEstimate::GAINS;
    PlantModel {
        gain: coordinates.x.exp().clamp(least, most),
        delay_s: late_s(coordinates.y),
        lag_s: late_s(coordinates.z),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const PERIOD_S: f64 = 0.5e-3;
    const NOMINAL: PlantModel = PlantModel { gain: 1.0, delay_s: 0.5e-3, lag_s: 0.5e-3 };

    fn seen(plant: &PlantModel, noise: f64, also: impl Fn(f64) -> Complex<f64>) -> Vec<Seen> {
        let harmonic = |order: u32| {
            let omega_rad_s = TAU * 30.0 * f64::from(order);
            let command = Complex::from_polar(40.0 / f64::from(order), f64::from(order));
            let position =
                plant.response(Complex::cis(omega_rad_s * PERIOD_S), PERIOD_S).0 * command * also(omega_rad_s);
            // A sign that changes without a pattern stands for the noise.
            let error = Complex::from_polar(noise, f64::from(order * order));
            Seen { omega_rad_s, command, position: position + error, variance: noise * noise }
        };
        (1..=31).map(harmonic).collect()
    }

    #[test]
    fn verif_gain_delay_and_lag_far_from_the_nominal_are_found() {
        for (gain, delay_s, lag_s) in [(0.4, 0.5e-3, 0.5e-3), (2.0, 0.0, 1.5e-3), (1.0, 1.5e-3, 0.0), (0.7, 1e-3, 1e-3)]
        {
            let plant = PlantModel { gain, delay_s, lag_s };
            let mut estimate = PlantEstimate::new(NOMINAL, [0.4, 0.5e-3, 0.5e-3]);
            estimate.fit(&seen(&plant, 3e-7, |_| Complex::from(1.0)), 6, PERIOD_S);
            let found = estimate.model();
            assert!((found.gain / gain - 1.0).abs() < 0.02, "{found:?} {plant:?}");
            assert!((found.delay_s + found.lag_s - delay_s - lag_s).abs() < 50e-6, "{found:?} {plant:?}");
        }
    }

    #[test]
    fn a_resonance_leaves_the_rigid_plant_where_it_is() {
        let mode = |omega_rad_s: f64| {
            let ratio = omega_rad_s / (TAU * 420.0);
            1.0 + 0.05 * ratio * ratio / Complex::new(ratio * ratio - 1.0, -0.02 * ratio)
        };
        let mut estimate = PlantEstimate::new(NOMINAL, [0.4, 0.5e-3, 0.5e-3]);
        estimate.fit(&seen(&NOMINAL, 3e-7, mode), 6, PERIOD_S);
        let found = estimate.model();
        assert!((found.gain - 1.0).abs() < 0.03 && (found.delay_s + found.lag_s - 1e-3).abs() < 0.1e-3, "{found:?}");
    }
}
