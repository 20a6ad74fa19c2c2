//! For tests that talk over real DDS: a domain nobody else uses.

use std::net::{Ipv4Addr, TcpListener};
use std::ops::Deref;

use crate::dds::{DiscoveryRange, Domain, StaticPeers};

/// First domain given to tests; below are the ones people use.
const FIRST: u16 = 20;
/// Last one whose ports lie below those the system hands out for a short time.
const LAST: u16 = 101;
/// TCP port that stands for domain 0 while a test holds a domain.
const LOCK_PORT: u16 = 45_000;

/// A domain of this host alone, held until dropped, also against other test processes.
pub struct TestDomain {
    domain: Domain,
    _lock: TcpListener,
}

impl TestDomain {
    /// Takes a free domain.
    ///
    /// # Panics
    /// When every domain is taken: tests that do not drop theirs.
    #[must_use]
    pub fn claim() -> Self {
        // Started at a place of its own, so that a domain is not used again while peers of the
        // previous test may still be leaving it.
        let start = u16::try_from(std::process::id() % u32::from(LAST - FIRST + 1)).unwrap_or(0);
        (0..=LAST - FIRST)
            .map(|offset| FIRST + (start + offset) % (LAST - FIRST + 1))
            .find_map(|id| {
                let lock = TcpListener::bind((Ipv4Addr::LOCALHOST, LOCK_PORT + id)).ok()?;
                Some(Self {
                    domain: Domain { id, range: DiscoveryRange::Localhost, peers: StaticPeers::default() },
                    _lock: lock,
                })
            })
            .expect("a free DDS domain between 20 and 101")
    }
}

impl Deref for TestDomain {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.domain
    }
}
