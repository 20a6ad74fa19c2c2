//! The waveforms of the paper, and the optimal one.

use super::{Axis, Segment, Waveform, WaveformError};
use crate::range::OutOfRange;

/// What the optimal waveform is designed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OptimalDesign {
    /// Coefficient of friction μ, static and kinetic.
    pub friction: f64,
    /// Slope φ of the track in the feed direction, rad.
    pub slope_rad: f64,
    /// Gravity g, m/s².
    pub gravity_m_s2: f64,
    /// Largest horizontal acceleration A of the tray, m/s².
    pub limit_m_s2: f64,
}

/// The accelerations that bound sticking on a slope, seen from the optimal waveform (m/s²).
#[derive(Clone, Copy, Debug, PartialEq)]
struct StickWindow {
    /// a_s = g tan(φ_f − φ): largest acceleration that carries the part along.
    forward: f64,
    /// k = g tan(φ_f + φ): largest deceleration that still holds it.
    backward: f64,
}

impl OptimalDesign {
    /// The largest horizontal acceleration of the tray that carries a part up a slope φ, g tan(φ_f − φ) with φ_f = atan μ,
    /// m/s²; not positive if the part slides down by itself.
    #[must_use]
    pub fn carrying_m_s2(friction: f64, slope_rad: f64, gravity_m_s2: f64) -> f64 {
        gravity_m_s2 * (friction.atan() - slope_rad).tan()
    }

    /// Checks the design and gives its stick window.
    fn window(&self) -> Result<StickWindow, OutOfRange> {
        let Self { friction, slope_rad, gravity_m_s2, limit_m_s2 } = *self;
        OutOfRange::unless_positive("friction", friction)?;
        OutOfRange::unless_positive("gravity_m_s2", gravity_m_s2)?;
        let friction_angle = friction.atan();
        OutOfRange::unless(
            slope_rad.abs() < friction_angle && slope_rad.abs() + friction_angle < std::f64::consts::FRAC_PI_2,
            "slope_rad",
            slope_rad,
            format_args!(
                "within ±{} (friction angle, and 90° less the friction angle)",
                friction_angle.min(std::f64::consts::FRAC_PI_2 - friction_angle)
            ),
        )?;
        let forward = Self::carrying_m_s2(friction, slope_rad, gravity_m_s2);
        let backward = gravity_m_s2 * (friction_angle + slope_rad).tan();
        // On a slope one of the pushes takes the tray from under the part beyond g / tan |φ|.
        let lift_off = gravity_m_s2 / slope_rad.abs().tan();
        OutOfRange::unless(
            limit_m_s2 > backward && limit_m_s2 >= forward && limit_m_s2 <= lift_off,
            "limit_m_s2",
            limit_m_s2,
            format_args!(
                "above {backward} (g tan(φ_f + φ)), at least {forward} (g tan(φ_f − φ)), at most {lift_off} (g / tan |φ|)"
            ),
        )?;
        Ok(StickWindow { forward, backward })
    }

    /// Mean speed along the slope of a part fed by the optimal waveform of period `period_s`, m/s.
    ///
    /// v* = (D²/4T)(A²c1² − k1²)/(A c1) with D = T a_s/(a_s + k), k1 = g(sin φ + μ cos φ), c1 = cos φ − μ sin φ. It is an
    /// upper bound for every periodic waveform within |a| ≤ A on a part with this friction.
    ///
    /// # Errors
    ///
    /// As [`Waveform::optimal`].
    pub fn best_feed_m_s(&self, period_s: f64) -> Result<f64, WaveformError> {
        let window = self.window()?;
        OutOfRange::unless_positive("period_s", period_s)?;
        let (sin, cos) = self.slope_rad.sin_cos();
        let slip_s = period_s * window.forward / (window.forward + window.backward);
        let drag = self.gravity_m_s2 * (sin + self.friction * cos);
        let push = self.limit_m_s2 * (cos - self.friction * sin);
        Ok(slip_s * slip_s / (4.0 * period_s) * (push * push - drag * drag) / push)
    }
}

impl Waveform {
    /// The stick-slip waveform: +`a_min` for t1, −`a_max` for T − 2 t1, +`a_min` for t1, with
    /// t1 = a_max T / (2 (a_min + a_max)) (Quaid Eqs 1–3).
    ///
    /// The part sticks and slips as meant if a_min < μ g < a_max; other values are legal.
    ///
    /// # Errors
    ///
    /// If the period is not positive, or not 0 < a_min < a_max.
    pub fn stick_slip(axis: Axis, period_s: f64, a_min: f64, a_max: f64) -> Result<Self, WaveformError> {
        OutOfRange::unless_positive("period_s", period_s)?;
        OutOfRange::unless_positive("a_min", a_min)?;
        OutOfRange::unless(a_max > a_min, "a_max", a_max, format_args!("greater than a_min = {a_min}, and finite"))?;
        let forward_s = a_max * period_s / (2.0 * (a_min + a_max));
        let backward_s = period_s * a_min / (a_min + a_max);
        Self::of(axis, &[(forward_s, a_min), (backward_s, -a_max), (forward_s, a_min)])
    }

    /// The Coulomb pump: +`a` for (1 − z) T/2, 0 for z T, −`a` for (1 − z) T/2 (Quaid Eq. 8).
    ///
    /// # Errors
    ///
    /// If the period or `a` is not positive, or `z` not within (0, 1).
    pub fn coulomb_pump(axis: Axis, period_s: f64, a: f64, z: f64) -> Result<Self, WaveformError> {
        OutOfRange::unless_positive("period_s", period_s)?;
        OutOfRange::unless_positive("a", a)?;
        OutOfRange::unless(z > 0.0 && z < 1.0, "z", z, "0 < z < 1")?;
        let push_s = (1.0 - z) * period_s / 2.0;
        Self::of(axis, &[(push_s, a), (z * period_s, 0.0), (push_s, -a)])
    }

    /// The fastest periodic waveform within |a| ≤ A for a known friction (the paper's open problem).
    ///
    /// With φ_f = atan μ, a_s = g tan(φ_f − φ), k = g tan(φ_f + φ) and D = T a_s/(a_s + k): +a_s for T − D, during which
    /// the part sticks, then −A for D (A + k)/(2A), then +A for D (A − k)/(2A), at the end of which the part has just
    /// come to rest on the tray. Speed: [`OptimalDesign::best_feed_m_s`]. It is nominal only: with less friction than
    /// designed for, the part slides back on a ramp.
    ///
    /// Accelerations are in m/s²; for rotation about a centre at distance r, follow with
    /// [`scaled`](Self::scaled)`(1.0 / r)`.
    ///
    /// # Errors
    ///
    /// If a parameter is not positive, or outside the waveform's validity: |φ| < φ_f < 90° − |φ|, A > k, A ≥ a_s, and
    /// A sin |φ| ≤ g cos φ (contact).
    pub fn optimal(axis: Axis, period_s: f64, design: &OptimalDesign) -> Result<Self, WaveformError> {
        OutOfRange::unless_positive("period_s", period_s)?;
        let StickWindow { forward, backward } = design.window()?;
        let limit = design.limit_m_s2;
        let slip_s = period_s * forward / (forward + backward);
        let stick_s = period_s * backward / (forward + backward);
        Self::of(
            axis,
            &[
                (stick_s, forward),
                (slip_s * (limit + backward) / (2.0 * limit), -limit),
                (slip_s * (limit - backward) / (2.0 * limit), limit),
            ],
        )
    }

    /// A waveform from (duration, acceleration) pairs.
    fn of(axis: Axis, pairs: &[(f64, f64)]) -> Result<Self, WaveformError> {
        let segments = pairs.iter().map(|&(duration_s, acceleration)| Segment { duration_s, acceleration });
        Self::new(axis, segments.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MU_G: f64 = 0.2 * 9.81;

    fn flat(limit_over_mu_g: f64) -> OptimalDesign {
        OptimalDesign { friction: 0.2, slope_rad: 0.0, gravity_m_s2: 9.81, limit_m_s2: limit_over_mu_g * MU_G }
    }

    #[test]
    fn verif_stick_slip_stroke_and_speed_by_hand() {
        // From the middle of the forward push to its end the velocity rises by a_min t1, from zero by symmetry, so the
        // peak is a_min t1; the stroke is the travel while the velocity is positive, a triangle of that height.
        let (period_s, a_min, a_max) = (0.05, 1.6, 10.1);
        let waveform = Waveform::stick_slip(Axis::X, period_s, a_min, a_max).unwrap();
        let peak = a_min * a_max * period_s / (2.0 * (a_min + a_max));
        assert!((waveform.peak_speed() - peak).abs() < 1e-15);
        assert!((waveform.stroke() - peak * period_s / 4.0).abs() < 1e-15);
        assert!((waveform.period_s() - period_s).abs() < 1e-15);
        assert!(waveform.start_velocity().abs() < 1e-15);
    }

    #[test]
    fn val_optimal_speed_stroke_and_peak_of_the_table() {
        // optimal_waveform.csv, linear, flat: A/μg, v (mm/s), stroke (mm), peak speed (mm/s) at T = 1/30 s and μ = 0.2.
        for (a, v, stroke, peak) in [
            (2.0, 6.131_249_999_999_991, 0.193_198_242_187_500_04, 26.568_750_000_000_01),
            (4.0, 15.328_125_000_000_082, 0.319_668_579_101_562_54, 50.071_875),
            (9.0, 36.333_333_333_333_43, 0.695_454_389_574_759_9, 110.816_666_666_666_68),
        ] {
            let waveform = Waveform::optimal(Axis::X, 1.0 / 30.0, &flat(a)).unwrap();
            assert!((flat(a).best_feed_m_s(1.0 / 30.0).unwrap() * 1e3 - v).abs() < 1e-9);
            assert!((waveform.stroke() * 1e3 - stroke).abs() < 1e-9, "{}", waveform.stroke());
            assert!((waveform.peak_speed() * 1e3 - peak).abs() < 1e-9, "{}", waveform.peak_speed());
        }
    }

    #[test]
    fn bad_parameters_are_named_with_their_range() {
        let ss = |t, a, b| Waveform::stick_slip(Axis::X, t, a, b).unwrap_err().to_string();
        let cp = |t, a, z| Waveform::coulomb_pump(Axis::X, t, a, z).unwrap_err().to_string();
        let opt = |d: OptimalDesign| Waveform::optimal(Axis::X, 0.05, &d).unwrap_err().to_string();
        for (text, parameter) in [
            (ss(0.0, 1.0, 2.0), "period_s = 0"),
            (ss(0.05, 2.0, 2.0), "a_max = 2"),
            (ss(0.05, f64::NAN, 2.0), "a_min = NaN"),
            (ss(0.05, 1.0, f64::INFINITY), "a_max = inf"),
            (cp(0.05, 1.0, 0.0), "z = 0"),
            (cp(0.05, 1.0, 1.0), "z = 1"),
            (cp(0.05, -1.0, 0.5), "a = -1"),
            (opt(OptimalDesign { friction: 0.0, ..flat(4.0) }), "friction = 0"),
            (opt(OptimalDesign { slope_rad: 0.3, ..flat(4.0) }), "slope_rad = 0.3"),
            (opt(flat(0.9)), "limit_m_s2 = "),
        ] {
            assert!(text.starts_with(parameter) && text.contains("range"), "{text}");
        }
    }
}
