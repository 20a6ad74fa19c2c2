//! Topics between two participants over real DDS.

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::mpsc;
use std::time::Duration;

use crate::common::{participant, secluded, wait_until};
use bytes::Bytes;
use feeder_runtime::{
    cdr,
    dds::{DiscoveryRange, Domain, Graph, PublishError, Qos, Sample},
    testing::TestDomain,
};

const TYPE: &str = "test_msgs::msg::dds_::Numbered_";
const PATIENCE: Duration = Duration::from_secs(20);

fn body(number: u64, bytes: usize) -> Bytes {
    let mut body = number.to_le_bytes().to_vec();
    body.resize(bytes, number.to_le_bytes()[0]);
    body.into()
}

fn number(sample: &Sample) -> u64 {
    u64::from_le_bytes(sample.payload[..8].try_into().expect("eight bytes"))
}

/// A reliable reader acknowledges what its thread has not drained yet, so nothing but the publisher
/// keeps it from overflowing: with no more in flight than the reader's backlog, nothing is lost,
/// however the threads are scheduled.
#[test]
fn ten_thousand_reliable_samples_all_arrive_in_order() {
    const COUNT: u64 = 10_000;
    let in_flight_max = u64::from(Qos::loop_edge().backlog);
    let domain = TestDomain::claim();
    let (talker, listener) = (participant(&domain, "talker"), participant(&domain, "listener"));
    let (sender, received) = mpsc::channel();
    let reader = listener
        .reader("/test/stream", TYPE, &Qos::loop_edge(), move |sample| {
            sender.send(sample).expect("the test waits");
        })
        .expect("a reader");
    let writer = talker.writer("/test/stream", TYPE, &Qos::loop_edge()).expect("a writer");
    wait_until("both have matched", || writer.matched_readers() == 1 && reader.matched_writers() == 1);

    let mut expected = 0;
    let mut take = || {
        let sample = received.recv_timeout(PATIENCE).expect("no sample is lost");
        assert_eq!((number(&sample), sample.payload.len()), (expected, 3_000));
        assert_eq!(sample.payload[2_999], expected.to_le_bytes()[0]);
        assert_eq!((sample.writer_guid, sample.little_endian), (writer.guid(), true));
        assert!(sample.source_timestamp.is_some() && sample.related.is_none());
        expected += 1;
    };
    for number in 0..COUNT {
        if number >= in_flight_max {
            take();
        }
        let mut payload = body(number, 3_000);
        while let Err(error) = writer.publish(payload) {
            let PublishError::Full { payload: returned, .. } = error else { panic!("{error}") };
            payload = returned;
            std::thread::yield_now();
        }
    }
    (0..in_flight_max).for_each(|_| take());
    assert_eq!(reader.refused(), 0);
}

#[test]
fn a_body_of_the_largest_unfragmented_size_and_one_beyond_arrive() {
    let domain = TestDomain::claim();
    let (talker, listener) = (participant(&domain, "talker"), participant(&domain, "listener"));
    let (sender, received) = mpsc::channel();
    let _reader = listener
        .reader("/test/large", TYPE, &Qos::command(), move |sample| {
            sender.send(sample).expect("the test waits");
        })
        .expect("a reader");
    let writer = talker.writer("/test/large", TYPE, &Qos::command()).expect("a writer");
    wait_until("matched", || writer.matched_readers() == 1);
    for bytes in [feeder_runtime::dds::BODY_BYTES_MAX_IN_ONE_DATAGRAM, 300_000] {
        writer.publish(body(7, bytes)).expect("room");
        assert_eq!(received.recv_timeout(PATIENCE).expect("it arrives").payload, body(7, bytes));
    }
}

#[test]
fn a_late_reader_gets_what_is_latched_and_only_that() {
    let domain = TestDomain::claim();
    let talker = participant(&domain, "talker");
    let latched = talker.writer("/test/latched", TYPE, &Qos::latched()).expect("a writer");
    let volatile = talker.writer("/test/volatile", TYPE, &Qos::command()).expect("a writer");
    latched.publish(cdr::encode(&"fact sheet").expect("text")).expect("room");
    volatile.publish(cdr::encode(&"gone").expect("text")).expect("room");

    let late = participant(&domain, "late");
    let (sender, received) = mpsc::channel::<String>();
    let deliver = |sender: mpsc::Sender<String>| {
        move |sample: Sample| {
            sender.send(sample.decode().expect("text")).expect("the test waits");
        }
    };
    let _latched = late.reader("/test/latched", TYPE, &Qos::latched(), deliver(sender.clone())).expect("a reader");
    let _volatile = late.reader("/test/volatile", TYPE, &Qos::command(), deliver(sender)).expect("a reader");
    assert_eq!(received.recv_timeout(PATIENCE).expect("the latched one"), "fact sheet");
    wait_until("the volatile one has matched", || volatile.matched_readers() == 1);
    volatile.publish(cdr::encode(&"new").expect("text")).expect("room");
    assert_eq!(received.recv_timeout(PATIENCE).expect("the new one"), "new");
}

#[test]
fn a_reader_that_asks_for_more_than_is_offered_is_not_matched() {
    let domain = TestDomain::claim();
    let (talker, listener) = (participant(&domain, "talker"), participant(&domain, "listener"));
    let writer = talker.writer("/test/frames", TYPE, &Qos::sensor()).expect("a writer");
    let greedy = listener.reader("/test/frames", TYPE, &Qos::command(), |_| ()).expect("a reader");
    let modest = listener.reader("/test/frames", TYPE, &Qos::sensor(), |_| ()).expect("a reader");
    wait_until("the modest one has matched", || modest.matched_writers() == 1 && writer.matched_readers() == 1);
    assert_eq!(greedy.matched_writers(), 0);
}

#[test]
fn a_writer_counts_many_readers_that_come_and_go_at_once() {
    // More than the eight matches the DDS library queues before it drops them.
    const READERS: usize = 30;
    let domain = TestDomain::claim();
    let talker = participant(&domain, "talker");
    let listener = participant(&domain, "listener");
    let readers: Vec<_> = (0..READERS)
        .map(|_| listener.reader("/test/crowd", TYPE, &Qos::command(), |_| ()).expect("a reader"))
        .collect();
    let writer = talker.writer("/test/crowd", TYPE, &Qos::command()).expect("a writer");
    wait_until("all have matched", || writer.matched_readers() == READERS);
    drop(readers);
    wait_until("all have gone", || writer.matched_readers() == 0);
}

#[test]
fn a_dropped_participant_leaves_no_ghost() {
    let claimed = TestDomain::claim();
    for range in [DiscoveryRange::Localhost, DiscoveryRange::Subnet] {
        leave(&Domain { range, ..*claimed });
    }
}

fn leave(domain: &Domain) {
    let (stays, leaves) = (participant(domain, "stays"), participant(domain, "leaves"));
    // What one has oneself is not discovered, however far discovery reaches.
    let _own =
        (stays.reader("/test/in", TYPE, &Qos::command(), |_| ()), stays.writer("/test/out", TYPE, &Qos::command()));
    let reader = leaves.reader("/test/in", TYPE, &Qos::command(), |_| ()).expect("a reader");
    let writer = leaves.writer("/test/out", TYPE, &Qos::command()).expect("a writer");
    wait_until("everything is found", || {
        let graph = stays.discovered();
        graph.has_node("/test/leaves")
            && graph.readers_of("/test/in").count() == 1
            && graph.writers_of("/test/out").any(|endpoint| endpoint.guid == writer.guid())
    });
    // Handles keep the participant alive, whatever the order they go in.
    drop(leaves);
    drop(reader);
    wait_until("the reader is gone", || stays.discovered().readers_of("/test/in").count() == 0);
    assert!(stays.discovered().has_node("/test/leaves"));
    drop(writer);
    // A lease would take most of a minute, longer than this waits.
    wait_until("nothing is left", || stays.discovered() == Graph::default());
}

#[test]
fn a_dropped_reader_has_let_go_of_its_function() {
    let domain = TestDomain::claim();
    let listener = participant(&domain, "listener");
    let (sender, receiver) = mpsc::channel::<()>();
    let reader = listener
        .reader("/test/owned", TYPE, &Qos::command(), move |_| {
            sender.send(()).expect("the test waits");
        })
        .expect("a reader");
    assert_eq!(receiver.try_recv(), Err(mpsc::TryRecvError::Empty));
    drop(reader);
    assert_eq!(receiver.try_recv(), Err(mpsc::TryRecvError::Disconnected));
}

#[test]
fn a_stopped_reliable_reader_fills_the_writer_and_the_body_comes_back() {
    let domain = TestDomain::claim();
    let (talker, listener) = (participant(&domain, "talker"), participant(&domain, "listener"));
    let reader = listener.reader("/test/full", TYPE, &Qos::command(), |_| ()).expect("a reader");
    let writer = talker.writer("/test/full", TYPE, &Qos::command()).expect("a writer");
    wait_until("matched", || writer.matched_readers() == 1);
    // Published faster than anything can be acknowledged, sooner or later there is no room.
    let refused = (0..1_000_000).find_map(|number| writer.publish(body(number, 8)).err());
    let Some(PublishError::Full { topic, payload, .. }) = refused else { panic!("never full: {refused:?}") };
    assert_eq!((topic.as_str(), payload.len()), ("rt/test/full", 8));
    drop(reader);
    wait_until("without the reader there is room again", || writer.publish(body(0, 8)).is_ok());
}

/// The DDS library locks up where endpoints are made while many others are found; see `dds/door.rs`.
#[test]
fn participants_that_come_up_all_at_once_find_each_other() {
    const PARTICIPANTS: usize = 8;
    const TOPICS: usize = 8;
    let claimed = TestDomain::claim();
    let domain = Domain { range: DiscoveryRange::Subnet, ..*claimed };
    let (sender, came) = mpsc::channel();
    for number in 0..PARTICIPANTS {
        let sender = sender.clone();
        // Not joined: one that is locked up never ends.
        std::thread::spawn(move || {
            let peer = secluded(&domain, &format!("peer_{number}"));
            let topics: Vec<_> = (0..TOPICS).map(|topic| format!("/test/topic_{topic}")).collect();
            let readers: Vec<_> =
                topics.iter().map(|topic| peer.reader(topic, TYPE, &Qos::command(), |_| ())).collect();
            let writers: Vec<_> = topics.iter().map(|topic| peer.writer(topic, TYPE, &Qos::command())).collect();
            peer.meet_others();
            sender.send((readers, writers)).expect("the test waits");
        });
    }
    let all: Vec<_> = (0..PARTICIPANTS).map(|_| came.recv_timeout(PATIENCE).expect("nobody is locked up")).collect();
    for (readers, writers) in &all {
        let others = PARTICIPANTS - 1;
        wait_until("all writers are found", || {
            readers.iter().flatten().filter(|reader| reader.matched_writers() >= others).count() == TOPICS
        });
        wait_until("all readers are found", || {
            writers.iter().flatten().filter(|writer| writer.matched_readers() >= others).count() == TOPICS
        });
    }
}

#[test]
fn a_secluded_participant_is_met_when_it_says_so_however_late_that_is() {
    /// Where another participant of this host might listen: the last one of those that the DDS library tells itself.
    const PLACE: u16 = 11;
    for range in [DiscoveryRange::Localhost, DiscoveryRange::Subnet] {
        let claimed = TestDomain::claim();
        let domain = Domain { range, ..*claimed };
        let place = UdpSocket::bind((Ipv4Addr::LOCALHOST, 7410 + 250 * domain.id + 2 * PLACE)).expect("a free port");
        place.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let mut announcements = std::iter::repeat_with(|| {
            let mut message = [0; 1024];
            place.recv(&mut message).expect("announcements");
            // Of whom, and whether of its presence.
            (message[8..20].to_vec(), message[21] & 4 != 0)
        });
        let (early, late) = (participant(&domain, "early"), secluded(&domain, "late"));
        let writer = late.writer("/test/late", TYPE, &Qos::command()).expect("a writer");
        let guid = writer.guid().participant().to_vec();
        assert!(announcements.any(|heard| heard == (guid.clone(), true)), "the library announces it all the same");
        assert_eq!(late.discovered(), Graph::default(), "{range:?}");
        late.meet_others();
        wait_until("they are met", || late.discovered().has_node("/test/early"));
        wait_until("they are met", || early.discovered().has_node("/test/late"));
        // As the answers were over, somebody whom nobody has seen has asked for them, and has left again.
        let stranger = [&guid[..2], &guid[2..].iter().map(|byte| !byte).collect::<Vec<_>>()].concat();
        for is_here in [true, false] {
            assert!(announcements.any(|heard| heard == (stranger.clone(), is_here)));
        }
    }
}

/// RustDDS announces a participant to the first 12 of the host.
#[test]
fn on_this_host_alone_more_than_twelve_find_each_other() {
    const PARTICIPANTS: usize = 15;
    let domain = TestDomain::claim();
    let all: Vec<_> = (0..PARTICIPANTS).map(|number| participant(&domain, &format!("peer_{number}"))).collect();
    wait_until("all nodes are found", || all.iter().all(|peer| peer.discovered().nodes.len() == PARTICIPANTS - 1));
}

#[test]
fn nobody_is_found_with_discovery_off() {
    let domain = TestDomain::claim();
    let off = Domain { range: DiscoveryRange::Off, ..*domain };
    let wide = Domain { range: DiscoveryRange::Subnet, ..*domain };
    let alone = [participant(&off, "alone"), participant(&off, "alone_too")];
    // These meet meanwhile.
    let (a, b) = (participant(&domain, "a"), participant(&wide, "b"));
    wait_until("the others find each other", || {
        a.discovered().has_node("/test/b") && b.discovered().has_node("/test/a")
    });
    for other in [&a, &b] {
        assert_eq!(other.discovered().nodes.len(), 1);
    }
    for alone in &alone {
        assert_eq!(alone.discovered(), Graph::default());
    }
}

#[test]
fn on_one_host_those_who_look_further_are_heard_by_those_who_do_not() {
    let narrow = TestDomain::claim();
    let wide = Domain { range: DiscoveryRange::Subnet, ..*narrow };
    for (talks, listens) in [(&*narrow, &wide), (&wide, &*narrow)] {
        let (talker, listener) = (participant(talks, "talker"), participant(listens, "listener"));
        let (sender, received) = mpsc::channel();
        let reader = listener.reader("/test/word", TYPE, &Qos::latched(), move |sample| {
            sender.send(number(&sample)).expect("the test waits");
        });
        let _reader = reader.expect("a reader");
        let writer = talker.writer("/test/word", TYPE, &Qos::latched()).expect("a writer");
        writer.publish(body(7, 8)).expect("room");
        assert_eq!(received.recv_timeout(PATIENCE), Ok(7), "{:?} to {:?}", talks.range, listens.range);
    }
}

#[test]
fn a_domain_beyond_the_last_port_is_refused() {
    let node = feeder_runtime::dds::NodeName::new("/test", "far").expect("a good name");
    let domain = Domain { id: Domain::ID_MAX + 1, ..*TestDomain::claim() };
    let error = feeder_runtime::dds::Participant::open(&domain, &node).expect_err("no such ports");
    assert!(error.to_string().contains("233"), "{error}");
}

#[test]
fn handles_may_be_shared_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<feeder_runtime::dds::Participant>();
    shared::<feeder_runtime::dds::Reader>();
    shared::<feeder_runtime::dds::Writer>();
}
