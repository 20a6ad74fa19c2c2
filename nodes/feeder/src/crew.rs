//! The nodes of a run, as processes or as threads: started, watched, and waited for.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use feeder_runtime::dds::{DiscoveryRange, Domain};
use feeder_runtime::launch::Seat;
use feeder_runtime::lockstep::{LoopContract, RunError};
use feeder_runtime::patience::{Patience, share_of_machine};
use feeder_scenario::plan::RunPlan;

use crate::table::{name_of, placed};

/// A node running in a thread of this process.
pub(crate) type NodeThread = JoinHandle<Result<(), RunError>>;

/// How long a node's process may be stopped before the run is ended: unlike one that a busy machine keeps waiting, it
/// does not go on by itself.
const STOPPED_LIMIT: Duration = Duration::from_secs(2);

/// The nodes of a run, whichever way they live.
pub(crate) enum Crew {
    Threads(Vec<(String, Option<NodeThread>)>),
    Processes { children: Vec<NodeProcess>, lines: Receiver<String> },
}

/// A node running as a process.
pub(crate) struct NodeProcess {
    name: String,
    child: Child,
    /// Since when it has been seen stopped.
    stopped_at: Option<Instant>,
}

/// How long nodes may take to leave.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Leave {
    /// Long, and longer on a busy machine: the run has ended well and so should they.
    InOrder,
    /// Short: one of them may hang, and the user waits for the reason.
    AtOnce,
}

impl Crew {
    /// Starts every node of the plan in a thread.
    pub(crate) fn threads(seat: &impl Fn(&str) -> Seat, plan: &RunPlan) -> anyhow::Result<Self> {
        let mut threads = Vec::new();
        for (entry, planned) in placed(plan) {
            let (seat, name, planned) = (seat(&planned.namespace), name_of(planned), planned.clone());
            let thread = std::thread::Builder::new().name(entry.name.to_owned());
            let thread = thread.spawn(move || (entry.run)(&seat, &planned))?;
            threads.push((name, Some(thread)));
        }
        Ok(Self::Threads(threads))
    }

    /// Starts the nodes of the plan that are `here`, by their full names, as processes of this executable. Files for them
    /// go to `work`.
    pub(crate) fn processes(
        work: &Path,
        plan: &RunPlan,
        here: impl Fn(&str) -> bool,
        contract: &LoopContract,
        domain: &Domain,
        digest_dir: Option<&Path>,
        record_to: Option<&Path>,
    ) -> anyhow::Result<Self> {
        let contract_file = work.join("contract.json");
        std::fs::write(&contract_file, serde_json::to_vec(contract)?)?;
        let plan_file = work.join("plan.yaml");
        std::fs::write(&plan_file, plan.to_yaml()?)?;
        let executable = std::env::current_exe().context("cannot find this executable")?;
        let (sender, lines) = channel();
        let mut children = Vec::new();
        for (entry, planned) in placed(plan).filter(|(_, planned)| here(&name_of(planned))) {
            let mut command = Command::new(&executable);
            command.args(["node", entry.name, "--namespace", &planned.namespace]);
            command.arg("--config").arg(&plan_file).arg("--loop").arg(&contract_file);
            if let Some(dir) = digest_dir {
                command.arg("--digest-dir").arg(dir);
            }
            if let Some(socket) = record_to {
                command.arg("--record-to").arg(socket);
            }
            export(domain, &mut command);
            own_process_group(&mut command);
            let name = name_of(planned);
            let mut child = command
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .with_context(|| format!("cannot start {name}"))?;
            forward_lines(&mut child, &sender)?;
            children.push(NodeProcess { name, child, stopped_at: None });
        }
        Ok(Self::Processes { children, lines })
    }

    /// Hands over the lines that processes have written since the last call.
    pub(crate) fn for_each_line(&self, mut line: impl FnMut(&str)) {
        if let Self::Processes { lines, .. } = self {
            for text in lines.try_iter() {
                line(&text);
            }
        }
    }

    /// Finds nodes that are gone although the run goes on.
    ///
    /// # Errors
    /// The name of a node that has left, and how.
    pub(crate) fn check(&mut self) -> Result<(), String> {
        match self {
            Self::Threads(threads) => {
                for (name, thread) in threads {
                    if thread.as_ref().is_some_and(JoinHandle::is_finished)
                        && let Some(thread) = thread.take()
                    {
                        return Err(match thread.join() {
                            Ok(Ok(())) => format!("{name} left the loop"),
                            Ok(Err(error)) => format!("{name} failed: {error}"),
                            Err(_) => format!("{name} panicked"),
                        });
                    }
                }
            }
            Self::Processes { children, .. } => {
                for process in children {
                    process.check()?;
                }
            }
        }
        Ok(())
    }

    /// Waits until every node has left; processes that stay too long are killed.
    ///
    /// # Errors
    /// The names of the nodes that failed or had to be killed.
    pub(crate) fn finish(mut self, leave: Leave, mut line: impl FnMut(&str)) -> anyhow::Result<()> {
        let (since, mut patience) = (Instant::now(), Patience::default());
        let mut has_time = || match leave {
            Leave::InOrder => patience.spent(since.elapsed(), share_of_machine) < Duration::from_secs(5),
            Leave::AtOnce => since.elapsed() < Duration::from_secs(1),
        };
        let mut failed = Vec::new();
        while !self.all_gone() && has_time() {
            self.for_each_line(&mut line);
            std::thread::sleep(Duration::from_millis(5));
        }
        self.for_each_line(&mut line);
        match self {
            Self::Threads(threads) => {
                for (name, thread) in threads {
                    match thread {
                        Some(thread) if !thread.is_finished() => failed.push(format!("{name} did not leave")),
                        Some(thread) => match thread.join() {
                            Ok(Ok(())) => {}
                            Ok(Err(error)) => failed.push(format!("{name}: {error}")),
                            Err(_) => failed.push(format!("{name} panicked")),
                        },
                        None => {}
                    }
                }
            }
            Self::Processes { children, .. } => {
                for NodeProcess { name, mut child, .. } in children {
                    match child.try_wait()? {
                        Some(status) if status.success() => {}
                        Some(status) => failed.push(format!("{name}: {status}")),
                        None => {
                            child.kill()?;
                            child.wait()?;
                            failed.push(format!("{name} did not leave within {:?} and was killed", since.elapsed()));
                        }
                    }
                }
            }
        }
        if failed.is_empty() { Ok(()) } else { bail!(failed.join("; ")) }
    }

    pub(crate) fn all_gone(&mut self) -> bool {
        match self {
            Self::Threads(threads) => {
                threads.iter().all(|(_, thread)| thread.as_ref().is_none_or(JoinHandle::is_finished))
            }
            Self::Processes { children, .. } => {
                children.iter_mut().all(|process| !matches!(process.child.try_wait(), Ok(None)))
            }
        }
    }
}

impl NodeProcess {
    /// Finds out whether the node is there and may run.
    fn check(&mut self) -> Result<(), String> {
        let Self { name, child, stopped_at } = self;
        if let Ok(Some(status)) = child.try_wait() {
            return Err(format!("{name} is gone ({status})"));
        }
        if !is_stopped(child.id()) {
            *stopped_at = None;
            return Ok(());
        }
        let since = *stopped_at.get_or_insert_with(Instant::now);
        if since.elapsed() < STOPPED_LIMIT {
            return Ok(());
        }
        Err(format!("{name} has been stopped for {:.1} s, as SIGSTOP does it", since.elapsed().as_secs_f64()))
    }
}

/// Whether a signal has stopped a process; where the system does not tell, it is taken to run.
fn is_stopped(process_id: u32) -> bool {
    // The state comes after the name, which is in brackets and may hold any character.
    let status = std::fs::read_to_string(format!("/proc/{process_id}/stat"));
    status.is_ok_and(|text| text.rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with('T')))
}

/// Hands the domain down in the variables that every ROS 2 program reads.
fn export(domain: &Domain, command: &mut Command) {
    let range = match domain.range {
        DiscoveryRange::Localhost => "LOCALHOST",
        DiscoveryRange::Subnet => "SUBNET",
        DiscoveryRange::Off => "OFF",
    };
    command.env("ROS_DOMAIN_ID", domain.id.to_string());
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", range);
    command.env_remove("ROS_LOCALHOST_ONLY");
    let peers: Vec<String> = domain.peers.hosts().iter().map(ToString::to_string).collect();
    command.env("ROS_STATIC_PEERS", peers.join(";"));
}

/// A Ctrl-C in the terminal goes to `feeder up` alone, which ends the run in order.
fn own_process_group(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;
    command.process_group(0);
}

fn forward_lines(child: &mut Child, sender: &Sender<String>) -> anyhow::Result<()> {
    if let Some(stderr) = child.stderr.take() {
        let sender = sender.clone();
        std::thread::Builder::new().name("log".to_owned()).spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        })?;
    }
    Ok(())
}
