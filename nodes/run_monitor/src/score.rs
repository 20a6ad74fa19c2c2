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
mod tests {
    use std::f64::consts::PI;

    use feeder_model::part::Refusals;
    use feeder_model::tray::Place;
    use feeder_scenario::Scenario;
    use feeder_scenario::plan::NodeConfig as _;
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

    /// Blocks: they have a yaw, and their neighbours may lie closer than circles round them.
    fn score_of_blocks() -> FeederScore {
        let part = feeder_scenario::PartSource::Name("block".to_owned()).part_type().unwrap();
        FeederScore::new("feeder", &config(), &part)
    }

    #[test]
    fn a_part_delivered_with_another_yaw_than_it_was_presented_with_is_turned_wrongly() {
        let mut score = score_of_blocks();
        let turned = |id, degrees: f64| TruePart { yaw_rad: degrees.to_radians(), ..lying(id, 0.07, 0) };
        let stand = presented(&score, 0, 10);
        for (id, degrees, wrong, largest) in
            [(1, 4.0, 0, 4.0), (2, 176.0, 0, 4.0), (3, 186.0, 1, 6.0), (4, 90.0, 2, 90.0)]
        {
            score.learn(10 * u64::from(id), &truth(&[turned(id, degrees)]));
            score.hear_planner(10 * u64::from(id), &stand);
            score.note_taken(&TakenPart { id, resting_pose: 0 });
            score.score_pick(&TakenPart { id, resting_pose: 0 });
            assert_eq!(score.progress.wrong_yaw_delivered, wrong, "{degrees} deg");
            let error_rad = score.progress.max_yaw_error_rad.unwrap();
            assert!((error_rad.to_degrees() - largest).abs() < 1e-9, "{degrees} deg: {error_rad}");
        }
        // In another pose a yaw means nothing, and of a part that is round nothing is to be said.
        let mut other = score_of_blocks();
        other.learn(10, &truth(&[TruePart { resting_pose: 1, ..turned(1, 90.0) }]));
        other.hear_planner(10, &stand);
        other.score_pick(&TakenPart { id: 1, resting_pose: 1 });
        assert_eq!((other.progress.wrong_pose_delivered, other.progress.max_yaw_error_rad), (1, None));
        let mut round = self::score();
        round.learn(10, &truth(&[turned(1, 90.0)]));
        round.hear_planner(10, &presented(&round, 0, 10));
        round.score_pick(&TakenPart { id: 1, resting_pose: 0 });
        assert_eq!(round.progress.max_yaw_error_rad, None);
    }

    #[test]
    fn a_part_that_is_presented_without_room_for_the_gripper_is_counted_once_a_delivery() {
        let mut score = score();
        // Grommets of 5 mm, and a gripper that needs 1 mm beside them.
        score.learn(10, &truth(&[lying(1, 0.070, 0), lying(2, 0.0759, 0)]));
        score.learn(20, &truth(&[lying(1, 0.070, 0), lying(2, 0.0761, 0)]));
        let offered = |look_ns, delivery: &str, station: &str| {
            let mut stand = presented(&score, 0, look_ns);
            stand.chosen.as_mut().unwrap().position_in_tray_m = lying(1, 0.0701, 0).position_in_tray_m();
            PlannerStand { delivery_id: Some(delivery.to_owned()), station: Some(station.to_owned()), ..stand }
        };
        let stands = [
            (offered(20, "d1", "station_1"), 0),
            (offered(10, "d2", "station_1"), 1),
            (offered(10, "d2", "station_1"), 1),
            // Nobody knows what an agent's own gripper needs.
            (offered(10, "d3", "station_2"), 1),
            (offered(10, "d4", "station_1"), 2),
        ];
        for (stand, without_room) in stands {
            score.hear_planner(30, &stand);
            assert_eq!(score.progress.chosen_without_room, without_room, "{stand:?}");
        }
        let short_m = score.progress.room_short_m_max;
        assert!((short_m - 0.1e-3).abs() < 0.02e-3, "{short_m}");
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
        assert_eq!((feed(&score), score.progress.selected, score.progress.seen), ((0, 0), 0, 1));
        // As often as it is called right, once a lap.
        score.hear_selector(10, &[called(0.070, &right_name, clear)]);
        score.hear_selector(10, &[called(0.070, &right_name, clear)]);
        assert_eq!((feed(&score), score.progress.selected), ((1, 0), 1));
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

    #[test]
    fn however_long_a_run_is_its_history_is_bounded_and_even() {
        let mut score = score();
        let mut longest = 0;
        for second in 1..=5 * HISTORY_MAX as u64 {
            score.learn(second * METRICS_NS, &truth(&[]));
            longest = longest.max(score.progress.history.len());
        }
        assert_eq!(longest, HISTORY_MAX);
        let stamps_s: Vec<f64> = score.progress.history.iter().map(|(time_s, _)| *time_s).collect();
        assert!(stamps_s.windows(2).all(|pair| (pair[1] - pair[0] - 8.0).abs() < 1e-9), "{stamps_s:?}");
        assert!(stamps_s[0] <= 8.0 && stamps_s[stamps_s.len() - 1] > 4_990.0, "{stamps_s:?}");
    }
}
