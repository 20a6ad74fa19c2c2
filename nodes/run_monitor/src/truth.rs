//! Where the parts have been, by ground truth.

use std::collections::{BTreeMap, VecDeque};

use feeder_wire::parts::TruePart;
use nalgebra::Vector2;

/// How far back places are remembered, in messages of one tick each. A choice becomes known when the part is presented,
/// so this must be longer than the longest trip.
const MEMORY: usize = 4000;

/// Place in the tray frame, m, and resting pose by part.
type Places = BTreeMap<u32, (Vector2<f64>, u8)>;

/// Where the parts have been.
#[derive(Debug, Default)]
pub(crate) struct Truth {
    /// Stamp (ns) and places of the last moments, oldest first.
    recent: VecDeque<(u64, Places)>,
    settled: Option<Settled>,
}

/// Where every part was when a choice was made.
#[derive(Debug)]
struct Settled {
    look_ns: u64,
    places: Places,
    /// Largest displacement of each part since, m.
    slips_m: BTreeMap<u32, f64>,
}

impl Truth {
    /// The parts were there at `stamp_ns`.
    pub(crate) fn learn(&mut self, stamp_ns: u64, parts: &[TruePart]) {
        let place = |part: &TruePart| (part.id, (part.position_in_tray_m(), part.resting_pose));
        let places: Places = parts.iter().map(place).collect();
        if let Some(settled) = &mut self.settled {
            settled.follow(&places);
        }
        self.recent.push_back((stamp_ns, places));
        if self.recent.len() > MEMORY {
            self.recent.pop_front();
        }
    }

    /// Whether the parts' places at `stamp_ns` are remembered.
    pub(crate) fn knows(&self, stamp_ns: u64) -> bool {
        self.recent.iter().any(|(ns, _)| *ns == stamp_ns)
    }

    /// The part whose centre was nearest to `point` at `stamp_ns`, if within `reach_m`, and the pose it lay in.
    pub(crate) fn part_at(&self, stamp_ns: u64, point: &Vector2<f64>, reach_m: f64) -> Option<(u32, u8)> {
        let (_, places) = self.recent.iter().rev().find(|(ns, _)| *ns == stamp_ns)?;
        let distances = places.iter().map(|(id, (place, pose))| ((*id, *pose), (place - point).norm()));
        let (part, distance_m) = distances.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        (distance_m <= reach_m).then_some(part)
    }

    /// Counts slip from the picture taken at `look_ns`, on which a choice rests.
    pub(crate) fn settle(&mut self, look_ns: u64) {
        if self.settled.as_ref().is_some_and(|settled| settled.look_ns == look_ns) {
            return;
        }
        let mut since = self.recent.iter().filter(|(ns, _)| *ns >= look_ns);
        let Some((_, places)) = since.next() else { return };
        let mut settled = Settled { look_ns, places: places.clone(), slips_m: BTreeMap::new() };
        for (_, places) in since {
            settled.follow(places);
        }
        self.settled = Some(settled);
    }

    /// Largest displacement of a part since the last choice, m; nothing for a part that was not there then.
    pub(crate) fn slip_m(&self, id: u32) -> Option<f64> {
        self.settled.as_ref().and_then(|settled| settled.slips_m.get(&id)).copied()
    }
}

impl Settled {
    fn follow(&mut self, places: &Places) {
        for (id, (place, _)) in places {
            if let Some((from, _)) = self.places.get(id) {
                let slip_m = self.slips_m.entry(*id).or_insert(0.0);
                *slip_m = slip_m.max((place - from).norm());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use feeder_model::tray::Place;

    use super::*;

    /// Parts on the line of ψ = 0, numbered from 0.
    fn parts(radii_m: &[f64]) -> Vec<TruePart> {
        let part = |(id, &radius_m): (u32, &f64)| TruePart {
            id,
            part_class: "block".to_owned(),
            place: Place::Plateau,
            resting_pose: 0,
            radius_m,
            angle_rad: 0.0,
            yaw_rad: 0.0,
            radial_velocity_m_s: 0.0,
            tangential_velocity_m_s: 0.0,
            sticking: true,
            stranded: false,
        };
        (0..).zip(radii_m).map(part).collect()
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
}
