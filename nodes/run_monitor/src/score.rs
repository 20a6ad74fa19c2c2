//! The score of one feeder, by ground truth.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use feeder_model::delivery::Phase;
use feeder_model::part::PartType;
use feeder_scenario::plan::RunMonitorConfig;
use feeder_wire::delivery_state::PlannerStand;
use feeder_wire::part_candidates::SeenPart;
use feeder_wire::parts::TrueParts;
use feeder_wire::pick::TakenPart;

use crate::feed::FeedScore;
use crate::progress::{Activity, FeederProgress};
use crate::truth::Truth;

/// Time between figures on how well the feeder feeds, ns.
const METRICS_NS: u64 = 1_000_000_000;

/// Scores one feeder by what the truth and the feeder's nodes say, in the order in which it came.
pub(crate) struct FeederScore {
    /// Names of the resting poses, as the truth numbers them, and of those wanted.
    pose_names: Vec<String>,
    wanted_pose_names: Vec<String>,
    part_radius_m: f64,
    truth: Truth,
    feed: FeedScore,
    /// When the next figures on how well the feeder feeds are due, ns.
    metrics_ns: u64,
    /// Parts in the feeder, and those that were picked.
    present: BTreeSet<u32>,
    picked: BTreeSet<u32>,
    /// Since when the planner has done what it does, ns.
    active_since_ns: u64,
    /// The delivery whose part was presented last.
    presented: Option<String>,
    /// The pose in which the part presented last was said to lie.
    promised_pose: Option<String>,
    pub(crate) progress: FeederProgress,
}

impl FeederScore {
    pub(crate) fn new(feeder: &str, config: &RunMonitorConfig, part: &PartType) -> Self {
        Self {
            pose_names: part.poses.iter().map(|pose| pose.name.clone()).collect(),
            wanted_pose_names: part.wanted_pose_names().map(str::to_owned).collect(),
            part_radius_m: part.outline_radius_m(),
            truth: Truth::default(),
            feed: FeedScore::new(config.tray, part, config.part_gap_m_min),
            metrics_ns: METRICS_NS,
            present: BTreeSet::new(),
            picked: BTreeSet::new(),
            active_since_ns: 0,
            presented: None,
            promised_pose: None,
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
            Arc::make_mut(&mut self.progress.history).push((time_s, self.progress.feed.clone()));
        }
        is_full
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
            self.truth.settle(u64::try_from(chosen.look.as_nanos()).unwrap_or(u64::MAX));
            self.promised_pose.clone_from(&chosen.pose_class);
        }
        let spent_s = Duration::from_nanos(stamp_ns.saturating_sub(self.active_since_ns)).as_secs_f64();
        *self.progress.spent_s.entry(self.progress.activity).or_insert(0.0) += spent_s;
        let begins = stand.phase == Phase::Presented && stand.delivery_id != self.presented;
        if begins {
            self.presented.clone_from(&stand.delivery_id);
        }
        self.progress.trips.pass(self.progress.activity, spent_s, begins);
        let ended = stand.delivered + stand.failed_by_outcome.iter().sum::<u32>();
        let open = stand.accepted.saturating_sub(ended);
        self.progress.trips.goals_open_max = self.progress.trips.goals_open_max.max(open);
        self.progress.activity = activity_of(stand.phase);
        self.active_since_ns = stamp_ns;
        self.progress.accepted = stand.accepted;
        self.progress.succeeded = stand.delivered;
        self.progress.failed_by_outcome = stand.failed_by_outcome.to_vec();
    }

    /// Finds out which parts the selector meant, by where they were when the picture was taken.
    pub(crate) fn hear_selector(&mut self, stamp_ns: u64, seen: &[SeenPart]) {
        for seen in seen.iter().filter(|part| !part.refusals.off_plateau) {
            let part = self.truth.part_at(stamp_ns, &seen.position_in_tray_m, self.part_radius_m);
            let is_wanted = seen.pose_class.as_ref().is_some_and(|pose| self.wanted_pose_names.contains(pose));
            let called_right = seen.refusals.may_be_picked() && is_wanted;
            if called_right && self.truth.knows(stamp_ns) {
                self.feed.selected(part);
            }
            let Some((id, _)) = part else { continue };
            self.progress.seen.insert(id);
            if called_right {
                self.progress.selected.insert(id);
            }
        }
    }

    /// A part was picked; what was said before it has been heard.
    pub(crate) fn score_pick(&mut self, part: &TakenPart) {
        let lay = self.pose_names.get(usize::from(part.resting_pose));
        self.progress.delivered += 1;
        self.progress.wrong_pose_delivered += u32::from(lay != self.promised_pose.as_ref());
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
mod tests {
    use std::f64::consts::PI;

    use feeder_model::part::Refusals;
    use feeder_model::tray::Place;
    use feeder_scenario::Scenario;
    use feeder_scenario::plan::NodeConfig as _;
    use feeder_wire::delivery_state::ChosenPart;
    use feeder_wire::parts::TruePart;
    use nalgebra::Vector2;

    use super::*;

    /// The middle of the plateau, seen from the tray's centre.
    const ANGLE_RAD: f64 = 1.75 * PI;

    fn config() -> RunMonitorConfig {
        let plan = Scenario::default().plan().unwrap();
        plan.nodes.iter().find_map(|node| RunMonitorConfig::of(&node.node).cloned()).unwrap()
    }

    fn score() -> FeederScore {
        let config = config();
        let part = PartType::new(&config.part).unwrap();
        FeederScore::new("feeder", &config, &part)
    }

    fn lying(id: u32, radius_m: f64, resting_pose: u8) -> TruePart {
        TruePart {
            id,
            part_class: String::new(),
            place: Place::Plateau,
            resting_pose,
            radius_m,
            angle_rad: ANGLE_RAD,
            yaw_rad: 0.0,
            radial_velocity_m_s: 0.0,
            tangential_velocity_m_s: 0.0,
            sticking: true,
            stranded: false,
        }
    }

    fn truth(parts: &[TruePart]) -> TrueParts {
        TrueParts { parts: parts.to_vec(), ..TrueParts::default() }
    }

    /// What the selector says of a part of a pose at a radius.
    fn called(radius_m: f64, pose: &str, refusals: Refusals) -> SeenPart {
        SeenPart {
            id: 1,
            position_in_tray_m: Vector2::new(ANGLE_RAD.cos(), ANGLE_RAD.sin()) * radius_m,
            yaw_in_tray_rad: 0.0,
            pose_class: Some(pose.to_owned()),
            confidence: 0.99,
            radius_m: 0.003,
            part_gap_m: f64::INFINITY,
            wall_gap_m: 0.01,
            refusals,
        }
    }

    fn presented(score: &FeederScore, pose: usize, look_ns: u64) -> PlannerStand {
        let chosen = ChosenPart {
            look: Duration::from_nanos(look_ns),
            position_in_tray_m: Vector2::zeros(),
            yaw_in_tray_rad: 0.0,
            pose_class: Some(score.pose_names[pose].clone()),
        };
        PlannerStand { phase: Phase::Presented, chosen: Some(chosen), ..PlannerStand::idle() }
    }

    fn wanted(score: &FeederScore) -> (u8, String) {
        let name = score.wanted_pose_names[0].clone();
        (u8::try_from(score.pose_names.iter().position(|pose| *pose == name).unwrap()).unwrap(), name)
    }

    fn unwanted(score: &FeederScore) -> (u8, String) {
        let pose = score.pose_names.iter().position(|pose| !score.wanted_pose_names.contains(pose)).unwrap();
        (u8::try_from(pose).unwrap(), score.pose_names[pose].clone())
    }

    #[test]
    fn a_part_that_is_gone_without_a_pick_is_lost_and_one_that_was_picked_is_not() {
        let mut score = score();
        score.learn(10, &truth(&[lying(1, 0.07, 0), lying(2, 0.08, 0)]));
        score.note_taken(&TakenPart { id: 1, resting_pose: 0 });
        score.learn(20, &truth(&[lying(2, 0.08, 0)]));
        assert_eq!((score.progress.parts_lost, score.progress.parts_doubled), (0, 0));
        score.learn(30, &truth(&[]));
        assert_eq!((score.progress.parts_lost, score.progress.parts_doubled), (1, 0));
    }

    #[test]
    fn a_part_picked_twice_or_back_after_a_pick_is_doubled() {
        let mut score = score();
        score.learn(10, &truth(&[lying(1, 0.07, 0)]));
        score.note_taken(&TakenPart { id: 1, resting_pose: 0 });
        score.note_taken(&TakenPart { id: 1, resting_pose: 0 });
        assert_eq!(score.progress.parts_doubled, 1);
        score.learn(20, &truth(&[]));
        score.learn(30, &truth(&[lying(1, 0.07, 0)]));
        assert_eq!((score.progress.parts_lost, score.progress.parts_doubled), (0, 2));
    }

    #[test]
    fn a_part_delivered_in_another_pose_than_it_was_presented_in_is_wrong_whatever_pose_was_asked_for() {
        let mut score = score();
        let ((right, _), (other, _)) = (wanted(&score), unwanted(&score));
        for (promised, lay, wrong) in [(right, right, 0), (right, other, 1), (other, other, 1), (other, right, 2)] {
            let stand = presented(&score, usize::from(promised), 10);
            score.hear_planner(20, &stand);
            score.score_pick(&TakenPart { id: 1, resting_pose: lay });
            assert_eq!(score.progress.wrong_pose_delivered, wrong, "{promised} {lay}");
        }
        assert_eq!(score.progress.delivered, 4);
    }

    #[test]
    fn slip_is_counted_from_the_look_and_is_unknown_for_a_part_that_was_not_there() {
        let mut score = score();
        score.learn(10, &truth(&[lying(1, 0.070, 0)]));
        let stand = presented(&score, 0, 10);
        score.hear_planner(15, &stand);
        score.learn(20, &truth(&[lying(1, 0.0704, 0), lying(2, 0.08, 0)]));
        score.score_pick(&TakenPart { id: 1, resting_pose: 0 });
        assert!((score.progress.max_slip_m.unwrap() - 0.4e-3).abs() < 1e-12);
        assert_eq!(score.progress.slips_unknown, 0);
        score.score_pick(&TakenPart { id: 2, resting_pose: 0 });
        assert!((score.progress.max_slip_m.unwrap() - 0.4e-3).abs() < 1e-12);
        assert_eq!(score.progress.slips_unknown, 1);
    }

    #[test]
    fn selections_are_right_wrong_or_missed_by_where_the_part_was_in_the_picture() {
        let mut score = score();
        let ((right, right_name), (other, other_name)) = (wanted(&score), unwanted(&score));
        let clear = Refusals::default();
        let feed = |score: &FeederScore| {
            let feed = score.feed.feed();
            (feed.right_selections, feed.wrong_selections)
        };
        score.learn(10, &truth(&[lying(1, 0.070, right), lying(2, 0.085, other)]));
        score.learn(20, &truth(&[lying(2, 0.070, other)]));
        // Not wanted, refused, or from a time that is not remembered: not called right.
        score.hear_selector(10, &[called(0.070, &other_name, clear)]);
        score.hear_selector(10, &[called(0.070, &right_name, Refusals { part_too_near: true, ..clear })]);
        score.hear_selector(15, &[called(0.070, &right_name, clear)]);
        assert_eq!((feed(&score), score.progress.selected.len(), score.progress.seen.len()), ((0, 0), 0, 1));
        // As often as it is called right, once a lap.
        score.hear_selector(10, &[called(0.070, &right_name, clear)]);
        score.hear_selector(10, &[called(0.070, &right_name, clear)]);
        assert_eq!((feed(&score), score.progress.selected.len()), ((1, 0), 1));
        score.hear_selector(10, &[called(0.085, &right_name, clear)]);
        assert_eq!(feed(&score), (1, 1));
        // Nothing is there.
        score.hear_selector(20, &[called(0.095, &right_name, clear)]);
        assert_eq!(feed(&score), (1, 2));
    }

    #[test]
    fn the_planners_time_is_booked_by_what_it_did_and_its_counts_are_kept() {
        let mut score = score();
        let second_ns = 1_000_000_000;
        let stand = |phase| PlannerStand { phase, accepted: 3, delivered: 2, ..PlannerStand::idle() };
        score.hear_planner(0, &stand(Phase::Feeding));
        score.hear_planner(2 * second_ns, &stand(Phase::Moving));
        score.hear_planner(5 * second_ns, &stand(Phase::Idle));
        assert_eq!((score.progress.accepted, score.progress.succeeded), (3, 2));
        let spent_s = |activity| score.progress.spent_s.get(&activity).copied();
        assert_eq!((spent_s(Activity::Wait), spent_s(Activity::Move)), (Some(2.0), Some(3.0)));
    }

    #[test]
    fn figures_of_the_feed_are_due_once_a_second() {
        let mut score = score();
        let due: Vec<u64> = (0..=300).filter(|tick| score.learn(tick * 10_000_000, &truth(&[]))).collect();
        assert_eq!(due, [100, 200, 300]);
        assert_eq!(score.progress.history.len(), 3);
    }
}
