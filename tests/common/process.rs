//! Other processes, as /proc shows them.

use std::fs;

use nix::sys::{ptrace, wait};
use nix::unistd;
use rustix::process::{Pid, Signal, kill_process};

/// A process, by its number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Process {
    id: u32,
}

impl Process {
    pub(crate) fn new(id: u32) -> Self {
        Self { id }
    }

    /// Sends it a signal, if it still lives.
    pub(crate) fn signal(self, signal: Signal) {
        let id = i32::try_from(self.id).ok().and_then(Pid::from_raw).unwrap();
        // One that is gone needs no signal.
        let _ = kill_process(id, signal);
    }

    /// Its command line.
    pub(crate) fn arguments(self) -> Vec<String> {
        let bytes = fs::read(format!("/proc/{}/cmdline", self.id)).unwrap_or_default();
        bytes.split(|byte| *byte == 0).map(|argument| String::from_utf8_lossy(argument).into_owned()).collect()
    }

    /// Whether it still runs; one that only waits to be taken off the list does not.
    pub(crate) fn is_running(self) -> bool {
        stat(self.id).is_some_and(|stat| stat.state != "Z" && stat.state != "X")
    }

    /// Whether a signal has stopped it.
    pub(crate) fn is_stopped(self) -> bool {
        stat(self.id).is_some_and(|stat| stat.state == "T")
    }

    /// Stops its thread of this name alone, as a debugger does, if it has one by now.
    pub(crate) fn hold_thread(self, name: &str) -> Option<HeldThread> {
        let threads = fs::read_dir(format!("/proc/{}/task", self.id)).ok()?.flatten();
        let named = |id: &i32| {
            let told = fs::read_to_string(format!("/proc/{}/task/{id}/comm", self.id));
            told.is_ok_and(|told| told.trim_end() == name)
        };
        let id = threads.filter_map(|thread| thread.file_name().to_str()?.parse().ok()).find(named)?;
        let id = unistd::Pid::from_raw(id);
        ptrace::seize(id, ptrace::Options::empty()).unwrap();
        ptrace::interrupt(id).unwrap();
        Some(HeldThread { id })
    }

    /// The processes it has started and that still run.
    pub(crate) fn children(self) -> Vec<Self> {
        let ids = fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
        let ids = ids.filter(|id| stat(*id).is_some_and(|stat| stat.parent == self.id));
        ids.map(Self::new).filter(|child| child.is_running()).collect()
    }
}

/// A thread of another process that is held until that ends or puts another in its place. To be asked by the thread that holds it.
#[derive(Debug)]
pub(crate) struct HeldThread {
    id: unistd::Pid,
}

impl HeldThread {
    /// Whether it is gone, which is told once. It goes only when it is asked, as its process waits for the one who holds it.
    pub(crate) fn is_gone(&self) -> bool {
        let flags = wait::WaitPidFlag::__WALL | wait::WaitPidFlag::WNOHANG;
        let status = wait::waitpid(self.id, Some(flags)).unwrap();
        matches!(status, wait::WaitStatus::Exited(..) | wait::WaitStatus::Signaled(..))
    }
}

struct Stat {
    state: String,
    parent: u32,
}

fn stat(id: u32) -> Option<Stat> {
    let text = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The name before stands in brackets and may hold anything.
    let mut fields = text[text.rfind(')')? + 1..].split_whitespace();
    Some(Stat { state: fields.next()?.to_owned(), parent: fields.next()?.parse().ok()? })
}
