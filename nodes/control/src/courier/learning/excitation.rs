//! A weak excitation at harmonics of a waveform, by which the plant is measured before the waveform runs.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, Vector3};

use super::super::fourier::basis;
use super::super::smoothstep::smoothstep;
use super::plant::Seen;
use super::projection::Projection;

/// An excitation under way: it grows, and is then measured over a window of whole periods.
#[derive(Clone, Debug)]
pub(super) struct Excitation {
    axis: usize,
    fundamental_rad_s: f64,
    /// Acceleration of each harmonic; zero for those that are left out.
    amplitudes: Vec<Complex<f64>>,
    projection: Projection,
    /// Ticks since its start, and of its growth.
    tick: u32,
    growth_ticks: u32,
    period_s: f64,
}

impl Excitation {
    /// Most frequencies excited at once: more would leave too little for each.
    const LINES_MAX: usize = 24;
    /// How long it grows, and the least that it is measured, s.
    const GROWTH_S: f64 = 0.05;
    const MEASURED_S: f64 = 0.4;

    /// An excitation at the harmonics of a waveform up to the `orders`th, spread evenly on a logarithmic scale, none of whose
    /// accelerations exceeds `peak`.
    pub(super) fn new(axis: usize, fundamental_rad_s: f64, orders: usize, peak: f64, period_s: f64) -> Self {
        let mut amplitudes = vec![Complex::from(0.0); orders];
        let lines = orders.min(Self::LINES_MAX);
        for line in 0..lines {
            let share = (line as f64 + 1.0) / lines as f64;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of a harmonic")]
            let order = ((orders as f64).powf(share).round() as usize).clamp(line + 1, orders);
            // Schroeder's phases keep the peak low.
            let phase_rad = -PI * (line * line) as f64 / lines as f64;
            amplitudes[order - 1] = Complex::cis(phase_rad);
        }
        // Fine enough to find the peak of the highest harmonic within a few per cent.
        let steps = 16 * orders;
        let highest = (0..steps).map(|step| {
            let time_s = TAU / fundamental_rad_s * step as f64 / steps as f64;
            let terms = amplitudes.iter().zip(basis(fundamental_rad_s, time_s));
            terms.map(|(amplitude, power)| (amplitude * power).re).sum::<f64>().abs()
        });
        let scale = peak / highest.fold(f64::MIN_POSITIVE, f64::max);
        amplitudes.iter_mut().for_each(|amplitude| *amplitude *= scale);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred ticks")]
        let growth_ticks = (Self::GROWTH_S / period_s).round() as u32;
        let projection = Projection::new(fundamental_rad_s, orders, Self::MEASURED_S / period_s, period_s);
        Self { axis, fundamental_rad_s, amplitudes, projection, tick: 0, growth_ticks, period_s }
    }

    pub(super) fn axis(&self) -> usize {
        self.axis
    }

    pub(super) fn fundamental_rad_s(&self) -> f64 {
        self.fundamental_rad_s
    }

    /// The acceleration at this tick.
    pub(super) fn acceleration(&mut self) -> Vector3<f64> {
        let powers = self.projection.advance(f64::from(self.tick) * self.period_s);
        let sum: f64 = self.amplitudes.iter().zip(powers).map(|(amplitude, power)| (amplitude * power).re).sum();
        let (scale, _) = smoothstep(f64::from(self.tick), f64::from(self.growth_ticks));
        let mut acceleration = Vector3::zeros();
        acceleration[self.axis] = scale * sum;
        acceleration
    }

    /// Notes what was measured and commanded at this tick.
    pub(super) fn note(&mut self, error: &Vector3<f64>, command: &Vector3<f64>) {
        if self.tick >= self.growth_ticks {
            self.projection.add(error, command, &Vector3::zeros());
        }
        self.tick += 1;
    }

    pub(super) fn is_over(&self) -> bool {
        self.projection.is_full()
    }

    /// What was measured, by the order of the harmonic.
    pub(super) fn seen(&mut self) -> Vec<(usize, Seen)> {
        let (axis, fundamental_rad_s) = (self.axis, self.fundamental_rad_s);
        self.projection.measure_noise();
        let variance = self.projection.noise()[axis];
        let lines = self.projection.amplitudes().zip(&self.amplitudes).enumerate();
        let excited = lines.filter(|(_, (_, amplitude))| amplitude.norm_sqr() > 0.0);
        let seen = excited.map(|(index, ((error, command), _))| {
            let omega_rad_s = fundamental_rad_s * (index + 1) as f64;
            (index + 1, Seen { omega_rad_s, command: command[axis], position: -error[axis], variance })
        });
        seen.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_acceleration_never_exceeds_its_peak_and_uses_it() {
        for (hz, orders) in [(30.0, 31), (10.0, 93), (5.0, 190), (200.0, 4), (900.0, 1)] {
            let mut excitation = Excitation::new(2, TAU * hz, orders, 5.0, 0.5e-3);
            let mut highest = 0.0_f64;
            while !excitation.is_over() {
                highest = highest.max(excitation.acceleration().z.abs());
                excitation.note(&Vector3::zeros(), &Vector3::zeros());
            }
            assert!((2.5..=5.3).contains(&highest), "{hz} Hz: {highest}");
            assert!(f64::from(excitation.tick) * 0.5e-3 < 1.0);
        }
    }
}
