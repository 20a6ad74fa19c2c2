//! Requests, goals and parameters that make no sense: refused, counted, and nobody dies of them.

use std::sync::mpsc::{Receiver, channel};

use feeder_runtime::dds::{NodeName, Participant, Reader};
use minifactory_msgs::Action;
use minifactory_msgs::action::{DeliverPart, DeliverPartGoal};
use minifactory_msgs::action_msgs::msg::{GoalInfo, GoalStatus};
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use minifactory_msgs::interface::standard::DIAGNOSTICS;
use minifactory_msgs::rcl_interfaces::msg::{Parameter, ParameterType, ParameterValue};
use minifactory_msgs::rcl_interfaces::srv::{
    SetParameters, SetParametersAtomically, SetParametersAtomicallyRequest, SetParametersAtomicallyResponse,
    SetParametersRequest, SetParametersResponse,
};
use minifactory_msgs::srv::{ReportHandover, ReportHandoverRequest, ReportHandoverResponse};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;

use super::echo::EchoNode;
use crate::common::{ENCAPSULATION, Kind, Peer, hex, wait_for};

type SendGoal = <DeliverPart as Action>::SendGoal;
type SendGoalRequest = <DeliverPart as Action>::SendGoalRequest;
type SendGoalResponse = <DeliverPart as Action>::SendGoalResponse;
type GetResult = <DeliverPart as Action>::GetResult;
type GetResultRequest = <DeliverPart as Action>::GetResultRequest;
type GetResultResponse = <DeliverPart as Action>::GetResultResponse;

/// What a node says of its losses.
struct Diagnostics {
    _reader: Reader,
    _participant: Participant,
    heard: Receiver<DiagnosticArray>,
}

impl Diagnostics {
    fn of(node: &EchoNode) -> Self {
        let participant = Participant::open(&node.domain, &NodeName::new("/test", "watching").unwrap()).unwrap();
        let (sender, heard) = channel();
        let reader = participant.topic_reader(&DIAGNOSTICS, "", move |sample| {
            let _ = sender.send(sample.decode().unwrap());
        });
        Self { _reader: reader.unwrap(), _participant: participant, heard }
    }

    /// Waits until the node has counted `count` of something at an endpoint.
    #[track_caller]
    fn wait_for(&self, key: &str, count: &str) {
        wait_for(&format!("{key}: {count}"), || {
            let counts = |status: &DiagnosticStatus| {
                let is_it = |entry: &KeyValue| entry.key == key && entry.value == count;
                status.name.starts_with("/test/echo") && status.values.iter().any(is_it)
            };
            self.heard.try_iter().any(|message| message.status.iter().any(counts)).then_some(())
        });
    }
}

fn report(delivery_id: &str) -> ReportHandoverRequest {
    ReportHandoverRequest {
        delivery_id: delivery_id.to_owned(),
        report: ReportHandoverRequest::TAKEN,
        ..ReportHandoverRequest::default()
    }
}

/// Somebody whose good requests must be answered as ever.
struct Witness {
    peer: Peer,
    asked: u32,
}

impl Witness {
    fn new(kind: Kind, domain: u16) -> Self {
        let mut peer = Peer::start(kind, domain);
        peer.client::<ReportHandover>("report", "/test/report");
        Self { peer, asked: 0 }
    }

    #[track_caller]
    fn is_served(&mut self) {
        self.asked += 1;
        self.peer.call("report", self.asked, &report("all is well"));
        let answer: ReportHandoverResponse = self.peer.reply("report", self.asked).decode();
        assert_eq!(answer.message, "all is well");
    }
}

/// Cut off, too long, without content, another type: refused, counted, and nobody else notices.
#[test]
fn requests_that_make_no_sense_are_refused_and_counted_and_disturb_nobody() {
    for (kind, other) in [(Kind::Cyclone, Kind::Fast), (Kind::Fast, Kind::Cyclone)] {
        let node = EchoNode::start();
        let diagnostics = Diagnostics::of(&node);
        let mut witness = Witness::new(other, node.domain.id);
        let mut peer = Peer::start(kind, node.domain.id);
        peer.client::<ReportHandover>("report", "/test/report");
        let good = hex(&report("good"));
        let bad = [
            good[..good.len() - 10].to_owned(),
            format!("{good}{}", "00".repeat(300_000)),
            ENCAPSULATION.to_owned(),
            // A text that claims to go on for two gigabytes.
            format!("{ENCAPSULATION}ffffff7f00000000"),
            // Another encoding than plain CDR: dropped before anybody looks at it.
            hex(&GetResultRequest::from(UUID { uuid: [9; 16] })),
        ];
        for (number, request) in (100..).zip(&bad) {
            peer.tell(&format!("call report {number} {request}"));
            witness.is_served();
        }
        diagnostics.wait_for("/test/report: requests refused", &bad.len().to_string());
        peer.tell(&format!("call report 1 {good}"));
        let answer: ReportHandoverResponse = peer.reply("report", 1).decode();
        assert_eq!(answer.message, "good");
        assert!(!peer.has_stray_replies() && !witness.peer.has_stray_replies());
        node.stop();
    }
}

/// A client that dies while the node works for it gets its result sent to nobody, which is counted: also where its lease
/// runs out while the reply waits to be acknowledged.
#[test]
fn a_client_that_vanishes_before_its_reply_disturbs_nobody() {
    type Start = fn(u16) -> Peer;
    let cases: [(Start, Kind); 3] = [
        (|domain| Peer::start(Kind::Cyclone, domain), Kind::Fast),
        (|domain| Peer::start(Kind::Fast, domain), Kind::Cyclone),
        (|domain| Peer::with_lease(2, domain), Kind::Fast),
    ];
    for (start, other) in cases {
        let node = EchoNode::start();
        let diagnostics = Diagnostics::of(&node);
        let mut witness = Witness::new(other, node.domain.id);
        witness.peer.client::<CancelGoal>("cancel", "/test/deliver/_action/cancel_goal");
        let mut peer = start(node.domain.id);
        peer.client::<SendGoal>("send_goal", "/test/deliver/_action/send_goal");
        peer.client::<GetResult>("get_result", "/test/deliver/_action/get_result");
        let id = UUID { uuid: [5; 16] };
        let endless = DeliverPartGoal { station: "endless".to_owned(), ..DeliverPartGoal::default() };
        let send_goal = |peer: &mut Peer, number| {
            peer.call("send_goal", number, &SendGoalRequest::from((id, endless.clone())));
            let (accepted, _) = peer.reply("send_goal", number).decode::<SendGoalResponse>().into();
            accepted
        };
        assert!(send_goal(&mut peer, 1));
        peer.call("get_result", 1, &GetResultRequest::from(id));
        // One request goes out after another: when this one is answered, the one before has arrived.
        assert!(!send_goal(&mut peer, 2), "an identifier in use");
        witness.is_served();
        peer.kill();
        witness.is_served();
        // Now the goal ends, and its result is for nobody.
        let goal_info = GoalInfo { goal_id: id, stamp: Time::default() };
        witness.peer.call("cancel", 1, &CancelGoalRequest { goal_info });
        let cancelled: CancelGoalResponse = witness.peer.reply("cancel", 1).decode();
        assert_eq!(cancelled.goals_canceling.len(), 1);
        witness.is_served();
        diagnostics.wait_for("/test/deliver/_action/get_result: replies lost", "1");
        witness.is_served();
        node.stop();
    }
}

#[test]
fn goals_cannot_share_an_identifier_and_unknown_ones_cannot_be_cancelled() {
    for kind in Kind::BOTH {
        let node = EchoNode::start();
        let mut peer = Peer::start(kind, node.domain.id);
        peer.client::<SendGoal>("send_goal", "/test/deliver/_action/send_goal");
        peer.client::<CancelGoal>("cancel", "/test/deliver/_action/cancel_goal");
        peer.client::<GetResult>("get_result", "/test/deliver/_action/get_result");
        let id = |number| UUID { uuid: [number; 16] };
        let mut asked = 0;
        let mut send = |peer: &mut Peer, number, station: &str, tolerance_m| {
            asked += 1;
            let goal = DeliverPartGoal { station: station.to_owned(), tolerance_m, ..DeliverPartGoal::default() };
            peer.call("send_goal", asked, &SendGoalRequest::from((id(number), goal)));
            let (accepted, _) = peer.reply("send_goal", asked).decode::<SendGoalResponse>().into();
            accepted
        };
        assert!(
            send(&mut peer, 1, "first", 0.0) && send(&mut peer, 2, "second", 0.0) && send(&mut peer, 3, "third", 0.0)
        );
        assert!(!send(&mut peer, 1, "usurper", 0.0), "an identifier in use");
        assert!(!send(&mut peer, 4, "fourth", -1.0), "a goal that makes no sense");

        let mut asked = 0;
        let mut cancel = |peer: &mut Peer, goal_id| -> CancelGoalResponse {
            asked += 1;
            let goal_info = GoalInfo { goal_id, stamp: Time::default() };
            peer.call("cancel", asked, &CancelGoalRequest { goal_info });
            peer.reply("cancel", asked).decode()
        };
        let unknown = cancel(&mut peer, id(9));
        assert_eq!(unknown.return_code, CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID);
        let one = cancel(&mut peer, id(2));
        assert_eq!((one.return_code, one.goals_canceling.len()), (CancelGoalResponse::ERROR_NONE, 1));
        peer.call("get_result", 1, &GetResultRequest::from(id(2)));
        let (status, result) = peer.reply("get_result", 1).decode::<GetResultResponse>().into();
        assert_eq!((status, result.reason.as_str()), (GoalStatus::STATUS_CANCELED, "second"));
        assert_eq!(cancel(&mut peer, id(2)).return_code, CancelGoalResponse::ERROR_GOAL_TERMINATED);
        // No identifier and no time mean all that are left: the first and the third, not the usurper.
        let all = cancel(&mut peer, UUID::default());
        assert_eq!(all.goals_canceling.iter().map(|info| info.goal_id).collect::<Vec<_>>(), [id(1), id(3)]);
        peer.call("get_result", 2, &GetResultRequest::from(id(1)));
        let (_, result) = peer.reply("get_result", 2).decode::<GetResultResponse>().into();
        assert_eq!(result.reason, "first");
        peer.call("get_result", 3, &GetResultRequest::from(id(9)));
        let (status, _) = peer.reply("get_result", 3).decode::<GetResultResponse>().into();
        assert_eq!(status, GoalStatus::STATUS_UNKNOWN);
        node.stop();
    }
}

#[test]
fn parameters_of_the_wrong_type_or_out_of_range_are_refused_with_the_reason() {
    for kind in Kind::BOTH {
        let node = EchoNode::start();
        let mut peer = Peer::start(kind, node.domain.id);
        peer.client::<SetParameters>("set", "/test/echo/set_parameters");
        peer.client::<SetParametersAtomically>("set_all", "/test/echo/set_parameters_atomically");
        let integer =
            ParameterValue { r#type: ParameterType::PARAMETER_INTEGER, integer_value: 5, ..Default::default() };
        let double = |double_value| ParameterValue {
            r#type: ParameterType::PARAMETER_DOUBLE,
            double_value,
            ..Default::default()
        };
        let text = |word: &str| ParameterValue {
            r#type: ParameterType::PARAMETER_STRING,
            string_value: word.to_owned(),
            ..Default::default()
        };
        let no_type = ParameterValue { r#type: 77, ..Default::default() };
        let cases = [
            ("rate_hz", integer, "parameter rate_hz: 5 is not a double (write 1.0, not 1)"),
            ("rate_hz", double(0.1), "parameter rate_hz: 0.1 is not in 0.5 … 100.0"),
            ("rate_hz", double(f64::NAN), "parameter rate_hz: NaN is not in 0.5 … 100.0"),
            ("rate_hz", no_type, "parameter rate_hz cannot be set: 77 is no type of a parameter"),
            ("rate_hz", ParameterValue::default(), "parameter rate_hz cannot be deleted: it is declared"),
            ("name", text("other"), "parameter name is read-only: it can be set at the start of the node"),
            (
                "log_level",
                text("loud"),
                "parameter log_level: \"loud\" is no level, allowed are debug, info, warn, error, fatal",
            ),
            ("rate", double(1.0), "parameter rate is not declared"),
            ("rate_hz", double(20.0), ""),
            ("name", text("demo"), ""),
        ];
        let parameter = |name: &str, value: &ParameterValue| Parameter { name: name.to_owned(), value: value.clone() };
        let parameters: Vec<_> = cases.iter().map(|(name, value, _)| parameter(name, value)).collect();
        peer.call("set", 1, &SetParametersRequest { parameters });
        let answer: SetParametersResponse = peer.reply("set", 1).decode();
        assert_eq!(answer.results.len(), cases.len());
        for (result, (name, _, reason)) in answer.results.iter().zip(&cases) {
            assert_eq!((result.successful, result.reason.as_str()), (reason.is_empty(), *reason), "{name}");
        }
        let parameters = vec![parameter("rate_hz", &double(30.0)), parameter("name", &text("other"))];
        peer.call("set_all", 1, &SetParametersAtomicallyRequest { parameters });
        let answer: SetParametersAtomicallyResponse = peer.reply("set_all", 1).decode();
        assert!(!answer.result.successful && answer.result.reason.contains("parameter name is read-only"));
        node.stop();
    }
}
