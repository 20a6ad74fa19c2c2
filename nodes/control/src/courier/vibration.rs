//! The vibration a waveform asks for, faded in and out so that the courier starts and ends at rest.

use nalgebra::Vector3;

use super::fourier::Fourier;
use super::learning::Instant;
use super::smoothstep::smoothstep;
use crate::courier::limits::Extent;
use feeder_model::range::OutOfRange;
use feeder_model::range::check_range;
use feeder_model::waveform::{Axis, AxisState, Waveform};

/// A vibration with its fades: the periodic motion times an envelope that rises from 0 to 1 over the first
/// `fade_periods` periods and falls back over the last ones.
///
/// The envelope is the smoothstep 10 x³ − 15 x⁴ + 6 x⁵. Position, velocity and acceleration of the product begin and end
/// at zero, so the courier leaves from rest and returns to rest in the same place.
#[derive(Clone, Debug)]
pub(crate) struct Vibration {
    waveform: Waveform,
    /// The band-limited motion, where that and not the exact one is to be followed.
    fourier: Option<Fourier>,
    /// Peaks of position, velocity and acceleration of the steady motion.
    peaks: Vector3<f64>,
    axis: usize,
    fade_s: f64,
}

impl Vibration {
    /// Peaks of the smoothstep's first and second derivative on [0, 1]: 15/8 at the middle, 10/√3.
    const RISE_RATE_PEAK: f64 = 1.875;
    const RISE_CURVATURE_PEAK: f64 = 5.773_502_691_896_258;

    /// A vibration that fades within a period. Its motion is the exact one, or its harmonics up to `cutoff_hz`.
    ///
    /// # Errors
    /// A period that is not between a few servo ticks and a slow shake.
    pub(crate) fn new(waveform: Waveform, cutoff_hz: Option<f64>) -> Result<Self, OutOfRange> {
        let period_s = waveform.period_s();
        check_range("period of the waveform (s)", period_s, 0.005, 1.0)?;
        let axis = match waveform.axis() {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Yaw => 2,
        };
        let fourier = cutoff_hz.map(|cutoff_hz| Fourier::new(&waveform, cutoff_hz));
        let exact = || Vector3::new(waveform.peak_position(), waveform.peak_speed(), waveform.peak_acceleration());
        let peaks = fourier.as_ref().map_or_else(exact, Fourier::peaks);
        Ok(Self { waveform, fourier, peaks, axis, fade_s: period_s })
    }

    pub(crate) fn set_fade_periods(&mut self, periods: u32) {
        self.fade_s = self.waveform.period_s() * f64::from(periods);
    }

    /// What a learner of this vibration needs to know `elapsed_s` after it began at `start_tick`.
    pub(crate) fn instant(&self, start_tick: u64, elapsed_s: f64, fade_out_s: f64) -> Option<Instant<'_>> {
        self.fourier.as_ref().map(|fourier| Instant {
            waveform: &self.waveform,
            fourier,
            axis: self.axis,
            start_tick,
            elapsed_s,
            scale: self.envelope(elapsed_s, fade_out_s).0,
            steady: elapsed_s >= self.fade_s && elapsed_s < fade_out_s,
        })
    }

    pub(crate) fn waveform(&self) -> &Waveform {
        &self.waveform
    }

    pub(crate) fn fade_s(&self) -> f64 {
        self.fade_s
    }

    /// Peaks of the motion on each axis, fades included.
    ///
    /// With s the envelope and q the periodic motion, (s q)'' = s q'' + 2 s' q' + s'' q is bounded by the sum of the
    /// peaks of its terms.
    pub(crate) fn extent(&self) -> Extent {
        let rate_per_s = Self::RISE_RATE_PEAK / self.fade_s;
        let curvature_per_s2 = Self::RISE_CURVATURE_PEAK / (self.fade_s * self.fade_s);
        let [position, velocity, acceleration] = self.peaks.into();
        let mut extent = Extent::default();
        extent.position[self.axis] = position;
        extent.velocity[self.axis] = velocity + rate_per_s * position;
        extent.acceleration[self.axis] = acceleration + 2.0 * rate_per_s * velocity + curvature_per_s2 * position;
        extent
    }

    /// Position and velocity `time_s` after the start, when fading out began, or will, at `fade_out_s`.
    pub(crate) fn at(&self, time_s: f64, fade_out_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (position, velocity) = match &self.fourier {
            Some(fourier) => fourier.at(time_s),
            None => {
                let AxisState { position, velocity, .. } = self.waveform.state_at(time_s);
                (position, velocity)
            }
        };
        let (scale, scale_per_s) = self.envelope(time_s, fade_out_s);
        let mut result = (Vector3::zeros(), Vector3::zeros());
        result.0[self.axis] = scale * position;
        result.1[self.axis] = scale * velocity + scale_per_s * position;
        result
    }

    /// The envelope and its derivative, 1/s.
    fn envelope(&self, time_s: f64, fade_out_s: f64) -> (f64, f64) {
        let (rise, rise_per_s) = smoothstep(time_s, self.fade_s);
        let (fall, fall_per_s) = smoothstep(time_s - fade_out_s, self.fade_s);
        // Fading out begins only after fading in has ended, so one of the two rates is always zero.
        (rise - fall, rise_per_s - fall_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extent_bounds_the_motion_with_its_fades() {
        for (fade_periods, cutoff_hz) in [(1, None), (2, None), (5, None), (1, Some(630.0)), (2, Some(90.0))] {
            let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.87).unwrap();
            let mut vibration = Vibration::new(waveform, cutoff_hz).unwrap();
            vibration.set_fade_periods(fade_periods);
            let extent = vibration.extent();
            let end_s = 2.0 * vibration.fade_s();
            let step_s = 1e-5;
            let mut last = vibration.at(0.0, vibration.fade_s()).1.z;
            let mut time_s = 0.0;
            while time_s < end_s {
                time_s += step_s;
                let (position, velocity) = vibration.at(time_s, vibration.fade_s());
                assert!(position.z.abs() <= extent.position.z && velocity.z.abs() <= extent.velocity.z);
                assert!((velocity.z - last).abs() <= extent.acceleration.z * step_s * (1.0 + 1e-9));
                last = velocity.z;
            }
            let (position, velocity) = vibration.at(end_s, vibration.fade_s());
            assert!(position.norm() < 1e-15 && velocity.norm() < 1e-12);
        }
    }

    #[test]
    fn a_period_out_of_range_is_refused() {
        let slow = Waveform::stick_slip(Axis::X, 2.0, 1.0, 2.0).unwrap();
        assert!(Vibration::new(slow, None).is_err());
    }
}
