//! Where the parts have been, by ground truth.

use std::collections::{BTreeMap, VecDeque};

use feeder_model::tray::Place;
use feeder_wire::parts::TruePart;
use nalgebra::Vector2;

/// How far back places are remembered, in messages of one tick each. A choice becomes known when the part is presented,
/// so this must be longer than the longest trip.
const MEMORY: usize = 4000;

/// How a part lay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lay {
    /// Its centre in the tray frame, m.
    pub(crate) place_m: Vector2<f64>,
    /// How it was turned in the tray frame, rad.
    pub(crate) yaw_rad: f64,
    /// Its resting pose.
    pub(crate) pose: u8,
    /// If it lay on the plateau.
    pub(crate) on_plateau: bool,
}

/// How the parts lay.
pub(crate) type Lays = BTreeMap<u32, Lay>;

/// Where the parts have been.
#[derive(Debug, Default)]
pub(crate) struct Truth {
    /// Stamp (ns) and parts of the last moments, oldest first.
    recent: VecDeque<(u64, Lays)>,
    settled: Option<Settled>,
}

/// Where every part was when a choice was made.
#[derive(Debug)]
struct Settled {
    look_ns: u64,
    lays: Lays,
    /// Largest displacement of each part since, m.
    slips_m: BTreeMap<u32, f64>,
}

impl Truth {
    /// The parts were there at `stamp_ns`.
    pub(crate) fn learn(&mut self, stamp_ns: u64, parts: &[TruePart]) {
        let lay = |part: &TruePart| {
            let (place_m, yaw_rad, pose) = (part.position_in_tray_m(), part.yaw_rad, part.resting_pose);
            (part.id, Lay { place_m, yaw_rad, pose, on_plateau: part.place == Place::Plateau })
        };
        let lays: Lays = parts.iter().map(lay).collect();
        if let Some(settled) = &mut self.settled {
            settled.follow(&lays);
        }
        self.recent.push_back((stamp_ns, lays));
        if self.recent.len() > MEMORY {
            self.recent.pop_front();
        }
    }

    /// How the parts lay at `stamp_ns`, if that is remembered.
    pub(crate) fn at(&self, stamp_ns: u64) -> Option<&Lays> {
        self.recent.iter().rev().find(|(ns, _)| *ns == stamp_ns).map(|(_, lays)| lays)
    }

    /// How a part lay last, if that is remembered.
    pub(crate) fn last(&self, id: u32) -> Option<&Lay> {
        self.recent.iter().rev().find_map(|(_, lays)| lays.get(&id))
    }

    /// The part whose centre was nearest to `point` at `stamp_ns`, if within `reach_m`, and the pose it lay in.
    pub(crate) fn part_at(&self, stamp_ns: u64, point: &Vector2<f64>, reach_m: f64) -> Option<(u32, u8)> {
        let distances = self.at(stamp_ns)?.iter().map(|(id, lay)| ((*id, lay.pose), (lay.place_m - point).norm()));
        let (part, distance_m) = distances.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        (distance_m <= reach_m).then_some(part)
    }

    /// Counts slip from the picture taken at `look_ns`, on which a choice rests.
    pub(crate) fn settle(&mut self, look_ns: u64) {
        if self.settled.as_ref().is_some_and(|settled| settled.look_ns == look_ns) {
            return;
        }
        let mut since = self.recent.iter().filter(|(ns, _)| *ns >= look_ns);
        let Some((_, lays)) = since.next() else { return };
        let mut settled = Settled { look_ns, lays: lays.clone(), slips_m: BTreeMap::new() };
        for (_, lays) in since {
            settled.follow(lays);
        }
        self.settled = Some(settled);
    }

    /// Largest displacement of a part since the last choice, m; nothing for a part that was not there then.
    pub(crate) fn slip_m(&self, id: u32) -> Option<f64> {
        self.settled.as_ref().and_then(|settled| settled.slips_m.get(&id)).copied()
    }
}

impl Settled {
    fn follow(&mut self, lays: &Lays) {
        for (id, lay) in lays {
            if let Some(from) = self.lays.get(id) {
                let slip_m = self.slips_m.entry(*id).or_insert(0.0);
                *slip_m = slip_m.max((lay.place_m - from.place_m).norm());
            }
        }
    }
}

/// Parts for tests.
#[cfg(test)]
pub(crate) mod testing {
    use feeder_wire::parts::TrueParts;

    use super::*;

    /// A part at rest on the plateau, where it meets the line of ψ = 0.
    pub(crate) fn lying(id: u32, radius_m: f64, resting_pose: u8) -> TruePart {
        TruePart {
            id,
            part_class: String::new(),
            place: Place::Plateau,
            resting_pose,
            radius_m,
            angle_rad: 0.0,
            yaw_rad: 0.0,
            radial_velocity_m_s: 0.0,
            tangential_velocity_m_s: 0.0,
            sticking: true,
            stranded: false,
        }
    }

    pub(crate) fn truth(parts: &[TruePart]) -> TrueParts {
        TrueParts { parts: parts.to_vec(), ..TrueParts::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts on the line of ψ = 0, numbered from 0.
    fn parts(radii_m: &[f64]) -> Vec<TruePart> {
        (0..).zip(radii_m).map(|(id, &radius_m)| testing::lying(id, radius_m, 0)).collect()
    }

    #[test]
    fn slip_is_the_largest_displacement_since_the_choice_even_when_it_becomes_known_later() {
        let mut truth = Truth::default();
        for (stamp_ns, radius_m) in [(10, 0.070), (20, 0.080), (30, 0.0803), (40, 0.0801)] {
            truth.learn(stamp_ns, &parts(&[radius_m]));
        }
        truth.settle(20);
        assert!((truth.slip_m(0).unwrap() - 0.0003).abs() < 1e-12);
        truth.learn(50, &parts(&[0.0806]));
        truth.settle(20);
        assert!((truth.slip_m(0).unwrap() - 0.0006).abs() < 1e-12);
        assert_eq!(truth.slip_m(7), None);
    }

    #[test]
    fn a_part_is_found_where_it_was_not_where_it_is() {
        let mut truth = Truth::default();
        truth.learn(10, &parts(&[0.060, 0.080]));
        truth.learn(20, &parts(&[0.080, 0.060]));
        assert_eq!(truth.part_at(10, &Vector2::new(0.0795, 0.0), 0.002), Some((1, 0)));
        assert_eq!(truth.part_at(20, &Vector2::new(0.0795, 0.0), 0.002), Some((0, 0)));
        assert_eq!(truth.part_at(20, &Vector2::new(0.0700, 0.0), 0.002), None);
        assert_eq!(truth.part_at(15, &Vector2::new(0.0795, 0.0), 0.002), None);
    }

    #[test]
    fn a_part_is_remembered_as_it_lay_last_and_old_moments_are_forgotten() {
        let mut truth = Truth::default();
        truth.learn(0, &parts(&[0.060, 0.080]));
        for stamp_ns in 1..MEMORY as u64 {
            truth.learn(stamp_ns, &parts(&[0.070]));
        }
        assert!((truth.last(0).unwrap().place_m.x - 0.070).abs() < 1e-12);
        assert!((truth.last(1).unwrap().place_m.x - 0.080).abs() < 1e-12 && truth.last(2).is_none());
        assert!(truth.at(0).is_some());
        truth.learn(MEMORY as u64, &parts(&[0.070]));
        assert!(truth.at(0).is_none() && truth.at(1).is_some() && truth.last(1).is_none());
    }

    #[test]
    fn how_a_part_lies_is_kept_and_a_point_as_far_as_the_reach_is_within() {
        let mut truth = Truth::default();
        let mut lying = parts(&[0.5, 0.25]);
        lying[0] = TruePart { yaw_rad: 0.5, resting_pose: 3, ..lying[0].clone() };
        lying[1].place = Place::Ramp;
        truth.learn(10, &lying);
        let lays = truth.at(10).unwrap();
        assert_eq!((lays[&0].yaw_rad, lays[&0].pose, lays[&0].on_plateau), (0.5, 3, true));
        assert!(!lays[&1].on_plateau);
        assert_eq!(truth.part_at(10, &Vector2::new(0.75, 0.0), 0.25), Some((0, 3)));
        assert_eq!(truth.part_at(10, &Vector2::new(0.75, 0.0), 0.249), None);
    }

    #[test]
    fn slip_counts_from_the_first_moment_that_is_as_late_as_the_picture_and_not_from_a_picture_still_to_come() {
        let mut truth = Truth::default();
        for (stamp_ns, radius_m) in [(10, 0.070), (20, 0.080), (30, 0.081)] {
            truth.learn(stamp_ns, &parts(&[radius_m]));
        }
        truth.settle(40);
        assert_eq!(truth.slip_m(0), None);
        truth.settle(15);
        assert!((truth.slip_m(0).unwrap() - 0.001).abs() < 1e-12);
        // Another choice begins anew.
        truth.settle(10);
        assert!((truth.slip_m(0).unwrap() - 0.011).abs() < 1e-12);
    }
}
