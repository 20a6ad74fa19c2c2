//! The suite on the ROS graph: it comes up whole, and nothing of it stays behind. `feeder graph-check` does it 50 times.

use feeder_runtime::testing::TestDomain;

use crate::common::feeder;

const RUNS: usize = 3;

#[test]
fn every_endpoint_is_matched_at_each_start_and_nothing_is_left_after_each_stop() {
    for layout in [&[][..], &["--composed"]] {
        let domain = TestDomain::claim();
        let mut check = feeder();
        check.args(["graph-check", "--runs", &RUNS.to_string(), "--domain", &domain.id.to_string()]).args(layout);
        let output = check.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").output().unwrap();
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
