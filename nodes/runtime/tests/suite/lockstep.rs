//! The loop over real DDS: toy nodes in threads, each with a participant of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use feeder_runtime::dds::{Domain, NodeName, Participant, Qos};
use feeder_runtime::digest::{self, Digest, DigestLine};
use feeder_runtime::launch::{Seat, full_name, run_in_loop, run_opened};
use feeder_runtime::lockstep::{ClockRunner, LoopClock, LoopContract, LoopTiming, Speed};
use feeder_runtime::node::{
    ActionClient, ActionClientPorts, ActionServer, ActionServerPorts, Client, ClientEvent, Declare, FeederNode,
    GoalEnd, GoalId, Interface, NodeError, Publisher, Server, ServerEvent, StepIo, Subscriber,
};
use feeder_runtime::testing::TestDomain;
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::interface::{ActionSpec, EVERY_NODE, Namespace, ServiceSpec, TopicSpec, User};
use minifactory_msgs::std_srvs::srv::{Trigger, TriggerRequest, TriggerResponse};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

const NAMESPACE: &str = "/toy";
const NAMES: [&str; 3] = ["source", "judge", "relay"];
const SOURCE: usize = 0;
const JUDGE: usize = 1;
const RELAY: usize = 2;
const TICK: Duration = Duration::from_millis(10);
const TIMING: LoopTiming =
    LoopTiming { tick_ns: 10_000_000, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 32 };
/// How long nodes may take to find each other on a busy machine.
const START_UP_LIMIT: Duration = Duration::from_secs(30);

/// What a toy does beside its duty.
#[derive(Clone)]
enum Quirk {
    None,
    /// Sleeps a random time in some steps.
    Sleeps(u64),
    /// Reaches the goal of the run in this tick.
    Goal(u64),
    /// Dies in this tick, without a word.
    Dies(u64),
    /// Reports an error in this tick.
    Fails(u64),
    /// Blocks in this tick until the test is over.
    Hangs(u64, Arc<Gate>),
}

/// Opened once.
#[derive(Default)]
struct Gate {
    open: Mutex<bool>,
    opened: Condvar,
}

impl Gate {
    fn open(&self) {
        *self.open.lock().unwrap() = true;
        self.opened.notify_all();
    }

    fn wait(&self) {
        let open = self.open.lock().unwrap();
        drop(self.opened.wait_while(open, |open| !*open).unwrap());
    }
}

#[derive(Clone, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
struct NoConfig {}

/// The part a toy plays. All hash what they hear, and what they say depends on all they have heard.
enum Part {
    /// Counts, hears the echo, calls the service and the action.
    Source { count: Publisher<Point>, echo: Subscriber<Point>, go: Client<Trigger>, deliver: ActionClient<DeliverPart> },
    /// Hears the count and echoes it, serves the service and the action.
    Judge {
        count: Subscriber<Point>,
        echo: Publisher<Point>,
        go: Server<Trigger>,
        deliver: ActionServer<DeliverPart>,
        /// Goals and the ticks in which they end.
        goals: Vec<(GoalId, u64)>,
    },
    /// Hears both.
    Relay { count: Subscriber<Point>, echo: Subscriber<Point> },
}

struct Toy {
    part: Part,
    said: Publisher<Point>,
    state: u64,
    quirk: Quirk,
    random: Pcg64Mcg,
}

const ANY: &[&str] = &[EVERY_NODE];
const NEXT: &[User] = &[User::Forward(EVERY_NODE)];
const BACK: &[User] = &[User::Feedback(EVERY_NODE)];
const OWN: Namespace = Namespace::Own("");
const COUNT: TopicSpec<Point> = TopicSpec::new(OWN, "count", Qos::command()).between(ANY, NEXT, "");
const ECHO: TopicSpec<Point> = TopicSpec::new(OWN, "echo", Qos::command()).between(ANY, NEXT, "");
const ECHO_BACK: TopicSpec<Point> = ECHO.between(ANY, BACK, "");
const SAID: TopicSpec<Point> = TopicSpec::new(OWN, "said", Qos::command()).between(ANY, NEXT, "");
const GO: ServiceSpec<Trigger> = ServiceSpec::new(OWN, "go").between(ANY, NEXT, "");
const DELIVER: ActionSpec<DeliverPart> = ActionSpec::new(OWN, "deliver").between(ANY, BACK, "");

impl Toy {
    fn new(index: usize, quirk: Quirk) -> (Self, Interface) {
        let mut io = Declare::new("toy", NAMESPACE);
        let part = match index {
            SOURCE => {
                let deliver: ActionClientPorts<DeliverPart> = io.action_client(&DELIVER);
                Part::Source {
                    count: io.publisher(&COUNT),
                    echo: io.subscriber(&ECHO_BACK),
                    go: io.client(&GO),
                    deliver: ActionClient::new(deliver),
                }
            }
            JUDGE => {
                let deliver: ActionServerPorts<DeliverPart> = io.action_server(&DELIVER);
                Part::Judge {
                    count: io.subscriber(&COUNT),
                    echo: io.publisher(&ECHO),
                    go: io.server(&GO),
                    deliver: ActionServer::new(deliver),
                    goals: Vec::new(),
                }
            }
            _ => Part::Relay { count: io.subscriber(&COUNT), echo: io.subscriber(&ECHO) },
        };
        let said = io.publisher(&SAID);
        let random = Pcg64Mcg::seed_from_u64(if let Quirk::Sleeps(seed) = quirk { seed } else { 0 });
        (Self { part, said, state: index as u64, quirk, random }, io.finish().unwrap())
    }

    fn indulge(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        let tick = io.tick();
        match &self.quirk {
            Quirk::Sleeps(_) if self.random.random_bool(0.05) => {
                std::thread::sleep(Duration::from_micros(self.random.random_range(0..3_000)));
            }
            Quirk::Goal(at) if *at == tick => io.reach_goal(),
            // As a panic, without its message.
            Quirk::Dies(at) if *at == tick => std::panic::resume_unwind(Box::new("dies as it should")),
            Quirk::Fails(at) if *at == tick => return Err(NodeError::new("out of order")),
            Quirk::Hangs(at, gate) if *at == tick => gate.wait(),
            _ => {}
        }
        Ok(())
    }
}

fn mix(state: &mut u64, heard: impl std::fmt::Debug) {
    for byte in format!("{heard:?}").bytes() {
        *state = state.wrapping_mul(0x0100_0000_01b3) ^ u64::from(byte);
    }
}

fn point(tick: u64, state: u64) -> Point {
    #[expect(clippy::cast_precision_loss, reason = "any number made of the state will do")]
    let [x, y] = [tick as f64, state as f64];
    Point { x, y, z: 0.0 }
}

impl FeederNode for Toy {
    const NAME: &'static str = "toy";
    type Config = NoConfig;
    type Ports = ();

    fn tick(_: &NoConfig) -> Duration {
        TICK
    }

    fn declare(_: &mut Declare, _: &NoConfig) {}

    fn open((): (), _: &NoConfig) -> Result<Self, NodeError> {
        Err(NodeError::new("the tests make the toys"))
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        self.indulge(io)?;
        let (tick, state) = (io.tick(), &mut self.state);
        match &mut self.part {
            Part::Source { count, echo, go, deliver } => {
                io.take(echo).iter().for_each(|heard| mix(state, heard));
                io.replies(go).iter().for_each(|heard| mix(state, heard));
                for event in deliver.poll(io) {
                    mix(state, &event);
                    if let ClientEvent::Accepted(id) = event
                        && id.0[0] % 3 == 0
                    {
                        deliver.cancel(io, id);
                    }
                }
                io.publish(count, &point(tick, *state));
                if tick.is_multiple_of(7) {
                    io.call(go, &TriggerRequest::default());
                }
                if tick.is_multiple_of(31) {
                    let goal = DeliverPartGoal { station: state.to_string(), ..Default::default() };
                    deliver.send(
                        io,
                        GoalId([tick.to_le_bytes(), state.to_le_bytes()].concat().try_into().unwrap()),
                        goal,
                    );
                }
            }
            Part::Judge { count, echo, go, deliver, goals } => {
                io.take(count).iter().for_each(|heard| mix(state, heard));
                io.publish(echo, &point(tick, *state));
                for (asker, _) in io.requests(go) {
                    mix(state, "go");
                    io.reply(go, asker, &TriggerResponse { success: true, message: state.to_string() });
                }
                for event in deliver.poll(io) {
                    match event {
                        ServerEvent::Requested(request) if tick.is_multiple_of(4) => {
                            deliver.reject(io, request, "fourth");
                        }
                        ServerEvent::Requested(request) => {
                            goals.push((request.id, tick + 25));
                            deliver.accept(io, request);
                        }
                        ServerEvent::CancelRequested(id) => {
                            goals.retain(|(known, _)| *known != id);
                            deliver.finish(io, id, GoalEnd::Canceled, DeliverPartResult::default());
                        }
                    }
                }
                let ended: Vec<GoalId> = goals.iter().filter(|(_, ends)| *ends <= tick).map(|(id, _)| *id).collect();
                goals.retain(|(_, ends)| *ends > tick);
                for id in ended {
                    deliver.finish(
                        io,
                        id,
                        GoalEnd::Succeeded,
                        DeliverPartResult { reason: state.to_string(), ..Default::default() },
                    );
                }
                if let (Some((id, _)), true) = (goals.first(), tick.is_multiple_of(5)) {
                    deliver.feedback(
                        io,
                        *id,
                        DeliverPartFeedback { delivery_id: state.to_string(), ..Default::default() },
                    );
                }
            }
            Part::Relay { count, echo } => {
                io.take(count).iter().for_each(|heard| mix(state, heard));
                io.take(echo).iter().for_each(|heard| mix(state, heard));
            }
        }
        io.publish(&self.said, &point(tick, self.state));
        Ok(())
    }
}

/// How a run went.
struct Run {
    end: Result<(), String>,
    ended_at: u64,
    nodes: Vec<Result<(), String>>,
    digest: Vec<DigestLine>,
}

struct Nodes {
    threads: Vec<JoinHandle<Result<(), String>>>,
    stop: Arc<AtomicBool>,
    digests: tempfile::TempDir,
}

fn clocks_participant(domain: &Domain) -> Participant {
    Participant::open(domain, &NodeName::new("/", "clock").unwrap()).unwrap()
}

fn contract(run_id: u64) -> LoopContract {
    let nodes: Vec<_> = NAMES
        .iter()
        .enumerate()
        .map(|(index, name)| (full_name(NAMESPACE, name), Toy::new(index, Quirk::None).1))
        .collect();
    LoopContract::connect(run_id, TIMING, &nodes).unwrap()
}

fn start(domain: &Domain, contract: &LoopContract, quirks: [Quirk; 3]) -> Nodes {
    let digests = tempfile::tempdir().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let seat = Seat {
        contract: Arc::new(contract.clone()),
        namespace: NAMESPACE.into(),
        domain: *domain,
        hub: None,
        record_to: None,
        digest_dir: Some(digests.path().to_owned()),
        stop: stop.clone(),
    };
    let threads = quirks.into_iter().enumerate().map(|(index, quirk)| {
        let seat = seat.clone();
        let (toy, interface) = Toy::new(index, quirk);
        std::thread::spawn(move || {
            run_opened(&seat, toy, NAMES[index], &NoConfig {}, interface).map_err(|error| error.to_string())
        })
    });
    Nodes { threads: threads.collect(), stop, digests }
}

impl Nodes {
    fn join(&mut self) -> Vec<Result<(), String>> {
        let joined = self.threads.drain(..).map(|thread| thread.join().unwrap_or_else(|_| Err("died".into())));
        joined.collect()
    }
}

/// Runs the loop for `ticks` at most; `after` is called when the clock is done and before the nodes are waited for.
fn run_then(domain: &Domain, run_id: u64, ticks: u64, quirks: [Quirk; 3], after: impl FnOnce()) -> Run {
    let contract = contract(run_id);
    let mut nodes = start(domain, &contract, quirks);
    let participant = clocks_participant(domain);
    let clock = LoopClock::new(contract.clone(), Speed::Max, ticks, START_UP_LIMIT);
    let digest = Digest::new(Some(nodes.digests.path()), "/clock", &[]);
    let mut clock = ClockRunner::open(&participant, &contract, None, clock, digest).unwrap();
    let end = clock.run(&AtomicBool::new(false), |_| Ok(())).map_err(|error| error.to_string());
    after();
    let ended_at = clock.tick();
    nodes.stop.store(end.is_err(), Ordering::Relaxed);
    let left = nodes.join();
    clock.finish().unwrap();
    Run { end, ended_at, nodes: left, digest: digest::merge(nodes.digests.path()).unwrap() }
}

fn run(domain: &Domain, run_id: u64, ticks: u64, quirks: [Quirk; 3]) -> Run {
    run_then(domain, run_id, ticks, quirks, || {})
}

const PLAIN: [Quirk; 3] = [Quirk::None, Quirk::None, Quirk::None];

#[test]
fn runs_repeat_to_the_last_byte() {
    const TICKS: u64 = 2_000;
    let domain = TestDomain::claim();
    let first = run(&domain, 1, TICKS, PLAIN);
    assert_eq!((first.end, first.ended_at), (Ok(()), TICKS));
    assert!(first.nodes.iter().all(Result::is_ok), "{:?}", first.nodes);
    let counts: Vec<_> = first.digest.iter().map(|line| (line.topic.as_str(), line.count)).collect();
    assert_eq!(counts, [("/clock", TICKS), ("/toy/count", TICKS), ("/toy/echo", TICKS), ("/toy/said", 3 * TICKS)]);
    for (run_id, quirks) in
        [(2, PLAIN), (3, [11, 12, 13].map(Quirk::Sleeps)), (4, [Quirk::None, Quirk::Sleeps(1), Quirk::None])]
    {
        let again = run(&domain, run_id, TICKS, quirks);
        assert_eq!(again.end, Ok(()));
        assert_eq!(again.digest, first.digest, "run {run_id}");
    }
}

#[test]
fn a_goal_ends_every_run_in_the_same_tick() {
    let domain = TestDomain::claim();
    let quirks =
        |sleepy: bool| [if sleepy { Quirk::Sleeps(5) } else { Quirk::None }, Quirk::Goal(150), Quirk::Goal(170)];
    for (run_id, sleepy) in [(1, false), (2, true)] {
        let run = run(&domain, run_id, 1_000, quirks(sleepy));
        assert_eq!((run.end, run.ended_at), (Ok(()), 150 + TIMING.window_ticks));
    }
}

/// Two clocks and twice the nodes, of the same names: as when nodes of an earlier run are still about.
#[test]
fn another_run_in_the_domain_is_ignored() {
    const TICKS: u64 = 300;
    let domain = TestDomain::claim();
    let alone = run(&domain, 1, TICKS, PLAIN);
    let both = std::thread::scope(|scope| {
        let threads = [2, 3].map(|run_id| {
            let domain = &domain;
            scope.spawn(move || run(domain, run_id, TICKS, PLAIN))
        });
        threads.map(|thread| thread.join().unwrap())
    });
    for run in both {
        assert_eq!(run.end, Ok(()));
        assert_eq!(run.digest, alone.digest);
    }
}

/// A busy machine may silence others as well; whom the clock then accuses is tested with the clock.
#[test]
fn a_node_that_dies_is_named() {
    let domain = TestDomain::claim();
    for (index, name) in NAMES.iter().enumerate() {
        let mut quirks = PLAIN;
        quirks[index] = Quirk::Dies(100);
        let run = run(&domain, 1 + index as u64, 2_000, quirks);
        let error = run.end.unwrap_err();
        assert!(error.contains(&format!("/toy/{name} has been silent")), "{error}");
        assert_eq!(run.nodes[index], Err("died".into()));
    }
}

#[test]
fn a_node_that_hangs_is_named() {
    let domain = TestDomain::claim();
    let gate = Arc::new(Gate::default());
    let quirks = [Quirk::None, Quirk::Hangs(100, gate.clone()), Quirk::None];
    let run = run_then(&domain, 1, 2_000, quirks, || gate.open());
    let error = run.end.unwrap_err();
    assert!(error.contains("/toy/judge has been silent"), "{error}");
}

#[test]
fn a_node_that_fails_is_named_with_its_reason() {
    let domain = TestDomain::claim();
    let run = run(&domain, 1, 2_000, [Quirk::None, Quirk::None, Quirk::Fails(100)]);
    assert_eq!(run.end, Err("/toy/relay failed: out of order".into()));
    assert_eq!(run.nodes[RELAY], Err("out of order".into()));
}

#[test]
fn nodes_leave_when_their_clock_vanishes() {
    let domain = TestDomain::claim();
    let contract = contract(1);
    let mut nodes = start(&domain, &contract, PLAIN);
    let participant = clocks_participant(&domain);
    let clock = LoopClock::new(contract.clone(), Speed::Paced(1.0), 1_000_000, START_UP_LIMIT);
    let mut clock = ClockRunner::open(&participant, &contract, None, clock, Digest::new(None, "/clock", &[])).unwrap();
    // A clock that is killed says nothing any more; one that merely fails tells the nodes.
    let died = std::thread::spawn(move || {
        clock.run(&AtomicBool::new(false), |tick| if tick > 10 { panic!("dies as it should") } else { Ok(()) })
    });
    assert!(died.join().is_err());
    for left in nodes.join() {
        let error = left.unwrap_err();
        assert!(error.contains("no word from the clock"), "{error}");
    }
}

#[test]
fn a_loop_that_lacks_a_node_does_not_start_and_says_who() {
    let domain = TestDomain::claim();
    let contract = contract(1);
    let participant = clocks_participant(&domain);
    let clock = LoopClock::new(contract.clone(), Speed::Max, 10, Duration::from_millis(300));
    let mut clock = ClockRunner::open(&participant, &contract, None, clock, Digest::new(None, "/clock", &[])).unwrap();
    let error = clock.run(&AtomicBool::new(false), |_| Ok(())).unwrap_err().to_string();
    for name in NAMES {
        assert!(error.contains(&format!("/toy/{name} was never heard")), "{error}");
    }
}

#[test]
fn a_run_of_another_tick_than_the_configurations_is_refused() {
    let domain = TestDomain::claim();
    let mut contract = contract(1);
    contract.timing.tick_ns *= 2;
    let seat = Seat {
        contract: Arc::new(contract),
        namespace: NAMESPACE.into(),
        domain: *domain,
        hub: None,
        record_to: None,
        digest_dir: None,
        stop: Arc::default(),
    };
    let error = run_in_loop::<Toy>(&seat, &NoConfig {}).unwrap_err().to_string();
    assert_eq!(error, "the run's tick is 20ms, but the configuration says 10ms");
}
