//! What a round trip costs: in the loop, within a process and between two, and of a service between two processes, ours
//! and beside it that of Cyclone DDS in C.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the bench")]

#[path = "../common/install.rs"]
mod install;

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group};
use feeder_runtime::dds::{DiscoveryRange, Domain, NodeName, Participant, Qos, StaticPeers};
use feeder_runtime::digest::Digest;
use feeder_runtime::launch::{Seat, full_name, run_opened};
use feeder_runtime::lockstep::{ClockRunner, Hub, LoopClock, LoopContract, LoopTiming, Speed};
use feeder_runtime::node::{Declare, FeederNode, Interface, NodeError, Publisher, StepIo, Subscriber};
use feeder_runtime::testing::TestDomain;
use install::{apt_install, run};
use minifactory_msgs::interface::{EVERY_NODE, Namespace, TopicSpec, User};
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse};

/// What a second process of this executable is to be, with its arguments behind it.
const ROLE: &str = "ROUND_TRIP_ROLE";
const NAMESPACE: &str = "/round_trip";
const SERVICE: &str = "/round_trip/echo";
/// What each message and each request holds, bytes.
const BYTES: usize = 64;
const PATIENCE: Duration = Duration::from_secs(20);
const TICK: Duration = Duration::from_millis(10);
/// Each needs what the other said in the tick before, so that a round trip takes two ticks.
const TIMING: LoopTiming =
    LoopTiming { tick_ns: 10_000_000, forward_delay_ticks: 1, feedback_delay_ticks: 1, window_ticks: 32 };

const ANY: &[&str] = &[EVERY_NODE];
const NEXT: &[User] = &[User::Forward(EVERY_NODE)];
const PING: TopicSpec<Text> = TopicSpec::new(Namespace::Own(""), "ping", Qos::command()).between(ANY, NEXT, "");
const PONG: TopicSpec<Text> = TopicSpec::new(Namespace::Own(""), "pong", Qos::command()).between(ANY, NEXT, "");

#[derive(Clone, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
struct NoConfig {}

/// Says in every tick what it heard.
struct Player {
    hears: Subscriber<Text>,
    says: Publisher<Text>,
    said: Text,
    ticks: Arc<AtomicU64>,
}

impl Player {
    fn new(name: &str) -> (Self, Interface) {
        let mut io = Declare::new("player", NAMESPACE);
        let (hears, says) = if name == "ping" { (&PONG, &PING) } else { (&PING, &PONG) };
        let (hears, says) = (io.subscriber(hears), io.publisher(says));
        let said = Text { data: "x".repeat(BYTES) };
        (Self { hears, says, said, ticks: Arc::default() }, io.finish().expect("both topics are stated"))
    }
}

impl FeederNode for Player {
    const NAME: &'static str = "player";
    type Config = NoConfig;
    type Ports = ();

    fn tick(_: &NoConfig) -> Duration {
        TICK
    }

    fn declare(_: &mut Declare, _: &NoConfig) {}

    fn open((): (), _: &NoConfig) -> Result<Self, NodeError> {
        Err(NodeError::new("made where it is run"))
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        if let Some(heard) = io.take(&self.hears).pop() {
            self.said = heard;
        }
        io.publish(&self.says, &self.said);
        self.ticks.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

fn play(name: &'static str, seat: &Seat) -> (Arc<AtomicU64>, impl FnOnce() + Send + 'static) {
    let (player, interface) = Player::new(name);
    let (ticks, seat) = (player.ticks.clone(), seat.clone());
    // How it ends does not matter.
    (ticks, move || _ = run_opened(&seat, player, name, &NoConfig {}, interface))
}

/// A loop of two that goes on until it is dropped.
struct Loop {
    ticks: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    other: Option<Child>,
}

impl Loop {
    fn start(domain: &Domain, in_one_process: bool) -> Self {
        let nodes = ["ping", "pong"].map(|name| (full_name(NAMESPACE, name), Player::new(name).1));
        let contract = LoopContract::connect(1, TIMING, &nodes).expect("the two fit");
        let hub = in_one_process.then(Hub::default);
        let stop: Arc<AtomicBool> = Arc::default();
        let seat = Seat {
            contract: Arc::new(contract.clone()),
            namespace: NAMESPACE.to_owned(),
            domain: *domain,
            hub: hub.clone(),
            digest_dir: None,
            record_to: None,
            stop: stop.clone(),
        };
        let (ticks, ping) = play("ping", &seat);
        let mut threads = vec![std::thread::spawn(ping)];
        let other = if in_one_process {
            threads.push(std::thread::spawn(play("pong", &seat).1));
            None
        } else {
            let file = tempfile::NamedTempFile::new().expect("a file for the contract");
            serde_json::to_writer(&file, &contract).expect("a contract can be written");
            let (_, path) = file.keep().expect("the file can be kept");
            Some(second_process(&["pong", &domain.id.to_string(), &path.to_string_lossy()]))
        };
        let participant = participant(domain, "clock");
        let stopped = stop.clone();
        threads.push(std::thread::spawn(move || {
            let clock = LoopClock::new(contract.clone(), Speed::Max, u64::MAX / 2, PATIENCE);
            let digest = Digest::new(None, "/clock", &[]);
            let clock = ClockRunner::open(&participant, &contract, hub.as_ref(), clock, digest);
            clock.expect("the clock opens").run(&stopped, |_| Ok(())).expect("the loop goes on");
        }));
        let started = Self { ticks, stop, threads, other };
        started.wait_for(1);
        started
    }

    fn wait_for(&self, ticks: u64) {
        while self.ticks.load(Ordering::Relaxed) < ticks {
            std::thread::sleep(Duration::from_micros(200));
        }
    }

    fn time(&self, round_trips: u64) -> Duration {
        let (from, since) = (self.ticks.load(Ordering::Relaxed), Instant::now());
        self.wait_for(from + 2 * round_trips);
        since.elapsed()
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A node that is asked to leave leaves with an error, which is all that could be told.
            let _ = thread.join();
        }
        if let Some(mut other) = self.other.take() {
            other.wait().expect("the second process ends with the run");
        }
    }
}

/// Runs this executable once more, as something else.
fn second_process(role: &[&str]) -> Child {
    let executable = std::env::current_exe().expect("this executable has a path");
    Command::new(executable).env(ROLE, role.join(" ")).spawn().expect("it can be started")
}

fn act(role: &str) {
    let words: Vec<&str> = role.split(' ').collect();
    let domain = |id: &str| Domain {
        id: id.parse().expect("a domain"),
        range: DiscoveryRange::Localhost,
        peers: StaticPeers::default(),
    };
    match words[..] {
        ["pong", id, contract] => {
            let contract = std::fs::read(contract).expect("the contract is there");
            let seat = Seat {
                contract: Arc::new(serde_json::from_slice(&contract).expect("it is a contract")),
                namespace: NAMESPACE.to_owned(),
                domain: domain(id),
                hub: None,
                digest_dir: None,
                record_to: None,
                stop: Arc::default(),
            };
            play("pong", &seat).1();
        }
        ["server", id] => {
            let participant = participant(&domain(id), "server");
            let _server = participant.serve::<SetBool>(SERVICE, |request: SetBoolRequest| SetBoolResponse {
                success: request.data,
                message: "x".repeat(BYTES),
            });
            loop {
                std::thread::park();
            }
        }
        _ => panic!("no such role: {role}"),
    }
}

fn participant(domain: &Domain, name: &str) -> Participant {
    Participant::open(domain, &NodeName::new(NAMESPACE, name).expect("a good name")).expect("the domain can be joined")
}

/// A process that is killed when it is no longer needed.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn time_service(group: &mut BenchmarkGroup<WallTime>) {
    let domain = TestDomain::claim();
    let _server = Killed(second_process(&["server", &domain.id.to_string()]));
    let participant = participant(&domain, "client");
    let client = participant.service_client::<SetBool>(SERVICE).expect("a client");
    let call = || client.call(&SetBoolRequest { data: true }, PATIENCE).wait().expect("a reply");
    call();
    group.bench_function("service", |bencher| bencher.iter(call));
}

/// Calls made by a process, on demand.
struct Caller {
    process: Killed,
    orders: ChildStdin,
    times: BufReader<ChildStdout>,
}

impl Caller {
    fn time(&mut self, calls: u64) -> Duration {
        writeln!(self.orders, "{calls}").expect("the caller listens");
        let mut line = String::new();
        self.times.read_line(&mut line).expect("the caller answers");
        Duration::from_nanos(line.trim().parse().expect("nanoseconds"))
    }
}

fn time_cyclone(group: &mut BenchmarkGroup<WallTime>) {
    let (domain, program) = (TestDomain::claim(), cyclone());
    let start = |arguments: &[&str]| {
        let mut command = Command::new(&program);
        command.args(arguments).env_remove("CYCLONEDDS_URI").stdin(Stdio::piped()).stdout(Stdio::piped());
        Killed(command.spawn().expect("the peer starts"))
    };
    let id = domain.id.to_string();
    let _server = start(&["pong", &id]);
    let mut process = start(&["ping", &id, &BYTES.to_string()]);
    let (orders, times) = (process.0.stdin.take(), process.0.stdout.take());
    let (orders, times) = (orders.expect("it is a pipe"), BufReader::new(times.expect("it is a pipe")));
    let mut caller = Caller { process, orders, times };
    group.bench_function("service_of_cyclone_dds", |bencher| bencher.iter_custom(|calls| caller.time(calls)));
    drop(caller.process);
}

/// The compiled `tests/interop/cyclone/round_trip.c`.
fn cyclone() -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("interop/cyclone");
    let made = tempfile::tempdir().expect("a folder to build in").keep();
    let hint = "Cyclone DDS and gcc are needed (on Debian: apt install gcc cyclonedds-dev cyclonedds-tools)";
    let packages = ["gcc", "libc6-dev", "cyclonedds-dev", "cyclonedds-tools"];
    apt_install(Path::new("/usr/bin/idlc"), &packages, hint);
    run(Command::new("idlc").current_dir(&made).arg(source.join("Sample.idl")), hint);
    let mut compile = Command::new("gcc");
    compile.current_dir(&made).args(["-O2", "-I.", "-o", "round_trip"]).arg(source.join("round_trip.c"));
    run(compile.args(["Sample.c", "-lddsc"]), hint);
    made.join("round_trip")
}

fn round_trips(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("round_trip");
    for (name, in_one_process) in [("loop_in_one_process", true), ("loop_in_two_processes", false)] {
        let domain = TestDomain::claim();
        let running = Loop::start(&domain, in_one_process);
        group.bench_function(name, |bencher| bencher.iter_custom(|round_trips| running.time(round_trips)));
    }
    time_service(&mut group);
    time_cyclone(&mut group);
    group.finish();
}

criterion_group!(benches, round_trips);

fn main() {
    match std::env::var(ROLE) {
        Ok(role) => act(&role),
        Err(_) => {
            benches();
            Criterion::default().configure_from_args().final_summary();
        }
    }
}
