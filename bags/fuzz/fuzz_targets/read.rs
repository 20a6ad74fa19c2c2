//! Any bytes as a bag: opened, checked with every message taken apart, and recovered. From the folder `bags`:
//! `cargo +nightly fuzz run read -- -rss_limit_mb=2048`, with files of `golden` copied to `fuzz/corpus/read` to begin with.

#![no_main]

use ros2_bags::recover::recover;
use ros2_bags::{Bag, WriteSettings};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(work) = tempfile::tempdir() else { return };
    let file = work.path().join("bag.mcap");
    if std::fs::write(&file, bytes).is_err() {
        return;
    }
    if let Ok(bag) = Bag::open(&file) {
        let _ = ros2_bags::check::check(&bag);
        let again = work.path().join("again");
        if recover(&bag, &again, &WriteSettings::default()).is_ok() {
            let bag = Bag::open(&again).expect("a recovered bag can be opened");
            assert!(bag.problems().is_empty(), "{:?}", bag.problems());
        }
    }
});
