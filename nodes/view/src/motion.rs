//! How the tray moves within a period: what was commanded, what it did, and how the difference gets on.

use std::collections::VecDeque;

use feeder_model::motion::MotionBlock;
use feeder_model::waveform::{Axis, Waveform};
use feeder_wire::tray_motion;
use minifactory_msgs::msg::TrayMotion;
use serde_json::{Value, json};

use crate::description::axis_name;
use crate::frame::time_s;
use crate::numbers::{coarse, fine, radians, seconds};

/// Periods whose errors are kept.
const ERRORS_MAX: usize = 200;
/// The tray follows a waveform when it moves with at least this share of its rms velocity.
const FOLLOWING_SHARE: f64 = 0.5;
/// A vibration fades in and out over about so many periods, in which the tray is not meant to follow its waveform.
const FADE_PERIODS: usize = 2;
/// Longest period that is looked at, samples.
const PERIOD_SAMPLES_MAX: usize = 4000;
/// Samples that do not follow within this share of a period are another stretch of motion.
const GAP_SHARE: f64 = 0.5;

/// A sample of the vibrating axis.
#[derive(Clone, Copy, Debug)]
struct Moved {
    velocity: f64,
    acceleration: f64,
}

/// How far the tray was off its waveform in a period, rms.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PeriodError {
    time_s: f64,
    velocity: f64,
    acceleration: f64,
}

/// The newest whole period.
#[derive(Clone, Debug)]
struct Period {
    start_s: f64,
    moved: Vec<Moved>,
    /// What was commanded, when the tray follows a waveform.
    commanded: Option<Vec<Moved>>,
}

/// The motion of one tray.
pub(crate) struct MotionLog {
    axis: Axis,
    period_s: f64,
    sample_s: f64,
    /// The waveform at every sample of a period, beginning with its own beginning.
    commanded: Vec<Moved>,
    /// When the samples begin that are not yet a period, and they.
    start_s: f64,
    samples: Vec<Moved>,
    newest: Option<Period>,
    errors: VecDeque<PeriodError>,
    /// Periods in a row in which the tray has followed its waveform.
    following: usize,
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value * value, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

impl MotionLog {
    /// Nothing has moved yet; this waveform is expected, at a servo with this period.
    pub(crate) fn new(waveform: &Waveform, sample_s: f64) -> Self {
        let mut log = Self {
            axis: waveform.axis(),
            period_s: waveform.period_s(),
            sample_s,
            commanded: Vec::new(),
            start_s: 0.0,
            samples: Vec::new(),
            newest: None,
            errors: VecDeque::new(),
            following: 0,
        };
        log.expect(waveform);
        log
    }

    /// Another waveform is commanded.
    pub(crate) fn expect(&mut self, waveform: &Waveform) {
        (self.axis, self.period_s) = (waveform.axis(), waveform.period_s());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, and is never negative")]
        let samples = ((self.period_s / self.sample_s).round() as usize).clamp(1, PERIOD_SAMPLES_MAX);
        let at = |index: usize| {
            let state = waveform.state_at(index as f64 * self.sample_s);
            Moved {
                velocity: state.velocity,
                acceleration: waveform.mean_acceleration(index as f64 * self.sample_s, self.sample_s),
            }
        };
        self.commanded = (0..samples).map(at).collect();
        self.samples.clear();
        self.newest = None;
    }

    /// Takes in a block of motion; true when it completes a period.
    pub(crate) fn hear(&mut self, message: &TrayMotion) -> bool {
        let Ok(block) = tray_motion::from_message(message) else { return false };
        let at_s = time_s(&message.header.stamp);
        self.take(at_s, &block)
    }

    fn take(&mut self, at_s: f64, block: &MotionBlock) -> bool {
        let expected_s = self.start_s + self.samples.len() as f64 * self.sample_s;
        let follows = (at_s - expected_s).abs() < GAP_SHARE * self.sample_s;
        if !follows {
            self.samples.clear();
            self.following = 0;
            self.start_s = at_s;
        }
        let axis = match self.axis {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Yaw => 2,
        };
        self.samples.extend(
            block
                .samples
                .iter()
                .map(|sample| Moved { velocity: sample.velocity[axis], acceleration: sample.acceleration[axis] }),
        );
        let mut completed = false;
        while self.samples.len() >= self.commanded.len() {
            let moved: Vec<Moved> = self.samples.drain(..self.commanded.len()).collect();
            let start_s = self.start_s;
            self.start_s += moved.len() as f64 * self.sample_s;
            self.complete(start_s, moved);
            completed = true;
        }
        completed
    }

    fn complete(&mut self, start_s: f64, moved: Vec<Moved>) {
        let commanded = self.fitted(&moved);
        if commanded.is_some() {
            self.following += 1;
        } else {
            // The last ones were those of a fade.
            let counted = std::mem::take(&mut self.following).saturating_sub(FADE_PERIODS);
            self.errors.truncate(self.errors.len() - counted.min(FADE_PERIODS).min(self.errors.len()));
        }
        if let Some(commanded) = commanded.as_ref().filter(|_| self.following > FADE_PERIODS) {
            let pairs = || commanded.iter().zip(&moved);
            if self.errors.len() == ERRORS_MAX {
                self.errors.pop_front();
            }
            self.errors.push_back(PeriodError {
                time_s: start_s,
                velocity: rms(pairs().map(|(wanted, was)| wanted.velocity - was.velocity)),
                acceleration: rms(pairs().map(|(wanted, was)| wanted.acceleration - was.acceleration)),
            });
        }
        self.newest = Some(Period { start_s, moved, commanded });
    }

    /// The waveform, turned to where it fits the motion best: nobody says when its period began. Nothing where the tray
    /// does not follow it.
    fn fitted(&self, moved: &[Moved]) -> Option<Vec<Moved>> {
        let count = self.commanded.len();
        let wanted_rms = rms(self.commanded.iter().map(|sample| sample.velocity));
        let mean = moved.iter().map(|sample| sample.velocity).sum::<f64>() / count as f64;
        // Without its mean: a courier that travels does not follow its waveform for that.
        if rms(moved.iter().map(|sample| sample.velocity - mean)) < FOLLOWING_SHARE * wanted_rms {
            return None;
        }
        let misfit = |shift: usize| -> f64 {
            let turned = self.commanded[shift..].iter().chain(&self.commanded[..shift]);
            turned.zip(moved).map(|(wanted, was)| (wanted.velocity - was.velocity).powi(2)).sum()
        };
        let best = (0..count).map(|shift| (shift, misfit(shift))).min_by(|a, b| a.1.total_cmp(&b.1))?.0;
        Some(self.commanded[best..].iter().chain(&self.commanded[..best]).copied().collect())
    }

    /// The message of the newest period.
    pub(crate) fn message(&self, feeder: &str) -> Option<Value> {
        let Period { start_s, moved, commanded } = self.newest.as_ref()?;
        let velocities = |samples: &[Moved]| samples.iter().map(|sample| radians(sample.velocity)).collect::<Vec<_>>();
        let accelerations =
            |samples: &[Moved]| samples.iter().map(|sample| coarse(sample.acceleration)).collect::<Vec<_>>();
        let errors = |value: fn(&PeriodError) -> f64| self.errors.iter().map(value).collect::<Vec<_>>();
        Some(json!({
            "type": "motion",
            "feeder": feeder,
            "axis": axis_name(self.axis),
            "period_s": self.period_s,
            "start_s": seconds(*start_s),
            "sample_period_s": self.sample_s,
            "commanded_velocity": commanded.as_deref().map(velocities),
            "commanded_acceleration": commanded.as_deref().map(accelerations),
            "actual_velocity": velocities(moved),
            "actual_acceleration": accelerations(moved),
            "errors": {
                "time_s": errors(|error| seconds(error.time_s)),
                "velocity_rms": errors(|error| fine(error.velocity)),
                "acceleration_rms": errors(|error| coarse(error.acceleration)),
            },
        }))
    }
}

/// A block of motion, every sample.
pub(crate) fn servo_message(feeder: &str, message: &TrayMotion) -> Value {
    let each = |values: &[f64], rounded: fn(f64) -> f64| values.iter().map(|value| rounded(*value)).collect::<Vec<_>>();
    json!({
        "type": "servo",
        "feeder": feeder,
        "start_s": seconds(time_s(&message.header.stamp)),
        "sample_period_s": message.sample_period_s,
        "x_m": each(&message.x_m, fine),
        "y_m": each(&message.y_m, fine),
        "yaw_rad": each(&message.yaw_rad, fine),
        "vx_m_s": each(&message.vx_m_s, radians),
        "vy_m_s": each(&message.vy_m_s, radians),
        "yaw_rate_rad_s": each(&message.yaw_rate_rad_s, radians),
        "ax_m_s2": each(&message.ax_m_s2, coarse),
        "ay_m_s2": each(&message.ay_m_s2, coarse),
        "yaw_acceleration_rad_s2": each(&message.yaw_acceleration_rad_s2, coarse),
    })
}

#[cfg(test)]
mod tests {
    use feeder_model::motion::MotionSample;
    use nalgebra::Vector3;

    use super::*;

    const SAMPLE_S: f64 = 5e-4;

    /// A block of a tray that follows a waveform but for a factor, from a sample on, with the waveform's period begun
    /// `late` samples after the run.
    fn block(waveform: &Waveform, factor: f64, first: usize, late: usize) -> MotionBlock {
        let sample = |index: usize| {
            let state = waveform.state_at((index + 200 - late) as f64 * SAMPLE_S);
            let only_yaw = |value: f64| Vector3::new(0.0, 0.0, factor * value);
            MotionSample {
                position: only_yaw(state.position),
                velocity: only_yaw(state.velocity),
                acceleration: only_yaw(state.acceleration),
            }
        };
        MotionBlock { sample_period_s: SAMPLE_S, samples: (first..first + 20).map(sample).collect() }
    }

    fn follow(
        log: &mut MotionLog,
        waveform: &Waveform,
        factor: f64,
        late: usize,
        blocks: std::ops::Range<usize>,
    ) -> usize {
        blocks.filter(|index| log.take(*index as f64 * 0.01, &block(waveform, factor, 20 * index, late))).count()
    }

    #[test]
    fn the_error_of_a_period_is_what_the_tray_is_off_its_waveform_whenever_that_began() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 0.1, 9.0, 66.7).unwrap();
        let mut log = MotionLog::new(&waveform, SAMPLE_S);
        assert!(log.message("feeder").is_none());
        assert_eq!(follow(&mut log, &waveform, 1.0, 37, 0..40), 4);
        assert_eq!(log.errors.len(), 2, "the first two may be those of a fade");
        let exact = log.errors.back().unwrap().velocity;
        assert!(exact < 1e-9, "{exact}");
        assert_eq!(follow(&mut log, &waveform, 0.9, 37, 40..50), 1);
        let wanted = rms(log.commanded.iter().map(|sample| sample.velocity));
        let off = log.errors.back().unwrap().velocity;
        assert!((off - 0.1 * wanted).abs() < 1e-6, "{off} of {wanted}");
        let message = log.message("feeder").unwrap();
        assert_eq!(message["start_s"], json!(0.4));
        assert_eq!(message["commanded_velocity"].as_array().unwrap().len(), 200);
        assert_eq!(follow(&mut log, &waveform, 0.0, 37, 50..60), 1);
        assert_eq!(log.errors.len(), 1, "the last two may be those of a fade");
    }

    #[test]
    fn a_tray_at_rest_has_no_error_and_a_gap_begins_another_period() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 0.1, 9.0, 66.7).unwrap();
        let mut log = MotionLog::new(&waveform, SAMPLE_S);
        assert_eq!(follow(&mut log, &waveform, 0.0, 0, 0..10), 1);
        assert!(log.errors.is_empty());
        assert_eq!(log.message("feeder").unwrap()["commanded_velocity"], Value::Null);
        assert_eq!(follow(&mut log, &waveform, 1.0, 0, 10..15), 0);
        assert_eq!(follow(&mut log, &waveform, 1.0, 0, 17..26), 0, "two blocks were lost: nothing is a whole period");
        assert_eq!(follow(&mut log, &waveform, 1.0, 0, 26..27), 1);
        assert_eq!(log.message("feeder").unwrap()["start_s"], json!(0.17));
    }
}
