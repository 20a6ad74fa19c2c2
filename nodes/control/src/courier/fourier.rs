//! A waveform's motion as its first Fourier harmonics: what a servo of limited bandwidth can repeat.

use std::f64::consts::TAU;

use nalgebra::{Complex, Vector3};

use feeder_model::waveform::Waveform;

/// The powers exp(i k ω t), k = 1, 2, …, of a harmonic basis at one instant.
pub(crate) fn basis(fundamental_rad_s: f64, time_s: f64) -> impl Iterator<Item = Complex<f64>> {
    let first = Complex::cis((fundamental_rad_s * time_s).rem_euclid(TAU));
    std::iter::successors(Some(first), move |power| Some(power * first))
}

/// Position along one axis as Re Σ P_k exp(i k ω t), k = 1…n.
#[derive(Clone, Debug)]
pub(crate) struct Fourier {
    fundamental_rad_s: f64,
    position: Vec<Complex<f64>>,
}

impl Fourier {
    /// The harmonics of a waveform up to `cutoff_hz`, at least one.
    ///
    /// The acceleration's coefficients are A_k = (2/T) ∫ a e^(−i k ω t) dt, exact for constant segments, and the position
    /// follows as P_k = −A_k/(k ω)².
    pub(crate) fn new(waveform: &Waveform, cutoff_hz: f64) -> Self {
        let period_s = waveform.period_s();
        let fundamental_rad_s = TAU / period_s;
        // A cut-off meant to include a harmonic includes it whatever rounding says.
        let cutoff = cutoff_hz * period_s * (1.0 + 1e-9);
        let position = (1..=4096)
            .map(f64::from)
            .take_while(|&k| k <= cutoff || k < 1.5)
            .map(|k| {
                let omega_rad_s = k * fundamental_rad_s;
                let mut start_s = 0.0;
                let mut sum = Complex::new(0.0, 0.0);
                for segment in waveform.segments() {
                    let end_s = start_s + segment.duration_s;
                    let edges = Complex::cis(-omega_rad_s * start_s) - Complex::cis(-omega_rad_s * end_s);
                    sum += edges * segment.acceleration;
                    start_s = end_s;
                }
                let acceleration = sum * (2.0 / period_s) / Complex::new(0.0, omega_rad_s);
                -acceleration / (omega_rad_s * omega_rad_s)
            })
            .collect();
        Self { fundamental_rad_s, position }
    }

    pub(crate) fn fundamental_rad_s(&self) -> f64 {
        self.fundamental_rad_s
    }

    pub(crate) fn len(&self) -> usize {
        self.position.len()
    }

    /// The coefficients P_k, k = 1…n.
    pub(crate) fn position(&self) -> &[Complex<f64>] {
        &self.position
    }

    /// Position and velocity at `time_s` after the start of a period.
    pub(crate) fn at(&self, time_s: f64) -> (f64, f64) {
        let (mut position, mut velocity, mut omega_rad_s) = (0.0, 0.0, 0.0);
        for (coefficient, power) in self.position.iter().zip(basis(self.fundamental_rad_s, time_s)) {
            omega_rad_s += self.fundamental_rad_s;
            let term = coefficient * power;
            position += term.re;
            velocity -= omega_rad_s * term.im;
        }
        (position, velocity)
    }

    /// Peaks of position, velocity and acceleration, by sampling every harmonic finely.
    pub(crate) fn peaks(&self) -> Vector3<f64> {
        let steps = 32 * self.len();
        let period_s = TAU / self.fundamental_rad_s;
        (0..steps).fold(Vector3::zeros(), |peaks: Vector3<f64>, step| {
            let time_s = period_s * step as f64 / steps as f64;
            let (position, velocity) = self.at(time_s);
            let mut acceleration = 0.0;
            for (index, (coefficient, power)) in
                self.position.iter().zip(basis(self.fundamental_rad_s, time_s)).enumerate()
            {
                let omega_rad_s = self.fundamental_rad_s * (index + 1) as f64;
                acceleration -= omega_rad_s * omega_rad_s * (coefficient * power).re;
            }
            peaks.sup(&Vector3::new(position, velocity, acceleration).abs())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use feeder_model::waveform::Axis;

    #[test]
    fn verif_many_harmonics_approach_the_exact_motion() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.87).unwrap();
        let fourier = Fourier::new(&waveform, 30.0 * 400.0);
        for step in 0..50 {
            let time_s = f64::from(step) / 1500.0;
            let (position, velocity) = fourier.at(time_s);
            let exact = waveform.state_at(time_s);
            // The tail beyond n harmonics is below Σ 2 Δa/(T ω² k²)/… ~ Δa T/(π² n) in velocity, one order less in T
            // for the position.
            assert!((velocity - exact.velocity).abs() < 150.0 / 30.0 / (9.8 * 400.0));
            assert!((position - exact.position).abs() < 1e-8);
        }
    }

    #[test]
    fn the_cut_off_counts_harmonics() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.87).unwrap();
        assert_eq!(Fourier::new(&waveform, 630.0).len(), 21);
        assert_eq!(Fourier::new(&waveform, 1.0).len(), 1);
    }
}
