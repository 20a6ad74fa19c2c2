//! What the tests over real DDS share.

use std::time::{Duration, Instant};

use feeder_runtime::dds::{Domain, NodeName, Participant};

/// A peer under test, in a participant of its own.
pub(crate) fn participant(domain: &Domain, name: &str) -> Participant {
    let node = NodeName::new("/test", name).expect("a good name");
    Participant::open(domain, &node).expect("the domain can be joined")
}

/// The same, as long as nobody can meet it.
pub(crate) fn secluded(domain: &Domain, name: &str) -> Participant {
    let node = NodeName::new("/test", name).expect("a good name");
    Participant::secluded(domain, &node).expect("the domain can be joined")
}

/// Waits until something holds; the limit only keeps a failing test from hanging.
pub(crate) fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let give_up = Instant::now() + Duration::from_secs(20);
    while !holds() {
        assert!(Instant::now() < give_up, "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}
