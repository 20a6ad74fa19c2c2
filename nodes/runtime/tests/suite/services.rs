//! Services over real DDS, between our own ends and with clients and servers of ros2-client, which
//! speaks both wire forms.

use std::collections::BTreeSet;
use std::net::Ipv4Addr;
use std::sync::mpsc;
use std::time::Duration;

use crate::common::{participant, wait_until};
use bytes::Bytes;
use feeder_runtime::{
    cdr,
    dds::{CallError, Client, Participant, Request, Server},
    testing::TestDomain,
};
use ros2_client::{
    Context, Message, Name, Node, NodeName, NodeOptions, ServiceMapping, ServiceTypeName,
    dds::rustdds::DomainParticipantBuilder, qos,
};
use serde::{Deserialize, Serialize};

const SERVICE: &str = "/test/add_two_ints";
const REQUEST: &str = "example_interfaces::srv::dds_::AddTwoInts_Request_";
const RESPONSE: &str = "example_interfaces::srv::dds_::AddTwoInts_Response_";
const PATIENCE: Duration = Duration::from_secs(20);

fn serve(participant: &Participant, deliver: impl FnMut(Request) + Send + 'static) -> Server {
    participant.server(SERVICE, REQUEST, RESPONSE, deliver).expect("a server")
}

fn client(participant: &Participant) -> Client {
    participant.client(SERVICE, REQUEST, RESPONSE).expect("a client")
}

fn add(request: Request) {
    match request.decode::<(i64, i64)>() {
        Ok((a, b)) => request.reply.send(cdr::encode(&(a + b)).expect("a number")),
        Err(error) => request.reply.refuse(&error),
    }
}

fn numbers(a: i64, b: i64) -> Bytes {
    cdr::encode(&(a, b)).expect("numbers")
}

#[test]
fn calls_made_before_the_server_came_are_answered() {
    let domain = TestDomain::claim();
    let asking = participant(&domain, "asking");
    let client = client(&asking);
    let calls: Vec<_> = (0..100).map(|a| client.call(numbers(a, 1), PATIENCE)).collect();
    assert!(!client.is_available());
    let answering = participant(&domain, "answering");
    let server = serve(&answering, add);
    for (a, call) in (0..).zip(calls) {
        assert_eq!(call.wait().expect("an answer").decode::<i64>().expect("a number"), a + 1);
    }
    assert!(client.is_available());
    let counts = server.counts();
    assert_eq!((counts.requests, counts.refused, counts.replies_lost), (100, 0, 0));
    drop(server);
    wait_until("the server is gone", || !client.is_available());
}

#[test]
fn requests_may_be_answered_later_in_any_order_from_any_thread() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let (sender, requests) = mpsc::channel();
    let _server = serve(&answering, move |request| {
        sender.send(request).expect("the test waits");
    });
    let client = client(&asking);
    let calls: Vec<_> = (0..10).map(|a| client.call(numbers(a, 0), PATIENCE)).collect();
    let mut kept: Vec<Request> = (0..10).map(|_| requests.recv_timeout(PATIENCE).expect("a request")).collect();
    kept.reverse();
    std::thread::spawn(move || kept.into_iter().for_each(add)).join().expect("no panic");
    for (a, call) in (0..).zip(calls) {
        assert_eq!(call.wait().expect("an answer").decode::<i64>().expect("a number"), a);
    }
}

#[test]
fn many_clients_get_their_own_answers() {
    let domain = TestDomain::claim();
    let answering = participant(&domain, "answering");
    let server = serve(&answering, add);
    let threads: Vec<_> = (0..4)
        .map(|number| {
            let domain = *domain;
            std::thread::spawn(move || {
                let asking = participant(&domain, &format!("asking_{number}"));
                let clients = [client(&asking), client(&asking)];
                for k in 0..100 {
                    for (which, client) in (0..).zip(&clients) {
                        let reply =
                            client.call(numbers(1_000 * number + k, which), PATIENCE).wait().expect("an answer");
                        assert_eq!(reply.decode::<i64>().expect("a number"), 1_000 * number + k + which);
                    }
                }
            })
        })
        .collect();
    threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
    assert_eq!((server.counts().requests, server.counts().refused), (800, 0));
}

#[test]
fn a_call_without_an_answer_ends_with_the_reason() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let alone = client(&asking);
    let timeout = Duration::from_millis(50);
    assert!(matches!(alone.call(numbers(1, 1), timeout).wait(), Err(CallError::Unavailable { .. })));

    let (sender, requests) = mpsc::channel();
    let server = serve(&answering, move |request| {
        sender.send(request).expect("the test waits");
    });
    wait_until("the server is there", || alone.is_available());
    assert!(matches!(alone.call(numbers(1, 1), Duration::from_secs(1)).wait(), Err(CallError::TimedOut { .. })));
    // Its answer comes too late and is dropped.
    add(requests.recv_timeout(PATIENCE).expect("a request"));

    let malformed = alone.call(Bytes::from_static(b"no numbers"), PATIENCE);
    add(requests.recv_timeout(PATIENCE).expect("a request"));
    assert_eq!(server.counts().refused, 1);
    drop(alone);
    assert!(matches!(malformed.wait(), Err(CallError::Closed { .. })));
}

#[test]
fn a_call_that_is_made_again_finds_the_server_that_took_anothers_place_and_ends_where_none_is() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "answering"));
    let client = client(&asking);
    // Longer than a server that was just found is given to find its client.
    let period = Duration::from_secs(1);
    let ask = || {
        let (sender, outcome) = mpsc::channel();
        client.call_again_with(numbers(40, 2), period, move |reply| sender.send(reply).expect("the test waits"));
        outcome
    };
    let (sender, requests) = mpsc::channel();
    let silent = serve(&answering, move |request| _ = sender.send(request));
    let outcome = ask();
    let first = requests.recv_timeout(PATIENCE).expect("a request");
    drop(requests.recv_timeout(PATIENCE).expect("the same once more"));
    assert!(outcome.try_recv().is_err(), "a server is there: it may answer yet");

    // Nobody tells the server after it what this one was asked.
    drop((first, requests, silent));
    let server = serve(&answering, add);
    let reply = outcome.recv_timeout(PATIENCE).expect("an end").expect("an answer");
    assert_eq!(reply.decode::<i64>().expect("a number"), 42);

    drop(server);
    wait_until("the server is gone", || !client.is_available());
    assert!(matches!(ask().recv_timeout(PATIENCE), Ok(Err(CallError::Unavailable { .. }))));
}

#[test]
fn a_reply_to_a_client_that_has_gone_is_counted() {
    let domain = TestDomain::claim();
    let answering = participant(&domain, "answering");
    let (sender, requests) = mpsc::channel();
    let server = serve(&answering, move |request| {
        sender.send(request).expect("the test waits");
    });
    let request = {
        let asking = participant(&domain, "asking");
        let client = client(&asking);
        let _call = client.call(numbers(1, 1), PATIENCE);
        requests.recv_timeout(PATIENCE).expect("a request")
    };
    wait_until("the client is gone", || server.clients() == 0);
    add(request);
    wait_until("the reply is given up", || server.counts().replies_lost == 1);
}

#[test]
fn waiting_on_the_dds_thread_is_refused() {
    let domain = TestDomain::claim();
    let asking = participant(&domain, "asking");
    let client = client(&asking);
    let (sender, outcome) = mpsc::channel();
    let inner = std::sync::Arc::new(client);
    let again = inner.clone();
    inner.call_with(numbers(1, 1), Duration::from_millis(1), move |_| {
        sender.send(again.call(numbers(1, 1), PATIENCE).wait()).expect("the test waits");
    });
    assert!(matches!(outcome.recv_timeout(PATIENCE), Ok(Err(CallError::WouldWaitForever { .. }))));
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Numbers {
    a: i64,
    b: i64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Sum {
    sum: i64,
}

impl Message for Numbers {}
impl Message for Sum {}

/// A node of ros2-client in a participant of its own.
fn foreign_node(domain: &TestDomain) -> Node {
    let participant = DomainParticipantBuilder::new(domain.id).with_only_networks([Ipv4Addr::LOCALHOST]).build();
    let context = Context::from_domain_participant(participant.expect("a participant")).expect("a context");
    let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
    context.new_node(NodeName::new("/test", "foreign").expect("a good name"), options).expect("a node")
}

fn foreign_names() -> (Name, ServiceTypeName, qos::QosProfile) {
    let profile = qos::QosProfile::publisher_default().history(qos::History::KeepLast { depth: 10 });
    (
        Name::new("/test", "add_two_ints").expect("a good name"),
        ServiceTypeName::new("example_interfaces", "AddTwoInts"),
        profile,
    )
}

#[test]
fn foreign_clients_of_both_wire_forms_are_answered() {
    let domain = TestDomain::claim();
    let answering = participant(&domain, "answering");
    let server = serve(&answering, add);
    for mapping in [ServiceMapping::Cyclone, ServiceMapping::Enhanced] {
        let mut node = foreign_node(&domain);
        let (name, types, profile) = foreign_names();
        let client =
            node.create_client::<Numbers, Sum>(mapping, &name, &types, profile.clone(), profile).expect("a client");
        // ros2-client sends whether or not a server has been found.
        wait_until("the foreign client has been found", || {
            let graph = answering.discovered();
            let names: BTreeSet<_> = graph.writers.iter().chain(&graph.readers).map(|e| e.topic.as_str()).collect();
            names.contains("rq/test/add_two_intsRequest") && names.contains("rr/test/add_two_intsReply")
        });
        std::thread::sleep(Duration::from_millis(500));
        for a in 0..5 {
            let call = client.async_call_service(Numbers { a, b: 40 });
            let sum = futures::executor::block_on(call).expect("an answer").sum;
            assert_eq!(sum, a + 40, "{mapping:?}");
        }
    }
    assert_eq!((server.counts().requests, server.counts().refused), (10, 0));
}
