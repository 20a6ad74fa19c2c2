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
    pub(crate) fn new(tray: TrayGeometry, part: &PartType) -> Self {
        Self {
            observer: FeedObserver::new(tray, part),
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
    Sighting { id: part.id, place: part.place, pose, position_m }
}
