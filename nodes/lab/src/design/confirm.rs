//! The flow of a design once more, with the two-dimensional engine instead of the local slope.

use std::f64::consts::PI;

use super::flow::{Flow, Lane};
use feeder_model::mechanics::MechanicsError;
use feeder_model::mechanics::annular::{AnnularTrack, PartState};
use feeder_model::motion::MotionSample;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::Waveform;

/// Places of entry tried.
const PLACES: u32 = 24;
/// Whole hops before the crest at which parts start.
const HOPS_BEFORE: f64 = 3.0;
/// Samples per period, or a few more so that they end with the segments.
const SAMPLES: u32 = 1000;
/// Periods after the last part passed the crest that are given to settle.
const SETTLING_PERIODS: u32 = 8;
/// Periods over which mean speeds are taken.
const SPEED_PERIODS: u32 = 30;
/// Periods after which a part that has not passed the crest never will.
const PERIODS_MAX: u32 = 100_000;

/// What `flow` predicts for parts `length_m` long, measured on pairs of parts that go over the crest `flow`'s ramp
/// spacing apart, pressed by centrifugal force against the outer wall, which has no friction. `None` if they do not
/// arrive on the plateau.
///
/// # Errors
///
/// If the lane is off the tray, a part leaves the surface, or the waveform does not drive the yaw axis.
pub fn flow_in_two_dimensions(
    track: &AnnularTrack,
    waveform: &Waveform,
    length_m: f64,
    flow: &Flow,
) -> Result<Option<Flow>, MechanicsError> {
    let lane = Lane::new(track, waveform, length_m)?;
    let Some(ramp) = lane.ramp.steady() else {
        return Ok(None);
    };
    let radius_m = track.tray().outer_radius_m - length_m / 2.0;
    let pair = Pair {
        track: AnnularTrack::new(like_near_the_crest(track.tray(), radius_m), track.friction(), track.gravity_m_s2())?,
        samples: waveform.samples(SAMPLES),
        ramp_start_m_s: ramp.start_m_s,
        radius_m,
    };
    let period_s = waveform.period_s();
    let apart_m = flow.ramp_spacing_parts * length_m;
    let hop_m = flow.ramp_m_s * period_s;
    let (mut spacing_m, mut plateau_m_s) = (f64::INFINITY, f64::NAN);
    for place in 1..=PLACES {
        let before_m = hop_m * (HOPS_BEFORE + f64::from(place) / f64::from(PLACES));
        let Some((gap_m, speed_m_s)) = pair.over_the_crest(before_m, apart_m, period_s) else {
            return Ok(None);
        };
        spacing_m = spacing_m.min(gap_m);
        plateau_m_s = speed_m_s;
    }
    let ramp_m_s = pair.ramp_speed_m_s(period_s);
    Ok(Some(Flow {
        ramp_m_s,
        plateau_m_s,
        plateau_spacing_parts: spacing_m / length_m,
        parts_per_min: 60.0 * ramp_m_s / apart_m,
        ..*flow
    }))
}

/// Two parts on the same lane.
struct Pair {
    track: AnnularTrack,
    samples: Vec<(MotionSample, f64)>,
    ramp_start_m_s: f64,
    radius_m: f64,
}

impl Pair {
    fn run(&self, part: &mut PartState) {
        for (motion, sample_s) in &self.samples {
            self.track.step(part, motion, *sample_s);
        }
    }

    /// A part in steady motion on the ramp at the start of a period, an arc of `before_m` before the crest.
    fn climbing(&self, before_m: f64) -> PartState {
        let angle_rad = self.track.tray().ramp_angle_rad - before_m / self.radius_m;
        PartState { along_m_s: self.ramp_start_m_s, ..PartState::at_rest(self.radius_m, angle_rad) }
    }

    /// The smaller of the arcs between two parts one hop past the crest and after settling, and their speed then.
    fn over_the_crest(&self, before_m: f64, apart_m: f64, period_s: f64) -> Option<(f64, f64)> {
        let (mut first, mut second) = (self.climbing(before_m), self.climbing(before_m + apart_m));
        let crest_rad = self.track.tray().ramp_angle_rad;
        let passed = (0..PERIODS_MAX).any(|_| {
            self.run(&mut first);
            self.run(&mut second);
            second.angle_rad > crest_rad
        });
        if !passed {
            return None;
        }
        let mut gap_m = f64::INFINITY;
        for period in 1..=SETTLING_PERIODS {
            self.run(&mut first);
            self.run(&mut second);
            if period == 1 || period == SETTLING_PERIODS {
                gap_m = gap_m.min((first.angle_rad - second.angle_rad) * self.radius_m);
            }
        }
        let start_rad = first.angle_rad;
        self.run(&mut first);
        Some((gap_m, (first.angle_rad - start_rad) * self.radius_m / period_s))
    }

    fn ramp_speed_m_s(&self, period_s: f64) -> f64 {
        let middle_m = self.track.tray().ramp_angle_rad * self.radius_m / 2.0;
        let mut part = self.climbing(middle_m);
        let mut covered_rad = 0.0;
        for _ in 0..SPEED_PERIODS {
            let start_rad = part.angle_rad;
            self.run(&mut part);
            covered_rad += part.angle_rad - start_rad;
            part.angle_rad = start_rad;
        }
        covered_rad * self.radius_m / (f64::from(SPEED_PERIODS) * period_s)
    }
}

/// A tray with the same slopes and a wall for the centres of parts in the lane at `radius_m`, but half of it plateau, so
/// that there is room to settle.
fn like_near_the_crest(tray: &TrayGeometry, radius_m: f64) -> TrayGeometry {
    TrayGeometry { outer_radius_m: radius_m, ramp_angle_rad: PI, rise_m: tray.pitch_m_per_rad() * PI, ..*tray }
}
