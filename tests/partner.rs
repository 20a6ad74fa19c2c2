//! Another agent's view of the protocol: a partner in Python, with Cyclone DDS and without our crates, at a station of its
//! own.

use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use feeder_runtime::dds::{Participant, Qos, Reader};
use feeder_scenario::{Recipe, Scenario};
use feeder_wire::{services, topics};
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::action_msgs::msg::GoalStatus;
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse};
use minifactory_msgs::msg::{DeliveryState, FeederState};
use minifactory_msgs::srv::{ReportHandoverRequest, ReserveAreaResponse};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::{Action, Message};
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::common::{FEEDER, Up, python, wait_for};
use crate::wall_clock::{call, hear, participant};

/// Wall time after which the agent gives up.
const PATIENCE: Duration = Duration::from_secs(400);

#[test]
fn an_agent_without_our_crates_takes_parts_and_learns_why_not() {
    // Made first, where it must be: a run is not to wait for it.
    python();
    let mut scenario = Scenario::default();
    scenario.platen.shared = true;
    scenario.stations[0].external = true;
    // Simulated, and the run goes at twice the pace of the wall clock: enough for three services on a busy machine.
    scenario.delivery.hand_over_timeout_s = 12.0;
    // The second recipe brings a waveform of its own.
    let recipe = |name: &str, waveform| Recipe { name: name.to_owned(), pose_classes: Vec::new(), waveform };
    scenario.recipes = vec![recipe("plain", None), recipe("other", Some(scenario.waveform.clone()))];
    let mut run = Up::new("--duration 3600 --speed 2 --composed").scenario(&scenario).default_discovery_range().start();
    run.wait_until_simulated(Duration::from_millis(100));
    let part = scenario.part_type().unwrap();
    let pose = part.wanted_pose_names().next().unwrap();
    let report: Value = run.seen_by("partner_agent.py", PATIENCE, &["--pose", pose]);

    assert_eq!(report["version"], "3.1");
    assert_eq!(report["stations"], json!(["station_1"]));
    for (what, accepted) in report["refused"].as_object().unwrap() {
        assert_eq!(accepted, false, "{what} was accepted");
    }
    // Whether the plateau empties in time depends on where the parts are by then.
    let prepared = json!({
        "unknown_recipe": false, "other_recipe": true, "recipe_now": "other", "purged_for_no_time": false,
        "purged_or_told_why": true, "first_recipe": true,
    });
    assert_eq!(report["prepared"], prepared);
    let result = |name: &str| report["areas"]["claims"][name]["result"].as_u64().unwrap();
    for (name, expected) in [
        ("first", ReserveAreaResponse::GRANTED),
        ("second", ReserveAreaResponse::TAKEN),
        ("after_expiry", ReserveAreaResponse::GRANTED),
        ("renewed_late", ReserveAreaResponse::UNKNOWN_LEASE),
        ("negative", ReserveAreaResponse::INVALID),
        ("parked", ReserveAreaResponse::PARKED),
    ] {
        assert_eq!(result(name), u64::from(expected), "{name}: {}", report["areas"]);
    }
    assert_eq!((&report["areas"]["stolen"], &report["areas"]["released"]), (&json!(false), &json!(true)));

    for delivery in ["delivered", "delivered_after_all"] {
        let delivery = &report[delivery];
        for (key, expected) in [
            ("released_early", false),
            ("picked", true),
            ("taken", true),
            ("taken_again", true),
            ("misnumbered", false),
            ("released", true),
        ] {
            assert_eq!(delivery[key], expected, "{key}: {delivery}");
        }
        assert_eq!(delivery["status"], GoalStatus::STATUS_SUCCEEDED, "{delivery}");
        assert_eq!(delivery["outcome"], DeliverPartResult::DELIVERED, "{delivery}");
        assert_eq!(delivery["same_part"], true, "{delivery}");
        let phases: Vec<u64> = delivery["phases"].as_array().unwrap().iter().filter_map(Value::as_u64).collect();
        for phase in [DeliveryState::LOOKING, DeliveryState::RESERVING, DeliveryState::MOVING, DeliveryState::PRESENTED]
        {
            assert!(phases.contains(&u64::from(phase)), "{phase}: {delivery}");
        }
    }
    let cancelled = &report["cancelled"];
    assert_eq!(cancelled["outcome"], DeliverPartResult::CANCELLED, "{cancelled}");
    assert_eq!(cancelled["status"], GoalStatus::STATUS_CANCELED, "{cancelled}");
    assert!(!cancelled["phases"].as_array().unwrap().contains(&json!(DeliveryState::PRESENTED)), "{cancelled}");
    let silent = &report["silent"];
    assert_eq!(silent["outcome"], DeliverPartResult::NO_HANDOVER, "{silent}");
    assert_eq!((&silent["status"], &silent["late_report"]), (&json!(GoalStatus::STATUS_ABORTED), &json!(false)));
    let states = report["states"].as_array().unwrap();
    for state in [FeederState::EXECUTE, FeederState::SUSPENDED] {
        assert!(states.contains(&json!(state)), "{state} not in {states:?}");
    }
}

/// What asks for a delivery and says whether that is accepted, what is told of it, and what keeps that coming.
fn goals(agent: &Participant) -> (impl Fn(UUID) -> bool, Receiver<(UUID, DeliverPartFeedback)>, Reader) {
    let action = format!("{}/_action", services::DELIVER_PART.name_in(FEEDER));
    let (sender, fed_back) = channel();
    let dds_type = <<DeliverPart as Action>::FeedbackMessage as Message>::INFO.dds_type();
    let reader = agent.reader(&format!("{action}/feedback"), &dds_type, &Qos::command(), move |sample| {
        // A closed channel belongs to a test that has seen enough.
        let _ = sender.send(sample.decode::<<DeliverPart as Action>::FeedbackMessage>().unwrap().into());
    });
    let client = agent.service_client::<<DeliverPart as Action>::SendGoal>(&format!("{action}/send_goal")).unwrap();
    let send = move |goal: UUID| {
        let wanted = DeliverPartGoal { station: "station_1".into(), tolerance_m: 0.001, ..DeliverPartGoal::default() };
        let (accepted, _): (bool, _) = client.call(&(goal, wanted).into(), PATIENCE).wait().unwrap().into();
        accepted
    };
    (send, fed_back, reader.unwrap())
}

/// Every process has a DDS participant of its own.
#[test]
fn a_delivery_belongs_to_the_process_that_asked_for_it() {
    const GOAL: UUID = UUID { uuid: [7; 16] };
    let run = Up::new("--duration 86400 --speed 1 --composed").start();
    let (owner, other) = (participant(run.domain()), participant(run.domain()));
    let (send, fed_back, _reader) = goals(&owner);
    assert!(send(GOAL), "{}", run.stderr());
    let delivery_id = wait_for("the delivery's name", || {
        fed_back.try_iter().filter(|(goal, _)| *goal == GOAL).map(|(_, feedback)| feedback.delivery_id).last()
    });

    let action = format!("{}/_action", services::DELIVER_PART.name_in(FEEDER));
    let cancel = |who: &Participant| {
        let client = who.service_client::<CancelGoal>(&format!("{action}/cancel_goal")).unwrap();
        let mut request = CancelGoalRequest::default();
        request.goal_info.goal_id = GOAL;
        let answer = client.call(&request, PATIENCE).wait().unwrap();
        (answer.return_code, answer.goals_canceling.len())
    };
    let report = ReportHandoverRequest { delivery_id, sequence: 1, ..ReportHandoverRequest::default() };
    let refused = call(&other, &services::REPORT_HANDOVER, &report);
    assert!(!refused.accepted && refused.message.contains("another client"), "{refused:?}");
    let too_soon = call(&owner, &services::REPORT_HANDOVER, &report);
    assert!(!too_soon.accepted && !too_soon.message.contains("another client"), "{too_soon:?}");
    assert_eq!(cancel(&other), (CancelGoalResponse::ERROR_REJECTED, 0));
    assert_eq!(cancel(&owner), (CancelGoalResponse::ERROR_NONE, 1));
    run.process().signal(Signal::INT);
    assert!(run.outcome().status.success());
}

/// Who asks while a trip of others is under way may have to wait for long before the phase of his delivery changes.
#[test]
fn an_accepted_goal_is_told_of_at_once_while_others_are_served() {
    let run = Up::new("--duration 86400 --speed 1 --composed").start();
    let agent = participant(run.domain());
    let (_states_reader, states) = hear(&agent, &topics::DELIVERY_STATE, FEEDER);
    let (send, fed_back, _feedback_reader) = goals(&agent);
    let waits = (1..=5).any(|index| {
        wait_for("a part that is presented", || {
            states.try_iter().find(|state| state.phase == DeliveryState::PRESENTED)
        });
        let goal = UUID { uuid: [index; 16] };
        assert!(send(goal), "{}", run.stderr());
        let first = wait_for("feedback on the goal", || fed_back.try_iter().find(|(of, _)| *of == goal));
        // On a busy machine the trip may be over by then.
        first.1.phase == DeliveryState::IDLE && !first.1.delivery_id.is_empty()
    });
    assert!(waits, "{}", run.stderr());
    run.process().signal(Signal::INT);
    assert!(run.outcome().status.success());
}
