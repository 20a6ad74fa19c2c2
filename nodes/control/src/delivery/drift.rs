//! Where parts will come to rest: they go on along the tray until the vibration has ended.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use nalgebra::Rotation2;

use super::choice::{CandidateFrame, OfferedPart, angle_rad};
use super::request::Stamp;
use feeder_model::part::Refusals;

/// A part as it was last seen while feeding.
#[derive(Clone, Copy, Debug)]
struct SeenPath {
    stamp: Stamp,
    angle_rad: f64,
    /// Mean angular velocity about the tray's centre, rad/s, once it was seen twice.
    rate_rad_s: Option<f64>,
    /// Whether it was wanted in a frame since feeding began.
    fitted: bool,
}

/// Follows how parts move while feeding, and how far they go on after the order to stop.
#[derive(Clone, Debug)]
pub(super) struct Drift {
    tracks: BTreeMap<u64, SeenPath>,
    /// Time between the order to stop and rest during which parts move on as while feeding, s: the mean of what was seen.
    stop_drift_s: f64,
    /// The order to stop, until the parts have been seen at rest.
    stopped: Option<Stamp>,
    /// Fitting parts that came while feeding, and the time it took, both fading.
    arrived: f64,
    fed_s: f64,
    /// Feeding since the last of them came, or since it began, s.
    lull_s: f64,
}

/// Share of a new observation in a running mean.
const GAIN: f64 = 0.3;
/// Slower parts tell nothing about the time they need to stop, rad/s.
const MOVING_RAD_S: f64 = 0.02;
/// Feeding after which an observation of arrivals counts 1/e, s.
const MEMORY_S: f64 = 60.0;
/// Before anything was seen: one fitting part every two seconds.
const PRIOR_S: f64 = 2.0;

impl Drift {
    pub(super) fn new(stop_drift_s: f64) -> Self {
        Self { tracks: BTreeMap::new(), stop_drift_s, stopped: None, arrived: 0.0, fed_s: 0.0, lull_s: 0.0 }
    }

    /// Feeding begins.
    pub(super) fn start(&mut self) {
        self.tracks.clear();
        self.stopped = None;
        self.lull_s = 0.0;
    }

    /// Takes a frame seen while feeding; `fits` says which parts are wanted.
    pub(super) fn feed(&mut self, frame: &CandidateFrame, fits: impl Fn(&OfferedPart) -> bool) {
        let since = self.tracks.values().map(|track| track.stamp).max();
        let elapsed_s = since.map_or(0.0, |since| frame.stamp.saturating_sub(since).as_secs_f64());
        let fading = (-elapsed_s / MEMORY_S).exp();
        self.fed_s = self.fed_s * fading + elapsed_s;
        self.lull_s += elapsed_s;
        self.arrived *= fading;
        let mut tracks = BTreeMap::new();
        for candidate in &frame.candidates {
            let angle_rad = angle_rad(candidate);
            let known = self.tracks.get(&candidate.id);
            let rate_rad_s = known.and_then(|track| {
                let elapsed_s = frame.stamp.saturating_sub(track.stamp).as_secs_f64();
                let rate_rad_s = turn_rad(track.angle_rad, angle_rad) / elapsed_s;
                let mean_rad_s = track.rate_rad_s.map_or(rate_rad_s, |mean| mean + GAIN * (rate_rad_s - mean));
                (elapsed_s > 0.0).then_some(mean_rad_s)
            });
            let fitted_before = known.is_some_and(|track| track.fitted);
            let fitted = fitted_before || fits(candidate);
            // A part is wanted once its pose is sure, some frames after it came. Those of the first frame lay there.
            if fitted && !fitted_before && since.is_some() {
                self.arrived += 1.0;
                self.lull_s = 0.0;
            }
            tracks.insert(candidate.id, SeenPath { stamp: frame.stamp, angle_rad, rate_rad_s, fitted });
        }
        self.tracks = tracks;
    }

    /// The order to stop is given.
    pub(super) fn stop(&mut self, now: Stamp) {
        self.stopped = Some(now);
    }

    /// Takes the first frame of the parts at rest, and learns from it how long they went on.
    pub(super) fn rest(&mut self, frame: &CandidateFrame) {
        let Some(stopped) = self.stopped.take() else { return };
        let seen = frame.candidates.iter().filter_map(|candidate| {
            let track = self.tracks.get(&candidate.id)?;
            let rate_rad_s = track.rate_rad_s.filter(|rate_rad_s| *rate_rad_s > MOVING_RAD_S)?;
            let moved_s = turn_rad(track.angle_rad, angle_rad(candidate)) / rate_rad_s;
            Some(moved_s - stopped.saturating_sub(track.stamp).as_secs_f64())
        });
        let seen_s: Vec<f64> = seen.collect();
        if !seen_s.is_empty() {
            let mean_s = seen_s.iter().sum::<f64>() / seen_s.len() as f64;
            self.stop_drift_s = (self.stop_drift_s + GAIN * (mean_s - self.stop_drift_s)).clamp(0.0, 2.0);
        }
    }

    /// The parts of a frame where they would come to rest if feeding were stopped now. Those that would go over the
    /// drop-off may not be picked.
    pub(super) fn at_rest(&self, frame: &CandidateFrame, now: Stamp) -> CandidateFrame {
        let on_s = now.saturating_sub(frame.stamp).as_secs_f64() + self.stop_drift_s;
        let candidates = frame.candidates.iter().map(|candidate| {
            let turn_rad = self.rate_rad_s(candidate) * on_s;
            let left_rad = self.way_to_drop_off_rad(candidate);
            let refusals =
                Refusals { off_plateau: candidate.refusals.off_plateau || turn_rad >= left_rad, ..candidate.refusals };
            let position_in_tray_m = Rotation2::new(turn_rad) * candidate.position_in_tray_m;
            OfferedPart { position_in_tray_m, refusals, ..candidate.clone() }
        });
        CandidateFrame { stamp: frame.stamp, candidates: candidates.collect(), is_blind: frame.is_blind }
    }

    /// How long a part will stay on the plateau if feeding goes on, s.
    pub(super) fn stays_s(&self, candidate: &OfferedPart) -> f64 {
        let rate_rad_s = self.rate_rad_s(candidate);
        if rate_rad_s > 0.0 { self.way_to_drop_off_rad(candidate) / rate_rad_s } else { f64::INFINITY }
    }

    /// Mean time between fitting parts that come while feeding, s.
    pub(super) fn interval_s(&self) -> f64 {
        (self.fed_s + PRIOR_S) / (self.arrived + 1.0)
    }

    /// Whether no fitting part has come for much longer than one took to come before.
    pub(super) fn is_lull(&self) -> bool {
        /// So many times as long.
        const PATIENCE: f64 = 3.0;
        let before_s = ((self.fed_s - self.lull_s).max(0.0) + PRIOR_S) / (self.arrived + 1.0);
        self.lull_s > PATIENCE * before_s
    }

    /// How far a part can turn with its whole outline on the plateau, rad.
    fn way_to_drop_off_rad(&self, candidate: &OfferedPart) -> f64 {
        let radius_m = candidate.position_in_tray_m.norm();
        let half_rad = if radius_m > candidate.radius_m { (candidate.radius_m / radius_m).asin() } else { PI };
        TAU - half_rad - angle_rad(candidate)
    }

    /// The part's own angular velocity, or the mean of the others as long as it was seen once only.
    fn rate_rad_s(&self, candidate: &OfferedPart) -> f64 {
        let own = self.tracks.get(&candidate.id).and_then(|track| track.rate_rad_s);
        own.unwrap_or_else(|| {
            let rates: Vec<f64> = self.tracks.values().filter_map(|track| track.rate_rad_s).collect();
            if rates.is_empty() { 0.0 } else { rates.iter().sum::<f64>() / rates.len() as f64 }
        })
    }
}

/// The smaller turn from one angle to another, rad.
pub(super) fn turn_rad(from_rad: f64, to_rad: f64) -> f64 {
    (to_rad - from_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::super::tour::testing::candidate;
    use super::*;

    /// Parts at a radius of 70 mm that turn at a rate.
    fn frame(at_ms: u64, angles_rad: &[(u64, f64)]) -> CandidateFrame {
        let candidates: Vec<OfferedPart> =
            angles_rad.iter().map(|&(id, angle)| candidate(id, 0.07 * angle.cos(), 0.07 * angle.sin())).collect();
        CandidateFrame { stamp: Stamp::from_millis(at_ms), candidates, is_blind: false }
    }

    fn fed(drift: &mut Drift, rate_rad_s: f64) {
        drift.start();
        for step in 0..10_u32 {
            let turned = rate_rad_s * 0.1 * f64::from(step);
            drift.feed(&frame(u64::from(step) * 100, &[(1, 4.0 + turned), (2, 6.0 + turned)]), |_| true);
        }
    }

    #[test]
    fn parts_are_predicted_where_their_own_speed_takes_them() {
        let mut drift = Drift::new(0.4);
        fed(&mut drift, 0.2);
        let last = frame(900, &[(1, 4.18), (2, 6.18)]);
        let rest = drift.at_rest(&last, Stamp::from_millis(1000));
        assert!((angle_rad(&rest.candidates[0]) - 4.28).abs() < 1e-9);
        assert!(rest.candidates[0].refusals.may_be_picked());
        // The outline reaches 2π at 6.2475.
        assert!(rest.candidates[1].refusals.off_plateau);
        assert!((drift.stays_s(&last.candidates[1]) - (TAU - 0.0025_f64.atan2(0.07) - 6.18) / 0.2).abs() < 0.01);
    }

    #[test]
    fn the_time_to_rest_is_learned_from_what_was_seen() {
        let mut drift = Drift::new(0.0);
        for _ in 0..30 {
            fed(&mut drift, 0.2);
            drift.stop(Stamp::from_millis(1000));
            // 0.1 s from the last frame to the order, 0.35 s after it.
            drift.rest(&frame(1800, &[(1, 4.18 + 0.2 * 0.45)]));
        }
        assert!((drift.stop_drift_s - 0.35).abs() < 1e-3, "{}", drift.stop_drift_s);
    }

    #[test]
    fn the_interval_between_fitting_parts_is_learned() {
        let mut drift = Drift::new(0.0);
        assert!((drift.interval_s() - PRIOR_S).abs() < 1e-12);
        drift.start();
        for step in 0..1200_u64 {
            // A new part every 0.5 s, one at a time; one in four fits.
            drift.feed(&frame(step * 100, &[(step / 5, 4.0)]), |candidate| candidate.id % 4 == 0);
        }
        assert!((drift.interval_s() - 2.0).abs() < 0.1, "{}", drift.interval_s());
        // Then every one of them: minutes later what was before counts little.
        for step in 1200..4200_u64 {
            drift.feed(&frame(step * 100, &[(step / 5, 4.0)]), |_| true);
        }
        assert!((drift.interval_s() - 0.5).abs() < 0.05, "{}", drift.interval_s());
    }

    #[test]
    fn a_part_has_come_when_it_is_first_seen_to_fit_once_in_a_feeding() {
        let mut drift = Drift::new(0.0);
        drift.start();
        let lull_s: Vec<f64> = (0..10_u64)
            .map(|step| {
                // One that lies there; and one that comes with the fourth picture and is sure with the seventh, but for one more.
                let parts = [(1, 4.0), (2, 4.5)];
                let fits = |candidate: &OfferedPart| candidate.id == 1 || (step >= 6 && step != 8);
                drift.feed(&frame(step * 100, if step < 3 { &parts[..1] } else { &parts }), fits);
                drift.lull_s
            })
            .collect();
        let expected_s = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.1, 0.2, 0.3];
        assert!(lull_s.iter().zip(expected_s).all(|(seen_s, s)| (seen_s - s).abs() < 1e-9), "{lull_s:?}");
        drift.start();
        assert!(drift.lull_s.abs() < 1e-12);
    }

    #[test]
    fn a_part_is_taken_to_go_on_as_fast_as_it_went_of_late_and_in_this_feeding() {
        let mut drift = Drift::new(0.4);
        fed(&mut drift, 0.2);
        // It slows down to a quarter.
        for step in 0..20_u32 {
            drift.feed(&frame(1000 + u64::from(step) * 100, &[(1, 4.18 + 0.005 * f64::from(step))]), |_| true);
        }
        let part = &frame(3000, &[(1, 4.3)]).candidates[0];
        let way_rad = TAU - (0.0025_f64 / 0.07).asin() - 4.3;
        assert!((drift.stays_s(part) - way_rad / 0.05).abs() < 1.0, "{}", drift.stays_s(part));
        // Nothing is known of it when feeding begins anew: somebody may have moved it.
        drift.start();
        assert!(drift.stays_s(part).is_infinite());
    }

    #[test]
    fn a_part_seen_once_is_taken_to_go_as_fast_as_the_others_do_on_the_mean() {
        let mut drift = Drift::new(0.4);
        for step in 0..10_u32 {
            let s = 0.1 * f64::from(step);
            drift.feed(&frame(u64::from(step) * 100, &[(1, 4.0 + 0.1 * s), (2, 5.0 + 0.3 * s)]), |_| true);
        }
        let new = &frame(1000, &[(3, 4.5)]).candidates[0];
        let way_rad = TAU - (0.0025_f64 / 0.07).asin() - 4.5;
        assert!((drift.stays_s(new) - way_rad / 0.2).abs() < 0.1, "{}", drift.stays_s(new));
    }

    #[test]
    fn the_time_to_rest_is_the_mean_of_what_the_parts_took() {
        let mut drift = Drift::new(0.0);
        for _ in 0..30 {
            fed(&mut drift, 0.2);
            drift.stop(Stamp::from_millis(900));
            drift.rest(&frame(1800, &[(1, 4.18 + 0.2 * 0.3), (2, 6.18 + 0.2 * 0.1)]));
        }
        assert!((drift.stop_drift_s - 0.2).abs() < 1e-3, "{}", drift.stop_drift_s);
    }
}
