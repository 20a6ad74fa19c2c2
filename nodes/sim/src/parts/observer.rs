//! How well a tray feeds, seen from outside: what passes the camera, how it lies, how far apart, and how long a lap takes.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector2;

use crate::parts::{Part, Place};
use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;

/// A part as an observer sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Identity.
    pub id: u32,
    /// Where it is.
    pub place: Place,
    /// Index into the stable poses of its type.
    pub pose: usize,
    /// Centre in the tray frame, m.
    pub position_m: Vector2<f64>,
}

impl From<&Part> for Sighting {
    fn from(part: &Part) -> Self {
        Self { id: part.id, place: part.place, pose: part.pose, position_m: part.position_m() }
    }
}

/// A part that left the plateau over its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Departure {
    /// Identity.
    pub id: u32,
    /// If it lay in a wanted pose, and apart from others when it passed the camera.
    pub was_good: bool,
}

/// What was seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FeedReport {
    /// Time observed, s.
    pub observed_s: f64,
    /// Parts that passed the middle of the plateau, where the camera looks.
    pub passed: u32,
    /// Of these, in a wanted pose.
    pub right: u32,
    /// Of these, apart from others by at least one length.
    pub apart: u32,
    /// Of these, both; and others that were taken from the plateau in a wanted pose, before the middle or after it.
    pub good: u32,
    /// Parts on the plateau, on average over time.
    pub plateau_parts: f64,
    /// Share of the parts on the plateau that were apart from others by at least one length, on average.
    pub singulation: f64,
    /// Free distance from a part on the plateau to the next, mean over those that have one, m.
    pub gap_m: f64,
    /// Distance of the parts on the plateau from the outer wall, less their own radius: mean, m.
    pub wall_gap_m: f64,
    /// Time from leaving the plateau to entering it again, mean, s; 0 if no part has.
    pub recirculation_s: f64,
}

impl FeedReport {
    /// A count per minute.
    #[must_use]
    pub fn per_minute(&self, count: u32) -> f64 {
        if self.observed_s > 0.0 { 60.0 * f64::from(count) / self.observed_s } else { 0.0 }
    }
}

/// Counts what passes the camera.
#[derive(Clone, Debug)]
pub struct FeedObserver {
    tray: TrayGeometry,
    wanted: Vec<bool>,
    /// Radius of the part in each pose, m.
    radii_m: Vec<f64>,
    /// The largest length of the part, m: it is apart from others if the gap is as long.
    length_m: f64,
    /// What each part did last.
    known: BTreeMap<u32, Known>,
    began_s: Option<f64>,
    /// Sums over observations, and over parts within them.
    observations: u32,
    seen: u32,
    seen_apart: u32,
    gaps: u32,
    gap_sum_m: f64,
    wall_gap_sum_m: f64,
    laps: u32,
    lap_sum_s: f64,
    report: FeedReport,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    place: Place,
    angle_rad: f64,
    /// When it fell, s, until it enters the plateau again.
    fell_s: Option<f64>,
    /// If it lies in a wanted pose.
    right: bool,
    /// If it was good when it passed the camera.
    good: bool,
}

impl FeedObserver {
    /// An observer of parts of one type on a tray.
    #[must_use]
    pub fn new(tray: TrayGeometry, part: &PartType) -> Self {
        Self {
            tray,
            wanted: (0..part.poses.len()).map(|pose| part.wanted_poses.contains(&pose)).collect(),
            radii_m: part.poses.iter().map(|pose| pose.outline.radius_m).collect(),
            length_m: part.poses.iter().map(|pose| pose.outline.width_range_m().1).fold(0.0, f64::max),
            known: BTreeMap::new(),
            began_s: None,
            observations: 0,
            seen: 0,
            seen_apart: 0,
            gaps: 0,
            gap_sum_m: 0.0,
            wall_gap_sum_m: 0.0,
            laps: 0,
            lap_sum_s: 0.0,
            report: FeedReport::default(),
        }
    }

    /// Looks at all parts at a time, which must not run back. Returns who left the plateau over its end since.
    pub fn observe(&mut self, time_s: f64, sightings: impl Iterator<Item = Sighting>) -> Vec<Departure> {
        let sightings: Vec<Sighting> = sightings.collect();
        let plateau: Vec<&Sighting> = sightings.iter().filter(|part| part.place == Place::Plateau).collect();
        let began_s = *self.began_s.get_or_insert(time_s);
        self.report.observed_s = time_s - began_s;
        self.observations += 1;
        let mut departures = Vec::new();
        let mut known = BTreeMap::new();
        for part in &sightings {
            let now = self.follow(time_s, part, &plateau, &mut departures);
            known.insert(part.id, now);
        }
        let is_taken = |(id, before): &(&u32, &Known)| before.place == Place::Plateau && !known.contains_key(id);
        let taken = self.known.iter().filter(is_taken).filter(|(_, before)| before.right && !before.good).count();
        self.report.good += u32::try_from(taken).unwrap_or(u32::MAX);
        self.known = known;
        departures
    }

    fn follow(
        &mut self,
        time_s: f64,
        part: &Sighting,
        plateau: &[&Sighting],
        departures: &mut Vec<Departure>,
    ) -> Known {
        let angle_rad = part.position_m.y.atan2(part.position_m.x).rem_euclid(TAU);
        let before = self.known.get(&part.id).copied();
        let right = self.wanted.get(part.pose).copied().unwrap_or_default();
        let mut now = Known { place: part.place, angle_rad, fell_s: None, right, good: false };
        if let Some(before) = before {
            (now.fell_s, now.good) = (before.fell_s, before.good);
        }
        let was_on_plateau = before.is_some_and(|before| before.place == Place::Plateau);
        match part.place {
            Place::Plateau => {
                if let Some(fell_s) = now.fell_s.take() {
                    self.laps += 1;
                    self.lap_sum_s += time_s - fell_s;
                }
                let gap_m = self.gap_m(part, plateau);
                let apart = gap_m.is_none_or(|gap_m| gap_m >= self.length_m);
                self.seen += 1;
                self.seen_apart += u32::from(apart);
                if let Some(gap_m) = gap_m {
                    self.gaps += 1;
                    self.gap_sum_m += gap_m;
                }
                self.wall_gap_sum_m += self.tray.outer_radius_m - part.position_m.norm() - self.radius_m(part);
                let middle_rad = f64::midpoint(self.tray.ramp_angle_rad, TAU);
                let passes = before.is_some_and(|b| was_on_plateau && b.angle_rad < middle_rad);
                if passes && angle_rad >= middle_rad {
                    now.good = right && apart;
                    self.report.passed += 1;
                    self.report.right += u32::from(right);
                    self.report.apart += u32::from(apart);
                    self.report.good += u32::from(now.good);
                }
            }
            Place::Ramp | Place::Falling => {
                let over_the_end = part.place == Place::Falling || angle_rad < 0.5 * self.tray.ramp_angle_rad;
                if was_on_plateau && over_the_end {
                    now.fell_s = Some(time_s);
                    departures.push(Departure { id: part.id, was_good: now.good });
                    now.good = false;
                }
            }
        }
        now
    }

    /// Free distance to the nearest other part on the plateau, m.
    fn gap_m(&self, part: &Sighting, plateau: &[&Sighting]) -> Option<f64> {
        let others = plateau.iter().filter(|other| other.id != part.id);
        let gaps = others
            .map(|other| (other.position_m - part.position_m).norm() - self.radius_m(part) - self.radius_m(other));
        gaps.min_by(f64::total_cmp).map(|gap_m| gap_m.max(0.0))
    }

    fn radius_m(&self, part: &Sighting) -> f64 {
        self.radii_m.get(part.pose).copied().unwrap_or_default()
    }

    /// What was seen so far.
    #[must_use]
    pub fn report(&self) -> FeedReport {
        let mean = |sum: f64, count: u32| if count > 0 { sum / f64::from(count) } else { 0.0 };
        FeedReport {
            plateau_parts: mean(f64::from(self.seen), self.observations),
            singulation: mean(f64::from(self.seen_apart), self.seen),
            gap_m: mean(self.gap_sum_m, self.gaps),
            wall_gap_m: mean(self.wall_gap_sum_m, self.seen),
            recirculation_s: mean(self.lap_sum_s, self.laps),
            ..self.report
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::tests::disc;

    fn at(id: u32, place: Place, pose: usize, angle_rad: f64) -> Sighting {
        let position_m = 0.08 * Vector2::new(angle_rad.cos(), angle_rad.sin());
        Sighting { id, place, pose, position_m }
    }

    #[test]
    fn what_passes_the_middle_is_counted_by_how_it_lies_and_how_far_apart() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2));
        let plateau = |id, pose, angle_rad| at(id, Place::Plateau, pose, angle_rad);
        // Part 0 lies right and alone; 1 and 2 lie within a length of each other, 2 the wrong way round.
        observer.observe(0.0, [plateau(0, 0, 4.7), plateau(1, 0, 4.1), plateau(2, 1, 4.0)].into_iter());
        observer.observe(10.0, [plateau(0, 0, 5.2), plateau(1, 0, 4.8), plateau(2, 1, 4.72)].into_iter());
        let report = observer.report();
        assert_eq!((report.passed, report.right, report.apart, report.good), (3, 2, 1, 1));
        assert!((report.per_minute(report.passed) - 18.0).abs() < 1e-9);
        assert!((report.plateau_parts - 3.0).abs() < 1e-12);
        assert!((report.singulation - 2.0 / 6.0).abs() < 1e-12);
        assert!((report.wall_gap_m - 0.007).abs() < 1e-12);
    }

    #[test]
    fn parts_that_are_taken_were_good_if_they_lay_right_and_no_part_counts_twice() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2));
        let plateau = |id, pose, angle_rad| at(id, Place::Plateau, pose, angle_rad);
        observer.observe(0.0, [plateau(0, 0, 4.7), plateau(1, 0, 4.1), plateau(2, 1, 3.6)].into_iter());
        observer.observe(1.0, [plateau(0, 0, 4.8), plateau(1, 0, 4.2), plateau(2, 1, 3.7)].into_iter());
        assert_eq!(observer.report().good, 1);
        // The first had passed, the second lay right, the third the wrong way round; a fourth is taken from the ramp.
        observer.observe(2.0, [at(3, Place::Ramp, 0, 1.0)].into_iter());
        observer.observe(3.0, std::iter::empty());
        assert_eq!((observer.report().passed, observer.report().good), (1, 2));
    }

    #[test]
    fn a_lap_is_from_the_end_of_the_plateau_to_its_begin() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2));
        let path = [
            (0.0, Place::Plateau, 4.6),
            (1.0, Place::Plateau, 4.8),
            (2.0, Place::Falling, 0.0),
            (3.0, Place::Ramp, 0.1),
            (14.0, Place::Ramp, 3.1),
            (15.0, Place::Plateau, 3.2),
            // Slipping back over the crest is no lap.
            (16.0, Place::Ramp, 3.1),
            (17.0, Place::Plateau, 3.2),
        ];
        let mut left = Vec::new();
        for (time_s, place, angle_rad) in path {
            left.extend(observer.observe(time_s, [at(7, place, 0, angle_rad)].into_iter()));
        }
        assert_eq!(left, [Departure { id: 7, was_good: true }]);
        let report = observer.report();
        assert!((report.recirculation_s - 13.0).abs() < 1e-12 && report.passed == 1);
    }
}
