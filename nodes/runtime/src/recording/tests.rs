//! What a recorder gets of what nodes publish, and what happens when either end is slow or gone.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use proptest::prelude::*;

use super::listener::clock_name;
use super::*;
use crate::lockstep::{LoopContract, LoopTiming};

const PATIENCE: Duration = Duration::from_secs(20);

fn contract() -> LoopContract {
    let timing = LoopTiming { tick_ns: 1, forward_delay_ticks: 1, feedback_delay_ticks: 2, window_ticks: 8 };
    let nodes = ["/a", "/b"].map(|name| (name.to_owned(), Interface::default()));
    LoopContract::connect(7, timing, &nodes).unwrap()
}

fn interface(topics: &[&str]) -> Interface {
    let port = |name: &&str| Port {
        kind: PortKind::Publish,
        name: (*name).to_owned(),
        ros_type: "std_msgs/msg/String".to_owned(),
        dds_types: Vec::new(),
        qos: Qos::command(),
    };
    Interface { ports: topics.iter().map(port).collect() }
}

struct Setup {
    listener: RunListener,
    socket: PathBuf,
    _work: tempfile::TempDir,
}

fn listen(wanted: impl Fn(&RunTopic) -> bool + Send + 'static) -> Setup {
    let work = tempfile::tempdir().unwrap();
    let socket = work.path().join("socket");
    Setup { listener: RunListener::bind(&socket, &contract(), wanted).unwrap(), socket, _work: work }
}

impl Setup {
    fn tap(&self, node: &str, topics: &[&str]) -> io::Result<Tap> {
        Tap::open(&self.socket, 7, node, &interface(topics))
    }

    /// The messages until the end, as (topic, tick, payload).
    fn messages(&self) -> Vec<(String, u64, Vec<u8>)> {
        let mut messages = Vec::new();
        loop {
            match self.listener.next(PATIENCE) {
                RunEvent::Message { topic, tick, payload } => {
                    messages.push((topic.to_string(), tick, payload.to_vec()));
                }
                RunEvent::Topic(_) => {}
                RunEvent::Idle => panic!("nothing was heard"),
                RunEvent::End => return messages,
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    /// Whoever is faster: ticks, then nodes in order of the contract, then the order of each node.
    #[test]
    fn streams_are_merged_by_tick_then_node(
        ticks in prop::collection::vec(prop::collection::vec(0_u64..20, 0..12), 3),
        order in Just([0_usize, 1, 2]).prop_shuffle(),
    ) {
        let nodes = ["/a", "/b", &clock_name()];
        let setup = listen(|_| true);
        let mut expected: BTreeMap<(u64, usize), Vec<usize>> = BTreeMap::new();
        for at in order {
            let mut ticks = ticks[at].clone();
            ticks.sort_unstable();
            let mut tap = setup.tap(nodes[at], &["/x"]).unwrap();
            for (index, tick) in ticks.into_iter().enumerate() {
                tap.complete_until(tick).unwrap();
                tap.add(0, tick, &[u8::try_from(at).unwrap(), u8::try_from(index).unwrap()]).unwrap();
                expected.entry((tick, at)).or_default().push(index);
            }
            tap.finish().unwrap();
        }
        let heard: Vec<(u64, usize, usize)> = setup.messages().into_iter()
            .map(|(_, tick, payload)| (tick, usize::from(payload[0]), usize::from(payload[1]))).collect();
        let expected: Vec<(u64, usize, usize)> = expected.into_iter()
            .flat_map(|((tick, at), indices)| indices.into_iter().map(move |index| (tick, at, index))).collect();
        prop_assert_eq!(heard, expected);
    }
}

#[test]
fn what_is_not_wanted_is_not_handed_over_and_what_no_digest_covers_is_not_offered() {
    let setup = listen(|topic| topic.name != "/b");
    let mut tap = setup.tap("/a", &["/rosout", "/x", "/b", "/a/_action/status"]).unwrap();
    assert_eq!([0, 1, 2, 3].map(|port| tap.wants(port)), [false, true, false, false]);
    for port in 0..4 {
        tap.add(port, 0, b"1").unwrap();
    }
    tap.finish().unwrap();
    for node in ["/b", &clock_name()] {
        setup.tap(node, &[]).unwrap().finish().unwrap();
    }
    assert_eq!(setup.messages(), [("/x".to_owned(), 0, b"1".to_vec())]);
}

/// A slow recorder holds the nodes back instead of filling the memory.
#[test]
fn a_node_waits_while_the_recorder_is_behind() {
    let setup = listen(|_| true);
    for node in ["/b", &clock_name()] {
        setup.tap(node, &[]).unwrap().finish().unwrap();
    }
    let mut tap = setup.tap("/a", &["/x"]).unwrap();
    let (payload, count) = (vec![1; 1 << 20], 100_u64);
    std::thread::scope(|scope| {
        let publisher = scope.spawn(|| {
            for tick in 0..count {
                tap.add(0, tick, &payload).unwrap();
                tap.complete_until(tick + 1).unwrap();
            }
            tap.finish().unwrap();
        });
        // 100 MiB do not fit: the node cannot be at its end before anything is taken.
        let full = || {
            let merge = setup.listener.next(PATIENCE);
            assert!(!publisher.is_finished());
            merge
        };
        assert!(matches!(full(), RunEvent::Topic(_)));
        assert_eq!(setup.messages().len() as u64, count);
    });
}

#[test]
fn a_listener_that_is_gone_and_a_node_of_another_run_get_errors() {
    let setup = listen(|_| true);
    assert!(Tap::open(&setup.socket, 8, "/a", &interface(&["/x"])).is_err());
    assert!(setup.tap("/stranger", &["/x"]).is_err());
    let mut tap = setup.tap("/a", &["/x"]).unwrap();
    drop(setup.listener);
    let payload = vec![0; 1 << 20];
    // On a busy machine the listener's thread takes what comes for a while before it is gone.
    let gives_up = Instant::now() + PATIENCE;
    let refused = (0_u64..).find(|&tick| tap.add(0, tick, &payload).is_err() || Instant::now() > gives_up);
    assert!(Instant::now() < gives_up, "the listener still took message {refused:?}");
}

/// The messages of a node that dies are kept, and nobody waits for it.
#[test]
fn a_stream_that_breaks_is_over() {
    let setup = listen(|_| true);
    for node in ["/b", &clock_name()] {
        setup.tap(node, &[]).unwrap().finish().unwrap();
    }
    let mut tap = setup.tap("/a", &["/x"]).unwrap();
    tap.add(0, 3, b"1").unwrap();
    tap.flush().unwrap();
    drop(tap);
    assert_eq!(setup.messages(), [("/x".to_owned(), 3, b"1".to_vec())]);
}
