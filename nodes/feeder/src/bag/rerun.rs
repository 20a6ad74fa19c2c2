//! `feeder bag rerun`: runs again what a bag recorded, and says whether the same comes out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use bytes::Bytes;
use feeder_runtime::launch::Recorded;
use feeder_runtime::lockstep::LoopContract;
use feeder_scenario::plan::{PlannedNode, RunPlan};
use ros2_bags::cdr::HEADER_BYTES;
use ros2_bags::diff::{DiffSettings, diff};
use ros2_bags::{Bag, BagError, BagWriter, NewTopic, Query, Selection, WriteSettings};

use crate::recording::{PLAN, RUN_END, RecordOptions, TICKS};
use crate::table::{NODES, NodeEntry, name_of, placed};
use crate::up::{self, UpArgs};

/// Run a recorded scenario again and compare; exit code 0 when the same comes out
#[derive(Debug, clap::Args)]
pub(crate) struct RerunArgs {
    /// A bag of `feeder up --record`
    bag: PathBuf,
    /// Run this node alone, on what it heard in the bag, such as vision_selector
    #[arg(long, value_name = "NODE", value_parser = clap::builder::PossibleValuesParser::new(NODES.iter().map(|entry| entry.name)))]
    only: Option<String>,
    /// One process for each node instead of one for all
    #[arg(long)]
    processes: bool,
    /// Keep the new bag in this folder
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: Option<u16>,
}

/// What a bag says of the run that it holds.
struct Run {
    plan: RunPlan,
    /// Ticks that the bag holds completely.
    ticks: u64,
    /// Whether the bag is cut off: what lies behind those ticks is not whole.
    cut_off: bool,
    tick_ns: u64,
}

/// Runs again and compares.
pub(crate) fn run(args: &RerunArgs) -> anyhow::Result<ExitCode> {
    let bag = super::open(&args.bag)?;
    let run = recorded_run(&bag)?;
    let work = tempfile::tempdir().context("cannot make a temporary folder")?;
    let folder = args.keep.clone().unwrap_or_else(|| work.path().join("rerun"));
    let selection = match &args.only {
        None => {
            run_all(args, &bag, &run, &folder)?;
            Selection { hidden: true, ..Selection::default() }
        }
        Some(node) => Selection::of(run_one(node, &bag, &run, &folder)?),
    };
    let settings = DiffSettings {
        selection,
        // The clock tells the end of the last tick when there is no other message any more.
        before_ns: run.cut_off.then_some(run.ticks * run.tick_ns),
        ..DiffSettings::default()
    };
    Ok(super::show(&diff(&bag, &Bag::open(&folder)?, &settings)))
}

/// The plan of the run that a bag holds.
///
/// # Errors
/// A bag of something else.
pub(crate) fn recorded_plan(bag: &Bag) -> anyhow::Result<RunPlan> {
    let plan = bag.attachment(PLAN)?.with_context(|| {
        format!("{} holds no plan of a run: only a bag of feeder up --record does", bag.path().display())
    })?;
    let plan = String::from_utf8(plan).with_context(|| format!("{PLAN} in the bag"))?;
    RunPlan::from_yaml(&plan).with_context(|| format!("{PLAN} in the bag"))
}

fn recorded_run(bag: &Bag) -> anyhow::Result<Run> {
    let plan = recorded_plan(bag)?;
    let version = &plan.provenance.version;
    if version != env!("CARGO_PKG_VERSION") {
        eprintln!("warning: recorded by version {version}, this is {}", env!("CARGO_PKG_VERSION"));
    }
    let tick_ns = plan.time.tick_ns();
    let ended = bag.records(RUN_END).last().and_then(|facts| facts.get(TICKS));
    let ticks = match ended {
        Some(ticks) => ticks.parse().with_context(|| format!("{ticks:?} is no number of ticks"))?,
        None => {
            // The run or its recorder was cut off: the last tick may lack something.
            let (_, last_ns) = bag.bounds_ns().context("the bag holds no message")?;
            let ticks = (last_ns / tick_ns).saturating_sub(2);
            eprintln!("warning: the bag ends early; the first {ticks} ticks are compared");
            ticks
        }
    };
    if ticks == 0 {
        bail!("the bag holds no complete tick");
    }
    Ok(Run { plan, ticks, cut_off: ended.is_none(), tick_ns })
}

fn run_all(args: &RerunArgs, bag: &Bag, run: &Run, folder: &Path) -> anyhow::Result<()> {
    let topics = bag.topics().iter().map(|topic| topic.name.clone()).collect();
    let recording =
        RecordOptions { record: Some(folder.to_owned()), record_topics: Some(topics), ..RecordOptions::default() };
    let mut plan = run.plan.clone();
    plan.run.duration_s = Duration::from_nanos(run.ticks * run.tick_ns).as_secs_f64();
    up::run_plan(&plan, &UpArgs::again(!args.processes, args.domain, recording))
}

/// Runs one node on its recorded inputs; returns the topics that it publishes and the bag holds.
fn run_one(name: &str, bag: &Bag, run: &Run, folder: &Path) -> anyhow::Result<Vec<String>> {
    let contract = up::connect(&run.plan)?;
    let mut writer = BagWriter::create(folder, WriteSettings::default())?;
    let mut topics: BTreeMap<String, usize> = BTreeMap::new();
    for (entry, planned) in placed(&run.plan).filter(|(entry, _)| entry.name == name) {
        let interface = (entry.interface)(planned)?;
        for topic in bag.topics().iter().filter(|topic| interface.publishes(&topic.name)) {
            let at = writer.add_topic(NewTopic {
                name: topic.name.clone(),
                ros_type: topic.ros_type.clone(),
                schema_encoding: topic.schema_encoding.clone(),
                schema: topic.schema.clone(),
                ..NewTopic::default()
            })?;
            topics.insert(topic.name.clone(), at);
        }
        replay(entry, planned, &contract, bag, run, &topics, &mut writer)
            .with_context(|| format!("cannot run {} alone", name_of(planned)))?;
    }
    writer.finish()?;
    Ok(topics.into_keys().collect())
}

fn replay(
    entry: &NodeEntry,
    planned: &PlannedNode,
    contract: &LoopContract,
    bag: &Bag,
    run: &Run,
    topics: &BTreeMap<String, usize>,
    writer: &mut BagWriter,
) -> anyhow::Result<()> {
    let mut unreadable: Option<BagError> = None;
    let mut messages = bag.messages(&Query::default());
    let mut recorded = std::iter::from_fn(|| match messages.next()? {
        Ok(message) => Some(Recorded {
            topic: bag.topics()[message.topic].name.clone(),
            tick: message.log_ns / run.tick_ns,
            payload: message.data.slice(HEADER_BYTES.min(message.data.len())..),
        }),
        Err(error) => {
            unreadable = Some(error);
            None
        }
    });
    let mut written: Result<(), BagError> = Ok(());
    let wanted = |topic: &str| topics.contains_key(topic);
    let mut publish = |Recorded { topic, tick, payload }: Recorded| {
        if let (Some(&topic), true) = (topics.get(&topic), written.is_ok()) {
            let data = Bytes::from([&[0, 1, 0, 0], &*payload].concat());
            let time_ns = tick * run.tick_ns;
            written = writer.write(topic, time_ns, time_ns, &data);
        }
    };
    (entry.replay)(contract, planned, run.ticks, &mut recorded, &wanted, &mut publish)
        .map_err(|error| anyhow!("{error}"))?;
    written?;
    unreadable.map_or(Ok(()), |error| Err(error.into()))
}
