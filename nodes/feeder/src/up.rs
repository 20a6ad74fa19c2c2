//! `feeder up`: starts the nodes of a scenario, keeps simulated time, shows progress, and says how it went.

use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use feeder_runtime::dds::{DiscoveryRange, Domain, NodeName, Participant};
use feeder_runtime::launch::full_name;
use feeder_runtime::lockstep::{LoopContract, LoopTiming, Speed};
use feeder_runtime::node::{FeederNode, Interface, NodeError};
use feeder_runtime::patience::{Patience, share_of_machine};
use feeder_scenario::Scenario;
use feeder_scenario::plan::{Loaded, RunMonitorConfig, RunPlan, load, named};
use feeder_view::{Place, Settings, Source};
use feeder_wire::topics::CLOCK;
use run_monitor::{Progress, RunMonitor};

use crate::attempt::{Again, Attempt, NAME, Pace, attempt};
use crate::muster::Muster;
use crate::recording::RecordOptions;
use crate::summary::Summary;
use crate::table::{name_of, placed};

/// How often the nodes are started before the run is given up.
const STARTS_MAX: u32 = 3;
/// What a process that is started again is told of how often that was done: a number.
const STARTS_VARIABLE: &str = "FEEDER_UP_STARTS";
/// How long to listen for others in the domain before starting, longer on a busy machine. They are told after 300 ms a second
/// time that somebody is there.
const BUSY_CHECK: Duration = Duration::from_millis(400);

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
    /// Leave these nodes to other hosts, and wait until they are offered there by `feeder join`: kinds, namespaces or full
    /// names
    #[arg(long, value_name = "NODE", value_delimiter = ',', conflicts_with_all = ["composed", "record"])]
    pub except: Vec<String>,
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
    let ended = execute(plan, args, &stop)?;
    if !ended.has_come_up && args.composed && args.recording.record.is_none() && !stop.load(Ordering::Relaxed) {
        start_process_again(&ended, std::env::var(STARTS_VARIABLE).ok().as_deref())?;
    }
    let Ended { summary, progress, outcome, .. } = ended;
    print!("{summary}");
    if let Some(file) = &args.summary {
        write(file, &summary.to_json()?)?;
    }
    outcome?;
    let (delivered, goal) = (progress.delivered(), plan.run.goal_delivered.unwrap_or(0));
    anyhow::ensure!(delivered >= goal, "the run ended before its goal: {delivered} of {goal} parts delivered");
    Ok(())
}

/// Puts this command, begun anew, in the place of this process: threads that have locked up end in no other way. Returns where it was begun
/// often enough.
fn start_process_again(ended: &Ended, starts: Option<&str>) -> anyhow::Result<()> {
    let Some(start) = next_start(starts) else { return Ok(()) };
    let why = ended.outcome.as_ref().err().map(|error| format!("{error:#}")).unwrap_or_default();
    tracing::warn!("{why}; the nodes are started again: start {start} of {STARTS_MAX}");
    let mut again = Command::new(std::env::current_exe().context("cannot start again")?);
    again.args(std::env::args_os().skip(1)).env(STARTS_VARIABLE, start.to_string());
    Err(anyhow::Error::new(again.exec()).context("cannot start again"))
}

/// Which start of a process comes next, if another may.
fn next_start(starts: Option<&str>) -> Option<u32> {
    let starts: u32 = starts.and_then(|starts| starts.parse().ok()).unwrap_or(1);
    (starts < STARTS_MAX).then(|| starts + 1)
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
    /// Whether its nodes came up; where they did not, none of them said why.
    pub has_come_up: bool,
}

/// Runs a plan as `args` say but for the scenario they name.
///
/// # Errors
/// A domain that is taken, nodes that cannot be connected or started.
pub fn execute(plan: &RunPlan, args: &UpArgs, stop: &Arc<AtomicBool>) -> anyhow::Result<Ended> {
    for file in [&args.summary, &args.digest].into_iter().flatten() {
        refuse_lost(file)?;
    }
    let domain = domain(args.domain)?;
    let began = Instant::now();
    refuse_busy_domain(&domain, plan, stop)?;
    let mut listened = began.elapsed();
    let on_screen = !args.plain && feeder_top::is_possible();
    let shown = (on_screen || args.view.is_some()).then(|| show(plan, args, domain)).transpose()?;
    let mut muster = (!args.except.is_empty()).then(|| Muster::call(&domain, plan, &args.except)).transpose()?;
    if let Some(muster) = &mut muster {
        muster.wait(stop)?;
    }
    again_until_up(Pace::of(args), can_start_again(args), stop, |pace| {
        let mut attempt = attempt(plan, args, pace, stop, domain, shown.as_ref(), muster.as_mut())?;
        attempt.ended.summary.add_start_up(std::mem::take(&mut listened));
        Ok(attempt)
    })
}

/// Makes one attempt after the other, until one has come up or there were [`STARTS_MAX`] of them, and anew after a reset.
fn again_until_up(
    mut pace: Pace,
    can_start_again: bool,
    stop: &AtomicBool,
    mut attempt: impl FnMut(Pace) -> anyhow::Result<Attempt>,
) -> anyhow::Result<Ended> {
    let mut starts = 1;
    loop {
        let Attempt { ended, again } = attempt(pace)?;
        let is_told = stop.load(Ordering::Relaxed);
        match again {
            Some(Again::NotUp(why)) if starts < STARTS_MAX && can_start_again && !is_told => {
                starts += 1;
                tracing::warn!("{why}; the nodes are started again: start {starts} of {STARTS_MAX}");
            }
            Some(Again::Reset(now)) if ended.outcome.is_ok() && !is_told => {
                (pace, starts) = (now, 1);
                tracing::info!("the run is started again, as a reset was asked for");
            }
            _ => return Ok(ended),
        }
    }
}

/// Nodes that have locked up as threads end with their process alone, and a bag cannot be begun twice.
fn can_start_again(args: &UpArgs) -> bool {
    !args.composed && args.recording.record.is_none()
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
pub(crate) fn domain(id: Option<u16>) -> anyhow::Result<Domain> {
    let mut domain = Domain::from_env()?;
    if let Some(id) = id {
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
fn refuse_busy_domain(domain: &Domain, plan: &RunPlan, stop: &AtomicBool) -> anyhow::Result<()> {
    let participant = Participant::open(domain, &NodeName::new("/", NAME)?)?;
    let clock = CLOCK.name_in("");
    let ours: Vec<String> = plan.nodes.iter().map(|planned| format!("{}/", planned.namespace)).collect();
    let (since, mut patience) = (Instant::now(), Patience::default());
    while patience.spent(since.elapsed(), share_of_machine) < BUSY_CHECK && !stop.load(Ordering::Relaxed) {
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

pub(crate) fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attempt(again: Option<Again>, outcome: anyhow::Result<()>) -> Attempt {
        let (progress, none) = (Progress::default(), Duration::ZERO);
        let summary = Summary::new(&progress, false, 0, 1, none, none);
        let has_come_up = !matches!(again, Some(Again::NotUp(_)));
        Attempt { ended: Ended { summary, progress, outcome, has_come_up }, again }
    }

    fn not_up() -> Attempt {
        attempt(
            Some(Again::NotUp("/feeder/vision_selector has not come up".to_owned())),
            Err(anyhow::anyhow!("not up")),
        )
    }

    fn came_up() -> Attempt {
        attempt(None, Ok(()))
    }

    fn reset() -> Attempt {
        attempt(Some(Again::Reset(Pace::of(&UpArgs::default()))), Ok(()))
    }

    /// How many attempts were made of these, and whether the last was a good one.
    fn tried(attempts: Vec<Attempt>, can_start_again: bool, is_told: bool) -> (usize, bool) {
        let all = attempts.len();
        let mut attempts = attempts.into_iter();
        let pace = Pace::of(&UpArgs::default());
        let ended = again_until_up(pace, can_start_again, &AtomicBool::new(is_told), |_| {
            attempts.next().context("no attempt was to be made any more")
        });
        (all - attempts.len(), ended.unwrap().outcome.is_ok())
    }

    #[test]
    fn nodes_that_did_not_come_up_are_started_again_and_given_up_after_three_starts() {
        assert_eq!(tried(vec![came_up(), came_up()], true, false), (1, true));
        assert_eq!(tried(vec![not_up(), came_up(), came_up()], true, false), (2, true));
        assert_eq!(tried(vec![not_up(), not_up(), came_up()], true, false), (3, true));
        assert_eq!(tried(vec![not_up(), not_up(), not_up(), came_up()], true, false), (3, false));
    }

    #[test]
    fn nodes_are_not_started_again_in_one_process_on_record_or_when_the_user_wants_to_leave() {
        let args = |options: &[&str]| <UpCommand as clap::Parser>::parse_from([&["up"], options].concat()).args;
        for (options, can) in [(&[] as &[&str], true), (&["--composed"], false), (&["--record", "bag"], false)] {
            assert_eq!(can_start_again(&args(options)), can, "{options:?}");
        }
        assert_eq!(tried(vec![not_up(), came_up()], false, false), (1, false));
        assert_eq!(tried(vec![not_up(), came_up()], true, true), (1, false));
    }

    #[test]
    fn a_process_is_started_three_times_at_most() {
        assert_eq!([None, Some("2"), Some("3")].map(next_start), [Some(2), Some(3), None]);
        assert_eq!(next_start(Some("4294967295")), None);
        assert_eq!(next_start(Some("many")), Some(2));
    }

    #[test]
    fn starts_are_counted_anew_after_a_reset_and_a_run_that_failed_is_not_reset() {
        let twice = [not_up(), not_up(), reset(), not_up(), not_up(), came_up()];
        assert_eq!(tried(Vec::from(twice), true, false), (6, true));
        // Where nodes are threads too.
        assert_eq!(tried(vec![reset(), came_up()], false, false), (2, true));
        let failed = Attempt { ended: attempt(None, Err(anyhow::anyhow!("ended"))).ended, ..reset() };
        assert_eq!(tried(vec![failed, came_up()], true, false), (1, false));
    }

    #[derive(clap::Parser)]
    struct UpCommand {
        #[command(flatten)]
        args: UpArgs,
    }
}
