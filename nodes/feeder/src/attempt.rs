//! One run of a plan from the start of its nodes to their end.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use feeder_runtime::dds::{Domain, NodeName, Participant};
use feeder_runtime::digest::{self, Digest};
use feeder_runtime::launch::{Seat, run_opened};
use feeder_runtime::lockstep::{ClockError, ClockRunner, Hub, LoopClock, ResetRefusal, RunEnd, Speed};
use feeder_runtime::node::{Declare, FeederNode};
use feeder_scenario::plan::{RunMonitorConfig, RunPlan};
use feeder_top::Screen;
use feeder_wire::topics::CLOCK;
use run_monitor::{Activity, Progress, RunMonitor};

use crate::crew::{Crew, Leave, NodeThread};
use crate::muster::Muster;
use crate::recording::Recording;
use crate::summary::Summary;
use crate::up::{Ended, UpArgs, connect, write};
use crate::view::View;

/// How long nodes may take to appear and connect, longer on a busy machine.
const START_UP_LIMIT: Duration = Duration::from_secs(20);
/// Time without progress after which a run over several hosts is ended, s: a cable may be put back.
const PATIENCE_OVER_HOSTS_S: u32 = 10;
/// Why a run that is recorded cannot be started again.
const RECORDED: &str = "the run is recorded, and a bag cannot be begun twice: end it and start another";

/// The node that keeps the time.
pub(crate) const NAME: &str = "feeder_up";

/// How simulated time passes at first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    speed: Speed,
    is_paused: bool,
}

impl Pace {
    /// As the command says.
    pub(crate) fn of(args: &UpArgs) -> Self {
        let speed = args.speed.unwrap_or(if args.view.is_some() { Speed::Paced(1.0) } else { Speed::Max });
        Self { speed, is_paused: false }
    }

    /// As it passes now.
    fn now(clock: &ClockRunner) -> Self {
        let (speed, is_paused) = clock.pace();
        Self { speed, is_paused }
    }
}

/// A run, or the attempt at one.
pub(crate) struct Attempt {
    pub(crate) ended: Ended,
    /// Why there should be another.
    pub(crate) again: Option<Again>,
}

/// Why the nodes should be started once more.
pub(crate) enum Again {
    /// They did not come up, although none of them said why.
    NotUp(String),
    /// Somebody asked for it; time is to pass as it does now.
    Reset(Pace),
}

/// Starts the nodes of a plan and keeps time until the run ends.
pub(crate) fn attempt(
    plan: &RunPlan,
    args: &UpArgs,
    pace: Pace,
    stop: &Arc<AtomicBool>,
    domain: Domain,
    shown: Option<&feeder_view::View>,
    mut muster: Option<&mut Muster>,
) -> anyhow::Result<Attempt> {
    let started = Instant::now();
    let mut contract = connect(plan)?;
    if muster.is_some() {
        contract.patience_s = PATIENCE_OVER_HOSTS_S;
    }
    let contract = Arc::new(contract);
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
        let elsewhere = |node: &str| muster.as_ref().is_some_and(|muster| muster.has(node));
        let here = |node: &str| !elsewhere(node);
        Crew::processes(work.path(), plan, here, &contract, &domain, digest_dir.as_deref(), record_to)?
    };

    if let Some(muster) = &mut muster {
        muster.go(plan, &contract, args.digest.is_some())?;
    }

    let end_tick = ticks(plan.run.duration_s, contract.timing.tick_ns);
    let mut clock = LoopClock::new(contract.as_ref().clone(), pace.speed, end_tick, START_UP_LIMIT);
    if pace.is_paused {
        clock.set_paused(true, Duration::ZERO);
        // So that there is something to be seen.
        clock.step(1);
    }
    let clock_digest = Digest::new(digest_dir.as_deref(), &CLOCK.name_in(""), &contract.shared_topics);
    let participant = Participant::secluded(&domain, &NodeName::new("/", NAME)?)?;
    let mut clock = ClockRunner::open(&participant, &contract, hub.as_ref(), clock, clock_digest)?;
    participant.meet_others();
    let (followed, is_recorded) = (Arc::clone(&progress), record_to.is_some());
    clock.refuse_reset_for(move || reset_refusal(&followed, is_recorded));
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
        crew.check()?;
        muster.as_mut().map_or(Ok(()), |muster| muster.check())
    });
    let ended = Instant::now();
    left_early.store(result.is_err(), Ordering::Relaxed);
    let leave = if result.is_ok() { Leave::InOrder } else { Leave::AtOnce };
    let left = crew.finish(leave, |line| view.line(line));
    let left = left.and(muster.map_or(Ok(()), |muster| muster.collect(&digests, leave)));
    let monitored = monitor.join();
    view.close();
    let tick = clock.tick();
    let started_ticking = clock.started_at().unwrap_or(ended);
    let reset_to = clock.is_reset().then(|| Pace::now(&clock));
    let told = clock.finish().context("cannot keep the digest or the record of /clock");
    let recorded = recording.map_or(Ok(()), |recording| recording.finish(tick));

    let progress = progress.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let (startup, wall) = (started_ticking - started, ended - started_ticking);
    let summary = Summary::new(&progress, arbitrated, tick, contract.timing.tick_ns, startup, wall);
    let again = match &result {
        Err(RunEnd::Clock(error @ ClockError::NotWired { .. })) => Some(Again::NotUp(error.to_string())),
        _ => reset_to.map(Again::Reset),
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
    let has_come_up = !matches!(again, Some(Again::NotUp(_)));
    Ok(Attempt { ended: Ended { summary, progress, outcome, has_come_up }, again })
}

/// Why the run cannot be started again: at all, or while somebody has been promised a part that is on its way.
fn reset_refusal(progress: &Mutex<Progress>, is_recorded: bool) -> Option<ResetRefusal> {
    if is_recorded {
        return Some(ResetRefusal::Never(RECORDED.to_owned()));
    }
    let progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
    let is_delivering = |activity| matches!(activity, Activity::Move | Activity::Pick);
    let delivering = progress.feeders.iter().find(|feeder| is_delivering(feeder.activity))?;
    let name = &delivering.name;
    let message = format!("{name} brings a part to a station: ask when that is over, or stop the simulation");
    Some(ResetRefusal::Now(message))
}

fn ticks(duration_s: f64, tick_ns: u64) -> u64 {
    u64::try_from(Duration::from_secs_f64(duration_s).as_nanos()).unwrap_or(u64::MAX).div_ceil(tick_ns)
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
