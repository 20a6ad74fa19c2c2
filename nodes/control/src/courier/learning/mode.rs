//! A tray that swings on its mounting, from how the plant answers beside a rigid one.

use nalgebra::{Complex, Matrix3, SMatrix, SVector, Vector3};

/// The plant's answer over that of a rigid one at one frequency, and its standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ratio {
    pub(super) omega_rad_s: f64,
    pub(super) ratio: Complex<f64>,
    pub(super) deviation: f64,
}

/// A mode of two inertias on a spring: beside the rigid body's −1/ω² the sensor sees φ/(ω_r² − ω² + 2 i ζ ω_r ω).
///
/// Force and motion at the same inertia give φ > 0, that of the other over its own. Seen at the other inertia φ is −1,
/// whatever the two are. So the sign of φ says whether the sensor sees the courier or the tray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrayMode {
    omega_rad_s: f64,
    damping: f64,
    residue: f64,
    /// The plant below the mode over the rigid plant that it was compared with.
    factor: f64,
    /// Covariance of residue, logarithm of the frequency, and logarithm of the damping ratio.
    covariance: Matrix3<f64>,
}

impl TrayMode {
    /// By how much the sum of squares of deviations must fall for a mode to be believed, and to stay so.
    const EVIDENCE: f64 = 14.0;
    const EVIDENCE_LEFT: f64 = 7.0;
    /// So much beyond the highest of the frequencies measured a mode is looked for: its flank shows.
    const BEYOND: f64 = 1.1;
    /// Damping ratios tried.
    const DAMPINGS: [f64; 4] = [0.005, 0.01, 0.02, 0.05];
    /// Step from one frequency tried to the next, relative.
    const STEP: f64 = 0.005;
    /// Rounds in which the best of those tried is refined, and the range of the damping ratio.
    const ROUNDS: u32 = 6;
    const DAMPING_RANGE: (f64, f64) = (1e-3, 0.2);
    /// By how much frequency and damping may at least be off, relative: what no fit to a linear plant shows.
    const FREQUENCY_SPREAD: f64 = 3e-3;
    const DAMPING_SPREAD: f64 = 0.1;

    /// The mode that explains the ratios best, if one explains them much better than none. The rigid plant may be off by a
    /// factor and a little delay. `known` says whether one has been found before.
    pub(super) fn fit(ratios: &[Ratio], known: bool) -> Option<Self> {
        let evidence = if known { Self::EVIDENCE_LEFT } else { Self::EVIDENCE };
        let (lowest, highest) = (ratios.first()?.omega_rad_s, ratios.last()?.omega_rad_s);
        let squares = Squares::of(ratios);
        let without = squares.without();
        let mut best: Option<(Self, f64)> = None;
        let mut omega_rad_s = 1.5 * lowest;
        while omega_rad_s < Self::BEYOND * highest {
            let explained = squares.by_damping(omega_rad_s, Self::DAMPINGS);
            for (damping, explained) in Self::DAMPINGS.into_iter().zip(explained) {
                if let Some(Explained { share, factor, left }) = explained
                    && best.is_none_or(|(_, least)| left < least)
                {
                    let (residue, covariance) = (share / factor, Matrix3::zeros());
                    best = Some((Self { omega_rad_s, damping, residue, factor, covariance }, left));
                }
            }
            omega_rad_s *= 1.0 + Self::STEP;
        }
        let (mode, _) = best.filter(|(_, left)| without - left > evidence && *left < 0.5 * without)?;
        mode.refined(ratios)
    }

    /// The mode that explains the ratios best near this one, and how well it is known: Gauss–Newton.
    fn refined(mut self, ratios: &[Ratio]) -> Option<Self> {
        /// Step of a slope.
        const STEP: f64 = 1e-5;
        let highest = ratios.last()?.omega_rad_s;
        let mut delay = 0.0;
        let mut covariance = SMatrix::<f64, 5, 5>::zeros();
        for _ in 0..Self::ROUNDS {
            let (mut information, mut moment) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
            for ratio in ratios {
                let omega = ratio.omega_rad_s;
                let late = omega / highest;
                let at = |mode: &Self, delay: f64| mode.seen_over_rigid(omega) + Complex::new(0.0, delay * late);
                let now = at(&self, delay);
                let slopes = [0, 1, 2, 3, 4].map(|index| {
                    let mut by = SVector::<f64, 5>::zeros();
                    by[index] = STEP;
                    (at(&self.moved(&by), delay + by[4]) - now) / STEP
                });
                let weight = ratio.deviation.powi(-2);
                let off = ratio.ratio - now;
                for part in [|value: Complex<f64>| value.re, |value: Complex<f64>| value.im] {
                    let slope = SVector::from(slopes.map(part));
                    information += slope * slope.transpose() * weight;
                    moment += slope * (part(off) * weight);
                }
            }
            // A step in the logarithms is not to leave the neighbourhood.
            covariance = information.try_inverse()?;
            let step = covariance * moment;
            let longest = (step[1].abs() / Self::STEP).max(step[2].abs()).max(1.0);
            self = self.moved(&(step / longest));
            delay += step[4] / longest;
        }
        let least = Vector3::new(0.0, Self::FREQUENCY_SPREAD.powi(2), Self::DAMPING_SPREAD.powi(2));
        self.covariance = covariance.fixed_view::<3, 3>(0, 0) + Matrix3::from_diagonal(&least);
        Some(self)
    }

    /// The mode with residue, logarithms of frequency and damping, and factor moved by so much.
    fn moved(&self, by: &SVector<f64, 5>) -> Self {
        let (least, most) = Self::DAMPING_RANGE;
        Self {
            residue: self.residue + by[0],
            omega_rad_s: self.omega_rad_s * by[1].exp(),
            damping: (self.damping * by[2].exp()).clamp(least, most),
            factor: self.factor + by[3],
            ..*self
        }
    }

    fn denominator(&self, omega_rad_s: f64) -> Complex<f64> {
        let (mode, omega) = (self.omega_rad_s, omega_rad_s);
        Complex::new(mode * mode - omega * omega, 2.0 * self.damping * mode * omega)
    }

    /// Frequency of the mode, rad/s.
    pub(super) fn omega_rad_s(&self) -> f64 {
        self.omega_rad_s
    }

    /// What the sensor sees over what it would see of the rigid plant that the mode was compared with.
    pub(super) fn seen_over_rigid(&self, omega_rad_s: f64) -> Complex<f64> {
        let swing = omega_rad_s * omega_rad_s / self.denominator(omega_rad_s);
        (1.0 - self.residue * swing) * self.factor
    }

    /// Motion of the tray over that which the sensor sees.
    pub(super) fn tray_over_seen(&self, omega_rad_s: f64) -> Complex<f64> {
        if self.residue <= 0.0 {
            return Complex::from(1.0);
        }
        let swing = omega_rad_s * omega_rad_s / self.denominator(omega_rad_s);
        (1.0 + swing) / (1.0 - self.residue * swing)
    }

    /// Standard deviation of that, relative.
    pub(super) fn tray_uncertainty(&self, omega_rad_s: f64) -> f64 {
        /// Step of a slope.
        const STEP: f64 = 1e-5;
        let now = self.tray_over_seen(omega_rad_s);
        let slopes = [0, 1, 2].map(|index| {
            let mut by = SVector::<f64, 5>::zeros();
            by[index] = STEP;
            (self.moved(&by).tray_over_seen(omega_rad_s) / now - 1.0) / STEP
        });
        let parts = [|value: Complex<f64>| value.re, |value: Complex<f64>| value.im];
        let squares = parts.map(|part| {
            let slope = Vector3::from(slopes.map(part));
            slope.dot(&(self.covariance * slope))
        });
        squares.iter().sum::<f64>().max(0.0).sqrt()
    }
}

/// Least squares of the ratios by a + i b ω + φ s(ω), where s is how a mode swings: what does not depend on it, worked out once.
struct Squares {
    terms: Vec<Term>,
    /// Sums of weights and of what goes with a and with b: the two do not mix.
    weight: f64,
    late: f64,
    moments: [f64; 2],
    sum: f64,
}

/// What one ratio adds.
struct Term {
    omega_rad_s: f64,
    ratio: Complex<f64>,
    weight: f64,
    /// The frequency relative to the highest.
    late: f64,
}

/// A mode's share φ and the factor a that go with it, and the sum of squares that is left.
#[derive(Clone, Copy)]
struct Explained {
    share: f64,
    factor: f64,
    left: f64,
}

impl Squares {
    fn of(ratios: &[Ratio]) -> Self {
        let highest_rad_s = ratios.last().map_or(1.0, |ratio| ratio.omega_rad_s);
        let term = |&Ratio { omega_rad_s, ratio, deviation }: &Ratio| Term {
            omega_rad_s,
            ratio,
            weight: deviation.powi(-2),
            late: omega_rad_s / highest_rad_s,
        };
        let terms: Vec<Term> = ratios.iter().map(term).collect();
        let mut squares = Self { terms: Vec::new(), weight: 0.0, late: 0.0, moments: [0.0; 2], sum: 0.0 };
        for Term { ratio, weight, late, .. } in &terms {
            squares.weight += weight;
            squares.late += weight * late * late;
            squares.moments[0] += weight * ratio.re;
            squares.moments[1] += weight * late * ratio.im;
            squares.sum += weight * ratio.norm_sqr();
        }
        Self { terms, ..squares }
    }

    /// The sum of squares that is left without a mode.
    fn without(&self) -> f64 {
        let [real, imaginary] = self.moments;
        self.sum - real * real / self.weight - imaginary * imaginary / self.late
    }

    /// What modes at one frequency explain, by their damping ratios; nothing where that cannot be told.
    fn by_damping<const N: usize>(&self, mode_rad_s: f64, dampings: [f64; N]) -> [Option<Explained>; N] {
        // One damping beside the other, as vectors take them.
        let (mut real, mut imaginary, mut square, mut moment) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
        for Term { omega_rad_s, ratio, weight, late } in &self.terms {
            let omega = omega_rad_s * omega_rad_s;
            let stiff = mode_rad_s * mode_rad_s - omega;
            for lane in 0..N {
                let damped = 2.0 * dampings[lane] * mode_rad_s * omega_rad_s;
                let swing = omega / (stiff * stiff + damped * damped);
                let (re, im) = (-swing * stiff, swing * damped);
                real[lane] += weight * re;
                imaginary[lane] += weight * late * im;
                square[lane] += weight * (re * re + im * im);
                moment[lane] += weight * (re * ratio.re + im * ratio.im);
            }
        }
        let [constant, slope] = self.moments;
        std::array::from_fn(|lane| {
            let (real, imaginary) = (real[lane], imaginary[lane]);
            let (of_real, of_slope) = (real / self.weight, imaginary / self.late);
            // What the mode does beyond what a and b may do.
            let alone = square[lane] - real * of_real - imaginary * of_slope;
            let gain = moment[lane] - constant * of_real - slope * of_slope;
            let share = gain / alone;
            (alone > 0.0).then(|| Explained {
                share,
                factor: constant / self.weight - share * of_real,
                left: self.without() - share * gain,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn ratios(mode: Option<TrayMode>, noise: f64) -> Vec<Ratio> {
        let at = |order: u32| {
            let omega_rad_s = TAU * 30.0 * f64::from(order);
            let swing = mode.map_or(Complex::from(0.0), |mode| {
                mode.residue * omega_rad_s * omega_rad_s / mode.denominator(omega_rad_s)
            });
            let error = Complex::from_polar(noise, f64::from(order * order));
            Ratio { omega_rad_s, ratio: 1.1 * (1.0 - swing) + error, deviation: noise }
        };
        (1..=31).map(at).collect()
    }

    #[test]
    fn verif_a_mode_is_found_and_so_is_the_place_of_the_sensor() {
        for (hz, residue) in [(120.0, 0.43), (180.0, 0.11), (405.0, 0.05), (180.0, -1.0), (640.0, -1.0)] {
            let mode =
                TrayMode { omega_rad_s: TAU * hz, damping: 0.02, residue, factor: 1.0, covariance: Matrix3::zeros() };
            let found = TrayMode::fit(&ratios(Some(mode), 0.02), false).unwrap();
            assert!((found.omega_rad_s / mode.omega_rad_s - 1.0).abs() < 0.02, "{found:?} {mode:?}");
            assert!((found.residue - residue).abs() < 0.2 * residue.abs(), "{found:?} {mode:?}");
            assert_eq!(residue < 0.0, found.tray_over_seen(1000.0) == Complex::from(1.0));
        }
    }

    #[test]
    fn verif_refinement_finds_what_lies_between_those_tried() {
        // 153.4 Hz and a damping of 0.03 lie on no step; with hardly any noise both are found all the same.
        let mode = TrayMode {
            omega_rad_s: TAU * 153.4,
            damping: 0.03,
            residue: 0.2,
            factor: 1.0,
            covariance: Matrix3::zeros(),
        };
        let found = TrayMode::fit(&ratios(Some(mode), 1e-4), false).unwrap();
        assert!((found.omega_rad_s / mode.omega_rad_s - 1.0).abs() < 1e-4, "{found:?}");
        assert!((found.damping / mode.damping - 1.0).abs() < 0.01, "{found:?}");
        assert!((found.residue / mode.residue - 1.0).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn val_the_uncertainty_of_the_tray_s_motion_covers_how_far_it_is_off() {
        // At 150 Hz the tray of a mode at 200 Hz moves twice as much as the courier.
        let mode = TrayMode {
            omega_rad_s: TAU * 200.0,
            damping: 0.02,
            residue: 0.3,
            factor: 1.0,
            covariance: Matrix3::zeros(),
        };
        let truth = mode.tray_over_seen(TAU * 150.0);
        let mut told = Vec::new();
        for noise in [0.003, 0.01, 0.03, 0.06] {
            let mut square = 0.0;
            let mut last = 0.0;
            for seed in 0..20_u32 {
                let mut ratios = ratios(Some(mode), 0.0);
                for (ratio, order) in ratios.iter_mut().zip(0_u32..) {
                    // Angles without a pattern stand for the noise.
                    ratio.ratio += Complex::from_polar(noise, f64::from((order + 7 * seed) * (order + 3 * seed + 1)));
                    ratio.deviation = noise;
                }
                let found = TrayMode::fit(&ratios, false).unwrap();
                last = found.tray_uncertainty(TAU * 150.0);
                square += ((found.tray_over_seen(TAU * 150.0) - truth) / truth / last).norm_sqr() / 20.0;
            }
            // In standard deviations. Where there is hardly any noise, it is what no fit shows that counts.
            assert!(square.sqrt() < 1.5, "{noise}: {square}");
            told.push((last, square.sqrt()));
        }
        // Neither the same whatever the noise, nor so large that it says nothing.
        assert!(told.is_sorted_by(|less, more| less.0 < more.0) && told[3].1 > 0.2, "{told:?}");
    }

    #[test]
    fn a_tray_that_the_sensor_sees_is_known() {
        let mode = TrayMode {
            omega_rad_s: TAU * 180.0,
            damping: 0.02,
            residue: -1.0,
            factor: 1.0,
            covariance: Matrix3::identity() * 1e-4,
        };
        assert!(mode.tray_uncertainty(TAU * 150.0) < 1e-12);
    }

    #[test]
    fn a_rigid_courier_has_no_mode() {
        assert_eq!(TrayMode::fit(&ratios(None, 0.05), false), None);
    }

    #[test]
    fn verif_the_tray_moves_as_two_inertias_on_a_spring_do() {
        // Below the mode alike, at the courier's antiresonance the tray alone, far above the tray hardly.
        let mode =
            TrayMode { omega_rad_s: 1000.0, damping: 1e-6, residue: 0.25, factor: 1.0, covariance: Matrix3::zeros() };
        assert!((mode.tray_over_seen(10.0) - 1.0).norm() < 1e-3);
        // (1 + φ) ω_a² = ω_r².
        assert!(mode.tray_over_seen(1000.0 / 1.25_f64.sqrt()).norm() > 1e3);
        let ratio = mode.tray_over_seen(5000.0);
        assert!((ratio - 1.0 / (1.0 - 25.0 * 1.25)).norm() < 1e-3, "{ratio}");
    }
}
