//! How well the feeder feeds and the selector selects, by ground truth.

use std::collections::BTreeSet;

use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;
use feeder_sim::parts::{Departure, FeedObserver, FeedReport, Sighting};
use feeder_wire::parts::{TruePart, TrueParts};
use minifactory_msgs::msg::FeedMetrics;
use minifactory_msgs::std_msgs::msg::Header;

/// The figures of a run so far, and how they came about.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Feed {
    /// What passed the camera.
    pub report: FeedReport,
    /// Parts called right that were, once a lap.
    pub right_selections: u32,
    /// Parts called right that were not, once a lap.
    pub wrong_selections: u32,
    /// Good parts that left without having been called right.
    pub missed_selections: u32,
    /// Jams that began.
    pub jams: u32,
    /// Parts that are stranded.
    pub stranded: u32,
}

/// Scores what the tray feeds and what the selector makes of it.
#[derive(Debug)]
pub(crate) struct FeedScore {
    observer: FeedObserver,
    wanted_poses: Vec<u8>,
    /// Parts called right in their present lap, and those wrongly so.
    called_right: BTreeSet<u32>,
    called_wrongly: BTreeSet<u32>,
    feed: Feed,
}

impl FeedScore {
    /// As [`FeedObserver::new`].
    pub(crate) fn new(tray: TrayGeometry, part: &PartType, room_m: f64) -> Self {
        Self {
            observer: FeedObserver::new(tray, part, room_m),
            wanted_poses: part.wanted_poses.iter().filter_map(|&pose| u8::try_from(pose).ok()).collect(),
            called_right: BTreeSet::new(),
            called_wrongly: BTreeSet::new(),
            feed: Feed::default(),
        }
    }

    /// Looks at all parts.
    pub(crate) fn learn(&mut self, time_s: f64, truth: &TrueParts) {
        self.feed.jams = truth.jams;
        self.feed.stranded = truth.parts.iter().fold(0, |count, part| count + u32::from(part.stranded));
        for Departure { id, was_good } in self.observer.observe(time_s, truth.parts.iter().map(sighting)) {
            let called = self.called_right.remove(&id);
            self.called_wrongly.remove(&id);
            self.feed.missed_selections += u32::from(was_good && !called);
        }
    }

    /// The selector called a part right that lay in `pose`, or something where no part was.
    pub(crate) fn selected(&mut self, part: Option<(u32, u8)>) {
        match part {
            Some((id, pose)) if self.wanted_poses.contains(&pose) => {
                self.feed.right_selections += u32::from(self.called_right.insert(id));
            }
            Some((id, _)) => self.feed.wrong_selections += u32::from(self.called_wrongly.insert(id)),
            None => self.feed.wrong_selections += 1,
        }
    }

    pub(crate) fn feed(&self) -> Feed {
        Feed { report: self.observer.report(), ..self.feed.clone() }
    }
}

impl Feed {
    /// As a message.
    pub(crate) fn message(&self, header: Header) -> FeedMetrics {
        let report = &self.report;
        FeedMetrics {
            header,
            passed_per_min: report.per_minute(report.passed),
            good_per_min: report.per_minute(report.good),
            right_selections: self.right_selections,
            wrong_selections: self.wrong_selections,
            missed_selections: self.missed_selections,
            plateau_parts: report.plateau_parts,
            singulation: report.singulation,
            gap_m: report.gap_m,
            recirculation_s: report.recirculation_s,
            jams: self.jams,
            stranded: self.stranded,
        }
    }
}

fn sighting(part: &TruePart) -> Sighting {
    let (pose, position_m) = (usize::from(part.resting_pose), part.position_in_tray_m());
    Sighting { id: part.id, place: part.place, pose, position_m, yaw_rad: part.yaw_rad }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use feeder_model::tray::Place;
    use feeder_scenario::PartSource;

    use super::*;
    use crate::truth::testing::{self, truth};

    /// The middle of the plateau, where the camera looks.
    const MIDDLE_RAD: f64 = 1.5 * PI;

    fn score() -> FeedScore {
        FeedScore::new(TrayGeometry::PAPER, &PartSource::Name("grommet".to_owned()).part_type().unwrap(), 0.001)
    }

    fn part(id: u32, place: Place, angle_rad: f64) -> TruePart {
        TruePart { place, angle_rad, ..testing::lying(id, 0.05 + 0.02 * f64::from(id), 0) }
    }

    /// Two good parts pass the camera and fall off the end, a lap of a minute.
    fn lap(score: &mut FeedScore, begin_s: f64, called: impl Fn(&mut FeedScore)) {
        let both = |place, angle_rad| truth(&[part(0, place, angle_rad), part(1, place, angle_rad)]);
        score.learn(begin_s, &both(Place::Plateau, MIDDLE_RAD - 0.1));
        score.learn(begin_s + 20.0, &both(Place::Plateau, MIDDLE_RAD + 0.1));
        called(score);
        score.learn(begin_s + 40.0, &both(Place::Falling, 0.1));
    }

    #[test]
    fn a_good_part_that_leaves_without_having_been_called_right_in_this_lap_was_missed() {
        let mut score = score();
        assert!(score.wanted_poses.contains(&0));
        lap(&mut score, 0.0, |score| score.selected(Some((0, 0))));
        assert_eq!((score.feed().right_selections, score.feed().missed_selections), (1, 1));
        // What was called right a lap ago is not called right now, and counts again when it is.
        lap(&mut score, 60.0, |score| score.selected(Some((1, 0))));
        assert_eq!((score.feed().right_selections, score.feed().missed_selections), (2, 2));
        lap(&mut score, 120.0, |score| (0..2).for_each(|id| score.selected(Some((id, 0)))));
        assert_eq!((score.feed().right_selections, score.feed().missed_selections), (4, 2));
    }

    #[test]
    fn a_part_called_right_wrongly_counts_once_a_lap_and_nothing_called_right_each_time() {
        let mut score = score();
        let unwanted = (0..=u8::MAX).find(|pose| !score.wanted_poses.contains(pose)).unwrap();
        for lap_number in 1..=2 {
            lap(&mut score, 60.0 * f64::from(lap_number), |score| {
                (0..3).for_each(|_| score.selected(Some((0, unwanted))));
            });
            assert_eq!((score.feed().right_selections, score.feed().wrong_selections), (0, lap_number));
        }
        score.selected(None);
        score.selected(None);
        assert_eq!(score.feed().wrong_selections, 4);
    }

    #[test]
    fn figures_are_told_as_they_are() {
        let mut score = score();
        let stranded = TruePart { stranded: true, ..part(1, Place::Plateau, MIDDLE_RAD + 0.5) };
        let passing = |angle_rad| part(0, Place::Plateau, angle_rad);
        score.learn(0.0, &truth(&[passing(MIDDLE_RAD - 0.1), stranded.clone()]));
        score.learn(15.0, &TrueParts { jams: 7, ..truth(&[passing(MIDDLE_RAD + 0.1), stranded]) });
        score.selected(Some((0, 0)));
        let header = Header { frame_id: "tray".to_owned(), ..Header::default() };
        let (message, report) = (score.feed().message(header.clone()), score.feed().report);
        assert_eq!((message.header, message.jams, message.stranded), (header, 7, 1));
        let selections = (message.right_selections, message.wrong_selections, message.missed_selections);
        assert_eq!(selections, (1, 0, 0));
        // Both could be picked, and one passed.
        assert_eq!((message.passed_per_min, message.good_per_min), (4.0, 8.0));
        assert_eq!((message.plateau_parts, message.singulation), (2.0, 1.0));
        assert!(message.gap_m > 0.01 && (message.gap_m - report.gap_m).abs() < 1e-12, "{report:?}");
    }
}
