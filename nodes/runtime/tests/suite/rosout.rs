//! The log on `/rosout`.

use std::sync::{Arc, mpsc};
use std::time::Duration;

use crate::common::{participant, wait_until};
use feeder_runtime::{dds::Qos, rosout::RosoutLayer, testing::TestDomain};
use minifactory_msgs::{Message, builtin_interfaces::msg::Time, rcl_interfaces::msg::Log};
use tracing_subscriber::{Registry, layer::SubscriberExt};

const PATIENCE: Duration = Duration::from_secs(20);

#[test]
fn messages_are_sent_for_the_node_they_belong_to() {
    let domain = TestDomain::claim();
    let (first, second) = (participant(&domain, "first"), participant(&domain, "second"));
    let layer = RosoutLayer::new();
    let stamp = |sec| Arc::new(move || Time { sec, nanosec: 0 });
    let rosout =
        [layer.attach(&first, stamp(1)).expect("a writer"), layer.attach(&second, stamp(2)).expect("a writer")];
    tracing::subscriber::with_default(Registry::default().with(layer), || {
        tracing::warn!(part = 3, "no part on the plateau");
        let span = tracing::info_span!("run", node = %second.node());
        span.in_scope(|| tracing::error!("stopped"));
        tracing::error!(target: "rustdds::rtps", "would never end");
        tracing::info!("the end");
    });

    // Latched: a late listener hears of it too.
    let listening = participant(&domain, "listening");
    let (sender, received) = mpsc::channel::<Log>();
    let deliver = move |sample: feeder_runtime::dds::Sample| {
        sender.send(sample.decode().expect("a log message")).expect("the test waits");
    };
    let _reader =
        listening.reader("/rosout", &<Log as Message>::INFO.dds_type(), &Qos::latched(), deliver).expect("a reader");
    let mut heard: Vec<_> = (0..3)
        .map(|_| received.recv_timeout(PATIENCE).expect("three messages"))
        .map(|log| (log.name, log.level, log.msg, log.stamp.sec))
        .collect();
    heard.sort();
    let expected = [
        ("test.first", Log::INFO, "the end", 1),
        ("test.first", Log::WARN, "no part on the plateau (part 3)", 1),
        ("test.second", Log::ERROR, "stopped", 2),
    ];
    let expected = expected.map(|(name, level, text, sec)| (name.to_owned(), level, text.to_owned(), sec));
    assert_eq!(heard, expected);
    assert_eq!(rosout.map(|rosout| rosout.dropped()), [0, 0]);
}

#[test]
fn a_flood_is_bounded_and_counted() {
    let domain = TestDomain::claim();
    let node = participant(&domain, "node");
    let layer = RosoutLayer::new();
    let rosout = layer.attach(&node, Arc::new(Time::default)).expect("a writer");
    // A function that does not return keeps the participant's thread from publishing.
    let (hold, held) = mpsc::channel::<()>();
    let client = node.client("/test/nothing", "a", "b").expect("a client");
    client.call_with(bytes::Bytes::new(), Duration::ZERO, move |_| {
        // Ends when the test lets go.
        let _ = held.recv();
    });
    tracing::subscriber::with_default(Registry::default().with(layer), || {
        wait_until("messages are dropped", || {
            tracing::info!("once more");
            rosout.dropped() > 0
        });
    });
    drop(hold);
}
