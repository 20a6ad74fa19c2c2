//! `feeder join`: starts on this host nodes that a `feeder up --except` on another has left to others.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use feeder_runtime::dds::Domain;
use feeder_runtime::lockstep::LoopContract;
use feeder_scenario::plan::RunPlan;

use crate::crew::{Crew, Leave};
use crate::muster::{Call, Line, VERSION, Word, list};
use crate::up::{domain, stop_on_signals};

/// Between offers, and between looks at the nodes.
const PERIOD: Duration = Duration::from_millis(500);
const LOOK: Duration = Duration::from_millis(50);
/// How long after a run another one may begin, as after a reset.
const NEXT_RUN: Duration = Duration::from_secs(3);
/// How long an answer has to arrive.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// Bytes of a digest in one message.
const PART_BYTES: usize = 16_000;

/// Start nodes of a run that `feeder up --except` keeps on another host.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct JoinArgs {
    /// Full names of the nodes, as that command says them; without any all that it still waits for
    #[arg(value_name = "NODE")]
    nodes: Vec<String>,
    /// DDS domain, instead of ROS_DOMAIN_ID
    #[arg(long, value_parser = clap::value_parser!(u16).range(0..=232), allow_negative_numbers = true)]
    domain: Option<u16>,
}

/// One offer and what came of it.
struct Joining {
    domain: Domain,
    line: Line,
    calls: Receiver<Call>,
    crew: u64,
    nodes: BTreeSet<String>,
    stop: Arc<AtomicBool>,
}

/// A share of a run.
struct Share {
    plan: RunPlan,
    contract: Box<LoopContract>,
    nodes: BTreeSet<String>,
    digests: bool,
}

/// Offers the nodes, and runs them until the run has ended.
pub(crate) fn run(args: &JoinArgs) -> anyhow::Result<()> {
    let domain = domain(args.domain)?;
    let stop = stop_on_signals()?;
    let (line, calls) = Line::of_crew(&domain)?;
    tracing::info!("waiting for a `feeder up --except` in domain {}", domain.id);
    let joining =
        Joining { domain, line, calls, crew: rand::random(), nodes: args.nodes.iter().cloned().collect(), stop };
    let Some(mut share) = joining.first()? else { return Ok(()) };
    loop {
        let run_id = share.contract.run_id;
        let outcome = joining.run(&share);
        let error = outcome.as_ref().err().map(|error| format!("{error:#}"));
        joining.line.say(&Word::Done { crew: joining.crew, run_id, error })?;
        ensure!(joining.line.is_heard(ANSWER_LIMIT), "nobody hears how the run ended here; {}", told(&outcome));
        match joining.next(run_id)? {
            Some(next) => share = next,
            None => return outcome,
        }
    }
}

fn told(outcome: &anyhow::Result<()>) -> String {
    outcome.as_ref().map_or_else(|error| format!("{error:#}"), |()| "well".to_owned())
}

impl Joining {
    /// Offers the nodes until a run begins; none when the user wants no more.
    fn first(&self) -> anyhow::Result<Option<Share>> {
        let host = host_name();
        let mut offered: Option<Instant> = None;
        while !self.stop.load(Ordering::Relaxed) {
            if offered.is_none_or(|last| last.elapsed() >= PERIOD) {
                offered = Some(Instant::now());
                let (host, version) = (host.clone(), VERSION.to_owned());
                self.line.say(&Word::Offer { crew: self.crew, host, version, nodes: self.nodes.clone() })?;
            }
            match self.calls.recv_timeout(LOOK) {
                Ok(call) => {
                    if let Some(share) = self.share(call)? {
                        return Ok(Some(share));
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => bail!("the DDS library has stopped"),
            }
        }
        Ok(None)
    }

    /// The share in a run that begins after the one with this number.
    fn next(&self, run_id: u64) -> anyhow::Result<Option<Share>> {
        let since = Instant::now();
        while since.elapsed() < NEXT_RUN && self.line.has_caller() && !self.stop.load(Ordering::Relaxed) {
            if let Ok(call) = self.calls.recv_timeout(LOOK)
                && let Some(share) = self.share(call)?
                && share.contract.run_id != run_id
            {
                return Ok(Some(share));
            }
        }
        Ok(None)
    }

    fn share(&self, call: Call) -> anyhow::Result<Option<Share>> {
        match call {
            Call::Wanted { version, nodes } => {
                ensure!(version == VERSION, "the run is of version {version}, this is {VERSION}");
                if let Some(other) = self.nodes.iter().find(|node| !nodes.contains(*node)) {
                    bail!("{other} is not left to others; wanted are {}", list(&nodes));
                }
                Ok(None)
            }
            Call::Go { mut crews, plan, contract, digests } => {
                let Some(nodes) = crews.remove(&self.crew) else { return Ok(None) };
                let plan = RunPlan::from_yaml(&plan).context("the plan of the run")?;
                Ok(Some(Share { plan, contract, nodes, digests }))
            }
        }
    }

    /// Runs a share until its nodes have left.
    fn run(&self, share: &Share) -> anyhow::Result<()> {
        let work = tempfile::tempdir().context("cannot make a temporary folder")?;
        let digests = work.path().join("digests");
        std::fs::create_dir(&digests)?;
        let digest_dir = share.digests.then_some(digests.as_path());
        tracing::info!("starting {}", list(&share.nodes));
        let here = |node: &str| share.nodes.contains(node);
        let mut crew =
            Crew::processes(work.path(), &share.plan, here, &share.contract, &self.domain, digest_dir, None)?;
        let say = |line: &str| eprintln!("{line}");
        while !crew.all_gone() {
            crew.for_each_line(say);
            if self.stop.load(Ordering::Relaxed) {
                crew.finish(Leave::AtOnce, say)?;
                bail!("stopped by a signal");
            }
            std::thread::sleep(LOOK);
        }
        crew.finish(Leave::InOrder, say)?;
        digest_dir.map_or(Ok(()), |dir| self.send_digests(dir, share.contract.run_id))
    }

    fn send_digests(&self, dir: &Path, run_id: u64) -> anyhow::Result<()> {
        for entry in std::fs::read_dir(dir)? {
            let path = entry?.path();
            let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let text = std::fs::read_to_string(&path)?;
            // A digest is JSON in ASCII: any byte is a place to part it.
            for part in text.as_bytes().chunks(PART_BYTES) {
                let (file, text) = (file.clone(), String::from_utf8_lossy(part).into_owned());
                self.line.say(&Word::Digest { crew: self.crew, run_id, file, text })?;
                // A reader that is sent more than it can hold loses some.
                ensure!(self.line.is_heard(ANSWER_LIMIT), "nobody hears what was published here");
            }
        }
        Ok(())
    }
}

/// What this host calls itself.
fn host_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}
