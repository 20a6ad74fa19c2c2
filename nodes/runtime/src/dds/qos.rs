use ros2_client::dds::rustdds::{Duration, QosPolicies, QosPolicyBuilder, policy};

/// Whether lost samples are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reliability {
    /// Lost samples are sent again. A reader that asks for this matches reliable writers only.
    Reliable,
    /// A lost sample stays lost.
    BestEffort,
}

/// Whether a late reader gets what was published before it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Durability {
    /// No.
    Volatile,
    /// Yes, as long as the writer lives. A reader that asks for this matches such writers only.
    TransientLocal,
}

/// How samples of a topic are delivered. Made for a purpose, and changed field by field where needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Qos {
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// Whether late readers get earlier samples.
    pub durability: Durability,
    /// History depth in samples, as announced to peers.
    pub depth: u16,
    /// Samples that may wait at this end, never announced. In a reader, samples that have arrived
    /// and were not drained yet: more are lost. In a reliable writer, samples that some reader has not
    /// acknowledged: then [`publish`](super::Writer::publish) is refused. Memory is `backlog` times the
    /// size of a sample in a reader, and in a reliable writer up to four seconds' worth of what it
    /// published.
    pub backlog: u16,
}

impl Qos {
    /// Streams of which only the newest counts: raw images, ground truth, copies for onlookers.
    #[must_use]
    pub const fn sensor() -> Self {
        Self { reliability: Reliability::BestEffort, durability: Durability::Volatile, depth: 5, backlog: 8 }
    }

    /// Ordinary topics: commands, states, detections, compressed images.
    #[must_use]
    pub const fn command() -> Self {
        Self { reliability: Reliability::Reliable, durability: Durability::Volatile, depth: 10, backlog: 256 }
    }

    /// What is published rarely and holds until replaced: waveform, descriptions, fact sheets.
    /// A late reader gets up to `backlog` of the last values, oldest first: take the newest.
    #[must_use]
    pub const fn latched() -> Self {
        Self { reliability: Reliability::Reliable, durability: Durability::TransientLocal, depth: 1, backlog: 16 }
    }

    /// Requests and replies of services, parameters included. A client that has crashed acknowledges nothing until it is
    /// known to be gone, which takes up to 20 s: replies to others must find room meanwhile.
    #[must_use]
    pub const fn service() -> Self {
        Self { reliability: Reliability::Reliable, durability: Durability::Volatile, depth: 10, backlog: 2_048 }
    }

    /// Topics of the simulation loop, whose engine bounds what is in flight to less than `backlog`.
    #[must_use]
    pub const fn loop_edge() -> Self {
        Self { reliability: Reliability::Reliable, durability: Durability::Volatile, depth: 64, backlog: 256 }
    }

    pub(super) fn to_policies(self) -> QosPolicies {
        // Resource limits size RustDDS's reader cache and the writer's window; without them both
        // have defaults (64 and 8,192 samples) that lose samples or hoard memory.
        let limit = i32::from(self.backlog.max(self.depth));
        let builder = QosPolicyBuilder::new()
            .history(policy::History::KeepLast { depth: i32::from(self.depth) })
            .resource_limits(policy::ResourceLimits {
                max_samples: limit,
                max_instances: 1,
                max_samples_per_instance: limit,
            })
            .durability(match self.durability {
                Durability::Volatile => policy::Durability::Volatile,
                Durability::TransientLocal => policy::Durability::TransientLocal,
            });
        match self.reliability {
            // Announced as ROS 2 announces it; publishing here never waits.
            Reliability::Reliable => builder.reliable(Duration::from_millis(100)),
            Reliability::BestEffort => builder.best_effort(),
        }
        .build()
    }

    /// Whether a writer with this QoS matches a reader that asks for these.
    pub(super) fn serves(self, reliability: Reliability, durability: Durability) -> bool {
        offer_meets((self.reliability, self.durability), (reliability, durability))
    }

    /// Whether a reader with this QoS matches a writer that offers these.
    pub(super) fn is_served_by(self, reliability: Reliability, durability: Durability) -> bool {
        offer_meets((reliability, durability), (self.reliability, self.durability))
    }
}

fn offer_meets(offered: (Reliability, Durability), requested: (Reliability, Durability)) -> bool {
    let reliable = offered.0 == Reliability::Reliable || requested.0 == Reliability::BestEffort;
    let durable = offered.1 == Durability::TransientLocal || requested.1 == Durability::Volatile;
    reliable && durable
}

/// Reliability of a discovered endpoint.
pub(super) fn reliability_of(policies: &QosPolicies) -> Reliability {
    match policies.reliability() {
        Some(policy::Reliability::Reliable { .. }) => Reliability::Reliable,
        _ => Reliability::BestEffort,
    }
}

/// Durability of a discovered endpoint.
pub(super) fn durability_of(policies: &QosPolicies) -> Durability {
    match policies.durability() {
        None | Some(policy::Durability::Volatile) => Durability::Volatile,
        Some(_) => Durability::TransientLocal,
    }
}
