//! The score of one feeder, by ground truth.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use feeder_model::delivery::Phase;
use feeder_model::part::PartType;
use feeder_scenario::plan::RunMonitorConfig;
use feeder_wire::delivery_state::{ChosenPart, PlannerStand};
use feeder_wire::part_candidates::SeenPart;
use feeder_wire::parts::TrueParts;
use feeder_wire::pick::TakenPart;

use crate::feed::FeedScore;
use crate::presented::{PresentedScore, YAW_ERROR_MAX_RAD};
use crate::progress::{Activity, FeederProgress};
use crate::truth::Truth;

/// Time between figures on how well the feeder feeds, ns.
const METRICS_NS: u64 = 1_000_000_000;
/// How many of them are kept of a run: where it is longer, they are further apart.
const HISTORY_MAX: usize = 1_000;

/// Scores one feeder by what the truth and the feeder's nodes say, in the order in which it came.
pub(crate) struct FeederScore {
    /// Names of the resting poses, as the truth numbers them, and of those wanted.
    pose_names: Vec<String>,
    wanted_pose_names: Vec<String>,
    part_radius_m: f64,
    presented: PresentedScore,
    truth: Truth,
    feed: FeedScore,
    /// When the next figures on how well the feeder feeds are due, ns.
    metrics_ns: u64,
    /// Every so many of these figures are kept, and so many have come since.
    noted_every: u32,
    since_noted: u32,
    /// Parts that the selector saw, and those it called right.
    seen: BTreeSet<u32>,
    selected: BTreeSet<u32>,
    /// Parts in the feeder, and those that were picked.
    present: BTreeSet<u32>,
    picked: BTreeSet<u32>,
    /// Since when the planner has done what it does, ns.
    active_since_ns: u64,
    /// The part presented last, as the planner told of it.
    promised: Option<ChosenPart>,
    /// The delivery in which it was.
    promised_to: Option<String>,
    pub(crate) progress: FeederProgress,
}

impl FeederScore {
    pub(crate) fn new(feeder: &str, config: &RunMonitorConfig, part: &PartType) -> Self {
        Self {
            pose_names: part.poses.iter().map(|pose| pose.name.clone()).collect(),
            wanted_pose_names: part.wanted_pose_names().map(str::to_owned).collect(),
            part_radius_m: part.outline_radius_m(),
            presented: PresentedScore::new(part, config.grippers.clone()),
            truth: Truth::default(),
            feed: FeedScore::new(config.tray, part),
            metrics_ns: METRICS_NS,
            noted_every: 1,
            since_noted: 0,
            seen: BTreeSet::new(),
            selected: BTreeSet::new(),
            present: BTreeSet::new(),
            picked: BTreeSet::new(),
            active_since_ns: 0,
            promised: None,
            promised_to: None,
            progress: FeederProgress { name: feeder.to_owned(), ..FeederProgress::default() },
        }
    }

    /// A part was taken out of the feeder.
    pub(crate) fn note_taken(&mut self, part: &TakenPart) {
        self.progress.parts_doubled += u32::from(!self.picked.insert(part.id));
    }

    /// The parts were there at `stamp_ns`. Says whether another second of figures is full.
    pub(crate) fn learn(&mut self, stamp_ns: u64, truth: &TrueParts) -> bool {
        self.progress.fed = truth.fed;
        self.count(truth);
        self.truth.learn(stamp_ns, &truth.parts);
        let time_s = Duration::from_nanos(stamp_ns).as_secs_f64();
        self.feed.learn(time_s, truth);
        let is_full = stamp_ns >= self.metrics_ns;
        if is_full {
            self.metrics_ns += METRICS_NS;
            self.progress.feed = self.feed.feed();
            self.note_in_history(time_s);
        }
        is_full
    }

    fn note_in_history(&mut self, time_s: f64) {
        self.since_noted += 1;
        if self.since_noted < self.noted_every {
            return;
        }
        self.since_noted = 0;
        let history = Arc::make_mut(&mut self.progress.history);
        if history.len() == HISTORY_MAX {
            // The second of each two stays, and the next one comes as long after the last as they are apart.
            let mut stays = true;
            history.retain(|_| {
                stays = !stays;
                stays
            });
            self.since_noted = self.noted_every;
            self.noted_every *= 2;
            return;
        }
        history.push((time_s, self.progress.feed.clone()));
    }

    /// Looks for parts that are gone without a pick, or back after one.
    fn count(&mut self, truth: &TrueParts) {
        let present: BTreeSet<u32> = truth.parts.iter().map(|part| part.id).collect();
        let count = |parts: usize| u32::try_from(parts).unwrap_or(u32::MAX);
        let gone = self.present.difference(&present).filter(|id| !self.picked.contains(id)).count();
        let back = present.difference(&self.present).filter(|id| self.picked.contains(id)).count();
        self.progress.parts_lost += count(gone);
        self.progress.parts_doubled += count(back);
        self.present = present;
    }

    /// The planner stands there.
    pub(crate) fn hear_planner(&mut self, stamp_ns: u64, stand: &PlannerStand) {
        if let Some(chosen) = &stand.chosen {
            self.hear_chosen(stand, chosen);
        }
        let spent_s = Duration::from_nanos(stamp_ns.saturating_sub(self.active_since_ns)).as_secs_f64();
        *self.progress.spent_s.entry(self.progress.activity).or_insert(0.0) += spent_s;
        self.progress.activity = activity_of(stand.phase);
        self.active_since_ns = stamp_ns;
        self.progress.accepted = stand.accepted;
        self.progress.succeeded = stand.delivered;
        self.progress.failed_by_outcome = stand.failed_by_outcome.to_vec();
    }

    /// The planner presents this part; it may tell so several times.
    fn hear_chosen(&mut self, stand: &PlannerStand, chosen: &ChosenPart) {
        let look_ns = u64::try_from(chosen.look.as_nanos()).unwrap_or(u64::MAX);
        self.truth.settle(look_ns);
        let is_new = self.promised_to != stand.delivery_id;
        self.promised_to.clone_from(&stand.delivery_id);
        self.promised = Some(chosen.clone());
        let part = self.truth.part_at(look_ns, &chosen.position_in_tray_m, self.part_radius_m);
        if let (true, Some((id, _)), Some(station), Some(lays)) = (is_new, part, &stand.station, self.truth.at(look_ns))
            && let Some(short_m) = self.presented.room_short_m(station, id, lays)
        {
            self.progress.chosen_without_room += 1;
            self.progress.room_short_m_max = self.progress.room_short_m_max.max(short_m);
        }
    }

    /// Finds out which parts the selector meant, by where they were when the picture was taken.
    pub(crate) fn hear_selector(&mut self, stamp_ns: u64, seen: &[SeenPart]) {
        for seen in seen.iter().filter(|part| !part.refusals.off_plateau) {
            let part = self.truth.part_at(stamp_ns, &seen.position_in_tray_m, self.part_radius_m);
            let is_wanted = seen.pose_class.as_ref().is_some_and(|pose| self.wanted_pose_names.contains(pose));
            let called_right = seen.refusals.may_be_picked() && is_wanted;
            if called_right && self.truth.at(stamp_ns).is_some() {
                self.feed.selected(part);
            }
            let Some((id, _)) = part else { continue };
            self.progress.seen += u32::from(self.seen.insert(id));
            self.progress.selected += u32::from(called_right && self.selected.insert(id));
        }
    }

    /// A part was picked; what was said before it has been heard.
    pub(crate) fn score_pick(&mut self, part: &TakenPart) {
        let lay = self.pose_names.get(usize::from(part.resting_pose));
        self.progress.delivered += 1;
        let promised = self.promised.as_ref();
        let is_right = lay == promised.and_then(|promised| promised.pose_class.as_ref());
        self.progress.wrong_pose_delivered += u32::from(!is_right);
        // A part in another pose than it was said to lie in has no yaw to compare.
        let compared = self.truth.last(part.id).zip(promised).filter(|_| is_right);
        let error_rad = compared.and_then(|(lay, said)| self.presented.yaw_error_rad(lay, said.yaw_in_tray_rad));
        if let Some(error_rad) = error_rad {
            self.progress.wrong_yaw_delivered += u32::from(error_rad > YAW_ERROR_MAX_RAD);
            let most_rad = self.progress.max_yaw_error_rad.unwrap_or(0.0);
            self.progress.max_yaw_error_rad = Some(most_rad.max(error_rad));
        }
        match self.truth.slip_m(part.id) {
            Some(slip_m) => {
                self.progress.max_slip_m = Some(self.progress.max_slip_m.map_or(slip_m, |most| most.max(slip_m)));
            }
            None => self.progress.slips_unknown += 1,
        }
    }
}

fn activity_of(phase: Phase) -> Activity {
    match phase {
        Phase::Feeding => Activity::Wait,
        Phase::Stopping => Activity::Stop,
        Phase::Settling => Activity::Settle,
        Phase::Looking => Activity::Look,
        Phase::Reserving => Activity::Reserve,
        Phase::Moving => Activity::Move,
        Phase::Presented => Activity::Pick,
        Phase::Returning => Activity::Return,
        Phase::Idle | Phase::Purging | Phase::Fault => Activity::Idle,
    }
}

#[cfg(test)]
mod tests;
