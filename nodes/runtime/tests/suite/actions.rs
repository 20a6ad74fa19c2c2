//! Actions over real DDS.

use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

use crate::common::{participant, wait_until};
use feeder_runtime::{
    action::{
        ActionClient, ActionServer, ActionUpdate, GoalEvent, GoalHandle, GoalId, GoalRequest, GoalStatus,
        goals::GoalError,
    },
    dds::Participant,
    testing::TestDomain,
};
use minifactory_msgs::{
    action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult},
    action_msgs::srv::CancelGoalResponse,
    builtin_interfaces::msg::Time,
};

const ACTION: &str = "/test/deliver_part";
const PATIENCE: Duration = Duration::from_secs(20);
const KEEP: Duration = Duration::from_secs(600);
const STAMP: Time = Time { sec: 12, nanosec: 34 };

fn serve(participant: &Participant, keep: Duration) -> (ActionServer<DeliverPart>, Receiver<GoalEvent<DeliverPart>>) {
    let (sender, events) = mpsc::channel();
    let deliver = move |event| {
        // The test may have seen enough.
        let _ = sender.send(event);
    };
    (ActionServer::new(participant, ACTION, keep, deliver).expect("a server"), events)
}

fn client(participant: &Participant) -> (ActionClient<DeliverPart>, Receiver<ActionUpdate<DeliverPart>>) {
    let (sender, updates) = mpsc::channel();
    let deliver = move |update| {
        let _ = sender.send(update);
    };
    (ActionClient::new(participant, ACTION, deliver).expect("a client"), updates)
}

fn goal(station: &str) -> DeliverPartGoal {
    DeliverPartGoal { station: station.to_owned(), ..Default::default() }
}

fn result(reason: &str) -> DeliverPartResult {
    DeliverPartResult { reason: reason.to_owned(), ..Default::default() }
}

fn next_goal(events: &Receiver<GoalEvent<DeliverPart>>) -> GoalRequest<DeliverPart> {
    match events.recv_timeout(PATIENCE).expect("an event") {
        GoalEvent::Goal(request) => request,
        GoalEvent::Cancel(_) => panic!("nobody cancels"),
    }
}

fn accepted(
    client: &ActionClient<DeliverPart>,
    events: &Receiver<GoalEvent<DeliverPart>>,
    id: GoalId,
) -> GoalHandle<DeliverPart> {
    let answer = client.send_goal(id, goal("station_1"), PATIENCE);
    let handle = next_goal(events).accept(STAMP).expect("new");
    let (accepted, stamp) = answer.wait().expect("an answer").into();
    assert_eq!((accepted, stamp), (true, STAMP));
    handle
}

fn outcome(client: &ActionClient<DeliverPart>, id: GoalId) -> (GoalStatus, DeliverPartResult) {
    futures::executor::block_on(client.result(id, PATIENCE)).expect("a result")
}

#[test]
fn several_goals_run_give_feedback_and_end() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let (server, events) = serve(&answering, KEEP);
    let (client, updates) = client(&asking);
    wait_until("the server is there", || client.is_available());

    let ids = [GoalId([1; 16]), GoalId([2; 16]), GoalId([3; 16])];
    let handles = ids.map(|id| accepted(&client, &events, id));
    // Asked before the goals end, all three at once.
    let results = ids.map(|id| client.result(id, PATIENCE));
    for handle in &handles {
        assert_eq!(handle.status(), GoalStatus::Accepted);
        handle.start().expect("accepted");
        handle.feedback(DeliverPartFeedback { delivery_id: handle.id().to_string(), ..Default::default() });
    }
    for id in ids {
        let feedback = updates.iter().find_map(|update| match update {
            ActionUpdate::Feedback(of, feedback) => Some((of, feedback.delivery_id)),
            ActionUpdate::Status(_) => None,
        });
        assert_eq!(feedback, Some((id, id.to_string())));
    }
    let [first, second, third] = handles;
    third.succeed(result("third")).expect("executing");
    first.abort(result("first")).expect("executing");
    second.succeed(result("second")).expect("executing");
    let expected =
        [(GoalStatus::Aborted, "first"), (GoalStatus::Succeeded, "second"), (GoalStatus::Succeeded, "third")];
    for ((pending, (status, reason)), id) in results.into_iter().zip(expected).zip(ids) {
        assert_eq!(futures::executor::block_on(pending).expect("a result"), (status, result(reason)));
        // Asked again after the goal has ended.
        assert_eq!(outcome(&client, id), (status, result(reason)));
        assert_eq!(server.status(id), status);
    }
    let all = ids.iter().copied().zip(expected.map(|(status, _)| status)).collect::<Vec<_>>();
    wait_until("the last status has come", || match updates.recv_timeout(PATIENCE) {
        Ok(ActionUpdate::Status(statuses)) => statuses == all,
        _ => false,
    });
}

#[test]
fn a_goal_is_cancelled_when_the_server_grants_it() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let (_server, events) = serve(&answering, KEEP);
    let (client, _updates) = client(&asking);
    let (refused, granted) = (GoalId([1; 16]), GoalId([2; 16]));
    let (keeps_on, stops) = (accepted(&client, &events, refused), accepted(&client, &events, granted));
    keeps_on.start().expect("accepted");

    let answer = client.cancel(None, PATIENCE);
    let Ok(GoalEvent::Cancel(request)) = events.recv_timeout(PATIENCE) else { panic!("a wish to cancel") };
    assert_eq!(request.goals, [refused, granted]);
    request.grant([granted]);
    let answer = answer.wait().expect("an answer");
    assert_eq!(answer.return_code, CancelGoalResponse::ERROR_NONE);
    assert_eq!(answer.goals_canceling.len(), 1);
    assert_eq!(GoalId::from(answer.goals_canceling[0].goal_id), granted);
    assert_eq!(stops.status(), GoalStatus::Canceling);
    stops.cancel(result("stopped")).expect("canceling");
    assert_eq!(outcome(&client, granted), (GoalStatus::Canceled, result("stopped")));

    // Left undecided it is refused, and a goal nobody wanted cancelled cannot end as cancelled.
    let answer = client.cancel(Some(refused), PATIENCE);
    drop(events.recv_timeout(PATIENCE).expect("a wish to cancel"));
    assert_eq!(answer.wait().expect("an answer").return_code, CancelGoalResponse::ERROR_REJECTED);
    assert!(matches!(keeps_on.cancel(result("")), Err(GoalError::Transition { .. })));
    assert_eq!(outcome(&client, refused).0, GoalStatus::Aborted);

    let code = |id| client.cancel(Some(id), PATIENCE).wait().expect("an answer").return_code;
    assert_eq!(code(granted), CancelGoalResponse::ERROR_GOAL_TERMINATED);
    assert_eq!(code(GoalId([9; 16])), CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID);
}

#[test]
fn goals_are_rejected_abandoned_forgotten_and_sent_twice() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let (server, events) = serve(&answering, Duration::from_millis(100));
    let (client, _updates) = client(&asking);
    let (rejected, abandoned) = (GoalId([1; 16]), GoalId([2; 16]));
    let answer = client.send_goal(rejected, goal("nowhere"), PATIENCE);
    let request = next_goal(&events);
    assert_eq!((request.id(), request.goal.station.as_str()), (rejected, "nowhere"));
    request.reject();
    let (taken, _) = answer.wait().expect("an answer").into();
    assert!(!taken);
    assert_eq!(outcome(&client, rejected).0, GoalStatus::Unknown);

    let handle = accepted(&client, &events, abandoned);
    let (taken, _) = client.send_goal(abandoned, goal("station_1"), PATIENCE).wait().expect("an answer").into();
    assert!(!taken, "the id is in use");
    let pending = client.result(abandoned, PATIENCE);
    drop(handle);
    assert_eq!(futures::executor::block_on(pending).expect("a result"), (GoalStatus::Aborted, result("")));
    wait_until("its result has expired", || server.status(abandoned) == GoalStatus::Unknown);
    assert_eq!(outcome(&client, abandoned).0, GoalStatus::Unknown);
}

#[test]
fn a_goal_may_outlive_its_server_and_participant() {
    let domain = TestDomain::claim();
    let asking = participant(&domain, "asking");
    let (client, _updates) = client(&asking);
    let handle = {
        let answering = participant(&domain, "answering");
        let (_server, events) = serve(&answering, KEEP);
        accepted(&client, &events, GoalId([1; 16]))
    };
    wait_until("the server is gone", || !client.is_available() && asking.discovered().nodes.is_empty());
    handle.start().expect("accepted");
    handle.feedback(DeliverPartFeedback::default());
    handle.succeed(result("nobody hears of it")).expect("executing");
}
