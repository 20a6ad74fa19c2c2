//! A suite in processes of its own, as a user starts it.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use anyhow::{Context as _, Result, anyhow, ensure};
use feeder_scenario::Scenario;
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

/// How long a suite may take until it tells where its page is.
const START_LIMIT: Duration = Duration::from_secs(120);
/// What a run writes.
const SUMMARY: &str = "summary.json";
const DIGEST: &str = "digest.txt";
/// What stands before the page's address.
const PLACE: &str = "see it live at http://";

/// How fast a suite goes, and until when.
#[derive(Clone, Copy)]
pub(super) enum Pace {
    /// As fast as real time, without end.
    RealTime,
    /// As fast as it can, for so many simulated seconds; it keeps fingerprints.
    Full(u64),
}

/// A suite. Dropped, it is ended.
pub(super) struct Suite {
    child: Child,
    lines: Receiver<String>,
    address: Option<SocketAddr>,
    work: TempDir,
    /// Processor time of this process's children before it, s.
    before_s: f64,
}

/// How a run came out.
pub(super) struct Outcome {
    pub(super) real_time_factor: f64,
    /// Processor time of all its processes from start to end, s.
    pub(super) cpu_s: f64,
    pub(super) digest: String,
}

impl Suite {
    /// Starts `feeder up` with these options and this scenario, and waits until its page is there if it is to have one.
    pub(super) fn start(
        feeder: &Path,
        options: &[&str],
        scenario: &Scenario,
        pace: Pace,
        has_view: bool,
    ) -> Result<Self> {
        let work = tempfile::tempdir().context("cannot make a temporary folder")?;
        let file = work.path().join("scenario.yaml");
        std::fs::write(&file, scenario.to_yaml()?).context("cannot write the scenario")?;
        let mut command = Command::new(feeder);
        command.args(["up", "--plain"]).args(options).arg("--scenario").arg(&file);
        match pace {
            Pace::RealTime => _ = command.args(["--speed", "1", "--duration", "86400"]),
            Pace::Full(duration_s) => {
                command.args(["--speed", "max", "--duration", &duration_s.to_string()]);
                command.arg("--summary").arg(work.path().join(SUMMARY));
                command.arg("--digest").arg(work.path().join(DIGEST));
            }
        }
        if has_view {
            command.arg("--view=0");
        }
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let before_s = children_cpu_s()?;
        let mut child = command.spawn().with_context(|| format!("cannot start {}", feeder.display()))?;
        let stderr = child.stderr.take().context("its standard error is not there")?;
        let (sender, lines) = channel();
        // Reads to the end, so that the suite never waits for a reader.
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        let mut suite = Self { child, lines, address: None, work, before_s };
        if has_view {
            suite.address = Some(suite.told_address()?);
        }
        Ok(suite)
    }

    fn told_address(&self) -> Result<SocketAddr> {
        let mut said = Vec::new();
        loop {
            let line = self.lines.recv_timeout(START_LIMIT);
            let line = line.map_err(|_| anyhow!("the suite has not told where its page is: {}", said.join("\n")))?;
            if let Some(address) = line.split_once(PLACE).and_then(|(_, rest)| rest.split('/').next()) {
                return address.parse().with_context(|| line.clone());
            }
            said.push(line);
        }
    }

    /// Where its page is.
    pub(super) fn address(&self) -> Result<SocketAddr> {
        self.address.context("the suite has no page")
    }

    /// Processor time of its processes that run now, s.
    pub(super) fn cpu_s(&self) -> Result<f64> {
        let all: Vec<Stat> = std::fs::read_dir("/proc")?
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
            .filter_map(stat)
            .collect();
        let mut ours = BTreeSet::from([self.child.id()]);
        // Children come after their parents, unless numbers have begun anew.
        while all.iter().any(|stat| ours.contains(&stat.parent) && ours.insert(stat.id)) {}
        Ok(all.iter().filter(|stat| ours.contains(&stat.id)).map(|stat| stat.own_s).sum())
    }

    /// Waits for its end, which must be a good one.
    pub(super) fn outcome(mut self) -> Result<Outcome> {
        let status = self.child.wait()?;
        let said = || self.lines.try_iter().collect::<Vec<_>>().join("\n");
        ensure!(status.success(), "the suite has ended with {status}: {}", said());
        let summary: serde_json::Value = serde_json::from_str(&super::read(&self.work.path().join(SUMMARY))?)?;
        Ok(Outcome {
            real_time_factor: summary["real_time_factor"].as_f64().context("the summary has no real_time_factor")?,
            cpu_s: children_cpu_s()? - self.before_s,
            digest: super::read(&self.work.path().join(DIGEST))?,
        })
    }

    /// Ends it, as Ctrl-C does, and waits until it has.
    pub(super) fn end(mut self) -> Result<()> {
        self.interrupt();
        let status = self.child.wait()?;
        ensure!(status.success(), "the suite has ended with {status}");
        Ok(())
    }

    fn interrupt(&self) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        // One that is gone needs no signal.
        pid.into_iter().for_each(|pid| _ = kill_process(pid, Signal::INT));
    }
}

impl Drop for Suite {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            self.interrupt();
            let _ = self.child.wait();
        }
    }
}

/// What the system tells of a process.
struct Stat {
    id: u32,
    parent: u32,
    /// Its own processor time, s.
    own_s: f64,
    /// That of its children that have ended and been waited for, and of theirs, s.
    waited_s: f64,
}

fn stat(id: u32) -> Option<Stat> {
    let text = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The name before stands in brackets and may hold anything. What follows begins with the third field.
    let fields: Vec<&str> = text[text.rfind(')')? + 1..].split_whitespace().collect();
    let field = |number: usize| fields.get(number - 3)?.parse::<f64>().ok();
    let tick_s = 1.0 / rustix::param::clock_ticks_per_second() as f64;
    let parent = fields.get(1)?.parse().ok()?;
    let time_s = |user: usize| Some(tick_s * (field(user)? + field(user + 1)?));
    Some(Stat { id, parent, own_s: time_s(14)?, waited_s: time_s(16)? })
}

/// Processor time of this process's children that have ended, and of theirs, s.
fn children_cpu_s() -> Result<f64> {
    Ok(stat(std::process::id()).context("cannot read /proc: processor time is told on Linux alone")?.waited_s)
}
