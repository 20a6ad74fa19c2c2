//! Follows parts from frame to frame in the tray frame.

use nalgebra::{Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Candidate;
use super::detector::yaw_difference_rad;
use super::evidence::Evidence;
use super::filter::Filter;
use super::flow::{Lying, common_turn_rad};
use feeder_model::range::{OutOfRange, check_ranges};

/// How parts are followed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerConfig {
    /// A part this far from where it was expected is another part, m.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub gate_m: f64,
    /// Parts are followed up to this speed of feed, m/s.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub feed_m_s_max: f64,
    /// Frames in a row a part may be missed before it is forgotten.
    pub missed_max: u32,
    /// What a frame's evidence for a pose still counts one frame later, 0 to below 1.
    #[schemars(range(min = 0.0, max = 0.999))]
    pub memory: f64,
    /// Standard deviation of a measured place, m.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub measurement_sigma_m: f64,
    /// Standard deviation of the acceleration that parts undergo averaged over frames, m/s².
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub acceleration_sigma_m_s2: f64,
    /// Standard deviation of the velocity of a part just seen first, m/s.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub velocity_sigma_m_s: f64,
    /// Standard deviation of a measured yaw, rad.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub yaw_sigma_rad: f64,
    /// Standard deviation of the angular acceleration that parts undergo averaged over frames, rad/s².
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub yaw_acceleration_sigma_rad_s2: f64,
    /// Standard deviation of the yaw rate of a part just seen first, rad/s.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub yaw_rate_sigma_rad_s: f64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            gate_m: 0.003,
            feed_m_s_max: 0.15,
            missed_max: 5,
            memory: 0.8,
            measurement_sigma_m: 0.000_1,
            acceleration_sigma_m_s2: 0.02,
            velocity_sigma_m_s: 0.02,
            yaw_sigma_rad: 0.015,
            yaw_acceleration_sigma_rad_s2: 2.0,
            yaw_rate_sigma_rad_s: 1.0,
        }
    }
}

impl TrackerConfig {
    pub(super) fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("selector.tracker.", self)
    }
}

/// A part followed over frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedCandidate {
    /// Identity: the same from frame to frame, never given twice.
    pub id: u64,
    /// When it was seen, s.
    pub stamp_s: f64,
    /// What the latest frame shows of it.
    pub candidate: Candidate,
    /// Place in the tray frame, smoothed over frames, m.
    pub position_m: Point2<f64>,
    /// Velocity in the tray frame, m/s.
    pub velocity_m_s: Vector2<f64>,
    /// Yaw in the tray frame, smoothed over frames, rad; `None` if it looks the same from all sides.
    pub yaw_rad: Option<f64>,
    /// Yaw rate in the tray frame, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Resting pose, from all frames.
    pub pose: Option<usize>,
    /// How sure the pose is, from all frames, 0 to 1.
    pub confidence: f64,
    /// Frames that showed it.
    pub frames_seen: u32,
}

impl TrackedCandidate {
    /// Where the part is expected at `stamp_s`, tray frame, m.
    #[must_use]
    pub fn predict(&self, stamp_s: f64) -> Point2<f64> {
        self.position_m + self.velocity_m_s * (stamp_s - self.stamp_s)
    }

    /// The yaw expected at `stamp_s`, tray frame, rad.
    #[must_use]
    pub fn predict_yaw_rad(&self, stamp_s: f64) -> Option<f64> {
        self.yaw_rad.map(|yaw_rad| yaw_rad + self.yaw_rate_rad_s * (stamp_s - self.stamp_s))
    }
}

/// A track: where the part is, how it is turned, and evidence for its pose.
#[derive(Clone, Debug)]
struct Track {
    id: u64,
    stamp_s: f64,
    place: Filter<2>,
    /// With the taught pose whose yaw it is: another pose's yaw counts from another direction.
    yaw: Option<(usize, Filter<1>)>,
    evidence: Evidence,
    frames_seen: u32,
    missed: u32,
}

impl Track {
    fn start(id: u64, stamp_s: f64, candidate: &Candidate, pose_count: usize, config: &TrackerConfig) -> Self {
        let place = [candidate.x_m, candidate.y_m];
        let mut track = Self {
            id,
            stamp_s,
            place: Filter::start(place, config.measurement_sigma_m, config.velocity_sigma_m_s),
            yaw: None,
            evidence: Evidence::new(pose_count),
            frames_seen: 0,
            missed: 0,
        };
        track.start_yaw(candidate, config);
        track
    }

    fn start_yaw(&mut self, candidate: &Candidate, config: &TrackerConfig) {
        self.yaw = candidate.yaw_rad.map(|yaw_rad| {
            let filter = Filter::start([yaw_rad], config.yaw_sigma_rad, config.yaw_rate_sigma_rad_s);
            (candidate.likeness, filter)
        });
    }

    fn position(&self) -> Point2<f64> {
        Point2::from(self.place.value)
    }

    fn predict(&mut self, stamp_s: f64, config: &TrackerConfig) {
        let dt = (stamp_s - self.stamp_s).max(0.0);
        self.stamp_s = stamp_s;
        self.place.predict(dt, config.acceleration_sigma_m_s2);
        if let Some((_, filter)) = &mut self.yaw {
            filter.predict(dt, config.yaw_acceleration_sigma_rad_s2);
        }
    }

    fn correct(&mut self, candidate: &Candidate, symmetries: &[u32], config: &TrackerConfig) {
        let innovation = candidate.centre() - self.position();
        self.place.correct(innovation.into(), config.measurement_sigma_m);
        match (&mut self.yaw, candidate.yaw_rad) {
            (Some((pose, filter)), Some(yaw_rad)) if *pose == candidate.likeness => {
                let symmetry = symmetries.get(*pose).copied().unwrap_or(1);
                let miss_rad = yaw_difference_rad(yaw_rad, filter.value[0], symmetry);
                filter.correct([miss_rad], config.yaw_sigma_rad);
            }
            _ => self.start_yaw(candidate, config),
        }
        self.missed = 0;
    }
}

/// The velocity of a place that turns about the tray's axis, m/s.
fn turned(place: Point2<f64>, turn_rad_s: f64) -> [f64; 2] {
    [-turn_rad_s * place.y, turn_rad_s * place.x]
}

/// Parts that were fed unseen for longer than this are not known again, ms.
pub const UNSEEN_MS_MAX: u64 = 500;
/// The same, s, with what stamps are rounded by.
const UNSEEN_S_MAX: f64 = 1e-3 * UNSEEN_MS_MAX as f64 + 1e-6;
/// Slower turns of all parts are none, rad/s.
const STILL_RAD_S: f64 = 0.01;
/// By how much faster or slower a part may become with the others from one frame to the next, as a factor.
const CHANGE_MAX: f64 = 2.0;

/// Keeps the tracks.
#[derive(Clone, Debug)]
pub(super) struct Tracker {
    config: TrackerConfig,
    /// How fast the feed turned all parts about the tray's axis at the latest frame, rad/s.
    turn_rad_s: f64,
    /// Yaw symmetry of each pose.
    symmetries: Vec<u32>,
    next_id: u64,
    tracks: Vec<Track>,
}

impl Tracker {
    pub(super) fn new(config: TrackerConfig, symmetries: Vec<u32>) -> Self {
        Self { config, turn_rad_s: 0.0, symmetries, next_id: 1, tracks: Vec::new() }
    }

    /// Parts are about to have been fed as far as those of a frame show, if the tray was `shaken` since the one before.
    fn follow_feed(&mut self, stamp_s: f64, candidates: &[Candidate], shaken: bool) {
        let Some(dt) = self.tracks.iter().map(|track| stamp_s - track.stamp_s).reduce(f64::min) else { return };
        let before: Vec<Lying> =
            self.tracks.iter().map(|track| Lying { place: track.position(), pose: track.evidence.pose().0 }).collect();
        let now: Vec<Lying> =
            candidates.iter().map(|candidate| Lying { place: candidate.centre(), pose: candidate.pose }).collect();
        let radius_m = before.iter().map(|lying| lying.place.coords.norm()).fold(0.0, f64::max);
        if dt <= 0.0 || radius_m <= 0.0 {
            return;
        }
        if shaken && dt > UNSEEN_S_MAX {
            self.tracks.clear();
            return;
        }
        let (way_m_max, expected_rad) = (self.config.feed_m_s_max * dt, self.turn_rad_s * dt);
        let found = || common_turn_rad(&before, &now, radius_m, way_m_max, expected_rad);
        let Some(turn_rad) = (if shaken { found() } else { Some(0.0) }) else { return };
        let turn_rad_s = turn_rad / dt;
        let factor = turn_rad_s / self.turn_rad_s;
        for track in &mut self.tracks {
            track.place.rate = if self.turn_rad_s.abs() > STILL_RAD_S && factor.abs() < CHANGE_MAX {
                track.place.rate.map(|rate| factor * rate)
            } else {
                turned(track.position(), turn_rad_s)
            };
        }
        self.turn_rad_s = turn_rad_s;
    }

    /// Parts lie at `stamp_s` where they lay when they were seen last.
    pub(super) fn rest(&mut self, stamp_s: f64) {
        for track in &mut self.tracks {
            track.stamp_s = track.stamp_s.max(stamp_s);
        }
    }

    /// Takes in what a frame shows, and whether the tray was shaken since the one before; returns the tracks it shows, by
    /// identity.
    pub(super) fn update(&mut self, stamp_s: f64, candidates: &[Candidate], shaken: bool) -> Vec<TrackedCandidate> {
        self.follow_feed(stamp_s, candidates, shaken);
        for track in &mut self.tracks {
            track.predict(stamp_s, &self.config);
            track.missed += 1;
        }
        let known = self.tracks.len();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (track_index, track) in self.tracks.iter().enumerate() {
            for (index, candidate) in candidates.iter().enumerate() {
                let miss_m = (candidate.centre() - track.position()).norm();
                if miss_m <= self.config.gate_m {
                    pairs.push((miss_m, track_index, index));
                }
            }
        }
        // Closest pairs first; age of the track, then order in the image, break ties.
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut shown = vec![None; known];
        let mut taken = vec![false; candidates.len()];
        for (_, track_index, index) in pairs {
            if shown[track_index].is_none() && !taken[index] {
                shown[track_index] = Some(index);
                taken[index] = true;
                self.tracks[track_index].correct(&candidates[index], &self.symmetries, &self.config);
            }
        }
        for (index, candidate) in candidates.iter().enumerate() {
            if !taken[index] {
                let mut track = Track::start(self.next_id, stamp_s, candidate, self.symmetries.len(), &self.config);
                track.place.rate = turned(candidate.centre(), self.turn_rad_s);
                self.next_id += 1;
                self.tracks.push(track);
                shown.push(Some(index));
            }
        }
        let mut tracked = Vec::with_capacity(candidates.len());
        for (track, shown) in self.tracks.iter_mut().zip(shown) {
            let Some(candidate) = shown.map(|index| candidates[index]) else {
                continue;
            };
            track.frames_seen += 1;
            track.evidence.weigh(&candidate, self.config.memory);
            let (pose, confidence) = track.evidence.pose();
            tracked.push(TrackedCandidate {
                id: track.id,
                stamp_s,
                candidate,
                position_m: track.position(),
                velocity_m_s: track.place.rate.into(),
                yaw_rad: track.yaw.as_ref().map(|(_, filter)| filter.value[0]),
                yaw_rate_rad_s: track.yaw.as_ref().map_or(0.0, |(_, filter)| filter.rate[0]),
                pose,
                confidence,
                frames_seen: track.frames_seen,
            });
        }
        let missed_max = self.config.missed_max;
        self.tracks.retain(|track| track.missed <= missed_max);
        tracked
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const FRAME_S: f64 = 0.1;

    fn at(x_m: f64) -> Candidate {
        Candidate {
            x_m,
            y_m: -0.06,
            yaw_rad: None,
            likeness: 0,
            pose: Some(0),
            confidence: 0.95,
            part_gap_m: 0.004,
            wall_gap_m: 0.02,
            on_plateau: true,
        }
    }

    fn turned(yaw_rad: f64) -> Candidate {
        Candidate { yaw_rad: Some(yaw_rad), ..at(0.0) }
    }

    fn tracker(symmetry: u32) -> Tracker {
        Tracker::new(TrackerConfig::default(), vec![symmetry; 2])
    }

    /// Shows one thing, or nothing, a frame after the other; gives what is tracked in the last.
    fn show(tracker: &mut Tracker, first: u32, frames: &[Option<Candidate>]) -> Vec<TrackedCandidate> {
        let mut tracked = Vec::new();
        for (index, shown) in (first..).zip(frames) {
            tracked = tracker.update(f64::from(index) * FRAME_S, shown.as_slice(), true);
        }
        tracked
    }

    #[test]
    fn what_is_farther_off_than_the_gate_is_another_part() {
        let gate_m = TrackerConfig::default().gate_m;
        for side in [-1.0, 1.0] {
            for (share, is_same) in [(0.99, true), (1.01, false)] {
                let mut tracker = tracker(0);
                show(&mut tracker, 0, &[Some(at(0.0))]);
                let second = tracker.update(FRAME_S, &[at(side * share * gate_m)], false);
                assert_eq!(second[0].id == 1, is_same, "{side} {share}");
            }
        }
        // The gate is about where the part is expected, not where it was: this one goes 2.5 mm a frame.
        let mut tracker = tracker(0);
        let frames: Vec<_> = (0..8).map(|frame| Some(at(2.5e-3 * f64::from(frame)))).collect();
        show(&mut tracker, 0, &frames);
        let after_a_gap = show(&mut tracker, 8, &[None, Some(at(2.5e-3 * 9.0))]);
        assert_eq!(after_a_gap[0].id, 1);
    }

    /// Parts of two poses round the tray 85 mm from its axis, each 6 to 8 mm from the next, fed on by `way_m`.
    fn train(way_m: f64) -> Vec<Candidate> {
        let radius_m = 0.085;
        let part = |index: u32| {
            let spacing_m = 0.007 + 0.001 * f64::from(index).sin();
            let angle_rad = 3.4 + (f64::from(index) * spacing_m + way_m) / radius_m;
            let (sin, cos) = angle_rad.sin_cos();
            let pose = Some(usize::from(index.is_multiple_of(3)));
            Candidate { x_m: radius_m * cos, y_m: radius_m * sin, pose, ..at(0.0) }
        };
        (0..20).map(part).collect()
    }

    #[test]
    fn parts_that_are_fed_by_more_than_their_spacing_keep_their_identities_from_rest_to_rest() {
        let mut tracker = tracker(0);
        // At rest, fed at up to 90 mm/s, at rest again.
        let speeds_m_s = [0.0, 0.0, 0.03, 0.09, 0.09, 0.09, 0.04, 0.0, 0.0];
        let mut way_m = 0.0;
        let mut last = Vec::new();
        for (frame, speed_m_s) in (0..).zip(speeds_m_s) {
            way_m += speed_m_s * FRAME_S;
            last = tracker.update(f64::from(frame) * FRAME_S, &train(way_m), speed_m_s > 0.0);
            assert!(last.iter().map(|part| part.id).eq(1..=20), "frame {frame}");
        }
        assert!(last.iter().all(|part| part.confidence > 0.8 && part.frames_seen == 9));
    }

    #[test]
    fn parts_that_nobody_saw_are_known_again_unless_they_were_fed() {
        for (shaken, first) in [(false, 1), (true, 21)] {
            let mut tracker = tracker(0);
            tracker.update(0.0, &train(0.0), true);
            let later = tracker.update(5.0, &train(0.0), shaken);
            assert!(later.iter().map(|part| part.id).eq(first..first + 20), "{shaken}");
        }
    }

    #[test]
    fn a_part_is_forgotten_when_it_was_missed_too_often_in_a_row() {
        let missed_max = usize::try_from(TrackerConfig::default().missed_max).unwrap();
        let id_after = |missed: usize| {
            let mut tracker = tracker(0);
            show(&mut tracker, 0, &[Some(at(0.0))]);
            show(&mut tracker, 1, &vec![None; missed]);
            show(&mut tracker, 1, &[Some(at(0.0))])[0].id
        };
        assert_eq!((id_after(missed_max), id_after(missed_max + 1)), (1, 2));
        // Seen once in between, it is counted anew.
        let mut tracker = tracker(0);
        for _ in 0..3 {
            show(&mut tracker, 0, &[Some(at(0.0))]);
            show(&mut tracker, 0, &vec![None; missed_max]);
        }
        assert_eq!(show(&mut tracker, 0, &[Some(at(0.0))])[0].id, 1);
    }

    #[test]
    fn of_two_things_near_a_part_the_nearer_is_the_part_and_of_two_parts_near_a_thing_the_nearer_is_the_thing() {
        let gate_m = TrackerConfig::default().gate_m;
        let ids = |tracked: &[TrackedCandidate]| -> Vec<(u64, f64)> {
            tracked.iter().map(|tracked| (tracked.id, tracked.candidate.x_m)).collect()
        };
        let mut tracker = tracker(0);
        show(&mut tracker, 0, &[Some(at(0.0))]);
        let two = tracker.update(FRAME_S, &[at(0.6 * gate_m), at(-0.3 * gate_m)], false);
        assert_eq!(ids(&two), [(1, -0.3 * gate_m), (2, 0.6 * gate_m)]);
        let one = tracker.update(2.0 * FRAME_S, &[at(0.2 * gate_m)], false);
        assert_eq!(ids(&one), [(2, 0.2 * gate_m)]);
    }

    #[test]
    fn what_a_part_was_seen_to_do_outweighs_one_frame_and_one_frame_alone_is_not_sure() {
        let mut tracker = tracker(0);
        let first = show(&mut tracker, 0, &[Some(at(0.0))])[0];
        assert!(first.pose == Some(0) && first.confidence < 0.8, "{first:?}");
        show(&mut tracker, 1, &[Some(at(0.0)); 30]);
        let off_m = 1e-3;
        let share = tracker.update(31.0 * FRAME_S, &[at(off_m)], false)[0].position_m.x / off_m;
        assert!((0.4..0.9).contains(&share), "{share}");
    }

    #[test]
    fn evidence_of_earlier_frames_fades_but_outlives_a_single_one() {
        let mut tracker = tracker(0);
        let other = Candidate { pose: Some(1), ..at(0.0) };
        let sure = show(&mut tracker, 0, &[Some(at(0.0)); 20])[0].confidence;
        assert!(sure > 0.85, "{sure}");
        let once = show(&mut tracker, 20, &[Some(other)])[0];
        assert!(once.pose == Some(0) && once.confidence < sure - 0.2, "{once:?}");
        // Four frames at 0.8 leave 0.41 of what was.
        let often = show(&mut tracker, 21, &[Some(other); 3])[0];
        assert_eq!(often.pose, Some(1));
        // A frame that shows no pose is evidence for none.
        let unsure = show(&mut tracker, 24, &[Some(Candidate { pose: None, ..at(0.0) }); 10])[0];
        assert!(unsure.confidence < 0.2, "{unsure:?}");
        assert_eq!(unsure.frames_seen, 34);
    }

    #[test]
    fn yaw_and_its_rate_are_followed_either_way_and_round_the_circle() {
        for symmetry in [1, 2, 6] {
            for rate_rad_s in [-1.0, 1.0] {
                let sector_rad = TAU / f64::from(symmetry);
                let yaw_rad = |frame: u32| rate_rad_s * FRAME_S * f64::from(frame);
                let frames: Vec<_> = (0..30).map(|frame| Some(turned(yaw_rad(frame).rem_euclid(sector_rad)))).collect();
                let last = show(&mut tracker(symmetry), 0, &frames)[0];
                assert!((last.yaw_rate_rad_s - rate_rad_s).abs() < 0.02, "{symmetry} {last:?}");
                let off_rad = |found_rad: f64, frame| yaw_difference_rad(found_rad, yaw_rad(frame), symmetry).abs();
                assert!(off_rad(last.yaw_rad.unwrap(), 29) < 0.01, "{symmetry} {last:?}");
                let ahead_rad = last.predict_yaw_rad(3.4).unwrap();
                assert!(off_rad(ahead_rad, 34) < 0.02, "{symmetry} {ahead_rad}");
            }
        }
    }

    #[test]
    fn a_yaw_of_another_likeness_begins_anew() {
        let mut tracker = tracker(1);
        show(&mut tracker, 0, &[Some(turned(0.3)); 10]);
        let other = show(&mut tracker, 10, &[Some(Candidate { likeness: 1, ..turned(2.0) })])[0];
        assert!((other.yaw_rad.unwrap() - 2.0).abs() < 1e-12 && other.yaw_rate_rad_s.abs() < 1e-12);
    }

    #[test]
    fn place_and_velocity_are_smoothed_and_foreseen() {
        let frames: Vec<_> = (0..20).map(|frame| Some(at(1e-3 * f64::from(frame)))).collect();
        let last = show(&mut tracker(0), 0, &frames)[0];
        assert!((last.velocity_m_s - Vector2::new(0.01, 0.0)).norm() < 2e-4, "{last:?}");
        assert!((last.predict(2.4) - Point2::new(0.024, -0.06)).norm() < 1e-4);
    }
}
