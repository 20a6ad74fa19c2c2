//! Peers of both wire forms at once, each getting its own answers.

use minifactory_msgs::Action;
use minifactory_msgs::action::{DeliverPart, DeliverPartGoal};
use minifactory_msgs::action_msgs::msg::GoalStatus;
use minifactory_msgs::rcl_interfaces::srv::{
    DescribeParameters, DescribeParametersRequest, DescribeParametersResponse, GetParameters, GetParametersRequest,
    GetParametersResponse,
};
use minifactory_msgs::srv::{ReportHandover, ReportHandoverRequest, ReportHandoverResponse};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;

use super::echo::EchoNode;
use crate::common::{Kind, Peer};

type SendGoal = <DeliverPart as Action>::SendGoal;
type GetResult = <DeliverPart as Action>::GetResult;

/// Peers of each kind.
const PEERS: u8 = 2;
/// Rounds of each peer; in each it asks for a service, two parameter services, a goal and the goal's result.
const ROUNDS: u8 = 10;

/// What one round asks for, told by what only this round has.
struct Round {
    token: String,
    id: UUID,
    /// How many values of parameters it asks for.
    values: usize,
}

impl Round {
    fn new(kind: Kind, peer: u8, round: u8) -> Self {
        let token = format!("{kind:?}-{peer}-{round}");
        let mut uuid = [7; 16];
        uuid[..3].copy_from_slice(&[kind as u8, peer, round]);
        Self { token, id: UUID { uuid }, values: usize::from(1 + round + ROUNDS * peer) }
    }

    /// Everything but the result.
    fn ask(&self, number: u32, peer: &mut Peer) {
        let report = ReportHandoverRequest {
            delivery_id: self.token.clone(),
            report: ReportHandoverRequest::TAKEN,
            ..ReportHandoverRequest::default()
        };
        peer.call("report", number, &report);
        peer.call("describe", number, &DescribeParametersRequest { names: vec![self.token.clone()] });
        peer.call("get", number, &GetParametersRequest { names: vec!["name".to_owned(); self.values] });
        let goal = DeliverPartGoal { station: self.token.clone(), timeout_s: 3.0, ..DeliverPartGoal::default() };
        peer.call("send_goal", number, &<DeliverPart as Action>::SendGoalRequest::from((self.id, goal)));
    }

    fn check(&self, number: u32, peer: &mut Peer) {
        let reported: ReportHandoverResponse = peer.reply("report", number).decode();
        assert_eq!((reported.accepted, &reported.message), (true, &self.token));
        let described: DescribeParametersResponse = peer.reply("describe", number).decode();
        assert_eq!(described.descriptors[0].name, self.token);
        let got: GetParametersResponse = peer.reply("get", number).decode();
        assert_eq!(got.values.len(), self.values);
        assert!(got.values.iter().all(|value| value.string_value == "demo"));
        let (accepted, _) =
            peer.reply("send_goal", number).decode::<<DeliverPart as Action>::SendGoalResponse>().into();
        assert!(accepted, "{}", self.token);
    }

    fn check_result(&self, number: u32, peer: &mut Peer) {
        let reply = peer.reply("get_result", number);
        let (status, result) = reply.decode::<<DeliverPart as Action>::GetResultResponse>().into();
        assert_eq!((status, &result.reason), (GoalStatus::STATUS_SUCCEEDED, &self.token));
    }
}

fn work(kind: Kind, number: u8, domain: u16) {
    let mut peer = Peer::start(kind, domain);
    peer.client::<ReportHandover>("report", "/test/report");
    peer.client::<DescribeParameters>("describe", "/test/echo/describe_parameters");
    peer.client::<GetParameters>("get", "/test/echo/get_parameters");
    peer.client::<SendGoal>("send_goal", "/test/deliver/_action/send_goal");
    peer.client::<GetResult>("get_result", "/test/deliver/_action/get_result");
    let rounds: Vec<_> = (0..ROUNDS).map(|round| Round::new(kind, number, round)).collect();
    for (number, round) in (0..).zip(&rounds) {
        round.ask(number, &mut peer);
    }
    for (number, round) in (0..).zip(&rounds) {
        round.check(number, &mut peer);
    }
    for (number, round) in (0..).zip(&rounds) {
        peer.call("get_result", number, &<DeliverPart as Action>::GetResultRequest::from(round.id));
    }
    for (number, round) in (0..).zip(&rounds) {
        round.check_result(number, &mut peer);
    }
    assert!(!peer.has_stray_replies());
}

/// 200 requests from four clients of two kinds at once: none is lost, none answered to another client, none mixed up.
#[test]
fn mixed_requests_from_both_kinds_at_once_each_get_their_own_answer() {
    let node = EchoNode::start();
    let domain = node.domain.id;
    std::thread::scope(|scope| {
        for kind in Kind::BOTH {
            for number in 0..PEERS {
                scope.spawn(move || work(kind, number, domain));
            }
        }
    });
    node.stop();
}
