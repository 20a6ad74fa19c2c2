//! A small harness: runs `feeder` as a user does, in a DDS domain and a folder of its own.

mod browser;
mod fast;
mod install;
mod node;
mod peer;
mod process;
mod python;
mod terminal;

use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use feeder_runtime::dds::{NodeName, Participant};
use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use feeder_wire::topics::CLOCK;
use minifactory_msgs::rosgraph_msgs::msg::Clock;
use rustix::process::Signal;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tempfile::TempDir;

pub(crate) use browser::Browser;
pub(crate) use fast::fast_relay;
pub(crate) use install::apt_install;
pub(crate) use node::bag_reader;
pub(crate) use peer::{ENCAPSULATION, Kind, Peer, hex};
pub(crate) use process::Process;
pub(crate) use python::python;
pub(crate) use terminal::Terminal;

/// Longest wait for anything that a run does, wall time. It only keeps a failing test from hanging.
const PATIENCE: Duration = Duration::from_secs(600);

/// Namespace of the only feeder of the built-in scenario.
pub(crate) const FEEDER: &str = "/feeder";

const DISCOVERY_RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";

/// The `feeder` command, in an environment that says nothing about ROS or logging.
pub(crate) fn feeder() -> Command {
    in_silence(env!("CARGO_BIN_EXE_feeder-under-test"))
}

/// The `feeder-lab` command, likewise.
pub(crate) fn lab() -> Command {
    in_silence(env!("CARGO_BIN_EXE_lab-under-test"))
}

/// Puts both commands under their own names into a folder, as on a user's `PATH`.
pub(crate) fn put_commands(folder: &Path) {
    for (name, command) in [("feeder", feeder()), ("feeder-lab", lab())] {
        std::os::unix::fs::symlink(command.get_program(), folder.join(name)).unwrap();
    }
}

fn in_silence(executable: &str) -> Command {
    let mut command = Command::new(executable);
    for variable in ["ROS_DOMAIN_ID", DISCOVERY_RANGE, "ROS_LOCALHOST_ONLY", "RUST_LOG"] {
        command.env_remove(variable);
    }
    command
}

/// Runs the executable with these arguments to its end.
pub(crate) fn output(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Output {
    feeder().args(arguments).output().unwrap()
}

/// Waits until `found` has something.
#[track_caller]
pub(crate) fn wait_for<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let give_up = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = found() {
            return found;
        }
        assert!(Instant::now() < give_up, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What tells the simulated time that `/clock` has shown last.
pub(crate) fn simulated_time(domain: &TestDomain) -> impl Fn() -> Duration + use<> {
    let participant = Participant::open(domain, &NodeName::new("/test", "onlooker").unwrap()).unwrap();
    let latest_ns = Arc::new(AtomicU64::new(0));
    let seen = Arc::clone(&latest_ns);
    let note = move |sample: feeder_runtime::dds::Sample| {
        if let Ok(Clock { clock }) = sample.decode() {
            seen.store(feeder_runtime::node::ns_of_stamp(&clock), Ordering::Relaxed);
        }
    };
    let reader = participant.topic_reader(&CLOCK, "", note).unwrap();
    move || {
        let _kept = (&participant, &reader);
        Duration::from_nanos(latest_ns.load(Ordering::Relaxed))
    }
}

/// A run of `feeder up` to be started.
pub(crate) struct Up {
    command: Command,
    work: TempDir,
    domain: TestDomain,
}

impl Up {
    /// With these options, separated by spaces.
    pub(crate) fn new(options: &str) -> Self {
        let work = TempDir::new().unwrap();
        let domain = TestDomain::claim();
        let mut command = feeder();
        command.args(["up", "--domain", &domain.id.to_string()]).args(options.split_whitespace());
        // Tests on other machines of the network may use the same domain.
        command.env(DISCOVERY_RANGE, "LOCALHOST");
        command.arg("--summary").arg(work.path().join("summary.json"));
        Self { command, work, domain }
    }

    /// Lets it look for others as far as it does without settings.
    pub(crate) fn default_discovery_range(mut self) -> Self {
        self.command.env_remove(DISCOVERY_RANGE);
        self
    }

    /// Runs this scenario instead of the built-in one.
    pub(crate) fn scenario(mut self, scenario: &Scenario) -> Self {
        let file = self.work.path().join("scenario.yaml");
        std::fs::write(&file, scenario.to_yaml().unwrap()).unwrap();
        self.command.arg("--scenario").arg(file);
        self
    }

    /// Runs the scenario of this file.
    pub(crate) fn scenario_file(mut self, file: &Path) -> Self {
        self.command.arg("--scenario").arg(file);
        self
    }

    /// Records it to this folder.
    pub(crate) fn record(mut self, folder: &Path) -> Self {
        self.command.arg("--record").arg(folder);
        self
    }

    /// Keeps a digest too.
    pub(crate) fn digest(mut self) -> Self {
        self.command.arg("--digest").arg(self.work.path().join("digest.txt"));
        self
    }

    /// Starts it.
    pub(crate) fn start(mut self) -> Run {
        let open = |name| File::create(self.work.path().join(name)).unwrap();
        self.command.stdin(Stdio::null()).stdout(open("stdout")).stderr(open("stderr"));
        Run { child: self.command.spawn().unwrap(), work: self.work, domain: self.domain }
    }

    /// Runs it to its end.
    pub(crate) fn outcome(self) -> Outcome {
        self.start().outcome()
    }

    /// Runs it to its end, which must be a good one.
    #[track_caller]
    pub(crate) fn success(self) -> Outcome {
        let outcome = self.outcome();
        assert!(outcome.status.success(), "{}: {}", outcome.status, outcome.stderr);
        outcome
    }
}

/// A run of `feeder up`. Dropped before its end, it is killed with all its nodes.
pub(crate) struct Run {
    child: Child,
    work: TempDir,
    domain: TestDomain,
}

impl Run {
    /// The process of `feeder up`.
    pub(crate) fn process(&self) -> Process {
        Process::new(self.child.id())
    }

    /// The DDS domain it runs in.
    pub(crate) fn domain(&self) -> &TestDomain {
        &self.domain
    }

    /// The processes of its nodes.
    pub(crate) fn nodes(&self) -> Vec<Process> {
        self.process().children()
    }

    /// The process of the node of this name.
    #[track_caller]
    pub(crate) fn node(&self, name: &str) -> Process {
        let nodes = self.nodes();
        let found = nodes.iter().find(|node| node.arguments().iter().any(|argument| argument == name));
        *found.unwrap_or_else(|| panic!("no {name} among the children of feeder up: {}", self.stderr()))
    }

    /// Waits until `/clock` shows that so much simulated time has passed.
    #[track_caller]
    pub(crate) fn wait_until_simulated(&mut self, sim: Duration) {
        let simulated = simulated_time(&self.domain);
        wait_for("simulated time", || {
            let ended = self.child.try_wait().unwrap();
            assert!(ended.is_none(), "the run has ended already: {}", self.stderr());
            (simulated() >= sim).then_some(())
        });
    }

    /// Has a script of `tests/interop` work with it, at most for `patience` of wall time, and ends it. Returns what the
    /// script has printed in JSON.
    #[track_caller]
    pub(crate) fn seen_by<T: DeserializeOwned>(self, script: &str, patience: Duration, arguments: &[&str]) -> T {
        let seen = Command::new(python())
            .arg(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests/interop").join(script))
            .args(["--domain", &self.domain.id.to_string(), "--seconds", &patience.as_secs().to_string()])
            .args(arguments)
            .env_remove("CYCLONEDDS_URI")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        self.process().signal(Signal::INT);
        let outcome = self.outcome();
        assert!(seen.status.success(), "{}\nrun: {}", String::from_utf8_lossy(&seen.stderr), outcome.stderr);
        assert!(outcome.status.success(), "{}", outcome.stderr);
        serde_json::from_slice(&seen.stdout).unwrap()
    }

    /// Waits for its end.
    #[track_caller]
    pub(crate) fn outcome(mut self) -> Outcome {
        let status = wait_for("the end of the run", || self.child.try_wait().unwrap());
        let read = |name: &str| std::fs::read_to_string(self.work.path().join(name));
        Outcome {
            status,
            stdout: read("stdout").unwrap(),
            stderr: self.stderr(),
            summary: read("summary.json").ok().map(|text| serde_json::from_str(&text).unwrap()),
            digest: read("digest.txt").ok(),
        }
    }

    /// What it has written so far.
    pub(crate) fn stderr(&self) -> String {
        std::fs::read_to_string(self.work.path().join("stderr")).unwrap()
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            for process in self.nodes().into_iter().chain([self.process()]) {
                process.signal(Signal::KILL);
            }
            // It has been killed: waiting only takes it off the list of processes.
            let _ = self.child.wait();
        }
    }
}

/// How a run of `feeder up` ended.
pub(crate) struct Outcome {
    pub(crate) status: ExitStatus,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    summary: Option<Value>,
    digest: Option<String>,
}

impl Outcome {
    /// The last line it wrote: after a failure, the error.
    pub(crate) fn error(&self) -> &str {
        self.stderr.lines().last().unwrap_or_default()
    }

    /// The summary it left.
    #[track_caller]
    pub(crate) fn summary(&self) -> &Value {
        self.summary.as_ref().unwrap_or_else(|| panic!("no summary: {}", self.stderr))
    }

    /// A number in the summary.
    #[track_caller]
    pub(crate) fn number(&self, key: &str) -> f64 {
        self.summary()[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {}", self.summary()))
    }

    /// The digest it left.
    #[track_caller]
    pub(crate) fn digest(&self) -> &str {
        self.digest.as_deref().unwrap_or_else(|| panic!("no digest: {}", self.stderr))
    }
}

/// Writes a file of this name and returns where it is.
pub(crate) fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}
