//! By how much the feed has turned all parts about the tray's axis from one image to the next.
//!
//! Parts are fed farther between two images than they lie apart, so that none can be followed by itself. But all are fed
//! about as far, and each keeps its pose: the turn by which most parts come to lie where one of their pose is seen.

use std::f64::consts::{PI, TAU};

use nalgebra::Point2;

/// A part as it lies in an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lying {
    pub(super) place: Point2<f64>,
    /// Its resting pose, as far as it is known.
    pub(super) pose: Option<usize>,
}

/// Parts are fed along the tray: radii of one part in two images differ by less, m.
const RADIUS_M: f64 = 0.0015;
/// Ways of two parts that count as alike, m.
const ALIKE_M: f64 = 0.001;
/// Width of the steps of way that are told apart, m.
const STEP_M: f64 = 0.0005;
/// What a pair counts whose poses are not both known.
const UNSURE: f64 = 0.3;
/// What the turn that is expected counts, in pairs.
const EXPECTED: f64 = 0.5;

/// The turn from `before` to `now` about the tray's axis, rad, up to the way `way_m_max` (m) of a part at radius `radius_m`
/// (m), where `expected_rad` would be no surprise; nothing if no part is seen again.
pub(super) fn common_turn_rad(
    before: &[Lying],
    now: &[Lying],
    radius_m: f64,
    way_m_max: f64,
    expected_rad: f64,
) -> Option<f64> {
    let polar = |lying: &Lying| (lying.place.coords.norm(), lying.place.y.atan2(lying.place.x));
    let after: Vec<(f64, f64, Option<usize>)> =
        now.iter().map(|lying| (polar(lying).0, polar(lying).1, lying.pose)).collect();
    let mut ways: Vec<(f64, f64)> = Vec::new();
    for lying in before {
        let (r_m, angle_rad) = polar(lying);
        for &(other_m, other_rad, pose) in &after {
            let weight = match (lying.pose, pose) {
                (Some(one), Some(other)) if one == other => 1.0,
                (Some(_), Some(_)) => continue,
                _ => UNSURE,
            };
            let way_m = ((other_rad - angle_rad + PI).rem_euclid(TAU) - PI) * radius_m;
            if (other_m - r_m).abs() < RADIUS_M && (-ALIKE_M..=way_m_max).contains(&way_m) {
                ways.push((way_m, weight));
            }
        }
    }
    if ways.is_empty() {
        return None;
    }
    let expected_m = (expected_rad * radius_m).min(way_m_max);
    let votes = |way_m: f64| {
        let near = |other_m: f64| (1.0 - (other_m - way_m).abs() / ALIKE_M).max(0.0);
        ways.iter().map(|(other_m, weight)| weight * near(*other_m)).sum::<f64>() + EXPECTED * near(expected_m)
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
    let steps = ((way_m_max + ALIKE_M) / STEP_M).ceil() as u32;
    let tried = (0..=steps).map(|step| STEP_M * f64::from(step) - ALIKE_M).chain([expected_m]);
    let best_m = tried.max_by(|a, b| votes(*a).total_cmp(&votes(*b)))?;
    // To a fraction of a step: the mean of the ways that spoke for it.
    let spoke = ways.iter().filter(|(way_m, _)| (way_m - best_m).abs() < ALIKE_M);
    let (sum_m, total) = spoke.fold((0.0, 0.0), |(sum, total), (way_m, weight)| (sum + weight * way_m, total + weight));
    Some(if total > 0.0 { sum_m / total } else { best_m } / radius_m)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const RADIUS_M: f64 = 0.085;
    const MOST_M: f64 = 0.015;

    fn lying(angle_rad: f64, pose: usize) -> Lying {
        let (sin, cos) = angle_rad.sin_cos();
        Lying { place: Point2::new(cos, sin) * RADIUS_M, pose: Some(pose) }
    }

    fn turned(parts: &[(f64, usize)], turn_rad: f64) -> Vec<Lying> {
        parts.iter().map(|&(angle_rad, pose)| lying(angle_rad + turn_rad, pose)).collect()
    }

    /// A dense train: parts 6 mm apart, or up to 2 mm more, lying at random.
    fn train(random: &mut Pcg64Mcg) -> Vec<(f64, usize)> {
        let mut angle_rad = 3.3;
        let mut train = Vec::new();
        while angle_rad < 6.0 {
            train.push((angle_rad, usize::from(random.random_bool(0.5))));
            angle_rad += random.random_range(0.006..0.008) / RADIUS_M;
        }
        train
    }

    #[test]
    fn a_dense_train_that_moves_by_more_than_its_spacing_is_followed() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for _ in 0..100 {
            let parts = train(&mut random);
            let turn_rad = random.random_range(0.0..MOST_M) / RADIUS_M;
            let (before, after) = (turned(&parts, 0.0), turned(&parts[..parts.len() - 2], turn_rad));
            let found_rad = common_turn_rad(&before, &after, RADIUS_M, MOST_M, 0.0).unwrap();
            assert!((found_rad - turn_rad).abs() * RADIUS_M < 0.3e-3, "{found_rad} {turn_rad}");
        }
    }

    #[test]
    fn where_two_turns_are_as_likely_the_expected_one_is_taken() {
        // One of two parts 8 mm apart is gone: the other has stayed, or the first has come to its place.
        let parts = [(4.0, 0), (4.0 + 0.008 / RADIUS_M, 0)];
        let left = turned(&parts[1..], 0.0);
        for expected_m in [0.0, 0.008] {
            let found = common_turn_rad(&turned(&parts, 0.0), &left, RADIUS_M, MOST_M, expected_m / RADIUS_M).unwrap();
            assert!((found * RADIUS_M - expected_m).abs() < 1e-6, "{found}");
        }
    }

    #[test]
    fn parts_of_another_pose_or_lane_say_nothing() {
        let before = [lying(4.0, 0)];
        let inner = Lying { place: Point2::new(-0.08, 0.0), pose: Some(0) };
        assert_eq!(common_turn_rad(&before, &[lying(4.05, 1), inner], RADIUS_M, MOST_M, 0.0), None);
        assert_eq!(common_turn_rad(&before, &[], RADIUS_M, MOST_M, 0.0), None);
    }
}
