//! Where the tray stood at the stamp of an image, by interpolation between odometry's poses.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::{OutOfRange, check_ranges};

/// How odometry and images are brought together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseHistoryConfig {
    /// Longest time between two odometry messages across which the tray's pose is interpolated, s.
    #[schemars(range(min = 1e-3, max = 1.0))]
    pub gap_s_max: f64,
    /// Longest time that an image may be older than the latest odometry, s.
    #[schemars(range(min = 0.01, max = 10.0))]
    pub age_s_max: f64,
    /// Longest time that an image waits for the odometry that follows it, s.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub wait_s_max: f64,
}

impl Default for PoseHistoryConfig {
    fn default() -> Self {
        Self { gap_s_max: 0.025, age_s_max: 0.64, wait_s_max: 0.1 }
    }
}

impl PoseHistoryConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("selector.odometry.", self)
    }
}

/// The tray's pose and velocity at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// When, ns.
    pub stamp_ns: u64,
    /// Position x, y (m) and yaw (rad) in the platen frame.
    pub position: Vector3<f64>,
    /// Velocity in the platen frame, m/s and rad/s.
    pub velocity: Vector3<f64>,
}

/// Why the tray's pose at a time is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPose {
    /// Nothing was heard so far.
    #[error("no odometry yet")]
    NoOdometry,
    /// What was heard ends before that time.
    #[error("the image's stamp is ahead of odometry, longer than selector.odometry.wait_s_max")]
    Ahead,
    /// The time lies further back than is remembered.
    #[error("the image is older than selector.odometry.age_s_max, or than the first odometry")]
    TooOld,
    /// Odometry has a hole there.
    #[error("odometry has a gap at the image's stamp, longer than selector.odometry.gap_s_max")]
    Gap,
}

/// The tray's poses of late.
///
/// Between two poses position and yaw follow the cubic that has both positions and both velocities. Of a motion whose
/// fourth derivative stays below D, poses a time h apart leave an error of D h⁴/384 at most.
#[derive(Clone, Debug)]
pub struct PoseHistory {
    config: PoseHistoryConfig,
    /// In order of time, each later than the one before it.
    poses: VecDeque<TimedPose>,
    /// When the tray was seen to be shaken last, or the first pose was noted, ns.
    shaken_ns: Option<u64>,
}

/// A tray that turns faster is shaken, rad/s: waveforms reach some tenths, moves do without.
const SHAKEN_RAD_S: f64 = 0.02;
/// A tray that goes faster than this, wherever it turns, is under way, m/s: waveforms turn it on the spot, and what a poor motor
/// makes of them stays below. A stamp that is off by a millisecond puts a part aside by as many micrometres.
const UNDER_WAY_M_S: f64 = 0.05;

impl PoseHistory {
    /// An empty history.
    #[must_use]
    pub fn new(config: PoseHistoryConfig) -> Self {
        Self { config, poses: VecDeque::new(), shaken_ns: None }
    }

    /// How odometry and images are brought together.
    #[must_use]
    pub fn config(&self) -> &PoseHistoryConfig {
        &self.config
    }

    /// Notes a pose. One that is not later than the last one, or not finite, is left out.
    pub fn note(&mut self, pose: TimedPose) {
        let finite = pose.position.iter().chain(&pose.velocity).all(|value| value.is_finite());
        if !finite || self.poses.back().is_some_and(|last| last.stamp_ns >= pose.stamp_ns) {
            return;
        }
        if pose.velocity.z.abs() > SHAKEN_RAD_S || self.shaken_ns.is_none() {
            self.shaken_ns = Some(pose.stamp_ns);
        }
        self.poses.push_back(pose);
        // One that is too old is the beginning of the oldest stretch that is not.
        while self.poses.len() > 2 && self.is_too_old(self.poses[1].stamp_ns) {
            self.poses.pop_front();
        }
    }

    /// The tray on the platen at this time.
    ///
    /// # Errors
    /// Why it is not known.
    pub fn at(&self, stamp_ns: u64) -> Result<Isometry2<f64>, NoPose> {
        let (Some(first), Some(last)) = (self.poses.front(), self.poses.back()) else { return Err(NoPose::NoOdometry) };
        if stamp_ns > last.stamp_ns {
            return Err(NoPose::Ahead);
        }
        if stamp_ns < first.stamp_ns || self.is_too_old(stamp_ns) {
            return Err(NoPose::TooOld);
        }
        let after = self.poses.partition_point(|pose| pose.stamp_ns < stamp_ns);
        let next = &self.poses[after];
        if next.stamp_ns == stamp_ns {
            return Ok(isometry(&next.position));
        }
        // There is one before it: the first one's stamp is not later.
        let before = &self.poses[after - 1];
        let span_s = seconds(next.stamp_ns - before.stamp_ns);
        if span_s > self.config.gap_s_max {
            return Err(NoPose::Gap);
        }
        Ok(isometry(&between(before, next, seconds(stamp_ns - before.stamp_ns) / span_s, span_s)))
    }

    /// Whether the tray may have been shaken after `stamp_ns`: it was seen to turn, or nothing is known from then on.
    #[must_use]
    pub fn shaken_since(&self, stamp_ns: u64) -> bool {
        self.shaken_ns.is_none_or(|shaken_ns| shaken_ns > stamp_ns)
    }

    /// Whether the tray was being carried from place to place at this time, by the pose noted next, or else the last.
    #[must_use]
    pub fn is_under_way(&self, stamp_ns: u64) -> bool {
        let after = self.poses.partition_point(|pose| pose.stamp_ns < stamp_ns);
        let pose = self.poses.get(after).or(self.poses.back());
        pose.is_some_and(|pose| pose.velocity.xy().norm() > UNDER_WAY_M_S)
    }

    fn is_too_old(&self, stamp_ns: u64) -> bool {
        self.poses.back().is_some_and(|last| seconds(last.stamp_ns.saturating_sub(stamp_ns)) > self.config.age_s_max)
    }
}

/// Position and yaw on the cubic between two poses, at `share` of the time between them.
fn between(before: &TimedPose, after: &TimedPose, share: f64, span_s: f64) -> Vector3<f64> {
    let mut way = after.position - before.position;
    // Yaw goes the short way round.
    way.z = (way.z + PI).rem_euclid(TAU) - PI;
    let (slope_before, slope_after) = (before.velocity * span_s, after.velocity * span_s);
    let quadratic = way * 3.0 - slope_before * 2.0 - slope_after;
    let cubic = slope_before + slope_after - way * 2.0;
    before.position + (slope_before + (quadratic + cubic * share) * share) * share
}

fn isometry(position: &Vector3<f64>) -> Isometry2<f64> {
    Isometry2::new(position.xy(), position.z)
}

fn seconds(duration_ns: u64) -> f64 {
    std::time::Duration::from_nanos(duration_ns).as_secs_f64()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MS: u64 = 1_000_000;

    fn at(stamp_ns: u64, x_m: f64) -> TimedPose {
        TimedPose { stamp_ns, position: Vector3::new(x_m, 0.0, 0.0), velocity: Vector3::zeros() }
    }

    fn history(poses: impl IntoIterator<Item = TimedPose>) -> PoseHistory {
        let mut history = PoseHistory::new(PoseHistoryConfig::default());
        poses.into_iter().for_each(|pose| history.note(pose));
        history
    }

    #[test]
    fn what_cannot_be_interpolated_is_named() {
        assert_eq!(history([]).at(0), Err(NoPose::NoOdometry));
        let short = history([at(100 * MS, 0.1), at(110 * MS, 0.1), at(150 * MS, 0.1), at(160 * MS, 0.1)]);
        assert_eq!(short.at(99 * MS), Err(NoPose::TooOld));
        assert_eq!(short.at(130 * MS), Err(NoPose::Gap));
        assert_eq!(short.at(160 * MS + 1), Err(NoPose::Ahead));
        // Where there is a pose, no gap beside it matters.
        for stamp_ns in [100 * MS, 105 * MS, 110 * MS, 150 * MS, 155 * MS, 160 * MS] {
            assert_eq!(short.at(stamp_ns), Ok(Isometry2::new([0.1, 0.0].into(), 0.0)));
        }
    }

    #[test]
    fn what_is_older_than_the_stated_age_is_refused_and_forgotten() {
        let long = history((0..1000).map(|tick| at(10 * MS * tick, 0.0)));
        assert!(long.at((9990 - 640) * MS).is_ok());
        assert_eq!(long.at((9990 - 641) * MS), Err(NoPose::TooOld));
        assert!(long.poses.len() <= 66, "{}", long.poses.len());
    }

    #[test]
    fn a_pose_that_is_late_or_no_number_changes_nothing() {
        let mut history = history([at(0, 0.0), at(10 * MS, 0.0)]);
        history.note(at(10 * MS, 9.0));
        history.note(at(5 * MS, 9.0));
        history.note(at(20 * MS, f64::NAN));
        assert_eq!(history.at(7 * MS), Ok(Isometry2::identity()));
        assert_eq!(history.at(20 * MS), Err(NoPose::Ahead));
    }

    #[test]
    fn a_tray_was_shaken_where_it_turned_or_nothing_is_known_of_it() {
        let turning = |ms: u64, yaw_rate_rad_s: f64| TimedPose {
            velocity: Vector3::new(0.3, 0.0, yaw_rate_rad_s),
            ..at(ms * MS, 0.0)
        };
        assert!(history([]).shaken_since(0));
        let mut history = history([turning(10, 0.0), turning(20, -0.2)]);
        // However long ago that was.
        (3..300).for_each(|tick| history.note(turning(10 * tick, 0.001)));
        assert!(history.shaken_since(19 * MS) && !history.shaken_since(20 * MS) && !history.shaken_since(2990 * MS));
        let still = self::history([turning(10, 0.0), turning(20, 0.0)]);
        assert!(still.shaken_since(9 * MS) && !still.shaken_since(10 * MS));
    }

    #[test]
    fn a_tray_is_under_way_while_it_goes_and_not_while_it_turns() {
        let going = |ms: u64, velocity: [f64; 3]| TimedPose { velocity: velocity.into(), ..at(ms * MS, 0.0) };
        assert!(!history([]).is_under_way(0));
        let history = history([
            going(10, [0.0, 0.0, 3.0]),
            going(20, [0.03, -0.039, 0.0]),
            going(30, [0.03, -0.041, 0.0]),
            going(40, [0.0, 0.001, -3.0]),
        ]);
        for (ms, is_under_way) in
            [(0, false), (10, false), (20, false), (25, true), (30, true), (31, false), (50, false)]
        {
            assert_eq!(history.is_under_way(ms * MS), is_under_way, "{ms} ms");
        }
    }

    #[test]
    fn yaw_goes_the_short_way_round() {
        let pose = |stamp_ns, yaw_rad| TimedPose { position: Vector3::new(0.0, 0.0, yaw_rad), ..at(stamp_ns, 0.0) };
        let middle = history([pose(0, 3.1), pose(10 * MS, -3.1)]).at(5 * MS).unwrap();
        assert!((middle.rotation.angle().abs() - PI).abs() < 1e-12, "{middle}");
    }

    proptest! {
        /// x(t) = A sin(2π f t + φ), likewise y and yaw: the fourth derivative is A (2π f)⁴ at most.
        #[test]
        fn verif_a_smooth_motion_is_recovered_within_the_stated_error(
            amplitude_m in 1e-4..0.1, turn_rad in 1e-4..0.03, frequency_hz in 0.5..10.0_f64, phase_rad in 0.0..6.2_f64,
            period_ms in 2_u64..20, share in 0.0..1.0,
        ) {
            let omega_rad_s = TAU * frequency_hz;
            let amplitude = Vector3::new(amplitude_m, -0.5 * amplitude_m, turn_rad);
            let pose = |stamp_ns: u64| {
                let (sin, cos) = (omega_rad_s * seconds(stamp_ns) + phase_rad).sin_cos();
                TimedPose { stamp_ns, position: amplitude * sin, velocity: amplitude * omega_rad_s * cos }
            };
            let history = history((0..20).map(|index| pose(index * period_ms * MS)));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred ms")]
            let stamp_ns = (share * (19 * period_ms * MS) as f64) as u64;
            let (found, truth) = (history.at(stamp_ns).unwrap(), pose(stamp_ns).position);
            let bound = omega_rad_s.powi(4) * seconds(period_ms * MS).powi(4) / 384.0;
            let missed = Vector3::new(found.translation.x, found.translation.y, found.rotation.angle()) - truth;
            for axis in 0..3 {
                prop_assert!(missed[axis].abs() <= amplitude[axis].abs() * bound + 1e-12, "{missed} {bound}");
            }
        }
    }
}
