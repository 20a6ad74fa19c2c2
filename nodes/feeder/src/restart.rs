//! `feeder node --restart`: a node that is started again when something has ended it.

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Command, ExitCode, ExitStatus};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use rustix::process::{Pid, Signal, kill_process};

use crate::up::stop_on_signals;

/// How often a node is started again within [`WITHIN`] before it is given up.
const RESTARTS_MAX: usize = 5;
const WITHIN: Duration = Duration::from_secs(60);
const LOOK: Duration = Duration::from_millis(20);

/// Runs the node `name` with these options in a process of its own, and starts it again when a signal has ended it, as
/// where it ran out of memory. One that leaves by itself has said why, and stays away.
pub(crate) fn run(name: &str, options: &[OsString]) -> anyhow::Result<ExitCode> {
    let stop = stop_on_signals()?;
    let executable = std::env::current_exe().context("cannot find this executable")?;
    let mut ends: Vec<Instant> = Vec::new();
    loop {
        let mut child = Command::new(&executable).args(["node", name, "--"]).args(options).spawn()?;
        let mut is_told = false;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            if stop.load(Ordering::Relaxed) && !is_told {
                is_told = true;
                let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw).context("no process id")?;
                kill_process(pid, Signal::TERM)?;
            }
            std::thread::sleep(LOOK);
        };
        let Some(signal) = status.signal().filter(|_| !stop.load(Ordering::Relaxed)) else { return Ok(code(status)) };
        ends.retain(|end| end.elapsed() < WITHIN);
        if ends.len() >= RESTARTS_MAX {
            bail!("{name} was ended {} times within {WITHIN:?}, last by signal {signal}", ends.len() + 1);
        }
        ends.push(Instant::now());
        tracing::error!("{name} was ended by signal {signal}, and is started again");
    }
}

fn code(status: ExitStatus) -> ExitCode {
    status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from)
}
