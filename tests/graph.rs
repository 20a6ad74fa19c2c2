//! The suite on the ROS graph: it comes up whole, and nothing of it stays behind. `feeder graph-check` does it 50 times.

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use feeder_runtime::testing::TestDomain;
use rustix::process::Signal;

use crate::common::{Up, feeder, python};

const RUNS: usize = 3;
/// Most of the suite's endpoints, of which there are some more.
const THERE: &str = "150";
/// What is not said goodbye for stays on the graph for fifty seconds.
const GOODBYE: Duration = Duration::from_secs(15);

#[test]
fn every_endpoint_is_matched_at_each_start_and_nothing_is_left_after_each_stop() {
    for (layout, range) in [(&[][..], "LOCALHOST"), (&["--composed"], "LOCALHOST"), (&[], "SUBNET")] {
        let domain = TestDomain::claim();
        let mut check = feeder();
        check.args(["graph-check", "--runs", &RUNS.to_string(), "--domain", &domain.id.to_string()]).args(layout);
        let output = check.env("ROS_AUTOMATIC_DISCOVERY_RANGE", range).output().unwrap();
        let printed = String::from_utf8_lossy(&output.stdout);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{printed}{error}");
        let row = |line: &str| line.split_whitespace().filter(|word| word.parse::<f64>().is_ok()).count();
        // A number, then how long it took until matched, ticking, ended and gone.
        assert_eq!(printed.lines().filter(|line| row(line) == 5).count(), RUNS, "{printed}");
        for summary in ["median", "worst"] {
            assert!(printed.lines().any(|line| line.starts_with(summary) && row(line) == 4), "{printed}");
        }
    }
}

#[test]
fn another_implementation_sees_all_of_it_come_and_go() {
    let python = python();
    let mut run = Up::new("--duration 3600 --speed 1").default_discovery_range().start();
    let mut peer = Command::new(python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/interop/cyclone_peer.py"))
        .args(["--domain", &run.domain().id.to_string(), "--seconds", "120", "leave", "--count", THERE])
        .env_remove("CYCLONEDDS_URI")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(peer.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(said.next().is_some_and(|line| line.starts_with("there ")));
    run.wait_until_simulated(Duration::from_millis(100));
    run.process().signal(Signal::TERM);
    let outcome = run.outcome();
    let ended = Instant::now();
    assert!(outcome.status.success(), "{}", outcome.stderr);
    assert_eq!(said.next().as_deref(), Some("gone"));
    assert!(ended.elapsed() < GOODBYE, "gone only after {:?}", ended.elapsed());
    peer.wait().unwrap();
}
