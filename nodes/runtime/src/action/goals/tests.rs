//! The life of goals: accepted, cancelled, ended, forgotten.

use super::*;
use proptest::prelude::*;

const KEEP: Duration = Duration::from_secs(60);
const NOW: Duration = Duration::from_secs(1_000);

fn id(number: u8) -> GoalId {
    GoalId([number; 16])
}

fn at(sec: i32) -> Time {
    Time { sec, nanosec: 0 }
}

fn cancel(goal: u8, until: i32) -> CancelGoalRequest {
    CancelGoalRequest { goal_info: GoalInfo { goal_id: id(goal).into(), stamp: at(until) } }
}

fn goals() -> Goals<&'static str, u32> {
    let mut goals = Goals::new(KEEP);
    for number in 1..=3 {
        goals.accept(id(number), at(number.into())).expect("new");
    }
    goals
}

/// When the next result expires, if any is kept.
fn next_expiry<R, C>(goals: &Goals<R, C>) -> Option<Duration> {
    goals.goals.values().filter_map(|goal| goal.result.as_ref().map(|(_, forget)| *forget)).min()
}

#[test]
fn a_goal_runs_its_course_and_its_result_is_kept_for_a_while() {
    let mut goals = goals();
    assert_eq!(goals.accept(id(1), at(9)), Err(GoalError::Known(id(1))));
    assert_eq!(goals.result(id(1), 10), ResultOf::Later);
    goals.start(id(1)).expect("accepted");
    assert_eq!(goals.result(id(1), 11), ResultOf::Later);
    assert_eq!(goals.finish(id(1), GoalStatus::Succeeded, "done", NOW), Ok(vec![10, 11]));
    assert_eq!(goals.result(id(1), 12), ResultOf::Known(12, GoalStatus::Succeeded, &"done"));
    assert_eq!(next_expiry(&goals), Some(NOW + KEEP));
    assert!(goals.expire(NOW + KEEP - Duration::from_nanos(1)).is_empty());
    assert_eq!(goals.expire(NOW + KEEP), [id(1)]);
    assert_eq!(goals.result(id(1), 13), ResultOf::Unknown(13));
    assert_eq!(goals.status(id(2)), GoalStatus::Accepted);
}

#[test]
fn ids_are_written_in_sixteenths_and_numbers_without_a_meaning_are_unknown() {
    let mut bytes = [0; 16];
    bytes[..2].copy_from_slice(&[0x0a, 0xf1]);
    let written = "0af1".to_owned() + &"00".repeat(14);
    assert_eq!(GoalId(bytes).to_string(), written);
    assert_eq!(format!("{:?}", GoalId(bytes)), format!("GoalId({written})"));
    let numbers = [-1, 0, 1, 6, 7].map(GoalStatus::from_number);
    use GoalStatus::{Aborted, Accepted, Unknown};
    assert_eq!(numbers, [Unknown, Unknown, Accepted, Aborted, Unknown]);
}

#[test]
fn what_the_state_does_not_allow_is_refused() {
    let mut goals = goals();
    let refused = |from, to| Err(GoalError::Transition { id: id(1), from, to });
    assert_eq!(
        goals.finish(id(1), GoalStatus::Succeeded, "", NOW),
        refused(GoalStatus::Accepted, GoalStatus::Succeeded).map(|()| vec![])
    );
    goals.start(id(1)).expect("accepted");
    assert_eq!(goals.start(id(1)), refused(GoalStatus::Executing, GoalStatus::Executing));
    assert!(goals.finish(id(1), GoalStatus::Canceled, "", NOW).is_err());
    assert!(goals.finish(id(1), GoalStatus::Executing, "", NOW).is_err());
    goals.begin_cancel(id(1)).expect("executing");
    goals.finish(id(1), GoalStatus::Canceled, "", NOW).expect("canceling");
    assert_eq!(goals.begin_cancel(id(1)), refused(GoalStatus::Canceled, GoalStatus::Canceling));
    assert_eq!(goals.start(id(9)), Err(GoalError::Unknown(id(9))));
}

#[test]
fn cancel_means_the_goals_that_ros_2_means() {
    let mut goals = goals();
    assert_eq!(goals.to_cancel(&cancel(0, 0)), Ok(vec![id(1), id(2), id(3)]));
    assert_eq!(goals.to_cancel(&cancel(0, 2)), Ok(vec![id(1), id(2)]));
    assert_eq!(goals.to_cancel(&cancel(3, 0)), Ok(vec![id(3)]));
    assert_eq!(goals.to_cancel(&cancel(3, 1)), Ok(vec![id(1), id(3)]));
    assert_eq!(goals.to_cancel(&cancel(9, 0)), Err(NothingToCancel::UnknownGoal));
    goals.start(id(3)).expect("accepted");
    goals.finish(id(3), GoalStatus::Aborted, "", NOW).expect("executing");
    assert_eq!(goals.to_cancel(&cancel(3, 0)), Err(NothingToCancel::Terminated));
    assert_eq!(Goals::<(), ()>::new(KEEP).to_cancel(&cancel(0, 0)), Err(NothingToCancel::NoneRunning));
}

#[derive(Debug, Clone)]
enum Step {
    Accept(u8),
    Start(u8),
    Cancel(u8),
    Finish(u8, i8),
    Ask(u8),
    Expire(u64),
}

fn step() -> impl Strategy<Value = Step> {
    let goal = 0..4u8;
    prop_oneof![
        goal.clone().prop_map(Step::Accept),
        goal.clone().prop_map(Step::Start),
        goal.clone().prop_map(Step::Cancel),
        (goal.clone(), any::<i8>()).prop_map(|(goal, status)| Step::Finish(goal, status)),
        goal.prop_map(Step::Ask),
        (0..100u64).prop_map(Step::Expire),
    ]
}

proptest! {
    /// Whatever happens: nobody who asks is forgotten or answered twice, an ended goal stays as it is, and its
    /// result is kept as long as promised.
    #[test]
    fn every_question_is_answered_once(steps in prop::collection::vec(step(), 0..80)) {
        let mut goals = Goals::<(), usize>::new(Duration::from_secs(10));
        let mut now = Duration::ZERO;
        let (mut asked, mut answered) = (0, Vec::new());
        for step in steps {
            let before: Vec<_> = (0..4).map(|goal| goals.status(id(goal))).collect();
            match step {
                Step::Accept(goal) => _ = goals.accept(id(goal), Time::default()),
                Step::Start(goal) => _ = goals.start(id(goal)),
                Step::Cancel(goal) => _ = goals.begin_cancel(id(goal)),
                Step::Finish(goal, status) => {
                    let status = GoalStatus::from_number(status.rem_euclid(7));
                    answered.extend(goals.finish(id(goal), status, (), now).unwrap_or_default());
                }
                Step::Ask(goal) => {
                    match goals.result(id(goal), asked) {
                        ResultOf::Known(who, status, ()) => {
                            prop_assert!(status.is_terminal());
                            answered.push(who);
                        }
                        ResultOf::Unknown(who) => answered.push(who),
                        ResultOf::Later => prop_assert!(!before[usize::from(goal)].is_terminal()),
                    }
                    asked += 1;
                }
                Step::Expire(seconds) => {
                    now += Duration::from_secs(seconds);
                    for gone in goals.expire(now) {
                        prop_assert!(before[usize::from(gone.0[0])].is_terminal());
                    }
                    prop_assert!(next_expiry(&goals).is_none_or(|next| next > now));
                }
            }
            for (goal, before) in (0..4).zip(before) {
                let after = goals.status(id(goal));
                let forgotten = before.is_terminal() && after == GoalStatus::Unknown;
                let begun = before == GoalStatus::Unknown && after == GoalStatus::Accepted;
                prop_assert!(before == after || before.may_become(after) || forgotten || begun);
            }
        }
        for goal in 0..4 {
            let _ = goals.start(id(goal));
            answered.extend(goals.finish(id(goal), GoalStatus::Aborted, (), now).unwrap_or_default());
        }
        answered.sort_unstable();
        prop_assert_eq!(answered, (0..asked).collect::<Vec<_>>());
    }
}
