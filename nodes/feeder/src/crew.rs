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
use feeder_scenario::plan::RunPlan;

use crate::table::{name_of, placed};

/// A node running in a thread of this process.
pub(crate) type NodeThread = JoinHandle<Result<(), RunError>>;

/// The nodes of a run, whichever way they live.
pub(crate) enum Crew {
    Threads(Vec<(String, Option<NodeThread>)>),
    Processes { children: Vec<(String, Child)>, lines: Receiver<String> },
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

    /// Starts every node of the plan as a process of this executable. Files for them go to `work`.
    pub(crate) fn processes(
        work: &Path,
        plan: &RunPlan,
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
        for (entry, planned) in placed(plan) {
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
            children.push((name, child));
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
                for (name, child) in children {
                    if let Ok(Some(status)) = child.try_wait() {
                        return Err(format!("{name} is gone ({status})"));
                    }
                }
            }
        }
        Ok(())
    }

    /// Waits until every node has left, at most for `limit`; processes that stay longer are killed.
    ///
    /// # Errors
    /// The names of the nodes that failed or had to be killed.
    pub(crate) fn finish(mut self, limit: Duration, mut line: impl FnMut(&str)) -> anyhow::Result<()> {
        let deadline = Instant::now() + limit;
        let mut failed = Vec::new();
        while !self.all_gone() && Instant::now() < deadline {
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
                for (name, mut child) in children {
                    match child.try_wait()? {
                        Some(status) if status.success() => {}
                        Some(status) => failed.push(format!("{name}: {status}")),
                        None => {
                            child.kill()?;
                            child.wait()?;
                            failed.push(format!("{name} did not leave within {limit:?} and was killed"));
                        }
                    }
                }
            }
        }
        if failed.is_empty() { Ok(()) } else { bail!(failed.join("; ")) }
    }

    fn all_gone(&mut self) -> bool {
        match self {
            Self::Threads(threads) => {
                threads.iter().all(|(_, thread)| thread.as_ref().is_none_or(JoinHandle::is_finished))
            }
            Self::Processes { children, .. } => {
                children.iter_mut().all(|(_, child)| !matches!(child.try_wait(), Ok(None)))
            }
        }
    }
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
