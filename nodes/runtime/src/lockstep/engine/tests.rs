//! The engine in a network that delays and mixes what is sent: every node sees the same.

use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::cdr;
use crate::lockstep::{LoopClock, LoopEdge, LoopTiming, MESSAGE_BYTES_MAX, Speed};
use minifactory_msgs::msg::LoopStatus;

const RUN: u64 = 7;
/// Unread samples a DDS reader holds, less a margin; the contract promises no more ticks than that.
const UNREAD_MAX: usize = 56;
/// Largest UDP payload, less what RTPS puts before a sample.
const DATAGRAM_BYTES_MAX: usize = 65_507 - 200;

/// One message as its consumer sees it: publisher, port, payload.
type Seen = (usize, u16, Vec<u8>);

fn contract(nodes: usize, edges: Vec<LoopEdge>, window_ticks: u64) -> LoopContract {
    let timing = LoopTiming { tick_ns: 10_000_000, forward_delay_ticks: 1, feedback_delay_ticks: 1, window_ticks };
    let nodes = (0..nodes).map(|node| format!("/n{node}")).collect();
    LoopContract { run_id: RUN, timing, nodes, edges, shared_topics: Vec::new(), patience_s: 3 }
}

fn edge(from: usize, to: usize, delay_ticks: u64, ports: usize) -> LoopEdge {
    let channels = (0..ports).map(|port| Channel::Topic(format!("/t{from}_{to}_{port}"))).collect();
    LoopEdge { from, to, delay_ticks, channels }
}

/// 3 to 6 nodes with any edges among them.
fn contracts() -> impl Strategy<Value = LoopContract> {
    (3_usize..=6).prop_flat_map(|nodes| {
        let pairs = (0..nodes).flat_map(|to| (0..nodes).filter(move |from| *from != to).map(move |from| (from, to)));
        let edges: Vec<_> = pairs
            .map(|(from, to)| {
                prop::option::weighted(
                    0.5,
                    (1_u64..=12, 1_usize..=3).prop_map(move |(d, ports)| edge(from, to, d, ports)),
                )
            })
            .collect();
        (edges, 1_u64..=44)
            .prop_map(move |(edges, window)| contract(nodes, edges.into_iter().flatten().collect(), window))
    })
}

/// What a node does: what it sends depends on everything it has seen, so that one wrong input spoils all that follows.
struct Toy {
    state: u64,
    rate: f64,
    bytes_max: usize,
    seen: Vec<(u64, Vec<Seen>)>,
}

impl Toy {
    fn new(node: usize, rate: f64, bytes_max: usize) -> Self {
        Self { state: node as u64 + 1, rate, bytes_max, seen: Vec::new() }
    }

    /// Takes the inputs of `tick` and says what goes out on each (edge, port) of `outs`.
    fn step(&mut self, tick: u64, inputs: Vec<Seen>, outs: &[(usize, usize)]) -> Vec<(usize, u16, Vec<u8>)> {
        for (from, port, payload) in &inputs {
            for byte in payload.iter().copied().chain([u8::try_from(*from).unwrap(), u8::try_from(*port).unwrap()]) {
                self.state = self.state.wrapping_mul(0x0100_0000_01b3) ^ u64::from(byte);
            }
        }
        self.seen.push((tick, inputs));
        let mut random = Pcg64Mcg::seed_from_u64(self.state ^ tick.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut sent = Vec::new();
        for &(edge, ports) in outs {
            while random.random_bool(self.rate) {
                let port = u16::try_from(random.random_range(0..ports)).unwrap();
                let mut payload = self.state.to_le_bytes().to_vec();
                payload.resize(8 + random.random_range(0..=self.bytes_max), 0x55);
                sent.push((edge, port, payload));
            }
        }
        sent
    }
}

/// Contract index and number of ports of each edge that leaves `node`.
fn outs(contract: &LoopContract, node: usize) -> Vec<(usize, usize)> {
    let edges = contract.edges.iter().enumerate();
    edges.filter(|(_, edge)| edge.from == node).map(|(index, edge)| (index, edge.channels.len())).collect()
}

/// What every node must see, by the book: sent in tick k, consumed in tick k + d, ordered by publisher, tick, sequence.
fn reference(contract: &LoopContract, mut toys: Vec<Toy>, ticks: u64) -> Vec<Vec<(u64, Vec<Seen>)>> {
    let mut sent: Vec<(usize, u64, usize, u16, Vec<u8>)> = Vec::new();
    for tick in 0..ticks {
        for (node, toy) in toys.iter_mut().enumerate() {
            let mut due: Vec<_> = sent
                .iter()
                .filter(|(edge, sent_in, ..)| {
                    contract.edges[*edge].to == node && sent_in + contract.edges[*edge].delay_ticks == tick
                })
                .collect();
            due.sort_by_key(|(edge, sent_in, sequence, ..)| (contract.edges[*edge].from, *sent_in, *sequence));
            let inputs =
                due.into_iter().map(|(edge, _, _, port, payload)| (contract.edges[*edge].from, *port, payload.clone()));
            let inputs = inputs.collect();
            for (edge, port, payload) in toy.step(tick, inputs, &outs(contract, node)) {
                sent.push((edge, tick, sent.len(), port, payload));
            }
        }
    }
    toys.into_iter().map(|toy| toy.seen).collect()
}

/// All engines in one thread, with everything that is left to chance in a real run drawn from a generator.
struct Simulation {
    contract: LoopContract,
    engines: Vec<Engine>,
    toys: Vec<Toy>,
    clock: LoopClock,
    grants: Vec<VecDeque<LoopGrant>>,
    transit: Vec<VecDeque<LoopBundle>>,
    /// Until which tick each bundle goes that its consumer may not have read: of each edge.
    unread: Vec<VecDeque<u64>>,
    ticks: u64,
    random: Pcg64Mcg,
    largest_bundle: usize,
    most_unread: usize,
}

impl Simulation {
    fn new(contract: LoopContract, toys: Vec<Toy>, ticks: u64, seed: u64) -> Self {
        let engines = contract.nodes.iter().map(|node| Engine::new(&contract, node).unwrap()).collect();
        let mut clock = LoopClock::new(contract.clone(), Speed::Max, ticks, std::time::Duration::from_secs(1));
        for node in &contract.nodes {
            clock.accept(&status(node, 0), std::time::Duration::ZERO).unwrap();
        }
        Self {
            engines,
            toys,
            clock,
            grants: vec![VecDeque::new(); contract.nodes.len()],
            transit: vec![VecDeque::new(); contract.edges.len()],
            unread: vec![VecDeque::new(); contract.edges.len()],
            ticks,
            random: Pcg64Mcg::seed_from_u64(seed),
            largest_bundle: 0,
            most_unread: 0,
            contract,
        }
    }

    fn run(&mut self) {
        let mut since_step = 0;
        while self.engines.iter().any(|engine| engine.next_tick() < self.ticks) {
            let node = self.random.random_range(0..self.engines.len());
            since_step += 1;
            match self.random.random_range(0..5) {
                0 => self.deliver_some(),
                1 => self.flush(node),
                2 => self.tell_clock(node),
                3 => {
                    if let Some(grant) = self.grants[node].pop_front() {
                        self.engines[node].accept_grant(&grant);
                    }
                }
                _ if self.engines[node].blocked().is_none() => {
                    self.step(node);
                    since_step = 0;
                }
                _ => {}
            }
            if since_step > 2_000 {
                self.deliver_everything();
                let stuck = self.engines.iter().all(|engine| engine.blocked().is_some());
                assert!(!stuck, "deadlock: {:?}", self.engines.iter().map(Engine::blocked).collect::<Vec<_>>());
                since_step = 0;
            }
        }
    }

    fn step(&mut self, node: usize) {
        let engine = &mut self.engines[node];
        let tick = engine.next_tick();
        let froms: Vec<usize> = engine.in_edges().map(|(index, _)| self.contract.edges[index].from).collect();
        let inputs = engine.inputs().into_iter().map(|input| (froms[input.edge], input.port, input.payload.to_vec()));
        let sent = self.toys[node].step(tick, inputs.collect(), &outs(&self.contract, node));
        for (edge, port, payload) in sent {
            let channel = &self.contract.edges[edge].channels[usize::from(port)];
            for route in engine.routes(channel) {
                engine.send(route, &payload).unwrap();
            }
        }
        engine.finish_tick();
        for (index, edge) in self.contract.edges.iter().enumerate().filter(|(_, edge)| edge.to == node) {
            while self.unread[index].front().is_some_and(|until| until + edge.delay_ticks <= tick + 1) {
                self.unread[index].pop_front();
            }
        }
    }

    fn flush(&mut self, node: usize) {
        for (index, bundle) in self.engines[node].take_bundles() {
            self.largest_bundle = self.largest_bundle.max(cdr::encode(&bundle).unwrap().len());
            self.unread[index].push_back(bundle.until_tick);
            self.most_unread = self.most_unread.max(self.unread[index].len());
            self.transit[index].push_back(bundle);
        }
    }

    fn deliver_some(&mut self) {
        if self.transit.is_empty() {
            return;
        }
        let index = self.random.random_range(0..self.transit.len());
        for _ in 0..self.random.random_range(1..4) {
            self.deliver(index);
        }
    }

    fn deliver(&mut self, index: usize) {
        let to = self.contract.edges[index].to;
        if let Some(bundle) = self.transit[index].pop_front() {
            self.engines[to].accept_bundle(index, bundle).unwrap();
        }
    }

    fn tell_clock(&mut self, node: usize) {
        let status = status(&self.contract.nodes[node], self.engines[node].next_tick());
        self.clock.accept(&status, std::time::Duration::ZERO).unwrap();
        if let Some(grant) = self.clock.grant(std::time::Duration::ZERO, self.random.random()) {
            self.grants.iter_mut().for_each(|grants| grants.push_back(grant));
        }
    }

    /// What a real run does sooner or later when nobody moves.
    fn deliver_everything(&mut self) {
        for node in 0..self.engines.len() {
            self.flush(node);
            self.tell_clock(node);
        }
        for index in 0..self.transit.len() {
            while !self.transit[index].is_empty() {
                self.deliver(index);
            }
        }
        for (engine, grants) in self.engines.iter_mut().zip(&mut self.grants) {
            grants.drain(..).for_each(|grant| engine.accept_grant(&grant));
        }
    }
}

fn status(node: &str, tick: u64) -> LoopStatus {
    LoopStatus {
        run_id: RUN,
        node: node.into(),
        tick,
        wired: true,
        goal_tick: LoopStatus::NO_GOAL,
        ..Default::default()
    }
}

fn toys(contract: &LoopContract, rate: f64, bytes_max: usize) -> Vec<Toy> {
    (0..contract.nodes.len()).map(|node| Toy::new(node, rate, bytes_max)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn every_node_sees_what_the_contract_says(contract in contracts(), rate in 0.0..0.8, seed: u64) {
        const TICKS: u64 = 120;
        let expected = reference(&contract, toys(&contract, rate, 40), TICKS);
        let toys = toys(&contract, rate, 40);
        let window = contract.timing.window_ticks;
        let delay_max = contract.edges.iter().map(|edge| edge.delay_ticks).max().unwrap_or(0);
        let mut simulation = Simulation::new(contract, toys, TICKS, seed);
        simulation.run();
        for (toy, expected) in simulation.toys.iter().zip(&expected) {
            prop_assert_eq!(&toy.seen, expected);
        }
        prop_assert!(simulation.most_unread <= usize::try_from(window + delay_max).unwrap());
        prop_assert!(simulation.most_unread <= UNREAD_MAX);
    }

    #[test]
    fn large_messages_change_nothing_and_fit_datagrams(contract in contracts(), seed: u64) {
        const TICKS: u64 = 24;
        let large = MESSAGE_BYTES_MAX - 8;
        let expected = reference(&contract, toys(&contract, 0.4, large), TICKS);
        let toys = toys(&contract, 0.4, large);
        let mut simulation = Simulation::new(contract, toys, TICKS, seed);
        simulation.run();
        for (toy, expected) in simulation.toys.iter().zip(&expected) {
            prop_assert_eq!(&toy.seen, expected);
        }
        prop_assert!(simulation.largest_bundle <= DATAGRAM_BYTES_MAX, "{} bytes", simulation.largest_bundle);
    }

    #[test]
    fn a_lost_bundle_is_a_gap_that_names_the_sender(lost in 0_u64..20, delay in 1_u64..=12) {
        let (mut sender, mut receiver) = pair(delay);
        for number in 0..=lost {
            let bundle = one_tick(&mut sender);
            let outcome = receiver.accept_bundle(0, bundle);
            prop_assert_eq!(outcome, Ok(()), "bundle {}", number);
        }
        one_tick(&mut sender);
        let late = one_tick(&mut sender);
        let gap = LoopError::Gap { from: "/n0".into(), expected: lost + 1, got: lost + 2 };
        prop_assert_eq!(receiver.accept_bundle(0, late), Err(gap));
    }
}

/// Two nodes and an edge from the first to the second.
fn pair(delay: u64) -> (Engine, Engine) {
    let contract = contract(2, vec![edge(0, 1, delay, 1)], 32);
    (Engine::new(&contract, "/n0").unwrap(), Engine::new(&contract, "/n1").unwrap())
}

fn route(engine: &Engine) -> Route {
    engine.routes(&Channel::Topic("/t0_1_0".into()))[0]
}

/// Sends a message, ends the tick, and returns the bundle.
fn one_tick(engine: &mut Engine) -> LoopBundle {
    let route = route(engine);
    engine.send(route, &[1, 2, 3]).unwrap();
    engine.finish_tick();
    engine.take_bundles().remove(0).1
}

fn grant(until_tick: u64) -> LoopGrant {
    LoopGrant { run_id: RUN, until_tick, end_tick: 1_000, ended: false }
}

#[test]
fn what_another_run_sends_is_ignored() {
    let (mut sender, mut receiver) = pair(1);
    receiver
        .accept_bundle(0, LoopBundle { run_id: RUN + 1, sequence: 99, until_tick: 50, ..Default::default() })
        .unwrap();
    assert!(!receiver.wired(), "a stale probe is no sign of life");
    receiver.accept_grant(&LoopGrant { run_id: RUN + 1, until_tick: 50, end_tick: 0, ended: true });
    assert_eq!(receiver.blocked(), Some(Blocked::Grant));
    receiver.accept_grant(&grant(10));
    assert_eq!(receiver.blocked(), None, "tick 0 needs nothing of an edge with delay");
    receiver.finish_tick();
    assert_eq!(receiver.blocked(), Some(Blocked::Input("/n0")));
    receiver.accept_bundle(0, one_tick(&mut sender)).unwrap();
    assert_eq!(receiver.blocked(), None);
    assert_eq!(receiver.inputs(), [Input { edge: 0, port: 0, payload: Bytes::from_static(&[1, 2, 3]) }]);
}

#[test]
fn a_probe_wires_but_says_nothing_of_time() {
    let (sender, mut receiver) = pair(1);
    let (index, probe) = sender.probes().remove(0);
    receiver.accept_bundle(index, probe).unwrap();
    assert!(receiver.wired());
    receiver.accept_grant(&grant(10));
    receiver.finish_tick();
    assert_eq!(receiver.blocked(), Some(Blocked::Input("/n0")));
}

#[test]
fn a_sender_that_starts_again_is_a_gap() {
    let (mut sender, mut receiver) = pair(1);
    receiver.accept_bundle(0, one_tick(&mut sender)).unwrap();
    let (mut second, _) = pair(1);
    let gap = LoopError::Gap { from: "/n0".into(), expected: 1, got: 0 };
    assert_eq!(receiver.accept_bundle(0, one_tick(&mut second)), Err(gap));
}

#[test]
fn a_bundle_with_a_port_of_no_channel_is_refused() {
    let (_, mut receiver) = pair(1);
    let entries = vec![LoopEntry { port: 1, ..Default::default() }];
    let bundle = LoopBundle { run_id: RUN, until_tick: 1, entries, ..Default::default() };
    let error = LoopError::UnknownPort { from: "/n0".into(), port: 1, ports: 1 };
    assert_eq!(receiver.accept_bundle(0, bundle), Err(error));
}

#[test]
fn regress_what_is_sent_at_the_end_of_time_never_comes() {
    let (_, mut receiver) = pair(1);
    receiver.accept_grant(&grant(10));
    let entries = vec![LoopEntry { tick: u64::MAX, ..Default::default() }];
    let bundle = LoopBundle { run_id: RUN, until_tick: u64::MAX, entries, ..Default::default() };
    receiver.accept_bundle(0, bundle).unwrap();
    for _ in 0..10 {
        assert_eq!(receiver.blocked(), None);
        assert_eq!(receiver.inputs(), Vec::new());
        receiver.finish_tick();
    }
}

#[test]
fn the_largest_message_fits_and_one_byte_more_is_refused() {
    let (mut sender, _) = pair(1);
    let route = route(&sender);
    sender.send(route, &vec![0; MESSAGE_BYTES_MAX]).unwrap();
    let error = sender.send(route, &vec![0; MESSAGE_BYTES_MAX + 1]).unwrap_err();
    assert_eq!(error, LoopError::TooLarge { bytes: MESSAGE_BYTES_MAX + 1 });
    assert!(error.to_string().contains(&MESSAGE_BYTES_MAX.to_string()), "{error}");
    sender.finish_tick();
    let (_, bundle) = sender.take_bundles().remove(0);
    assert!(cdr::encode(&bundle).unwrap().len() <= DATAGRAM_BYTES_MAX);
}

/// The headers of many small messages are larger than the messages.
#[test]
fn regress_bundles_of_many_small_messages_fit_datagrams() {
    let (mut sender, _) = pair(1);
    let route = route(&sender);
    for _ in 0..20_000 {
        sender.send(route, &[1]).unwrap();
    }
    sender.finish_tick();
    let bundles = sender.take_bundles();
    assert_eq!(bundles.iter().map(|(_, bundle)| bundle.entries.len()).sum::<usize>(), 20_000);
    for (_, bundle) in bundles {
        assert!(cdr::encode(&bundle).unwrap().len() <= DATAGRAM_BYTES_MAX);
    }
}

#[test]
fn a_node_outside_the_contract_is_told_who_is_inside() {
    let contract = contract(2, Vec::new(), 32);
    let error = Engine::new(&contract, "/stranger").unwrap_err();
    assert_eq!(error, LoopError::NotInLoop { node: "/stranger".into(), nodes: contract.nodes });
}

#[test]
fn a_run_ends_at_its_last_tick_or_at_once_when_the_clock_says_so() {
    let (mut engine, _) = pair(1);
    engine.accept_grant(&LoopGrant { end_tick: 1, ..grant(10) });
    assert_eq!(engine.blocked(), None);
    engine.finish_tick();
    assert_eq!((engine.blocked(), engine.ended()), (Some(Blocked::Ended), false));
    let (mut engine, _) = pair(1);
    engine.accept_grant(&LoopGrant { ended: true, ..grant(10) });
    assert_eq!((engine.blocked(), engine.ended()), (Some(Blocked::Ended), true));
}

#[test]
fn what_nobody_waits_for_is_kept_together() {
    // The second node answers the first; the third only listens.
    let contract = contract(3, vec![edge(0, 1, 1, 1), edge(1, 0, 3, 1), edge(0, 2, 1, 1)], 32);
    let (answered, heard) = (0, 2);
    let mut node = Engine::new(&contract, "/n0").unwrap();
    let edges = |node: &mut Engine| node.take_bundles().into_iter().map(|(edge, _)| edge).collect::<Vec<_>>();
    let answer = |sequence, until_tick| LoopBundle { run_id: RUN, sequence, until_tick, ..LoopBundle::default() };
    node.accept_grant(&grant(12));
    (0..3).for_each(|_| node.finish_tick());
    assert_eq!(node.blocked(), Some(Blocked::Input("/n1")));
    assert_eq!(edges(&mut node), [answered]);
    node.accept_bundle(1, answer(0, 2)).unwrap();
    (0..2).for_each(|_| node.finish_tick());
    assert_eq!(edges(&mut node), [answered]);
    // Eight ticks are enough, whoever waits; and what is granted has an end.
    node.accept_bundle(1, answer(1, 6)).unwrap();
    (0..4).for_each(|_| node.finish_tick());
    assert_eq!(edges(&mut node), [answered, heard]);
    node.accept_bundle(1, answer(2, 12)).unwrap();
    (0..3).for_each(|_| node.finish_tick());
    assert_eq!(node.blocked(), Some(Blocked::Grant));
    assert_eq!(edges(&mut node), [answered, heard]);
}

#[test]
fn before_a_long_tick_what_others_wait_for_goes_out() {
    let contract = contract(3, vec![edge(0, 1, 1, 1), edge(1, 0, 3, 1), edge(0, 2, 1, 1)], 32);
    let mut node = Engine::new(&contract, "/n0").unwrap();
    let picture = LoopEntry { tick: 0, sequence: 0, port: 0, payload: vec![0; 30_000] };
    let answer = LoopBundle { run_id: RUN, until_tick: 9, entries: vec![picture], ..LoopBundle::default() };
    node.accept_grant(&grant(12));
    node.accept_bundle(1, answer).unwrap();
    for _ in 0..3 {
        assert!(!Engine::has_much_to_do(&node.inputs()));
        node.finish_tick();
    }
    // It could go on, and so nothing would be sent.
    assert!(node.take_bundles().is_empty());
    assert!(Engine::has_much_to_do(&node.inputs()));
    let complete = node.take_complete();
    assert_eq!(complete.iter().map(|(edge, bundle)| (*edge, bundle.until_tick)).collect::<Vec<_>>(), [(0, 3)]);
}
