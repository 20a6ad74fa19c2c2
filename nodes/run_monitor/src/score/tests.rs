//! What the monitor makes of truths and of what nodes say.

use std::f64::consts::PI;

use feeder_model::part::Refusals;
use feeder_scenario::Scenario;
use feeder_scenario::plan::NodeConfig as _;
use feeder_wire::parts::TruePart;
use nalgebra::Vector2;

use super::*;
use crate::truth::testing::{self, truth};

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
    TruePart { angle_rad: ANGLE_RAD, ..testing::lying(id, radius_m, resting_pose) }
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
    for (id, degrees, wrong, largest) in [(1, 4.0, 0, 4.0), (2, 176.0, 0, 4.0), (3, 186.0, 1, 6.0), (4, 90.0, 2, 90.0)]
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
    let failed_by_outcome = std::array::from_fn(|outcome| u32::from(outcome == 1));
    let stand = |phase| PlannerStand { phase, accepted: 5, delivered: 2, failed_by_outcome, ..PlannerStand::idle() };
    score.hear_planner(0, &stand(Phase::Feeding));
    score.hear_planner(2 * second_ns, &stand(Phase::Moving));
    let first = PlannerStand { delivery_id: Some("1".to_owned()), ..presented(&score, 0, 1) };
    score.hear_planner(5 * second_ns, &first);
    assert_eq!((score.progress.accepted, score.progress.succeeded), (0, 0));
    score.hear_planner(6 * second_ns, &stand(Phase::Idle));
    assert_eq!((score.progress.accepted, score.progress.succeeded), (5, 2));
    let spent_s = |activity| score.progress.spent_s.get(&activity).copied();
    assert_eq!((spent_s(Activity::Wait), spent_s(Activity::Move)), (Some(2.0), Some(3.0)));
    // Two of five goals have not ended. The oracle goes by the seconds that were fed, and the parts that came in them.
    assert_eq!(score.progress.trips.goals_open_max, 2);
    assert_eq!(score.progress.oracle(), None);
    score.progress.feed.report.good = 4;
    let oracle = score.progress.oracle().unwrap();
    assert_eq!((oracle.right_per_s, oracle.moves_s, oracle.stops), (2.0, 3.0, 2));
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

#[test]
fn each_phase_of_a_delivery_is_an_activity_of_its_own() {
    let phases = [
        (Phase::Feeding, Activity::Wait),
        (Phase::Stopping, Activity::Stop),
        (Phase::Settling, Activity::Settle),
        (Phase::Looking, Activity::Look),
        (Phase::Reserving, Activity::Reserve),
        (Phase::Moving, Activity::Move),
        (Phase::Presented, Activity::Pick),
        (Phase::Returning, Activity::Return),
        (Phase::Idle, Activity::Idle),
        (Phase::Purging, Activity::Idle),
        (Phase::Fault, Activity::Idle),
    ];
    let mut score = score();
    let failed_by_outcome = PlannerStand::idle().failed_by_outcome.map(|_| 4);
    for (phase, activity) in phases {
        score.hear_planner(0, &PlannerStand { phase, failed_by_outcome, ..PlannerStand::idle() });
        assert_eq!(score.progress.activity, activity, "{phase:?}");
    }
    assert_eq!(score.progress.failed_by_outcome, failed_by_outcome);
}

#[test]
fn a_part_beside_the_plateau_is_not_looked_for_and_how_many_were_fed_is_kept() {
    let mut score = score();
    let (pose, name) = wanted(&score);
    score.learn(10, &TrueParts { fed: 12, ..truth(&[lying(1, 0.070, pose)]) });
    assert_eq!(score.progress.fed, 12);
    score.hear_selector(10, &[called(0.070, &name, Refusals { off_plateau: true, ..Refusals::default() })]);
    assert_eq!((score.progress.seen, score.progress.selected), (0, 0));
    score.hear_selector(10, &vec![called(0.070, &name, Refusals::default()); 2]);
    assert_eq!((score.progress.seen, score.progress.selected), (1, 1));
}
