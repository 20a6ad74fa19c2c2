//! How well a tray feeds, seen from outside: what passes the camera, how it lies, how far apart, and how long a lap takes.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Isometry2, Point2, Vector2};

use crate::parts::{Part, Place};
use feeder_model::geometry::Outline;
use feeder_model::geometry::apart::gap_m;
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
    /// Heading in the tray frame, rad.
    pub yaw_rad: f64,
}

impl From<&Part> for Sighting {
    fn from(part: &Part) -> Self {
        Self { id: part.id, place: part.place, pose: part.pose, position_m: part.position_m(), yaw_rad: part.yaw_rad }
    }
}

/// A part that left the plateau over its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Departure {
    /// Identity.
    pub id: u32,
    /// If it could have been picked on its way over the plateau.
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
    /// Parts that could be picked on their way over the plateau, each once a lap: for a moment at least they lay in a wanted
    /// pose, wholly on the plateau, and with the room that a gripper needs.
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
    /// The part as it lies in each pose.
    outlines: Vec<Outline>,
    /// Free gap that a gripper needs to the next part, m.
    room_m: f64,
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
    /// If it could be picked in its present lap.
    good: bool,
}

impl FeedObserver {
    /// An observer of parts of one type on a tray, where a gripper needs a free gap of `room_m` (m) to the next part.
    #[must_use]
    pub fn new(tray: TrayGeometry, part: &PartType, room_m: f64) -> Self {
        Self {
            tray,
            wanted: (0..part.poses.len()).map(|pose| part.wanted_poses.contains(&pose)).collect(),
            outlines: part.poses.iter().map(|pose| pose.outline.clone()).collect(),
            room_m,
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
            let now = self.follow(time_s, part, &sightings, &plateau, &mut departures);
            known.insert(part.id, now);
        }
        self.known = known;
        departures
    }

    fn follow(
        &mut self,
        time_s: f64,
        part: &Sighting,
        all: &[Sighting],
        plateau: &[&Sighting],
        departures: &mut Vec<Departure>,
    ) -> Known {
        let angle_rad = part.position_m.y.atan2(part.position_m.x).rem_euclid(TAU);
        let before = self.known.get(&part.id).copied();
        let right = self.wanted.get(part.pose).copied().unwrap_or_default();
        let mut now = Known { place: part.place, angle_rad, fell_s: None, good: false };
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
                    self.report.passed += 1;
                    self.report.right += u32::from(right);
                    self.report.apart += u32::from(apart);
                }
                if !now.good && right && self.has_room(part, all) {
                    now.good = true;
                    self.report.good += 1;
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
        self.outlines.get(part.pose).map_or(0.0, |outline| outline.radius_m)
    }

    /// If a part lies wholly on the plateau, with room for a gripper to every other part.
    fn has_room(&self, part: &Sighting, all: &[Sighting]) -> bool {
        let Some(outline) = self.outlines.get(part.pose) else { return false };
        let corners = outline.at(&Isometry2::new(part.position_m, part.yaw_rad));
        let on_plateau = |corner: &Point2<f64>| {
            let angle_rad = corner.y.atan2(corner.x).rem_euclid(TAU);
            angle_rad >= self.tray.ramp_angle_rad
        };
        let clears = |other: &Sighting| {
            let Some(beside) = self.outlines.get(other.pose) else { return true };
            let circles_m = (other.position_m - part.position_m).norm() - outline.radius_m - beside.radius_m;
            let decided = circles_m >= self.room_m || (outline.round && beside.round);
            let exactly_m = || gap_m(&corners, &beside.at(&Isometry2::new(other.position_m, other.yaw_rad)));
            (if decided { circles_m } else { exactly_m() }) >= self.room_m
        };
        let mut others = all.iter().filter(|other| other.id != part.id && other.place != Place::Falling);
        corners.iter().all(on_plateau) && others.all(clears)
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

    const ROOM_M: f64 = 0.0015;

    fn at(id: u32, place: Place, pose: usize, angle_rad: f64) -> Sighting {
        let position_m = 0.08 * Vector2::new(angle_rad.cos(), angle_rad.sin());
        Sighting { id, place, pose, position_m, yaw_rad: 0.0 }
    }

    #[test]
    fn what_passes_the_middle_is_counted_by_how_it_lies_and_how_far_apart() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2), ROOM_M);
        let plateau = |id, pose, angle_rad| at(id, Place::Plateau, pose, angle_rad);
        // Part 0 lies right and alone; 1 and 2 lie within a length of each other, 2 the wrong way round.
        observer.observe(0.0, [plateau(0, 0, 4.7), plateau(1, 0, 4.1), plateau(2, 1, 4.0)].into_iter());
        observer.observe(10.0, [plateau(0, 0, 5.2), plateau(1, 0, 4.8), plateau(2, 1, 4.72)].into_iter());
        let report = observer.report();
        assert_eq!((report.passed, report.right, report.apart, report.good), (3, 2, 1, 2));
        assert!((report.per_minute(report.passed) - 18.0).abs() < 1e-9);
        assert!((report.plateau_parts - 3.0).abs() < 1e-12);
        assert!((report.singulation - 2.0 / 6.0).abs() < 1e-12);
        assert!((report.wall_gap_m - 0.007).abs() < 1e-12);
    }

    #[test]
    fn a_part_is_good_once_a_lap_if_for_a_moment_it_could_be_picked() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2), ROOM_M);
        let plateau = |id, pose, angle_rad| at(id, Place::Plateau, pose, angle_rad);
        let mut good = |time_s, parts: &[Sighting]| {
            observer.observe(time_s, parts.iter().copied());
            observer.report().good
        };
        // Across the crest, the wrong way round, nearer than the gripper needs: 0.09 rad are 7.2 mm, of which 1.2 are free.
        assert_eq!(good(0.0, &[plateau(0, 0, 3.17), plateau(1, 1, 4.0), plateau(2, 0, 4.5), plateau(3, 1, 4.59)]), 0);
        // The next moves on.
        assert_eq!(good(1.0, &[plateau(0, 0, 3.17), plateau(1, 1, 4.0), plateau(2, 0, 4.5), plateau(3, 1, 4.7)]), 1);
        // Wholly on the plateau; the other is still the same good one, and still is when it has been alone for long.
        assert_eq!(good(2.0, &[plateau(0, 0, 3.4), plateau(2, 0, 4.6)]), 2);
        assert_eq!(good(3.0, &[plateau(2, 0, 4.7)]), 2);
        // A lap later it counts again; a part on the ramp never does.
        assert_eq!(good(4.0, &[at(2, Place::Falling, 0, 0.0), at(4, Place::Ramp, 0, 1.0)]), 2);
        assert_eq!(good(5.0, &[plateau(2, 0, 4.0)]), 3);
    }

    #[test]
    fn a_lap_is_from_the_end_of_the_plateau_to_its_begin() {
        let mut observer = FeedObserver::new(TrayGeometry::PAPER, &disc(0.006, 0.2), ROOM_M);
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
