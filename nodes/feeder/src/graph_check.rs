//! `feeder graph-check`: starts and stops the suite again and again, and times how it comes onto the ROS graph and leaves.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use feeder_runtime::dds::{Client, Domain, NodeName, Participant, Reader};
use feeder_runtime::node::{Port, PortKind};
use feeder_scenario::plan::{RunPlan, load_plan};
use minifactory_msgs::interface::TopicSpec;
use minifactory_msgs::interface::standard::{CLOCK, DIAGNOSTICS, PARAMETER_EVENTS, ROSOUT};
use minifactory_msgs::rcl_interfaces::srv::{
    DescribeParameters, GetParameterTypes, GetParameters, ListParameters, SetParameters, SetParametersAtomically,
};
use minifactory_msgs::type_description_interfaces::srv::GetTypeDescription;
use minifactory_msgs::{Message, Service};
use rustix::process::{Pid, Signal, kill_process};

use crate::up::interfaces;

/// How long the suite may take to come up or to go, wall time.
const PATIENCE: Duration = Duration::from_secs(20);
/// Between two looks at the graph.
const LOOK: Duration = Duration::from_millis(2);

/// Start and stop the suite, and time how its endpoints are matched and how it leaves the ROS graph.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// How often
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// Scenario file (YAML); without it the built-in scenario runs
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// All nodes in one process
    #[arg(long)]
    composed: bool,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// What one start and stop took.
struct Timing {
    /// From the start of the command until every endpoint is matched by a counterpart outside.
    matched: Duration,
    /// Until simulated time was first heard outside.
    ticking: Duration,
    /// From SIGTERM until the command has ended.
    ended: Duration,
    /// From there until nothing is left of it on the graph.
    gone: Duration,
}

/// A counterpart for every endpoint of the suite.
struct Outside {
    participant: Participant,
    /// With the number of writers each is to find.
    readers: Vec<(Reader, usize)>,
    clients: Vec<Client>,
    ticks: Arc<AtomicU64>,
}

/// Runs the check and prints a line for each start, then medians and worst.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let plan = load_plan(args.scenario.as_deref())?;
    let mut domain = Domain::from_env()?;
    domain.id = args.domain.unwrap_or(domain.id);
    let outside = Outside::open(&domain, &plan)?;
    let endpoints = outside.readers.iter().map(|(_, writers)| writers).sum::<usize>() + outside.clients.len();
    println!("{endpoints} endpoints in domain {}", domain.id);
    println!("run  matched_s  ticking_s  ended_s  gone_s");
    let mut timings = Vec::new();
    for number in 1..=args.runs {
        let timing = outside.start_and_stop(args, &domain).with_context(|| format!("run {number}"))?;
        println!("{number:3}  {}", row(&Timing::COLUMNS.map(|column| column(&timing))));
        timings.push(timing);
    }
    let sorted = Timing::COLUMNS.map(|column| {
        let mut times: Vec<Duration> = timings.iter().map(column).collect();
        times.sort();
        times
    });
    println!("median  {}", row(&sorted.each_ref().map(|times| times[times.len() / 2])));
    println!("worst  {}", row(&sorted.each_ref().map(|times| times[times.len() - 1])));
    Ok(())
}

fn row(times: &[Duration; 4]) -> String {
    times.map(|time| format!("{:.3}", time.as_secs_f64())).join("  ")
}

impl Timing {
    const COLUMNS: [fn(&Self) -> Duration; 4] =
        [|timing| timing.matched, |timing| timing.ticking, |timing| timing.ended, |timing| timing.gone];
}

impl Outside {
    fn open(domain: &Domain, plan: &RunPlan) -> anyhow::Result<Self> {
        let participant = Participant::open(domain, &NodeName::new("/", "graph_check")?)?;
        let ticks = Arc::new(AtomicU64::new(0));
        let clock = participant.topic_reader(&CLOCK, "", {
            let ticks = Arc::clone(&ticks);
            move |_| _ = ticks.fetch_add(1, Ordering::Relaxed)
        })?;
        let mut outside = Self { participant, readers: vec![(clock, 1)], clients: Vec::new(), ticks };
        outside.meet_housekeeping("/feeder_up")?;
        for (node, interface) in interfaces(plan)? {
            for port in &interface.ports {
                outside.meet(port)?;
            }
            outside.meet_housekeeping(&node)?;
        }
        Ok(outside)
    }

    fn meet(&mut self, port: &Port) -> anyhow::Result<()> {
        match port.kind {
            PortKind::Publish => {
                let topic = format!("rt{}", port.name);
                match self.readers.iter_mut().find(|(reader, _)| reader.topic() == topic) {
                    Some((_, writers)) => *writers += 1,
                    None => {
                        let reader = self.participant.reader(&port.name, &port.dds_types[0], &port.qos, |_| {})?;
                        self.readers.push((reader, 1));
                    }
                }
            }
            PortKind::Serve => {
                self.clients.push(self.participant.client(&port.name, &port.dds_types[0], &port.dds_types[1])?);
            }
            PortKind::Subscribe(_) | PortKind::Call(_) => {}
        }
        Ok(())
    }

    /// What every node offers.
    fn meet_housekeeping(&mut self, node: &str) -> anyhow::Result<()> {
        self.meet(&publisher(&ROSOUT))?;
        self.meet(&publisher(&PARAMETER_EVENTS))?;
        self.meet(&publisher(&DIAGNOSTICS))?;
        self.meet_service::<ListParameters>(node, "list_parameters")?;
        self.meet_service::<GetParameters>(node, "get_parameters")?;
        self.meet_service::<GetParameterTypes>(node, "get_parameter_types")?;
        self.meet_service::<DescribeParameters>(node, "describe_parameters")?;
        self.meet_service::<SetParameters>(node, "set_parameters")?;
        self.meet_service::<SetParametersAtomically>(node, "set_parameters_atomically")?;
        self.meet_service::<GetTypeDescription>(node, "get_type_description")
    }

    fn meet_service<S: Service>(&mut self, node: &str, name: &str) -> anyhow::Result<()> {
        let types = (S::Request::INFO.dds_type(), S::Response::INFO.dds_type());
        self.clients.push(self.participant.client(&format!("{node}/{name}"), &types.0, &types.1)?);
        Ok(())
    }

    fn start_and_stop(&self, args: &Args, domain: &Domain) -> anyhow::Result<Timing> {
        self.ticks.store(0, Ordering::Relaxed);
        let started = Instant::now();
        let mut suite = start(args, domain)?;
        let up = self.wait_until_up(&mut suite, started);
        let stopped = Instant::now();
        let pid = i32::try_from(suite.id()).ok().and_then(Pid::from_raw).context("no process id")?;
        if suite.try_wait()?.is_none() {
            kill_process(pid, Signal::TERM).context("cannot stop the suite")?;
        }
        let status = wait(|| suite.try_wait().transpose());
        let ended = stopped.elapsed();
        let Some(status) = status else {
            suite.kill()?;
            bail!("still there {PATIENCE:?} after SIGTERM");
        };
        let (matched, ticking) = up?;
        let status = status?;
        if !status.success() {
            bail!("left with {status} after SIGTERM");
        }
        if wait(|| self.left().is_empty().then_some(())).is_none() {
            bail!("a ghost is left on the graph: {}", self.left().join(", "));
        }
        Ok(Timing { matched, ticking, ended, gone: stopped.elapsed() - ended })
    }

    /// Waits until everything is matched and time passes, and says when.
    fn wait_until_up(&self, suite: &mut Child, started: Instant) -> anyhow::Result<(Duration, Duration)> {
        let (mut matched, mut ticking) = (None, None);
        let up = wait(|| {
            if matched.is_none() && self.unmatched().is_empty() {
                matched = Some(started.elapsed());
            }
            if ticking.is_none() && self.ticks.load(Ordering::Relaxed) > 0 {
                ticking = Some(started.elapsed());
            }
            let ended = suite.try_wait().ok().flatten().map(Err);
            ended.or_else(|| matched.zip(ticking).map(Ok))
        });
        match up {
            Some(Ok(times)) => Ok(times),
            Some(Err(status)) => bail!("the suite left before it was up: {status}"),
            None => bail!("after {PATIENCE:?} still missing: {}", self.unmatched().join(", ")),
        }
    }

    /// What has not found its counterpart.
    fn unmatched(&self) -> Vec<String> {
        let readers = self.readers.iter().filter(|(reader, writers)| reader.matched_writers() < *writers);
        let clients = self.clients.iter().filter(|client| !client.is_available());
        readers
            .map(|(reader, _)| reader.topic().to_owned())
            .chain(clients.map(|client| client.name().to_owned()))
            .collect()
    }

    /// What is still on the graph beside this process.
    fn left(&self) -> Vec<String> {
        let graph = self.participant.discovered();
        let endpoints = graph.writers.iter().chain(&graph.readers).map(|endpoint| endpoint.topic.clone());
        graph.nodes.iter().map(|node| node.name.clone()).chain(endpoints).collect()
    }
}

fn publisher<M: Message>(topic: &TopicSpec<M>) -> Port {
    let (ros_type, dds_types) = (M::INFO.ros_type(), vec![topic.dds_type()]);
    Port { kind: PortKind::Publish, name: topic.name_in(""), ros_type, dds_types, qos: topic.qos() }
}

fn start(args: &Args, domain: &Domain) -> anyhow::Result<Child> {
    let mut command = Command::new(std::env::current_exe().context("cannot find this executable")?);
    command.args(["up", "--speed", "1", "--duration", "3600", "--domain", &domain.id.to_string()]);
    if let Some(scenario) = &args.scenario {
        command.arg("--scenario").arg(scenario);
    }
    if args.composed {
        command.arg("--composed");
    }
    command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().context("cannot start the suite")
}

fn wait<T>(mut found: impl FnMut() -> Option<T>) -> Option<T> {
    let give_up = Instant::now() + PATIENCE;
    while Instant::now() < give_up {
        if let Some(found) = found() {
            return Some(found);
        }
        std::thread::sleep(LOOK);
    }
    None
}
