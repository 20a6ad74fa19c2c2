//! Which loops can be built, and which cannot and why.

use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::interface::{EVERY_NODE, Namespace, ServiceSpec, TopicSpec, User};
use minifactory_msgs::rosgraph_msgs::msg::Clock;
use minifactory_msgs::std_srvs::srv::{SetBool, Trigger};
use minifactory_msgs::{Message, Service};

use super::*;
use crate::dds::Qos;
use crate::node::Declare;

const TIMING: LoopTiming =
    LoopTiming { tick_ns: 10_000_000, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 32 };

fn node(name: &str, declare: impl FnOnce(&mut Declare)) -> (String, Interface) {
    let mut io = Declare::new(name, "/");
    declare(&mut io);
    (name.to_owned(), io.finish().unwrap())
}

/// Who uses what with a latency: any node.
fn any(latency: Latency) -> &'static [User] {
    match latency {
        Latency::Forward => &[User::Forward(EVERY_NODE)],
        Latency::Feedback => &[User::Feedback(EVERY_NODE)],
    }
}

fn of_topic<M: Message>(name: &'static str, latency: Latency, qos: Qos) -> TopicSpec<M> {
    TopicSpec::new(Namespace::Own(""), name, qos).between(&[EVERY_NODE], any(latency), "")
}

fn publishes(io: &mut Declare, name: &'static str) {
    io.publisher::<Point>(&of_topic(name, Latency::Forward, Qos::command()));
}

fn hears(io: &mut Declare, name: &'static str, latency: Latency) {
    io.subscriber::<Point>(&of_topic(name, latency, Qos::command()));
}

fn serves<S: Service>(io: &mut Declare, name: &'static str) {
    io.server::<S>(&ServiceSpec::new(Namespace::Own(""), name).between(&[EVERY_NODE], &[], ""));
}

fn calls<S: Service>(io: &mut Declare, name: &'static str, latency: Latency) {
    io.client::<S>(&ServiceSpec::new(Namespace::Own(""), name).between(&[], any(latency), ""));
}

fn connect(nodes: &[(String, Interface)]) -> Result<LoopContract, ContractError> {
    LoopContract::connect(7, TIMING, nodes)
}

fn topic(name: &str) -> Channel {
    Channel::Topic(name.into())
}

#[test]
fn zero_is_refused_by_name() {
    let zero = |timing| LoopContract::connect(7, timing, &[]).unwrap_err();
    assert_eq!(zero(LoopTiming { tick_ns: 0, ..TIMING }), ContractError::Zero { key: "tick_ns" });
    let key = "forward_delay_ticks";
    assert_eq!(zero(LoopTiming { forward_delay_ticks: 0, ..TIMING }), ContractError::Zero { key });
    let key = "feedback_delay_ticks";
    assert_eq!(zero(LoopTiming { feedback_delay_ticks: 0, ..TIMING }), ContractError::Zero { key });
    assert_eq!(zero(LoopTiming { window_ticks: 0, ..TIMING }), ContractError::Zero { key: "window_ticks" });
}

#[test]
fn window_and_delay_must_fit_the_readers() {
    let with_window = |window_ticks| LoopContract::connect(7, LoopTiming { window_ticks, ..TIMING }, &[]);
    assert!(with_window(46).is_ok());
    let error = ContractError::WindowTooLarge { window_ticks: 47, largest_delay_ticks: 10 };
    assert_eq!(with_window(47), Err(error));
    assert!(with_window(u64::MAX).is_err());
    let forward = LoopTiming { forward_delay_ticks: 50, window_ticks: 7, ..TIMING };
    let error = ContractError::WindowTooLarge { window_ticks: 7, largest_delay_ticks: 50 };
    assert_eq!(LoopContract::connect(7, forward, &[]), Err(error));
}

#[test]
fn two_nodes_of_one_name_are_refused() {
    let error = connect(&[node("/a", |_| {}), node("/b", |_| {}), node("/a", |_| {})]).unwrap_err();
    assert_eq!(error, ContractError::DuplicateNode { name: "/a".into() });
}

#[test]
fn two_ports_of_one_role_and_name_are_refused() {
    let twice = node("/a", |io| {
        publishes(io, "x");
        publishes(io, "x");
    });
    assert_eq!(connect(&[twice]), Err(ContractError::DuplicatePort { node: "/a".into(), name: "/x".into() }));
    let twice = node("/a", |io| {
        hears(io, "x", Latency::Forward);
        hears(io, "x", Latency::Forward);
    });
    let publisher = node("/b", |io| publishes(io, "x"));
    assert_eq!(
        connect(&[publisher, twice]),
        Err(ContractError::DuplicatePort { node: "/a".into(), name: "/x".into() })
    );
}

#[test]
fn what_nobody_else_publishes_or_serves_is_refused() {
    let lonely = node("/a", |io| {
        publishes(io, "x");
        hears(io, "x", Latency::Forward);
    });
    let error = connect(&[lonely]).unwrap_err();
    assert_eq!(error, ContractError::NoPublisher { node: "/a".into(), name: "/x".into() });
    let caller = node("/a", |io| {
        calls::<Trigger>(io, "go", Latency::Forward);
    });
    assert_eq!(connect(&[caller]), Err(ContractError::NoServer { node: "/a".into(), name: "/go".into() }));
}

#[test]
fn a_service_has_one_server_even_when_no_node_calls_it() {
    let server = |name| {
        node(name, |io| {
            serves::<Trigger>(io, "go");
        })
    };
    let error = ContractError::TwoServers { name: "/go".into(), first: "/a".into(), second: "/b".into() };
    assert_eq!(connect(&[server("/a"), server("/b")]), Err(error));
}

#[test]
fn partners_must_agree_about_the_type() {
    let publisher = node("/a", |io| publishes(io, "x"));
    let subscriber = node("/b", |io| {
        io.subscriber::<Clock>(&of_topic("x", Latency::Forward, Qos::command()));
    });
    let mismatch = |expected: &str, found: &str| ContractError::TypeMismatch {
        node: "/b".into(),
        name: "/x".into(),
        expected: expected.into(),
        other: "/a".into(),
        found: found.into(),
    };
    let error = mismatch(&Clock::INFO.ros_type(), &Point::INFO.ros_type());
    assert_eq!(connect(&[publisher, subscriber]), Err(error));
    let server = node("/a", |io| {
        serves::<Trigger>(io, "x");
    });
    let client = node("/b", |io| {
        calls::<SetBool>(io, "x", Latency::Forward);
    });
    assert_eq!(connect(&[server, client]), Err(mismatch("std_srvs/srv/SetBool", "std_srvs/srv/Trigger")));
}

#[test]
fn a_publisher_must_offer_what_a_subscriber_asks_for() {
    let connected = |offered: Qos, asked: Qos| {
        let publisher = node("/a", |io| _ = io.publisher::<Point>(&of_topic("x", Latency::Forward, offered)));
        let subscriber = node("/b", |io| _ = io.subscriber::<Point>(&of_topic("x", Latency::Forward, asked)));
        connect(&[publisher, subscriber]).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(connected(Qos::latched(), Qos::sensor()), Ok(()));
    let refused = |why: &str| Err(format!("/b cannot hear /x from /a: {why}"));
    assert_eq!(connected(Qos::sensor(), Qos::command()), refused("RELIABLE is asked for, BEST_EFFORT is offered"));
    assert_eq!(connected(Qos::command(), Qos::latched()), refused("TRANSIENT_LOCAL is asked for, VOLATILE is offered"));
}

/// Topics and services have names of their own in ROS 2.
#[test]
fn regress_a_service_may_have_the_name_of_a_topic() {
    let both = node("/a", |io| {
        publishes(io, "x");
        serves::<Trigger>(io, "x");
    });
    let user = node("/b", |io| {
        hears(io, "x", Latency::Forward);
        calls::<Trigger>(io, "x", Latency::Forward);
    });
    let contract = connect(&[both, user]).unwrap();
    let forth = contract.edges.iter().find(|edge| edge.from == 0).unwrap();
    assert_eq!(forth.channels, [topic("/x"), Channel::Reply("/x".into())]);
}

#[test]
fn an_edge_is_as_late_as_the_latest_thing_it_carries() {
    let source = node("/a", |io| {
        publishes(io, "quick");
        publishes(io, "slow");
        hears(io, "back", Latency::Feedback);
    });
    let sink = node("/b", |io| {
        hears(io, "quick", Latency::Forward);
        hears(io, "slow", Latency::Feedback);
        publishes(io, "back");
    });
    let quick = node("/c", |io| hears(io, "quick", Latency::Forward));
    let contract = connect(&[source, sink, quick]).unwrap();
    let edge =
        |from, to, delay_ticks, channels: &[Channel]| LoopEdge { from, to, delay_ticks, channels: channels.to_vec() };
    let expected = [
        edge(1, 0, 10, &[topic("/back")]),
        edge(0, 1, 10, &[topic("/quick"), topic("/slow")]),
        edge(0, 2, 1, &[topic("/quick")]),
    ];
    assert_eq!(contract.edges, expected);
    assert_eq!(contract.edge_topic(&contract.edges[2]), format!("/_loop/run_{:x}/a/to/c", contract.run_id));
    assert_eq!((contract.node_index("/c"), contract.node_index("/d")), (Some(2), None));
}

#[test]
fn every_publisher_of_a_topic_is_heard_and_the_topic_is_shared() {
    let publisher = |name| node(name, |io| publishes(io, "x"));
    let alone = node("/c", |io| publishes(io, "y"));
    let sink = node("/d", |io| {
        hears(io, "x", Latency::Forward);
        hears(io, "y", Latency::Forward);
    });
    let contract = connect(&[publisher("/a"), publisher("/b"), alone, sink]).unwrap();
    let heard: Vec<_> = contract.edges.iter().map(|edge| (edge.from, edge.to, edge.channels.clone())).collect();
    assert_eq!(heard, [(0, 3, vec![topic("/x")]), (1, 3, vec![topic("/x")]), (2, 3, vec![topic("/y")])]);
    assert_eq!(contract.shared_topics, ["/x"]);
}

#[test]
fn every_client_of_a_service_gets_its_own_replies() {
    let client = |name, latency| {
        node(name, move |io| {
            calls::<Trigger>(io, "go", latency);
        })
    };
    let server = node("/s", |io| {
        serves::<Trigger>(io, "go");
    });
    let contract = connect(&[client("/a", Latency::Forward), server, client("/b", Latency::Feedback)]).unwrap();
    let (request, reply) = (Channel::Request("/go".into()), Channel::Reply("/go".into()));
    let edge =
        |from, to, delay_ticks, channel: &Channel| LoopEdge { from, to, delay_ticks, channels: vec![channel.clone()] };
    let expected = [edge(1, 0, 1, &reply), edge(0, 1, 1, &request), edge(2, 1, 10, &request), edge(1, 2, 1, &reply)];
    assert_eq!(contract.edges, expected);
    let engine = crate::lockstep::Engine::new(&contract, "/s").unwrap();
    let routes: Vec<_> = (0..2).map(|edge| engine.reply_route(&contract, edge, &reply)).collect();
    assert!(routes[0].is_some() && routes[1].is_some() && routes[0] != routes[1], "{routes:?}");
}

#[test]
fn a_contract_survives_its_file() {
    let publisher = node("/a", |io| publishes(io, "x"));
    let sink = node("/b", |io| hears(io, "x", Latency::Forward));
    let contract = connect(&[publisher, sink]).unwrap();
    let json = serde_json::to_vec(&contract).unwrap();
    assert_eq!(serde_json::from_slice::<LoopContract>(&json).unwrap(), contract);
}
