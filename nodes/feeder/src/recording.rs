//! `feeder up --record`: everything a run publishes goes into a bag, with what is needed to run it again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow};
use feeder_bag_transport::record::{definitions, record_run};
use feeder_runtime::lockstep::LoopContract;
use feeder_runtime::recording::RunListener;
use feeder_scenario::plan::RunPlan;
use regex::Regex;
use ros2_bags::{BagError, BagWriter, Distribution, NewAttachment, Selection, WriteSettings};

/// Attachment with the plan of the run, the scenario's text included.
pub(crate) const PLAN: &str = "plan.yaml";
/// Metadata record with what else the run depends on.
pub(crate) const RUN: &str = "feeder_run";
/// Metadata record with how it ended.
pub(crate) const RUN_END: &str = "feeder_run_end";
/// Key of the number of ticks in [`RUN_END`].
pub(crate) const TICKS: &str = "ticks";

/// Options of a recorded run.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct RecordOptions {
    /// Record everything the run publishes to this folder, a ROS 2 bag (MCAP), and what it takes to run it again
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Leave out topics whose name matches this pattern, such as camera/(image_raw|annotated)$
    #[arg(long, value_name = "REGEX", requires = "record")]
    pub record_exclude: Option<Regex>,
    /// Write the bag for the tools of this distribution: humble, iron, jazzy, kilted or lyrical
    #[arg(long, value_name = "DISTRO", requires = "record", default_value_t)]
    pub record_compat: Distribution,
    /// These topics only; set by `feeder bag rerun`
    #[arg(skip)]
    pub record_topics: Option<Vec<String>>,
}

/// A run being recorded.
pub(crate) struct Recording {
    socket: PathBuf,
    over: Arc<AtomicBool>,
    thread: JoinHandle<(BagWriter, Result<(), BagError>)>,
}

impl Recording {
    /// Begins the bag, and listens to the nodes of `contract` at a socket in `work`.
    pub(crate) fn start(
        options: &RecordOptions,
        work: &Path,
        contract: &LoopContract,
        plan: &RunPlan,
    ) -> anyhow::Result<Option<Self>> {
        let Some(folder) = &options.record else { return Ok(None) };
        let settings = WriteSettings { distribution: options.record_compat, ..WriteSettings::default() };
        let mut writer = BagWriter::create(folder, settings)?;
        let data = plan.to_yaml()?.into_bytes();
        let (name, media_type) = (PLAN.to_owned(), "application/yaml".to_owned());
        writer.attach(NewAttachment { name, media_type, data })?;
        let facts = [
            ("feeder_version", plan.provenance.version.clone()),
            ("seed", plan.provenance.seed.to_string()),
            ("tick_ns", contract.timing.tick_ns.to_string()),
        ];
        let facts: BTreeMap<String, String> = facts.map(|(key, value)| (key.to_owned(), value)).into();
        writer.add_record(RUN, facts)?;
        let selection = Selection {
            topics: options.record_topics.clone().unwrap_or_default(),
            exclude_regex: options.record_exclude.clone(),
            ..Selection::default()
        };
        let socket = work.join("recorder");
        let listener = RunListener::bind(&socket, contract, move |topic| selection.takes(&topic.name, &topic.ros_type))
            .with_context(|| format!("cannot listen at {}", socket.display()))?;
        let over = Arc::new(AtomicBool::new(false));
        let (tick_ns, definitions, is_over) = (contract.timing.tick_ns, definitions(), Arc::clone(&over));
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn(move || {
            let result = record_run(&mut writer, &listener, tick_ns, &definitions, &is_over);
            drop(listener);
            (writer, result)
        })?;
        Ok(Some(Self { socket, over, thread }))
    }

    /// Where the nodes hand over what they publish.
    pub(crate) fn socket(&self) -> &Path {
        &self.socket
    }

    /// Whether recording has ended before the run.
    pub(crate) fn has_failed(&self) -> bool {
        self.thread.is_finished()
    }

    /// Closes the bag after a run of so many ticks.
    ///
    /// # Errors
    /// Why recording failed, if it did. The bag is closed as well as it can be.
    pub(crate) fn finish(self, ticks: u64) -> anyhow::Result<()> {
        self.over.store(true, Ordering::Relaxed);
        let (mut writer, result) = self.thread.join().map_err(|_| anyhow!("the recorder panicked"))?;
        let folder = writer.folder().to_owned();
        if result.is_ok() {
            writer.add_record(RUN_END, BTreeMap::from([(TICKS.to_owned(), ticks.to_string())]))?;
        }
        let finished = match result {
            Err(BagError::Full { .. }) | Ok(()) => writer.finish().map(|_| ()),
            Err(_) => Ok(()),
        };
        result.context("the recording failed")?;
        finished.with_context(|| format!("cannot close the bag {}", folder.display()))
    }
}
