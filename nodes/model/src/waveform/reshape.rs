//! What becomes of a waveform on its way to the tray: another axis or amplitude, limited slew, servo sampling.

use super::{Axis, Segment, Waveform, WaveformError};
use crate::range::OutOfRange;

impl Waveform {
    /// The same shape with accelerations multiplied by a positive `factor`: 1/r turns m/s² at radius r into rad/s².
    ///
    /// # Errors
    ///
    /// If `factor` is not positive and finite.
    pub fn scaled(&self, factor: f64) -> Result<Self, WaveformError> {
        OutOfRange::unless_positive("factor", factor)?;
        let segments = self.segments.iter().map(|s| Segment { acceleration: s.acceleration * factor, ..*s });
        Self::new(self.axis, segments.collect())
    }

    /// The same waveform on another axis, numbers unchanged.
    #[must_use]
    pub fn on_axis(self, axis: Axis) -> Self {
        Self { axis, ..self }
    }

    /// The waveform of an amplifier that needs `slew_s` to change the acceleration: every jump becomes a ramp of that
    /// duration centred on it, written as a staircase of `steps` equal treads.
    ///
    /// This is the moving average of the acceleration over `slew_s`, so that jumps closer than `slew_s` blend. The
    /// staircase has the exact velocity where its treads meet.
    ///
    /// # Errors
    ///
    /// If `slew_s` is not within (0, period), or `steps` is 0.
    pub fn slew_limited(&self, slew_s: f64, steps: u32) -> Result<Self, WaveformError> {
        let period_s = self.period_s();
        OutOfRange::unless(
            slew_s > 0.0 && slew_s < period_s,
            "slew_s",
            slew_s,
            format_args!("0 < slew_s < {period_s}"),
        )?;
        OutOfRange::unless(steps > 0, "steps", f64::from(steps), "at least 1")?;
        let mut edges: Vec<f64> = self
            .jumps_s()
            .flat_map(|jump_s| (0..=steps).map(move |i| jump_s + slew_s * (f64::from(i) / f64::from(steps) - 0.5)))
            .map(|edge_s| edge_s.rem_euclid(period_s))
            .chain([0.0, period_s])
            .collect();
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|later, earlier| *later - *earlier < period_s * 1e-12);
        // The last edge must be the end of the period, whichever of two equal edges was kept.
        if let Some(last) = edges.last_mut() {
            *last = period_s;
        }
        let half = slew_s / 2.0;
        let velocity = |t: f64| (self.state_at(t + half).position - self.state_at(t - half).position) / slew_s;
        self.between(&edges, velocity)
    }

    /// The waveform a servo holds: the mean acceleration of each sample, over the fewest whole periods that are a whole
    /// number of samples. T = 1/30 s at 2 kHz is 66.67 samples, so what comes back spans three periods.
    ///
    /// # Errors
    ///
    /// If `sample_s` is not within (0, period], or no number of periods up to 60 is a whole number of samples within 1e-9.
    pub fn servo_sampled(&self, sample_s: f64) -> Result<Self, WaveformError> {
        const PERIODS_MAX: u32 = 60;
        let period_s = self.period_s();
        OutOfRange::unless(
            sample_s > 0.0 && sample_s <= period_s,
            "sample_s",
            sample_s,
            format_args!("0 < sample_s ≤ {period_s}"),
        )?;
        let whole = (1..=PERIODS_MAX)
            .map(|n| f64::from(n) * period_s / sample_s)
            .find(|samples| (samples - samples.round()).abs() < 1e-9 * samples);
        let samples = whole.ok_or_else(|| {
            let allowed = format_args!("a whole number of samples in {PERIODS_MAX} periods of {period_s} s or fewer");
            OutOfRange::new("sample_s", sample_s, allowed)
        })?;
        let edges: Vec<f64> =
            (0u32..).map(f64::from).take_while(|&i| i <= samples.round()).map(|i| i * sample_s).collect();
        self.between(&edges, |t| self.state_at(t).velocity)
    }

    /// Times within the period at which the acceleration jumps.
    fn jumps_s(&self) -> impl Iterator<Item = f64> {
        let before = self.segments.iter().cycle().skip(self.segments.len() - 1);
        self.segments
            .iter()
            .zip(before)
            .scan(0.0, |start_s, (segment, before)| {
                let jump = (*start_s, (segment.acceleration - before.acceleration).abs());
                *start_s += segment.duration_s;
                Some(jump)
            })
            .filter(|&(_, height)| height > 0.0)
            .map(|(start_s, _)| start_s)
    }

    /// Piecewise-constant acceleration that gives the periodic `velocity` at every edge.
    fn between(&self, edges_s: &[f64], velocity: impl Fn(f64) -> f64) -> Result<Self, WaveformError> {
        let count = edges_s.len() - 1;
        let speeds: Vec<f64> = edges_s[..count].iter().map(|&t| velocity(t)).collect();
        let segments = (0..count).map(|i| {
            let duration_s = edges_s[i + 1] - edges_s[i];
            Segment { duration_s, acceleration: (speeds[(i + 1) % count] - speeds[i]) / duration_s }
        });
        Self::new(self.axis, segments.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn servo_sampling_spans_three_periods_of_a_thirtieth() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 9.0, 66.7).unwrap();
        let sampled = waveform.servo_sampled(5e-4).unwrap();
        assert_eq!(sampled.segments().len(), 200);
        assert!((sampled.period_s() - 0.1).abs() < 1e-12);
        for i in [0, 17, 66, 67, 133, 199] {
            let t = f64::from(i) * 5e-4;
            assert!((sampled.state_at(t).velocity - waveform.state_at(t).velocity).abs() < 1e-6, "sample {i}");
        }
        assert!(waveform.servo_sampled(3.141_592_65e-4).unwrap_err().to_string().contains("sample_s"));
    }

    #[test]
    fn slew_keeps_the_velocity_away_from_the_ramps_and_rounds_the_corners() {
        let waveform = Waveform::coulomb_pump(Axis::X, 0.05, 10.3, 0.37).unwrap();
        let slewed = waveform.slew_limited(1e-3, 8).unwrap();
        assert!((slewed.period_s() - 0.05).abs() < 1e-15);
        for t in [0.002, 0.01, 0.02, 0.03, 0.045] {
            assert!((slewed.state_at(t).velocity - waveform.state_at(t).velocity).abs() < 1e-9, "at {t}");
        }
        assert!(slewed.peak_speed() < waveform.peak_speed());
        // Half-way along a ramp the acceleration is the mean of both sides: −10.3 and +10.3 meet at the period's end.
        assert!((slewed.mean_acceleration(-5e-4, 1e-3)).abs() < 1e-9);
    }

    #[test]
    fn scaling_by_one_over_r_gives_the_yaw_waveform() {
        let linear = Waveform::stick_slip(Axis::X, 0.05, 1.6, 10.1).unwrap();
        let yaw = linear.scaled(1.0 / 0.09).unwrap().on_axis(Axis::Yaw);
        assert_eq!(yaw.axis(), Axis::Yaw);
        assert!((yaw.stroke() * 0.09 - linear.stroke()).abs() < 1e-15);
        assert!(linear.scaled(0.0).is_err());
    }
}
