//! Error and command of a stretch of time as harmonics, and the sensor's noise between them.

use std::f64::consts::TAU;

use nalgebra::{Complex, Vector3};

use super::super::fourier::basis;

/// A complex amplitude on each axis.
pub(super) type Amplitude = Vector3<Complex<f64>>;

/// Sums of error and command over a window of whole periods.
#[derive(Clone, Debug)]
pub(super) struct Projection {
    fundamental_rad_s: f64,
    window_ticks: u32,
    /// Ticks of the present window.
    ticks: u32,
    /// Powers of the basis at the present tick.
    powers: Vec<Complex<f64>>,
    error: Vec<Amplitude>,
    command: Vec<Amplitude>,
    /// What of the command was asked for and not given.
    cut: Vec<Amplitude>,
    /// Turn a tick and sum of each frequency at which nothing is commanded.
    silent: Vec<(f64, Amplitude)>,
    /// Variance of an amplitude by the sensor's noise; nothing before the first window.
    noise: Option<Vector3<f64>>,
}

impl Projection {
    /// Frequencies between the cut-off and half the servo rate at which the noise is measured.
    const SILENT: u32 = 8;
    /// Share of a new window in the mean of the noise.
    const NOISE_GAIN: f64 = 0.2;

    /// A projection on the first `orders` harmonics over the fewest whole ticks, of at least `least_ticks`, that are nearly
    /// whole periods.
    pub(super) fn new(fundamental_rad_s: f64, orders: usize, least_ticks: f64, period_s: f64) -> Self {
        let window_ticks = window_ticks(TAU / (fundamental_rad_s * period_s), least_ticks);
        let highest = fundamental_rad_s * period_s * orders as f64 / TAU * f64::from(window_ticks);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "less than half of the window")]
        let (from, to) = (highest.ceil() as u32 + 2, window_ticks.div_ceil(2).saturating_sub(1));
        let step = (to.saturating_sub(from) / Self::SILENT).max(1);
        let turn = |bin: u32| (TAU * f64::from(bin) / f64::from(window_ticks), Amplitude::zeros());
        Self {
            fundamental_rad_s,
            window_ticks,
            ticks: 0,
            powers: vec![Complex::from(1.0); orders],
            error: vec![Amplitude::zeros(); orders],
            command: vec![Amplitude::zeros(); orders],
            cut: vec![Amplitude::zeros(); orders],
            silent: (from..to).step_by(step as usize).map(turn).collect(),
            noise: None,
        }
    }

    /// Goes to the instant `elapsed_s` after the start of a period, and gives the powers of the basis there.
    pub(super) fn advance(&mut self, elapsed_s: f64) -> &[Complex<f64>] {
        for (power, now) in self.powers.iter_mut().zip(basis(self.fundamental_rad_s, elapsed_s)) {
            *power = now;
        }
        &self.powers
    }

    /// Adds what was measured and commanded at the present instant, and what was asked for beyond that.
    pub(super) fn add(&mut self, error: &Vector3<f64>, command: &Vector3<f64>, cut: &Vector3<f64>) {
        if *cut != Vector3::zeros() {
            for (power, cuts) in self.powers.iter().zip(&mut self.cut) {
                *cuts += cut.map(|cut| power.conj() * cut);
            }
        }
        for ((power, errors), commands) in self.powers.iter().zip(&mut self.error).zip(&mut self.command) {
            let power = power.conj();
            for axis in 0..3 {
                errors[axis] += power * error[axis];
                commands[axis] += power * command[axis];
            }
        }
        for (turn_rad, sum) in &mut self.silent {
            let power = Complex::cis(-*turn_rad * f64::from(self.ticks));
            *sum += error.map(|error| power * error);
        }
        self.ticks += 1;
    }

    pub(super) fn is_full(&self) -> bool {
        self.ticks >= self.window_ticks
    }

    pub(super) fn forget(&mut self) {
        if self.ticks > 0 {
            self.ticks = 0;
            self.error.fill(Amplitude::zeros());
            self.command.fill(Amplitude::zeros());
            self.cut.fill(Amplitude::zeros());
            self.silent.iter_mut().for_each(|(_, sum)| *sum = Amplitude::zeros());
        }
    }

    /// Amplitudes of error and command over a full window, harmonic by harmonic.
    pub(super) fn amplitudes(&self) -> impl Iterator<Item = (Amplitude, Amplitude)> + '_ {
        let share = Complex::from(2.0 / f64::from(self.window_ticks));
        self.error.iter().zip(&self.command).map(move |(error, command)| (error * share, command * share))
    }

    /// Amplitudes of what was asked for and not given, likewise.
    pub(super) fn cut(&self) -> impl Iterator<Item = Amplitude> + '_ {
        let share = Complex::from(2.0 / f64::from(self.window_ticks));
        self.cut.iter().map(move |cut| cut * share)
    }

    /// Takes in how strong the noise was in a full window, once a window.
    pub(super) fn measure_noise(&mut self) {
        let share = (2.0 / f64::from(self.window_ticks)).powi(2) / self.silent.len().max(1) as f64;
        let sums = self.silent.iter().map(|(_, sum)| sum.map(|sum| sum.norm_sqr()));
        let seen = sums.sum::<Vector3<f64>>() * share;
        let noise = self.noise.map_or(seen, |noise| noise + (seen - noise) * Self::NOISE_GAIN);
        self.noise = Some(noise);
    }

    /// Variance of an amplitude by the noise, as measured so far.
    pub(super) fn noise(&self) -> Vector3<f64> {
        self.noise.unwrap_or_default()
    }
}

/// The fewest ticks, of `least_ticks` or more, that are nearly a whole number of periods of `period_ticks` each.
///
/// Over a window that is off by δ of n ticks a harmonic leaks δ/n of itself into the others; what is tolerated here is
/// less than the updates correct.
fn window_ticks(period_ticks: f64, least_ticks: f64) -> u32 {
    const OFF_TICKS_MAX: f64 = 0.05;
    let least = (least_ticks / period_ticks - 1e-3).ceil().max(1.0);
    let windows = (0..60).map(|more| (least + f64::from(more)) * period_ticks);
    let off = |ticks: &f64| (ticks - ticks.round()).abs();
    let whole = windows.clone().find(|ticks| off(ticks) <= OFF_TICKS_MAX);
    let ticks = whole.or_else(|| windows.min_by(|a, b| off(a).total_cmp(&off(b)))).unwrap_or(period_ticks);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred periods of 1 s at most")]
    let ticks = ticks.round() as u32;
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_whole_periods() {
        assert_eq!(window_ticks(200.0 / 3.0, 200.0), 200);
        assert_eq!(window_ticks(200.0, 200.0), 200);
        assert_eq!(window_ticks(100.0, 300.0), 300);
        assert_eq!(window_ticks(66.6, 190.0), 333);
        // √2: 7 · 99/7 …, the best of sixty is within a few hundredths.
        let ticks = window_ticks(100.0 * 2.0_f64.sqrt(), 200.0);
        let periods = f64::from(ticks) / (100.0 * 2.0_f64.sqrt());
        assert!((periods - periods.round()).abs() < 1e-3);
    }

    #[test]
    fn verif_harmonics_come_out_and_the_noise_beside_them() {
        let mut projection = Projection::new(TAU * 30.0, 31, 200.0, 0.5e-3);
        let mut draw = 12345_u64;
        for tick in 0..200 {
            let time_s = f64::from(tick) * 0.5e-3;
            let powers = projection.advance(time_s).to_vec();
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = (draw >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
            let error = Vector3::new(noise, 0.0, (powers[2] * Complex::new(1.0, 2.0)).re);
            projection.add(&error, &Vector3::new(0.0, (powers[30] * 3.0).re, 0.0), &Vector3::zeros());
        }
        assert!(projection.is_full());
        let seen: Vec<_> = projection.amplitudes().collect();
        assert!((seen[2].0.z - Complex::new(1.0, 2.0)).norm() < 1e-12 && seen[3].0.z.norm() < 1e-12);
        assert!((seen[30].1.y - Complex::from(3.0)).norm() < 1e-12);
        // Uniform noise of variance 1/12 gives amplitudes of variance 4/(12 n); a few frequencies know it within a factor.
        projection.measure_noise();
        let noise = projection.noise();
        assert!((0.25..4.0).contains(&(noise.x / (4.0 / 12.0 / 200.0))), "{noise}");
        assert!(noise.z < 1e-25);
    }
}
