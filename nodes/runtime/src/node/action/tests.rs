//! A client and a server of an action, tick by tick.

use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::action_msgs::msg::GoalStatus as StatusMessage;
use minifactory_msgs::interface::{Namespace, User};
use proptest::prelude::*;

use super::super::{Arrival, AskerInner, Interface, Output, PortKind};
use super::*;
use crate::cdr;

const TICK_NS: u64 = 10_000_000;
const RESULT_LIFETIME_TICKS: u64 = 1_000;

/// A client and a server, each with ports of its own; what one sends the other gets in the next tick.
struct Bench {
    tick: u64,
    interfaces: [Interface; 2],
    ios: [StepIo; 2],
    client: ActionClient<DeliverPart>,
    server: ActionServer<DeliverPart>,
    /// Who asks.
    edge: usize,
    heard: Vec<Heard>,
    statuses: Vec<Vec<(u8, i8)>>,
    cancel_answers: Vec<(i8, Vec<u8>)>,
    /// Everything either side sent.
    wire: Vec<Vec<u8>>,
}

/// What the client heard.
#[derive(Debug, Clone, PartialEq)]
enum Heard {
    Accepted(u8),
    Rejected(u8),
    Feedback(u8, f64),
    Finished(u8, Option<GoalEnd>, String),
    Lost(u8),
}

fn id(number: u8) -> GoalId {
    GoalId([number; 16])
}

fn result(reason: &str) -> DeliverPartResult {
    DeliverPartResult { reason: reason.into(), ..Default::default() }
}

const DELIVER: ActionSpec<DeliverPart> =
    ActionSpec::new(Namespace::Own(""), "deliver").between(&["serves"], &[User::Forward("asks")], "");

impl Bench {
    fn new() -> Self {
        let (mut asks, mut serves) = (Declare::new("asks", "/a"), Declare::new("serves", "/a"));
        let client = ActionClient::new(asks.action_client(&DELIVER));
        let server = ActionServer::new(serves.action_server(&DELIVER));
        let interfaces = [asks.finish().unwrap(), serves.finish().unwrap()];
        let ios = [0, 1].map(|side: usize| StepIo::new(interfaces[side].ports.len(), TICK_NS));
        Self {
            tick: 0,
            interfaces,
            ios,
            client,
            server,
            edge: 0,
            heard: Vec::new(),
            statuses: Vec::new(),
            cancel_answers: Vec::new(),
            wire: Vec::new(),
        }
    }

    /// Runs a tick: first `client` and `server` do what they want, then both hear. Returns the server's events.
    fn tick(
        &mut self,
        client: impl FnOnce(&mut ActionClient<DeliverPart>, &mut StepIo),
        server: impl FnOnce(&mut ActionServer<DeliverPart>, &mut StepIo),
    ) -> Vec<ServerEvent<DeliverPart>> {
        self.ios.iter_mut().for_each(|io| io.begin(self.tick, self.tick * TICK_NS));
        let [client_io, server_io] = &mut self.ios;
        let events = self.server.poll(server_io);
        server(&mut self.server, server_io);
        let heard = self.client.poll(client_io).into_iter().map(|event| match event {
            ClientEvent::Accepted(id) => Heard::Accepted(id.0[0]),
            ClientEvent::Rejected(id) => Heard::Rejected(id.0[0]),
            ClientEvent::Feedback(id, feedback) => Heard::Feedback(id.0[0], feedback.eta_s),
            ClientEvent::Finished(id, end, result) => Heard::Finished(id.0[0], end, result.reason),
            ClientEvent::Lost(id) => Heard::Lost(id.0[0]),
        });
        self.heard.extend(heard);
        client(&mut self.client, client_io);
        self.ios.iter_mut().for_each(StepIo::end);
        for side in 0..2 {
            for output in std::mem::take(&mut self.ios[side].outputs) {
                self.carry(side, output);
            }
        }
        self.tick += 1;
        events
    }

    fn carry(&mut self, from: usize, output: Output) {
        let to = 1 - from;
        let name = |port: usize| self.interfaces[from].ports[port].name.clone();
        let port_of = |name: &str| self.interfaces[to].ports.iter().position(|port| port.name == name);
        let (name, payload, arrival) = match output {
            Output::Message { port, payload } => {
                (name(port), payload.clone(), Arrival::Message { payload, little_endian: true })
            }
            Output::Request { port, call, payload } => {
                let asker = Asker(AskerInner::Loop { edge: self.edge, call: call.0 });
                (name(port), payload.clone(), Arrival::Request { payload, little_endian: true, asker })
            }
            Output::Reply { port, asker, payload } => {
                let AskerInner::Loop { call, .. } = asker.0 else { panic!("nobody asks from outside") };
                (name(port), payload.clone(), Arrival::Reply { payload, little_endian: true, call: CallId(call) })
            }
        };
        self.wire.push(payload.to_vec());
        if name.ends_with("status") {
            let status: GoalStatusArray = cdr::decode(&payload, true).unwrap();
            let numbers = status.status_list.iter().map(|goal| (goal.goal_info.goal_id.uuid[0], goal.status));
            self.statuses.push(numbers.collect());
        }
        if name.ends_with("cancel_goal") && matches!(arrival, Arrival::Reply { .. }) {
            let answer: CancelGoalResponse = cdr::decode(&payload, true).unwrap();
            let goals = answer.goals_canceling.iter().map(|info| info.goal_id.uuid[0]).collect();
            self.cancel_answers.push((answer.return_code, goals));
        }
        if let Some(port) = port_of(&name) {
            self.ios[to].arrive(port, arrival);
        }
    }

    fn idle(&mut self) -> Vec<ServerEvent<DeliverPart>> {
        self.tick(|_, _| {}, |_, _| {})
    }

    /// Sends a goal; the server gets it with the next tick.
    fn send(&mut self, number: u8) -> GoalRequest<DeliverPart> {
        self.tick(|client, io| client.send(io, id(number), DeliverPartGoal::default()), |_, _| {});
        match self.idle().pop() {
            Some(ServerEvent::Requested(request)) => request,
            other => panic!("no request but {other:?}"),
        }
    }

    fn start(&mut self, number: u8) {
        let request = self.send(number);
        self.tick(|_, _| {}, |server, io| server.accept(io, request));
    }

    fn finish(&mut self, number: u8, end: GoalEnd, reason: &str) {
        self.tick(|_, _| {}, |server, io| server.finish(io, id(number), end, result(reason)));
    }

    /// Asks to cancel by identifier and stamp, as any client may; returns which goals the server is to end.
    fn cancel(&mut self, number: u8, stamp: Time) -> Vec<u8> {
        let goal_info = GoalInfo { goal_id: id(number).into(), stamp };
        self.tick(
            |client, io| {
                io.call(&client.ports.cancel, &CancelGoalRequest { goal_info });
            },
            |_, _| {},
        );
        let events = self.idle();
        events
            .iter()
            .map(|event| match event {
                ServerEvent::CancelRequested(id) => id.0[0],
                ServerEvent::Requested(request) => panic!("a request: {request:?}"),
            })
            .collect()
    }

    /// Asks for a result and returns what is heard last, two ticks later.
    fn ask(&mut self, number: u8) -> Option<Heard> {
        let request = UUID::from(id(number)).into();
        self.tick(
            |client, io| {
                let call = io.call(&client.ports.get_result, &request);
                client.asked.insert(call, id(number));
            },
            |_, _| {},
        );
        self.idle_for(2);
        self.heard.pop()
    }

    fn idle_for(&mut self, ticks: u64) {
        for _ in 0..ticks {
            self.idle();
        }
    }
}

#[test]
fn a_goal_is_accepted_fed_back_and_finished() {
    let mut bench = Bench::new();
    bench.start(1);
    bench.tick(
        |_, _| {},
        |server, io| server.feedback(io, id(1), DeliverPartFeedback { eta_s: 2.5, ..Default::default() }),
    );
    bench.idle();
    bench.finish(1, GoalEnd::Succeeded, "there");
    bench.idle();
    let expected =
        [Heard::Accepted(1), Heard::Feedback(1, 2.5), Heard::Finished(1, Some(GoalEnd::Succeeded), "there".into())];
    assert_eq!(bench.heard, expected);
    let executing = vec![(1, StatusMessage::STATUS_EXECUTING)];
    assert_eq!(bench.statuses, [vec![], executing, vec![(1, StatusMessage::STATUS_SUCCEEDED)]]);
}

#[test]
fn where_owners_alone_may_cancel_others_cannot() {
    let mut bench = Bench::new();
    bench.server = ActionServer::new(Declare::new("serves", "/a").action_server(&DELIVER)).cancelled_by_owners();
    bench.start(1);
    bench.edge = 1;
    bench.start(2);
    assert!(bench.cancel(1, Time::default()).is_empty());
    let (rejected, none) = (CancelGoalResponse::ERROR_REJECTED, CancelGoalResponse::ERROR_NONE);
    assert_eq!(bench.cancel_answers.last(), Some(&(rejected, vec![])));
    assert_eq!(bench.cancel(0, Time::default()), [2], "all goals are all of one's own");
    bench.edge = 0;
    assert_eq!(bench.cancel(1, Time::default()), [1]);
    assert_eq!(bench.cancel_answers.last(), Some(&(none, vec![1])));
}

#[test]
fn a_goal_whose_answer_is_lost_is_known_to_be_lost() {
    let mut bench = Bench::new();
    let lose = |bench: &mut Bench, service: &str, call: u64| {
        let port = bench.interfaces[0].ports.iter().position(|port| port.name.ends_with(service)).unwrap();
        bench.ios[0].arrive(port, Arrival::NoReply { call: CallId(call) });
        bench.idle();
    };
    bench.send(1);
    lose(&mut bench, "send_goal", 0);
    assert_eq!(bench.heard, [Heard::Lost(1)]);
    // The result of another goal is lost: its calls are 1, to send it, and 2, to ask for the result.
    bench.start(2);
    bench.idle();
    lose(&mut bench, "get_result", 2);
    assert_eq!(bench.heard, [Heard::Lost(1), Heard::Accepted(2), Heard::Lost(2)]);
    // An answer that comes too late says nothing new.
    bench.finish(2, GoalEnd::Succeeded, "late");
    bench.idle();
    assert_eq!(bench.heard.len(), 3);
}

#[test]
fn a_rejected_goal_leaves_no_trace_and_may_be_sent_again() {
    let mut bench = Bench::new();
    let request = bench.send(1);
    bench.tick(|_, _| {}, |server, io| server.reject(io, request, "not now"));
    bench.idle();
    assert_eq!(bench.heard, [Heard::Rejected(1)]);
    assert_eq!(bench.statuses, [vec![]]);
    bench.start(1);
    bench.idle();
    assert_eq!(bench.heard, [Heard::Rejected(1), Heard::Accepted(1)]);
}

/// The answer to a goal has no room for a reason; whoever asks for the result of a rejected goal gets one.
#[test]
fn the_result_of_a_rejected_goal_tells_why_until_it_expires() {
    let mut bench = Bench::new();
    for (number, reason) in [(1, "no way"), (2, "walled off")] {
        let request = bench.send(number);
        bench.tick(|_, _| {}, |server, io| server.reject_with(io, request, reason, result(reason)));
    }
    let rejected_in = bench.tick - 1;
    bench.idle();
    assert_eq!(bench.heard, [Heard::Rejected(1), Heard::Rejected(2)]);
    assert_eq!(bench.statuses, [vec![]], "they never were goals");
    let aborted = |number, reason: &str| Some(Heard::Finished(number, Some(GoalEnd::Aborted), reason.to_owned()));
    assert_eq!(bench.ask(2), aborted(2, "walled off"));
    assert_eq!(bench.ask(1), aborted(1, "no way"));
    bench.idle_for(rejected_in + RESULT_LIFETIME_TICKS - 2 - bench.tick);
    assert_eq!(bench.ask(2), aborted(2, "walled off"));
    assert_eq!(bench.ask(2), Some(Heard::Finished(2, None, String::new())), "forgotten");
}

#[test]
fn a_request_tells_who_asks() {
    let mut bench = Bench::new();
    let ids = [0, 7].map(|edge| {
        bench.edge = edge;
        let request = bench.send(u8::try_from(edge).unwrap() + 1);
        (request.client(), request.participant())
    });
    assert_eq!(ids, [(0, 0), (7, 7)]);
}

/// A message may overtake the answer to the goal.
#[test]
fn feedback_on_a_goal_that_is_not_answered_yet_is_heard() {
    let mut bench = Bench::new();
    let request = bench.send(1);
    let feedback = DeliverPartFeedback { eta_s: 1.5, ..Default::default() };
    bench.tick(|_, _| {}, |server, io| server.feedback(io, id(1), feedback));
    bench.tick(|_, _| {}, |server, io| server.accept(io, request));
    bench.idle();
    assert_eq!(bench.heard, [Heard::Feedback(1, 1.5), Heard::Accepted(1)]);
}

#[test]
fn an_identifier_in_use_is_rejected_also_before_the_first_is_decided() {
    let mut bench = Bench::new();
    let twice = |client: &mut ActionClient<DeliverPart>, io: &mut StepIo| {
        client.send(io, id(1), DeliverPartGoal::default());
        client.send(io, id(1), DeliverPartGoal::default());
    };
    bench.tick(twice, |_, _| {});
    let mut events = bench.idle();
    assert_eq!(events.len(), 1, "{events:?}");
    let Some(ServerEvent::Requested(request)) = events.pop() else { panic!("no request") };
    bench.tick(|_, _| {}, |server, io| server.accept(io, request));
    bench.idle();
    assert_eq!(bench.heard, [Heard::Rejected(1), Heard::Accepted(1)]);
    bench.tick(|client, io| client.send(io, id(1), DeliverPartGoal::default()), |_, _| {});
    assert!(bench.idle().is_empty());
    bench.idle();
    assert_eq!(bench.heard.last(), Some(&Heard::Rejected(1)));
}

#[test]
fn cancelling_means_what_ros_2_means() {
    let mut bench = Bench::new();
    for number in 1..=4 {
        bench.start(number);
    }
    bench.finish(4, GoalEnd::Succeeded, "");
    let accepted = |bench: &Bench, number| bench.server.goals.info(id(number)).unwrap().stamp;
    let (second, none) = (accepted(&bench, 2), Time::default());
    assert_eq!(bench.cancel(9, none), Vec::<u8>::new());
    assert_eq!(bench.cancel(4, none), Vec::<u8>::new());
    assert_eq!(bench.cancel(0, second), [1, 2]);
    assert_eq!(bench.cancel(1, none), Vec::<u8>::new(), "it is canceling already");
    assert_eq!(bench.cancel(0, none), [3]);
    assert_eq!(bench.cancel(0, none), Vec::<u8>::new(), "all are canceling");
    bench.idle();
    let expected = [
        (CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID, vec![]),
        (CancelGoalResponse::ERROR_GOAL_TERMINATED, vec![]),
        (CancelGoalResponse::ERROR_NONE, vec![1, 2]),
        (CancelGoalResponse::ERROR_GOAL_TERMINATED, vec![]),
        (CancelGoalResponse::ERROR_NONE, vec![3]),
        (CancelGoalResponse::ERROR_NONE, vec![]),
    ];
    assert_eq!(bench.cancel_answers, expected);
    bench.finish(1, GoalEnd::Canceled, "stopped");
    bench.finish(2, GoalEnd::Succeeded, "too late to stop");
    bench.finish(3, GoalEnd::Aborted, "broken");
    bench.idle();
    let ended = [
        Heard::Finished(1, Some(GoalEnd::Canceled), "stopped".into()),
        Heard::Finished(2, Some(GoalEnd::Succeeded), "too late to stop".into()),
        Heard::Finished(3, Some(GoalEnd::Aborted), "broken".into()),
    ];
    assert_eq!(bench.heard[bench.heard.len() - 3..], ended);
}

#[test]
fn the_clients_own_cancel_names_one_goal() {
    let mut bench = Bench::new();
    bench.start(1);
    bench.start(2);
    bench.tick(|client, io| client.cancel(io, id(2)), |_, _| {});
    let events = bench.idle();
    assert!(matches!(events[..], [ServerEvent::CancelRequested(canceling)] if canceling == id(2)), "{events:?}");
}

/// As when another goal replaces it: no client asked for the end.
#[test]
fn a_preempted_goal_ends_as_cancelled() {
    let mut bench = Bench::new();
    bench.start(1);
    let second = bench.send(2);
    bench.tick(
        |_, _| {},
        |server, io| {
            server.accept(io, second);
            server.finish(io, id(1), GoalEnd::Canceled, result("replaced"));
        },
    );
    bench.idle();
    let expected =
        [Heard::Accepted(1), Heard::Accepted(2), Heard::Finished(1, Some(GoalEnd::Canceled), "replaced".into())];
    assert_eq!(bench.heard, expected);
    let last = vec![(1, StatusMessage::STATUS_CANCELED), (2, StatusMessage::STATUS_EXECUTING)];
    assert_eq!(bench.statuses.last(), Some(&last));
}

#[test]
fn only_the_first_end_of_a_goal_counts() {
    let mut bench = Bench::new();
    bench.start(1);
    bench.finish(1, GoalEnd::Aborted, "first");
    bench.finish(1, GoalEnd::Canceled, "second");
    bench.finish(7, GoalEnd::Succeeded, "never accepted");
    bench.idle();
    assert_eq!(bench.heard, [Heard::Accepted(1), Heard::Finished(1, Some(GoalEnd::Aborted), "first".into())]);
}

/// The client asks for a result as soon as the goal is accepted; others may ask at any time.
#[test]
fn a_result_can_be_asked_for_until_it_expires() {
    let done = Heard::Finished(1, Some(GoalEnd::Succeeded), "done".into());
    let unknown = |number| Some(Heard::Finished(number, None, String::new()));
    let mut bench = Bench::new();
    assert_eq!(bench.ask(1), unknown(1));
    bench.start(1);
    assert_eq!(bench.ask(1), Some(Heard::Accepted(1)), "not yet finished: no answer");
    bench.finish(1, GoalEnd::Succeeded, "done");
    let finished_in = bench.tick - 1;
    bench.idle();
    assert_eq!(bench.heard, [done.clone(), done.clone()], "both who asked are answered");
    assert_eq!(bench.ask(1), Some(done.clone()), "and whoever asks afterwards");
    bench.idle_for(finished_in + RESULT_LIFETIME_TICKS - 2 - bench.tick);
    assert_eq!(bench.ask(1), Some(done));
    assert_eq!(bench.ask(1), unknown(1), "forgotten");
    assert_eq!(bench.statuses.last(), Some(&vec![]));
}

#[test]
fn feedback_of_other_clients_goals_is_not_heard() {
    let mut bench = Bench::new();
    bench.start(1);
    bench.tick(|_, _| {}, |server, io| server.feedback(io, id(2), DeliverPartFeedback::default()));
    bench.idle();
    assert_eq!(bench.heard, [Heard::Accepted(1)]);
}

#[test]
fn the_ports_carry_the_names_of_ros_2() {
    let bench = Bench::new();
    let names = |side: usize, wanted: fn(PortKind) -> bool| -> Vec<String> {
        let ports = bench.interfaces[side].ports.iter().filter(|port| wanted(port.kind));
        ports.map(|port| port.name.clone()).collect()
    };
    let services = ["send_goal", "cancel_goal", "get_result"].map(|part| format!("/a/deliver/_action/{part}"));
    assert_eq!(names(1, |kind| kind == PortKind::Serve), services);
    assert_eq!(names(0, |kind| matches!(kind, PortKind::Call(_))), services);
    let topics = ["feedback", "status"].map(|part| format!("/a/deliver/_action/{part}"));
    assert_eq!(names(1, |kind| kind == PortKind::Publish), topics);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is done with a few goals, every goal that is accepted ends once for its client, and the same doings
    /// put the same bytes on the wire.
    #[test]
    fn every_accepted_goal_ends_once_and_runs_repeat(doings in prop::collection::vec((0_u8..5, 1_u8..5), 0..60)) {
        let run = || {
            let mut bench = Bench::new();
            for &(what, number) in &doings {
                match what {
                    0 => {
                        bench.tick(|client, io| client.send(io, id(number), DeliverPartGoal::default()), |_, _| {});
                        if let Some(ServerEvent::Requested(request)) = bench.idle().pop() {
                            bench.tick(|_, _| {}, |server, io| server.accept(io, request));
                        }
                    }
                    1 => bench.finish(number, GoalEnd::Succeeded, "done"),
                    2 => bench.finish(number, GoalEnd::Canceled, "stopped"),
                    3 => {
                        bench.cancel(number, Time::default());
                    }
                    _ => bench.idle_for(u64::from(number)),
                }
            }
            for number in 1..5 {
                bench.finish(number, GoalEnd::Aborted, "over");
            }
            bench.idle_for(3);
            (bench.heard, bench.wire)
        };
        let (heard, wire) = run();
        for number in 1..5 {
            let accepted = heard.iter().filter(|event| **event == Heard::Accepted(number)).count();
            let finished = heard.iter().filter(|event| matches!(event, Heard::Finished(n, ..) if *n == number)).count();
            prop_assert_eq!(accepted, finished);
        }
        prop_assert_eq!(run(), (heard, wire));
    }
}
