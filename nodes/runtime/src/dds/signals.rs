//! Threads that signals leave alone.
//!
//! RustDDS's threads end for good when their poll returns an error, and it returns one when a handled signal lands on the
//! thread. A new thread inherits the mask of the one that starts it.

use nix::sys::signal::{SigSet, SigmaskHow};

/// While this lives, signals are kept from this thread and from those it starts, for which that stays so.
pub(super) struct Masked {
    before: Option<SigSet>,
}

impl Masked {
    pub(super) fn new() -> Self {
        let before = SigSet::all().thread_swap_mask(SigmaskHow::SIG_SETMASK);
        Self { before: before.inspect_err(|error| tracing::warn!("signals cannot be masked: {error}")).ok() }
    }
}

impl Drop for Masked {
    fn drop(&mut self) {
        if let Some(Err(error)) = self.before.map(|before| before.thread_set_mask()) {
            tracing::warn!("the signal mask cannot be restored: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::dds::{NodeName, Participant};
    use crate::testing::TestDomain;

    /// Names of this process's threads, each with whether SIGTERM is kept from it.
    fn threads() -> Vec<(String, bool)> {
        const SIGTERM_BIT: u64 = 1 << (15 - 1);
        let tasks = std::fs::read_dir("/proc/self/task").unwrap();
        let status = tasks.filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("status")).ok());
        let field = |status: &str, key: &str| {
            status.lines().find_map(|line| line.strip_prefix(key).map(|value| value.trim().to_owned())).unwrap()
        };
        let described = status.map(|status| {
            let blocked = u64::from_str_radix(&field(&status, "SigBlk:"), 16).unwrap();
            (field(&status, "Name:"), blocked & SIGTERM_BIT != 0)
        });
        described.collect()
    }

    #[test]
    fn no_signal_reaches_the_threads_of_the_library() {
        let domain = TestDomain::claim();
        let _participant = Participant::open(&domain, &NodeName::new("/", "masked").unwrap()).unwrap();
        let threads = threads();
        let (library, others): (Vec<_>, Vec<_>) = threads.iter().partition(|(name, _)| name.starts_with("RustDDS"));
        assert!(library.len() >= 2, "{threads:?}");
        assert!(library.iter().all(|(_, masked)| *masked), "{library:?}");
        assert!(others.iter().any(|(_, masked)| !masked), "{others:?}");
    }
}
