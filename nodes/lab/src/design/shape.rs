//! Waveforms as points of a space without constraints, for a search.

use std::ops::Range;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use feeder_model::range::OutOfRange;
use feeder_model::waveform::{Axis, AxisLimits, OptimalDesign, Segment, Waveform};

/// Turns 2 K numbers into a closed waveform of K segments with |a| ≤ limit, whatever the numbers.
///
/// The first K numbers are logarithms of durations, the others accelerations over the limit, clamped to ±1. Durations of
/// the backward segments are then scaled as a whole so that the waveform closes, and all durations so that they add up to
/// the period.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShapeSpace {
    pub(super) axis: Axis,
    pub(super) segments: usize,
    pub(super) limit: f64,
}

impl ShapeSpace {
    /// How far to vary each coordinate at first.
    pub(super) fn step_by(&self) -> Vec<f64> {
        [vec![0.3; self.segments], vec![0.2; self.segments]].concat()
    }

    /// The waveform at a point; `None` if it has no forward or no backward segment.
    pub(super) fn waveform(&self, point: &[f64], period_s: f64) -> Option<Waveform> {
        let (durations, accelerations) = point.split_at(self.segments);
        let share = |sign: f64| -> f64 {
            durations.iter().zip(accelerations).map(|(d, a)| d.exp() * (a.clamp(-1.0, 1.0) * sign).max(0.0)).sum()
        };
        let backward_scale = share(1.0) / share(-1.0);
        if !(backward_scale > 0.0 && backward_scale.is_finite()) {
            return None;
        }
        let raw = |d: f64, a: f64| d.exp() * if a < 0.0 { backward_scale } else { 1.0 };
        let total: f64 = durations.iter().zip(accelerations).map(|(d, a)| raw(*d, *a)).sum();
        let segments = durations.iter().zip(accelerations).map(|(&d, &a)| Segment {
            duration_s: raw(d, a) / total * period_s,
            acceleration: a.clamp(-1.0, 1.0) * self.limit,
        });
        Waveform::new(self.axis, segments.collect()).ok()
    }

    /// A random point.
    pub(super) fn random_point(&self, random: &mut Pcg64Mcg) -> Vec<f64> {
        let mut numbers = |range: Range<f64>| -> Vec<f64> {
            (0..self.segments).map(|_| random.random_range(range.clone())).collect()
        };
        [numbers(-2.0..0.0), numbers(-1.2..1.2)].concat()
    }

    /// A point that stands for a waveform, or nearly so: one with fewer segments has its longest ones split, of one with
    /// more the tail is lost.
    pub(super) fn point(&self, waveform: &Waveform) -> Vec<f64> {
        let mut segments = waveform.segments().to_vec();
        while segments.len() < self.segments {
            let longest =
                (0..segments.len()).max_by(|&i, &j| segments[i].duration_s.total_cmp(&segments[j].duration_s));
            let longest = longest.unwrap_or(0);
            segments[longest].duration_s /= 2.0;
            segments.insert(longest, segments[longest]);
        }
        segments.truncate(self.segments);
        let durations = segments.iter().map(|s| (s.duration_s / waveform.period_s()).ln());
        durations.chain(segments.iter().map(|s| s.acceleration / self.limit)).collect()
    }
}

/// The waveform made smaller, if need be, until it keeps to the limits of speed and stroke.
pub(super) fn tamed(waveform: Waveform, limits: &AxisLimits) -> Option<Waveform> {
    let factor = (limits.max_speed / waveform.peak_speed()).min(limits.max_stroke / waveform.stroke());
    if factor < 1.0 { waveform.scaled(factor).ok() } else { Some(waveform) }
}

/// The optimal waveform on an axis of the given lever.
pub(super) fn closed_form(axis: Axis, lever: f64, period_s: f64, design: &OptimalDesign) -> Option<Waveform> {
    Waveform::optimal(axis, period_s, design).ok()?.scaled(1.0 / lever).ok()
}

/// Checks the limits of an axis; speed and stroke may be infinite.
pub(super) fn check_limits(limits: &AxisLimits) -> Result<(), OutOfRange> {
    OutOfRange::unless_positive("max_acceleration", limits.max_acceleration)?;
    for (parameter, value) in [("max_speed", limits.max_speed), ("max_stroke", limits.max_stroke)] {
        OutOfRange::unless(value > 0.0, parameter, value.min(f64::MAX), "above 0")?;
    }
    Ok(())
}
