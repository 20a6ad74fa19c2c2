//! Goals: whose they are, and how long their results can be asked for.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use minifactory_msgs::Action;
use minifactory_msgs::action::{DeliverPart, DeliverPartGoal};
use minifactory_msgs::action_msgs::msg::{GoalStatus, GoalStatusArray};
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest, CancelGoalResponse};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;

use super::echo::{EchoNode, REPLACES_M};
use crate::common::{Kind, Peer};

type SendGoal = <DeliverPart as Action>::SendGoal;
type GetResult = <DeliverPart as Action>::GetResult;

/// How long results are kept: the default of rcl_action.
const RESULT_LIFETIME: Duration = Duration::from_secs(10);

/// A client of the node's action.
struct GoalClient {
    peer: Peer,
    asked: u32,
}

impl GoalClient {
    fn start(kind: Kind, domain: u16) -> Self {
        let mut peer = Peer::start(kind, domain);
        peer.client::<SendGoal>("send_goal", "/test/deliver/_action/send_goal");
        peer.client::<GetResult>("get_result", "/test/deliver/_action/get_result");
        peer.client::<CancelGoal>("cancel", "/test/deliver/_action/cancel_goal");
        Self { peer, asked: 0 }
    }

    /// Asks for a goal of so many steps (0: until it is cancelled) and says whether it was accepted.
    fn send(&mut self, id: u8, steps: f64, tolerance_m: f64) -> bool {
        self.asked += 1;
        let station = format!("goal {id}");
        let goal = DeliverPartGoal { station, timeout_s: steps, tolerance_m, ..DeliverPartGoal::default() };
        self.peer.call("send_goal", self.asked, &<DeliverPart as Action>::SendGoalRequest::from((uuid(id), goal)));
        let reply = self.peer.reply("send_goal", self.asked);
        let (accepted, _) = reply.decode::<<DeliverPart as Action>::SendGoalResponse>().into();
        accepted
    }

    /// Asks for a goal's result, which comes with [`result`](Self::result).
    fn ask(&mut self, id: u8) -> u32 {
        self.asked += 1;
        self.peer.call("get_result", self.asked, &<DeliverPart as Action>::GetResultRequest::from(uuid(id)));
        self.asked
    }

    /// How a goal has ended, and what its result names.
    fn result(&mut self, asked: u32) -> (i8, String) {
        let reply = self.peer.reply("get_result", asked);
        let (status, result) = reply.decode::<<DeliverPart as Action>::GetResultResponse>().into();
        (status, result.reason)
    }
}

fn uuid(id: u8) -> UUID {
    UUID { uuid: [id; 16] }
}

/// A result can be asked for until it has been kept for its time; then the goal is forgotten, and its identifier free.
#[test]
fn results_are_kept_for_their_time_and_then_forgotten() {
    let node = EchoNode::start();
    let mut clients = Kind::BOTH.map(|kind| GoalClient::start(kind, node.domain.id));
    let status = "rt/test/deliver/_action/status action_msgs::msg::dds_::GoalStatusArray_ reliable latched";
    for (id, client) in (1..).zip(&mut clients) {
        client.peer.tell(&format!("reader status {status}"));
        client.peer.wait_until_matched("status");
        assert!(client.send(id, 1.0, 0.0));
        // Asked for once more, it is given once more.
        for _ in 0..2 {
            let asked = client.ask(id);
            assert_eq!(client.result(asked), (GoalStatus::STATUS_SUCCEEDED, format!("goal {id}")));
        }
    }
    let ended = Instant::now();
    for (id, client) in (1..).zip(&mut clients) {
        let mut listed = BTreeSet::new();
        loop {
            let said: GoalStatusArray = client.peer.sample("status").decode();
            let now: BTreeSet<_> = said.status_list.iter().map(|status| status.goal_info.goal_id.uuid[0]).collect();
            if listed.contains(&id) && !now.contains(&id) {
                break;
            }
            listed.extend(now);
        }
        let asked = client.ask(id);
        assert_eq!(client.result(asked), (GoalStatus::STATUS_UNKNOWN, String::new()));
    }
    // The last goal ended a little before the clock was looked at.
    assert!(ended.elapsed() + Duration::from_secs(2) > RESULT_LIFETIME, "forgotten after {:?}", ended.elapsed());
    for (id, client) in (1..).zip(&mut clients) {
        assert!(client.send(id, 1.0, 0.0), "the identifier is free again");
        assert!(!client.peer.has_stray_replies());
    }
    node.stop();
}

/// Where a node lets a new goal replace those of the same client, it does so, and leaves those of others alone.
#[test]
fn a_goal_replaces_those_of_its_client_and_no_others() {
    for (kind, other) in [(Kind::Cyclone, Kind::Fast), (Kind::Fast, Kind::Cyclone)] {
        let node = EchoNode::start();
        let mut client = GoalClient::start(kind, node.domain.id);
        let mut bystander = GoalClient::start(other, node.domain.id);
        assert!(client.send(1, 0.0, 0.0) && bystander.send(2, 0.0, 0.0));
        let (first, bystanding) = (client.ask(1), bystander.ask(2));
        assert!(client.send(3, 0.0, REPLACES_M));
        assert_eq!(client.result(first), (GoalStatus::STATUS_CANCELED, "goal 1".to_owned()));
        let second = client.ask(3);
        // All that are left are those two; each ends with its own result.
        client.peer.call("cancel", 1, &CancelGoalRequest::default());
        let cancelled: CancelGoalResponse = client.peer.reply("cancel", 1).decode();
        let left: Vec<UUID> = cancelled.goals_canceling.iter().map(|info| info.goal_id).collect();
        assert_eq!(left, [uuid(2), uuid(3)]);
        assert_eq!(client.result(second), (GoalStatus::STATUS_CANCELED, "goal 3".to_owned()));
        assert_eq!(bystander.result(bystanding), (GoalStatus::STATUS_CANCELED, "goal 2".to_owned()));
        assert!(!client.peer.has_stray_replies() && !bystander.peer.has_stray_replies());
        node.stop();
    }
}
