//! Parts that are presented to grippers, by ground truth: whether there was room about them, and how they were turned.

use std::f64::consts::TAU;

use feeder_model::geometry::{Outline, apart};
use feeder_model::part::PartType;
use feeder_scenario::plan::WatchedGripper;
use nalgebra::{Isometry2, Point2};

use crate::truth::{Lay, Lays};

/// A delivered part that is turned by more than this from how it was presented counts as turned wrongly, rad: 5°.
pub const YAW_ERROR_MAX_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// Polygons about parts that are farther apart than this are not compared corner by corner, m.
const NEAR_M: f64 = 0.02;

/// What the truth must be compared with.
#[derive(Debug)]
pub(crate) struct PresentedScore {
    /// Silhouette in each resting pose, and how often it looks the same during a full turn.
    poses: Vec<(Outline, u32)>,
    grippers: Vec<WatchedGripper>,
}

impl PresentedScore {
    pub(crate) fn new(part: &PartType, grippers: Vec<WatchedGripper>) -> Self {
        let poses = part.poses.iter().map(|pose| (pose.outline.clone(), pose.yaw_symmetry)).collect();
        Self { poses, grippers }
    }

    /// By how much the free gap from the part `id` to the others on the plateau fell short of what the gripper of `station`
    /// needs, m; nothing if it did not, or nobody knows what it needs.
    pub(crate) fn room_short_m(&self, station: &str, id: u32, lays: &Lays) -> Option<f64> {
        let gripper = self.grippers.iter().find(|gripper| gripper.station == station)?;
        let short_m = gripper.part_gap_m_min - self.gap_m(id, lays)?;
        (short_m > 0.0).then_some(short_m)
    }

    /// Free gap from the part `id` to the nearest other on the plateau, m; nothing without another near it.
    fn gap_m(&self, id: u32, lays: &Lays) -> Option<f64> {
        let part = lays.get(&id)?;
        let outline = self.outline_of(part)?;
        let near = |other: &&Lay| other.on_plateau && (other.place_m - part.place_m).norm() < NEAR_M;
        let others = lays.iter().filter(|(other, _)| **other != id).map(|(_, lay)| lay).filter(near);
        let gaps_m = others.filter_map(|other| Some(apart::gap_m(&outline, &self.outline_of(other)?)));
        gaps_m.min_by(f64::total_cmp)
    }

    fn outline_of(&self, lay: &Lay) -> Option<Vec<Point2<f64>>> {
        let (outline, _) = self.poses.get(usize::from(lay.pose))?;
        Some(outline.at(&Isometry2::new(lay.place_m, lay.yaw_rad)))
    }

    /// How far a part that lies so is turned from `yaw_rad`, rad; nothing for one that looks the same from all sides, or lies
    /// in no pose that is known.
    pub(crate) fn yaw_error_rad(&self, lay: &Lay, yaw_rad: f64) -> Option<f64> {
        let (_, symmetry) = self.poses.get(usize::from(lay.pose))?;
        let period_rad = TAU / f64::from(Some(*symmetry).filter(|symmetry| *symmetry > 0)?);
        let turned_rad = lay.yaw_rad - yaw_rad;
        Some((turned_rad - period_rad * (turned_rad / period_rad).round()).abs())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::f64::consts::{FRAC_PI_2, PI};

    use feeder_scenario::PartSource;
    use nalgebra::Vector2;

    use super::*;

    /// Blocks of 6 x 4 mm as they lie flat, and a gripper that needs 1 mm.
    fn score() -> PresentedScore {
        let part = PartSource::Name("block".to_owned()).part_type().unwrap();
        let gripper = WatchedGripper { station: "station_1".to_owned(), part_gap_m_min: 0.001 };
        PresentedScore::new(&part, vec![gripper])
    }

    fn lay(x_m: f64, yaw_rad: f64, on_plateau: bool) -> Lay {
        Lay { place_m: Vector2::new(x_m, 0.0), yaw_rad, pose: 0, on_plateau }
    }

    /// By how much the room of the first of two parts fell short.
    fn short_m(other: Lay) -> Option<f64> {
        score().room_short_m("station_1", 1, &BTreeMap::from([(1, lay(0.0, FRAC_PI_2, true)), (2, other)]))
    }

    #[test]
    fn the_room_is_that_between_the_outlines_as_the_parts_lie_and_are_turned() {
        // Long sides face each other, 4 mm from middle to middle without a gap.
        assert_eq!(short_m(lay(0.0051, FRAC_PI_2, true)), None);
        assert!((short_m(lay(0.0049, FRAC_PI_2, true)).unwrap() - 1e-4).abs() < 1e-9);
        // The other one lies across: 5 mm from middle to middle without a gap.
        assert!((short_m(lay(0.0052, 0.0, true)).unwrap() - 8e-4).abs() < 1e-9);
        // What lies on the ramp, beside and below, is not in the way.
        assert_eq!(short_m(lay(0.0049, FRAC_PI_2, false)), None);
    }

    #[test]
    fn a_part_alone_has_room_and_nobody_knows_what_a_gripper_needs_that_is_not_simulated() {
        let score = score();
        let (alone, close) = (lay(0.0, 0.0, true), lay(0.004, 0.0, true));
        assert_eq!(score.room_short_m("station_1", 1, &BTreeMap::from([(1, alone)])), None);
        let both = BTreeMap::from([(1, alone), (2, close)]);
        assert!(score.room_short_m("station_1", 1, &both).is_some());
        assert_eq!(score.room_short_m("station_2", 1, &both), None);
        assert_eq!(score.room_short_m("station_1", 3, &both), None);
    }

    #[test]
    fn a_yaw_is_wrong_by_what_is_left_when_the_part_is_turned_to_where_it_looks_the_same() {
        let score = score();
        let error_rad = |lies_rad, said_rad| score.yaw_error_rad(&lay(0.0, lies_rad, true), said_rad).unwrap();
        assert!((error_rad(0.3, 0.1) - 0.2).abs() < 1e-12);
        assert!((error_rad(0.1, 0.3) - 0.2).abs() < 1e-12);
        // A block that lies flat looks the same after half a turn.
        assert!((error_rad(0.3 + PI, 0.1) - 0.2).abs() < 1e-12);
        assert!((error_rad(7.0 * PI, 0.1) - 0.1).abs() < 1e-9);
        assert!((error_rad(FRAC_PI_2, 0.0) - FRAC_PI_2).abs() < 1e-12);
        let round = PartSource::Name("grommet".to_owned()).part_type().unwrap();
        assert_eq!(PresentedScore::new(&round, Vec::new()).yaw_error_rad(&lay(0.0, 1.0, true), 0.0), None);
    }

    #[test]
    fn of_several_neighbours_the_nearest_counts_and_a_gap_as_wide_as_needed_is_room() {
        let score = |part_gap_m_min| {
            let part = PartSource::Name("block".to_owned()).part_type().unwrap();
            PresentedScore::new(&part, vec![WatchedGripper { station: "station_1".to_owned(), part_gap_m_min }])
        };
        let lays = BTreeMap::from([
            (1, lay(0.0, FRAC_PI_2, true)),
            (2, lay(0.015, FRAC_PI_2, true)),
            (3, lay(-0.010, FRAC_PI_2, true)),
        ]);
        let gap_m = score(0.0).gap_m(1, &lays).unwrap();
        assert!((gap_m - 0.006).abs() < 1e-9, "{gap_m}");
        assert_eq!(score(gap_m).room_short_m("station_1", 1, &lays), None);
        // What lies farther away is not looked at.
        let far = BTreeMap::from([(1, lay(0.0, 0.0, true)), (2, lay(0.021, 0.0, true))]);
        assert_eq!(score(0.1).room_short_m("station_1", 1, &far), None);
    }
}
