//! The runtime's topics and services with Cyclone DDS on the same host.

use std::{
    process::{Child, Command, Stdio},
    sync::mpsc,
    time::Duration,
};

use crate::common::{python, wait_for};
use feeder_runtime::{
    cdr,
    dds::{DiscoveryRange, Domain, NodeName, Participant, Qos},
    testing::TestDomain,
};

const PATIENCE: Duration = Duration::from_secs(20);
const STRING: &str = "std_msgs::msg::dds_::String_";
const REQUEST: &str = "example_interfaces::srv::dds_::AddTwoInts_Request_";
const RESPONSE: &str = "example_interfaces::srv::dds_::AddTwoInts_Response_";

/// What rmw_cyclonedds configures for a discovery range of LOCALHOST.
const LOCALHOST: &str = "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General>\
     <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>\
     <Peers><Peer address=\"localhost\"/></Peers></Discovery></Domain></CycloneDDS>";

/// A peer under test, in a participant of its own.
fn participant(domain: &Domain, name: &str) -> Participant {
    let node = NodeName::new("/test", name).expect("a good name");
    Participant::open(domain, &node).expect("the domain can be joined")
}

/// How far both sides look for each other.
struct Setting {
    _claimed: TestDomain,
    domain: Domain,
    cyclone_uri: &'static str,
}

/// Both sides as ROS 2 has them without settings, and both on this host only.
fn settings() -> impl Iterator<Item = Setting> {
    [(DiscoveryRange::Subnet, ""), (DiscoveryRange::Localhost, LOCALHOST)].into_iter().map(|(range, cyclone_uri)| {
        let claimed = TestDomain::claim();
        Setting { domain: Domain { range, ..*claimed }, _claimed: claimed, cyclone_uri }
    })
}

fn peer(setting: &Setting, arguments: &[&str]) -> Child {
    Command::new(python())
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/interop/cyclone_peer.py"))
        .args(["--domain", &setting.domain.id.to_string()])
        .args(arguments)
        .env("CYCLONEDDS_URI", setting.cyclone_uri)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the peer starts")
}

/// Waits for a peer and returns what it has printed.
fn outcome(peer: Child) -> String {
    let output = peer.wait_with_output().expect("the peer ends");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "the peer saw too little: {printed:?}");
    printed
}

#[test]
fn cyclone_sees_our_node_its_topics_and_what_is_published() {
    for setting in settings() {
        let talker = participant(&setting.domain, "talker");
        let latched = talker.writer("/test/latched", STRING, &Qos::latched()).expect("a writer");
        latched.publish(cdr::encode(&"fact sheet").expect("text")).expect("room");
        let stream = talker.writer("/test/stream", STRING, &Qos::command()).expect("a writer");

        assert!(outcome(peer(&setting, &["nodes", "--node", "/test/talker"])).contains("/test/talker"));
        let topics = outcome(peer(&setting, &["topics", "--topic", "/test/stream"]));
        assert!(topics.contains("topic /test/stream type std_msgs::msg::dds_::String_"), "{topics}");
        let late = outcome(peer(&setting, &["subscribe", "--topic", "/test/latched", "--count", "1", "--latched"]));
        assert_eq!(late, "received fact sheet\n");

        let mut listener = peer(&setting, &["subscribe", "--topic", "/test/stream", "--count", "50"]);
        let mut number = 0;
        while listener.try_wait().expect("the peer runs").is_none() {
            let payload = cdr::encode(&u32::to_string(&number)).expect("text");
            // There is no room while the listener has been found but does not acknowledge yet.
            number += u32::from(stream.publish(payload).is_ok());
            std::thread::sleep(Duration::from_millis(2));
        }
        let printed = outcome(listener);
        let received: Vec<u32> =
            printed.lines().map(|line| line["received ".len()..].parse().expect("a number")).collect();
        // It begins wherever the listener came in, and then nothing is lost.
        let expected: Vec<u32> = (received[0]..).take(50).collect();
        assert_eq!(received, expected);
        wait_for("the listener to go", || (stream.matched_readers() == 0).then_some(()));
    }
}

#[test]
fn we_receive_what_cyclone_publishes() {
    for setting in settings() {
        let listener = participant(&setting.domain, "listener");
        let (sender, received) = mpsc::channel();
        let _reader = listener
            .reader("/test/stream", STRING, &Qos::command(), move |sample| {
                sender.send(sample.decode::<String>()).expect("the test waits");
            })
            .expect("a reader");
        let talker = peer(&setting, &["publish", "--topic", "/test/stream", "--count", "50"]);
        for number in 0..50 {
            let text = received.recv_timeout(PATIENCE).expect("nothing is lost").expect("text");
            assert_eq!(text, number.to_string());
        }
        outcome(talker);
    }
}

#[test]
fn a_cyclone_client_is_answered_in_its_own_wire_form() {
    for setting in settings() {
        let answering = participant(&setting.domain, "answering");
        let server = answering
            .server("/test/add_two_ints", REQUEST, RESPONSE, |request| match request.decode::<(i64, i64)>() {
                Ok((a, b)) => request.reply.send(cdr::encode(&(a + b)).expect("a number")),
                Err(error) => request.reply.refuse(&error),
            })
            .expect("a server");
        let clients: Vec<_> =
            (0..3).map(|_| peer(&setting, &["call", "--service", "/test/add_two_ints", "--count", "20"])).collect();
        for client in clients {
            let printed = outcome(client);
            assert_eq!(printed.lines().count(), 20);
        }
        let counts = server.counts();
        assert_eq!((counts.requests, counts.refused), (60, 0));
    }
}

#[test]
fn a_cyclone_server_answers_our_client() {
    for setting in settings() {
        let asking = participant(&setting.domain, "asking");
        let client = asking.client("/test/add_two_ints", REQUEST, RESPONSE).expect("a client");
        let server = peer(&setting, &["serve", "--service", "/test/add_two_ints", "--count", "20"]);
        for a in 0..20 {
            let reply = client.call(cdr::encode(&(a, 40i64)).expect("numbers"), PATIENCE).wait().expect("an answer");
            assert_eq!(reply.decode::<i64>().expect("a number"), a + 40);
        }
        outcome(server);
    }
}

/// The golden samples were written by rosbags; Cyclone must read them and write the same bytes again.
#[test]
fn cyclone_encodes_every_message_as_the_golden_samples_say() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/interop/golden_cdr.py");
    let checked = Command::new(python()).arg(script).output().expect("the check runs");
    let printed = [checked.stdout, checked.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert!(checked.status.success() && printed.contains(" types, 0 wrong"), "{printed}");
}
