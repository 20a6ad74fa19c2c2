//! Whether the library's threads still run.
//!
//! RustDDS's loops end for good when their poll returns an error, and on Linux it does in a process that was stopped and goes on:
//! after Ctrl-Z and `fg`, or when a debugger lets go. From then on nothing is heard or sent, in silence, and what asks the loop for
//! an answer waits for ever. Nothing can be mended then, so the process ends, and says why.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Where Linux lists this process's threads. Elsewhere nothing is watched.
const THREADS: &str = "/proc/self/task";
/// What the names of the library's threads begin with.
const NAMED: &str = "RustDDS";
/// Between looks, wall time.
const PERIOD: Duration = Duration::from_millis(500);

/// The threads of one participant: where each is listed, and its name.
pub(super) struct Loops(BTreeMap<PathBuf, String>);

impl Loops {
    /// Those that `open` starts. One participant is opened at a time.
    pub(super) fn of<T>(open: impl FnOnce() -> T) -> (T, Self) {
        static OPENING: Mutex<()> = Mutex::new(());
        let _others_wait = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        Self::named(NAMED, open)
    }

    fn named<T>(prefix: &str, open: impl FnOnce() -> T) -> (T, Self) {
        let before = threads(prefix);
        let opened = open();
        let mut started = threads(prefix);
        started.retain(|place, _| !before.contains_key(place));
        (opened, Self(started))
    }

    /// Ends the process when one of them has ended.
    pub(super) async fn watch(self, node: String) {
        loop {
            tokio::time::sleep(PERIOD).await;
            if let Some(thread) = self.ended() {
                tracing::error!(
                    "{node}: the DDS library's thread {thread:?} has ended, and nothing is heard or sent any more; it does so in a \
                     process that was stopped and goes on (Ctrl-Z and fg, a debugger). The process ends"
                );
                std::process::exit(1);
            }
        }
    }

    /// The name of one that is gone.
    fn ended(&self) -> Option<&str> {
        self.0.iter().find(|(place, name)| name_of(place).as_ref() != Some(name)).map(|(_, name)| name.as_str())
    }
}

/// The threads of this process whose names begin so.
fn threads(prefix: &str) -> BTreeMap<PathBuf, String> {
    let places = Path::new(THREADS).read_dir().into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let named = places.filter_map(|place| name_of(&place).map(|name| (place, name)));
    named.filter(|(_, name)| name.starts_with(prefix)).collect()
}

/// The name of a thread, which Linux cuts to 15 bytes; nothing when it has ended.
fn name_of(place: &Path) -> Option<String> {
    let name = std::fs::read_to_string(place.join("comm")).ok()?;
    Some(name.trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;
    use crate::dds::{NodeName, Participant};
    use crate::testing::TestDomain;

    #[test]
    fn a_thread_that_ends_is_named_and_others_do_not_count() {
        let start = |name: &'static str| {
            let (stop, stopped) = mpsc::channel::<()>();
            let (here, is_here) = mpsc::channel();
            let body = move || {
                here.send(()).unwrap();
                let _ = stopped.recv();
            };
            let thread = std::thread::Builder::new().name(name.to_owned()).spawn(body).unwrap();
            is_here.recv().unwrap();
            (stop, thread)
        };
        let end = |(stop, thread): (mpsc::Sender<()>, std::thread::JoinHandle<()>)| {
            drop(stop);
            thread.join().unwrap();
        };
        let earlier = start("library earlier");
        let ((own, other), loops) = Loops::named("library", || (start("library own"), start("other")));
        assert_eq!(loops.0.values().collect::<Vec<_>>(), ["library own"]);
        end(earlier);
        end(other);
        assert_eq!(loops.ended(), None);
        end(own);
        // Joined, it may still be on the list for a moment.
        while loops.ended().is_none() {
            std::thread::yield_now();
        }
        assert_eq!(loops.ended(), Some("library own"));
    }

    #[test]
    fn both_loops_of_a_participant_are_watched() {
        let domain = TestDomain::claim();
        let open = || Participant::open(&domain, &NodeName::new("/", "watched").unwrap()).unwrap();
        let (_participant, loops) = Loops::named(NAMED, open);
        assert!(loops.0.len() >= 2, "{:?}", loops.0);
    }
}
