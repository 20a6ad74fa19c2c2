//! `feeder up`: starts the nodes of a scenario, keeps simulated time, shows progress, and says how it went.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use feeder_runtime::dds::{DiscoveryRange, Domain, NodeName, Participant};
use feeder_runtime::digest::{self, Digest};
use feeder_runtime::launch::{Seat, full_name, run_opened};
use feeder_runtime::lockstep::{ClockError, ClockRunner, Hub, LoopClock, LoopContract, LoopTiming, RunEnd, Speed};
use feeder_runtime::node::{Declare, FeederNode, Interface, NodeError};
use feeder_scenario::Scenario;
use feeder_scenario::plan::{Loaded, RunMonitorConfig, RunPlan, load, named};
use feeder_top::Screen;
use feeder_view::{Place, Settings, Source};
use feeder_wire::topics::CLOCK;
use run_monitor::{Progress, RunMonitor};

use crate::crew::{Crew, Leave, NodeThread};
use crate::recording::{RecordOptions, Recording};
use crate::summary::Summary;
use crate::table::{name_of, placed};
use crate::view::View;

/// How long nodes may take to appear and connect, longer on a busy machine.
const START_UP_LIMIT: Duration = Duration::from_secs(20);
/// How often the nodes are started before the run is given up.
const STARTS_MAX: u32 = 3;
/// How long to listen for others in the domain before starting.
const BUSY_CHECK: Duration = Duration::from_millis(600);

/// Run a scenario: all nodes, simulated time, progress and a summary.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct UpArgs {
    /// Scenario, or plan of a run that was (YAML); without it the built-in scenario runs
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Simulated seconds per wall second: a positive number, or max; by default max, with --view 1
    #[arg(long, value_parser = parse_speed, allow_negative_numbers = true, value_name = "1|N|max")]
    pub speed: Option<Speed>,
    /// Seed of all random numbers, instead of the scenario's
    #[arg(long, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232), allow_negative_numbers = true)]
    pub domain: Option<u16>,
    /// Simulated seconds to run, instead of the scenario's
    #[arg(long, allow_negative_numbers = true, value_name = "SECONDS")]
    pub duration: Option<f64>,
    /// End when so many parts are delivered, instead of the scenario's goal; a run that ends without them fails
    #[arg(long, value_name = "PARTS", value_parser = clap::value_parser!(u32).range(1..))]
    pub goal: Option<u32>,
    /// All nodes in this process instead of one process each
    #[arg(long)]
    pub composed: bool,
    /// Write the summary to this file (JSON)
    #[arg(long, value_name = "FILE")]
    pub summary: Option<PathBuf>,
    /// Write a fingerprint of every topic to this file
    #[arg(long, value_name = "FILE")]
    pub digest: Option<PathBuf>,
    /// Show the run on a page and print its address: on this machine alone, unless an address says otherwise
    #[arg(long, value_name = "ADDRESS|PORT", num_args = 0..=1, require_equals = true)]
    pub view: Option<Option<Place>>,
    /// The page controls nothing
    #[arg(long, requires = "view")]
    pub view_read_only: bool,
    /// Lines and a progress bar on a terminal too, in place of the picture of the run
    #[arg(long)]
    pub plain: bool,
    /// What is recorded.
    #[command(flatten)]
    pub recording: RecordOptions,
}

impl UpArgs {
    /// To run a plan as fast as the machine allows, and record it.
    pub(crate) fn again(composed: bool, domain: Option<u16>, recording: RecordOptions) -> Self {
        Self { composed, domain, recording, plain: true, ..Self::default() }
    }
}

fn parse_speed(text: &str) -> Result<Speed, String> {
    if text == "max" {
        return Ok(Speed::Max);
    }
    match text.parse::<f64>() {
        Ok(speed) if speed.is_finite() && speed > 0.0 => Ok(Speed::Paced(speed)),
        _ => Err(format!("{text:?} is neither a positive number nor max")),
    }
}

/// Runs the scenario to its end.
pub(crate) fn run(args: &UpArgs) -> anyhow::Result<()> {
    run_plan(&load_plan(args)?, args)
}

/// Runs a plan to its end.
pub(crate) fn run_plan(plan: &RunPlan, args: &UpArgs) -> anyhow::Result<()> {
    let stop = stop_on_signals()?;
    let Ended { summary, progress, outcome } = execute(plan, args, &stop)?;
    print!("{summary}");
    if let Some(file) = &args.summary {
        write(file, &summary.to_json()?)?;
    }
    outcome?;
    let (delivered, goal) = (progress.delivered(), plan.run.goal_delivered.unwrap_or(0));
    anyhow::ensure!(delivered >= goal, "the run ended before its goal: {delivered} of {goal} parts delivered");
    Ok(())
}

/// Refuses before the run what could not be written after it.
fn refuse_lost(file: &Path) -> anyhow::Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    anyhow::ensure!(folder.is_none_or(Path::is_dir), "{}: there is no such folder to write it to", file.display());
    Ok(())
}

/// A flag that is set when the user wants the run to end.
pub fn stop_on_signals() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot listen for signals")?;
    }
    Ok(stop)
}

/// How a run went as far as it came, and whether it came to its end.
#[derive(Debug)]
pub struct Ended {
    /// How it went.
    pub summary: Summary,
    /// What the run monitor saw.
    pub progress: Progress,
    /// Why it did not come to its end.
    pub outcome: anyhow::Result<()>,
}

/// Runs a plan as `args` say but for the scenario they name.
///
/// # Errors
/// A domain that is taken, nodes that cannot be connected or started.
pub fn execute(plan: &RunPlan, args: &UpArgs, stop: &Arc<AtomicBool>) -> anyhow::Result<Ended> {
    for file in [&args.summary, &args.digest].into_iter().flatten() {
        refuse_lost(file)?;
    }
    let domain = domain(args)?;
    let mut participant = Participant::open(&domain, &NodeName::new("/", "feeder_up")?)?;
    refuse_busy_domain(&participant, &domain, plan, stop)?;
    let on_screen = !args.plain && feeder_top::is_possible();
    let shown = (on_screen || args.view.is_some()).then(|| show(plan, args, domain)).transpose()?;
    let mut starts = 1;
    loop {
        let Attempt { ended, not_up } = attempt(plan, args, stop, &participant, shown.as_ref())?;
        let Some(why) = not_up.filter(|_| starts < STARTS_MAX && can_start_again(args)) else { return Ok(ended) };
        starts += 1;
        tracing::warn!("{why}; the nodes are started again: start {starts} of {STARTS_MAX}");
        // What locked up may be its own participant.
        participant = Participant::open(&domain, participant.node())?;
    }
}

/// Nodes that have locked up as threads cannot be ended, and a bag cannot be begun twice.
fn can_start_again(args: &UpArgs) -> bool {
    !args.composed && args.recording.record.is_none()
}

/// A run, or the attempt at one.
struct Attempt {
    ended: Ended,
    /// Why it never began: the nodes did not come up, although none of them said why.
    not_up: Option<String>,
}

fn attempt(
    plan: &RunPlan,
    args: &UpArgs,
    stop: &Arc<AtomicBool>,
    participant: &Participant,
    shown: Option<&feeder_view::View>,
) -> anyhow::Result<Attempt> {
    let (started, domain) = (Instant::now(), participant.domain());
    let contract = Arc::new(connect(plan)?);
    let work = tempfile::tempdir().context("cannot make a temporary folder")?;
    let digests = work.path().join("digests");
    std::fs::create_dir(&digests)?;
    let digest_dir = args.digest.is_some().then(|| digests.clone());
    let progress = Arc::new(Mutex::new(Progress::default()));
    let recording = Recording::start(&args.recording, work.path(), &contract, plan)?;
    let record_to = recording.as_ref().map(Recording::socket);

    let hub = args.composed.then(Hub::default);
    let left_early = Arc::new(AtomicBool::new(false));
    let seat = |namespace: &str| Seat {
        contract: Arc::clone(&contract),
        namespace: namespace.to_owned(),
        domain,
        hub: hub.clone(),
        digest_dir: digest_dir.clone(),
        record_to: record_to.map(Path::to_owned),
        stop: Arc::clone(&left_early),
    };
    let (namespace, config) = plan.of_kind::<RunMonitorConfig>().next().context("the plan has no run_monitor")?;
    let arbitrated = config.arbitrated;
    let monitor = start_monitor(&seat(namespace), config, plan.run.goal_delivered, Arc::clone(&progress))?;
    let mut crew = if args.composed {
        Crew::threads(&seat, plan)?
    } else {
        Crew::processes(work.path(), plan, &contract, &domain, digest_dir.as_deref(), record_to)?
    };

    let end_tick = ticks(plan.run.duration_s, contract.timing.tick_ns);
    let speed = args.speed.unwrap_or(if args.view.is_some() { Speed::Paced(1.0) } else { Speed::Max });
    let clock = LoopClock::new(contract.as_ref().clone(), speed, end_tick, START_UP_LIMIT);
    let clock_digest = Digest::new(digest_dir.as_deref(), &CLOCK.name_in(""), &contract.shared_topics);
    let mut clock = ClockRunner::open(participant, &contract, hub.as_ref(), clock, clock_digest)?;
    if let Some(socket) = record_to {
        clock.record_to(socket, &contract).context("cannot record /clock")?;
    }
    let address = shown.and_then(feeder_view::View::url);
    let hint = address
        .map_or_else(|| "to see it live: feeder up --view".to_owned(), |address| format!("see it live at {address}"));
    let on_screen = !args.plain && feeder_top::is_possible();
    let watch = shown.filter(|_| on_screen).and_then(feeder_view::View::watch);
    let screen = watch.map(|watch| Screen::open(watch, &hint, Arc::clone(stop))).transpose()?;
    let is_plain = screen.is_none();
    let mut view = View::new(end_tick, contract.timing.tick_ns, screen);
    if is_plain {
        view.line(&hint);
    }
    let result = clock.run(stop, |tick| {
        let now = progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
        crew.for_each_line(|line| view.line(line));
        view.show(tick, &now);
        if recording.as_ref().is_some_and(Recording::has_failed) {
            return Err("the recorder has stopped".to_owned());
        }
        crew.check()
    });
    let ended = Instant::now();
    left_early.store(result.is_err(), Ordering::Relaxed);
    let leave = if result.is_ok() { Leave::InOrder } else { Leave::AtOnce };
    let left = crew.finish(leave, |line| view.line(line));
    let monitored = monitor.join();
    view.close();
    let tick = clock.tick();
    let started_ticking = clock.started_at().unwrap_or(ended);
    let told = clock.finish().context("cannot keep the digest or the record of /clock");
    let recorded = recording.map_or(Ok(()), |recording| recording.finish(tick));

    let progress = progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let (startup, wall) = (started_ticking - started, ended - started_ticking);
    let summary = Summary::new(&progress, arbitrated, tick, contract.timing.tick_ns, startup, wall);
    let not_up = match &result {
        Err(RunEnd::Clock(error @ ClockError::NotWired { .. })) => Some(error.to_string()),
        _ => None,
    };
    let outcome = || {
        // A recorder that fails ends the run: its reason comes first.
        recorded?;
        result.context("the run ended early")?;
        told?;
        left.context("the run reached its end, but not every node left well")?;
        match monitored {
            Ok(outcome) => outcome.context("the run monitor failed")?,
            Err(_) => bail!("the run monitor panicked"),
        }
        if let Some(file) = &args.digest {
            let lines = digest::merge(&digests).context("cannot merge the digests")?;
            let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
            write(file, &text)?;
        }
        Ok(())
    };
    let outcome = outcome();
    Ok(Attempt { ended: Ended { summary, progress, outcome }, not_up })
}

/// The scenario that `args` name, with what they put in its place.
///
/// # Errors
/// A scenario that cannot run.
pub fn load_scenario(args: &UpArgs) -> anyhow::Result<Scenario> {
    match load(args.scenario.as_deref())? {
        Loaded::Scenario(scenario, _) => changed_scenario(scenario, args),
        Loaded::Plan(_) => bail!("a plan of a run that was cannot be changed: name a scenario"),
    }
}

/// The plan of the run that `args` name, with what they put in its place.
///
/// # Errors
/// A scenario that cannot run.
pub fn load_plan(args: &UpArgs) -> anyhow::Result<RunPlan> {
    let file = args.scenario.as_deref();
    match load(file)? {
        Loaded::Scenario(scenario, text) => {
            let plan = changed_scenario(scenario, args)?.resolve(&text);
            plan.with_context(|| named(file))
        }
        Loaded::Plan(_) if args.seed.is_some() => bail!("--seed: a plan has its seed already; name a scenario"),
        Loaded::Plan(mut plan) => {
            plan.run.goal_delivered = args.goal.or(plan.run.goal_delivered);
            plan.run.duration_s = args.duration.unwrap_or(plan.run.duration_s);
            plan.check().context("--duration")?;
            Ok(plan)
        }
    }
}

fn changed_scenario(mut scenario: Scenario, args: &UpArgs) -> anyhow::Result<Scenario> {
    if let Some(seed) = args.seed {
        scenario.seed = seed;
    }
    if args.goal.is_some() {
        scenario.run.goal_delivered = args.goal;
    }
    if let Some(duration_s) = args.duration {
        scenario = scenario.with_duration_s(duration_s).context("--duration")?;
    }
    Ok(scenario)
}

/// What shows the run: on a page, if one is asked for.
fn show(plan: &RunPlan, args: &UpArgs, domain: Domain) -> anyhow::Result<feeder_view::View> {
    let scenario = named(args.scenario.as_deref());
    let place = args.view.map(|place| place.unwrap_or(Place::Default));
    let settings = Settings { place, read_only: args.view_read_only, source: Source::Run, scenario, domain };
    feeder_view::View::start(plan, &settings).context("--view")
}

/// The domain of `--domain` or the environment. The range is ROS 2's default, SUBNET, unless the environment says
/// otherwise: a Cyclone DDS with default settings does not find participants that are on the loopback interface alone.
fn domain(args: &UpArgs) -> anyhow::Result<Domain> {
    let mut domain = Domain::from_env()?;
    if let Some(id) = args.domain {
        domain.id = id;
    }
    if domain.range == DiscoveryRange::Off {
        bail!(
            "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: the nodes could not find each other; allowed here: LOCALHOST, SUBNET"
        );
    }
    Ok(domain)
}

/// Two runs in one domain would drive each other.
fn refuse_busy_domain(
    participant: &Participant,
    domain: &Domain,
    plan: &RunPlan,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let clock = CLOCK.name_in("");
    let ours: Vec<String> = plan.nodes.iter().map(|planned| format!("{}/", planned.namespace)).collect();
    let since = Instant::now();
    while since.elapsed() < BUSY_CHECK && !stop.load(Ordering::Relaxed) {
        let graph = participant.discovered();
        let topics = graph.writers.iter().filter_map(|writer| writer.topic.strip_prefix("rt"));
        if let Some(topic) =
            topics.filter(|topic| *topic == clock || ours.iter().any(|ours| topic.starts_with(ours))).min()
        {
            bail!(
                "domain {} is busy: somebody already publishes {topic}; choose another with --domain (0 to 232) or ROS_DOMAIN_ID",
                domain.id
            );
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}

/// All nodes of the plan: full names and ports.
///
/// # Errors
/// When a port of a node is not stated for it.
pub(crate) fn interfaces(plan: &RunPlan) -> Result<Vec<(String, Interface)>, NodeError> {
    let monitors = plan.of_kind::<RunMonitorConfig>().map(|(namespace, config)| {
        let interface = feeder_runtime::launch::interface::<RunMonitor>(namespace, config).map_err(NodeError::new)?;
        Ok((full_name(namespace, RunMonitor::NAME), interface))
    });
    placed(plan).map(|(entry, planned)| Ok((name_of(planned), (entry.interface)(planned)?))).chain(monitors).collect()
}

/// The loop of these nodes.
pub(crate) fn connect(plan: &RunPlan) -> anyhow::Result<LoopContract> {
    let timing = LoopTiming {
        tick_ns: plan.time.tick_ns(),
        forward_delay_ticks: plan.time.forward_delay_ticks,
        feedback_delay_ticks: plan.time.feedback_delay_ticks,
        window_ticks: plan.time.window_ticks,
    };
    Ok(LoopContract::connect(rand::random(), timing, &interfaces(plan)?)?)
}

fn ticks(duration_s: f64, tick_ns: u64) -> u64 {
    u64::try_from(Duration::from_secs_f64(duration_s).as_nanos()).unwrap_or(u64::MAX).div_ceil(tick_ns)
}

fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

fn start_monitor(
    seat: &Seat,
    config: &RunMonitorConfig,
    goal_delivered: Option<u32>,
    progress: Arc<Mutex<Progress>>,
) -> anyhow::Result<NodeThread> {
    let mut declare = Declare::new(RunMonitor::NAME, &seat.namespace);
    let ports = RunMonitor::declare(&mut declare, config);
    let interface = declare.finish()?;
    let monitor = RunMonitor::watched(ports, config, goal_delivered, progress)?;
    let (seat, config) = (seat.clone(), config.clone());
    let thread = std::thread::Builder::new().name(RunMonitor::NAME.to_owned());
    Ok(thread.spawn(move || run_opened(&seat, monitor, RunMonitor::NAME, &config, interface))?)
}
