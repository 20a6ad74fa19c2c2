//! Whether learning does better than feedback alone, harmonic by harmonic and as a whole.

use nalgebra::Complex;

/// One harmonic over a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    pub(super) omega_rad_s: f64,
    /// Position wanted.
    pub(super) wanted: Complex<f64>,
    /// Position reached.
    pub(super) reached: Complex<f64>,
    /// Position that was to be expected by all windows so far.
    pub(super) expected: Complex<f64>,
    /// Position that feedback and feed-forward alone would reach.
    pub(super) with_feedback: Complex<f64>,
    /// Variance of the position reached by the sensor's noise.
    pub(super) noise: f64,
}

/// Sums of squares of velocities over a window.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    wanted: f64,
    off: f64,
    off_with_feedback: f64,
    noise: f64,
    off_expected: f64,
}

/// Watches what comes of a lesson, window by window.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    /// For how many windows in a row each harmonic was worse than with feedback alone.
    worse: Vec<u32>,
    left: Vec<bool>,
    all_worse: u32,
    given_up: bool,
    squares: Squares,
    /// Velocity off over velocity wanted, as known after the last window.
    velocity_error: Option<f64>,
    windows: u32,
}

impl Watch {
    /// What is worse for so many windows in a row is given up.
    const PATIENCE: u32 = 3;
    /// Worse is what is off by so much more than feedback alone would be.
    const MARGIN: f64 = 1.2;
    /// Noise that looks like an error, in standard deviations.
    const NOISE: f64 = 4.0;

    pub(super) fn new(orders: usize) -> Self {
        Self {
            worse: vec![0; orders],
            left: vec![false; orders],
            all_worse: 0,
            given_up: false,
            squares: Squares::default(),
            velocity_error: None,
            windows: 0,
        }
    }

    pub(super) fn begin(&mut self) {
        self.squares = Squares::default();
    }

    /// Judges a harmonic, and says whether it is left to feedback.
    pub(super) fn judge(&mut self, index: usize, followed: &Followed) -> bool {
        let off = followed.reached - followed.wanted;
        let with_feedback = followed.with_feedback - followed.wanted;
        let worse = off.norm() > Self::MARGIN * with_feedback.norm() + Self::NOISE * followed.noise.sqrt();
        self.worse[index] = if worse { self.worse[index] + 1 } else { 0 };
        self.left[index] |= self.worse[index] >= Self::PATIENCE;
        let square = followed.omega_rad_s * followed.omega_rad_s;
        self.squares.wanted += square * followed.wanted.norm_sqr();
        self.squares.off += square * off.norm_sqr();
        self.squares.off_with_feedback += square * with_feedback.norm_sqr();
        self.squares.noise += square * followed.noise;
        self.squares.off_expected += square * (followed.expected - followed.wanted).norm_sqr();
        self.left[index]
    }

    pub(super) fn end(&mut self) {
        let Squares { wanted, off, off_with_feedback, noise, off_expected } = self.squares;
        self.windows = self.windows.saturating_add(1);
        self.velocity_error = Some((off_expected / wanted.max(f64::MIN_POSITIVE)).sqrt());
        let worse = off > Self::MARGIN * Self::MARGIN * off_with_feedback + Self::NOISE * noise;
        self.all_worse = if worse { self.all_worse + 1 } else { 0 };
        self.given_up |= self.all_worse >= Self::PATIENCE;
    }

    /// Nothing that was learned is used any more.
    pub(super) fn give_up(&mut self) {
        self.given_up = true;
    }

    pub(super) fn is_given_up(&self) -> bool {
        self.given_up
    }

    /// Velocity off over velocity wanted, as known after the last window.
    pub(super) fn velocity_error(&self) -> Option<f64> {
        self.velocity_error
    }

    pub(super) fn windows(&self) -> u32 {
        self.windows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(watch: &mut Watch, off: f64) -> bool {
        watch.begin();
        let at = |off: f64| Complex::from(1.0 + off);
        let followed = Followed {
            omega_rad_s: 100.0,
            wanted: at(0.0),
            reached: at(off),
            expected: at(off),
            with_feedback: at(0.3),
            noise: 1e-6,
        };
        let left = watch.judge(0, &followed);
        watch.end();
        left
    }

    #[test]
    fn what_is_worse_than_feedback_for_long_is_given_up_and_nothing_else() {
        let mut watch = Watch::new(1);
        assert!(!window(&mut watch, 0.5) && !window(&mut watch, 0.5) && !window(&mut watch, 0.1));
        assert!(!window(&mut watch, 0.5) && !window(&mut watch, 0.5) && !watch.is_given_up());
        assert!(window(&mut watch, 0.5) && watch.is_given_up());
        assert!((watch.velocity_error().unwrap() - 0.5).abs() < 1e-3);
    }
}
