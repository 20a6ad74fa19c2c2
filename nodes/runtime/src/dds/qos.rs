//! Quality of service, to and from the DDS library.

use minifactory_msgs::interface::{Durability, Qos, Reliability};
use ros2_client::dds::rustdds::{Duration, QosPolicies, QosPolicyBuilder, policy};

/// What the DDS library is told of a quality of service.
pub(super) fn policies_of(qos: Qos) -> QosPolicies {
    // Resource limits size RustDDS's reader cache and the writer's window; without them both
    // have defaults (64 and 8,192 samples) that lose samples or hoard memory.
    let limit = i32::from(qos.backlog.max(qos.depth));
    let builder = QosPolicyBuilder::new()
        .history(policy::History::KeepLast { depth: i32::from(qos.depth) })
        .resource_limits(policy::ResourceLimits {
            max_samples: limit,
            max_instances: 1,
            max_samples_per_instance: limit,
        })
        .durability(match qos.durability {
            Durability::Volatile => policy::Durability::Volatile,
            Durability::TransientLocal => policy::Durability::TransientLocal,
        });
    let builder = match qos.lifespan_s {
        Some(s) => builder.lifespan(policy::Lifespan { duration: Duration::from_secs(s.into()) }),
        None => builder,
    };
    match qos.reliability {
        // Announced as ROS 2 announces it; publishing here never waits.
        Reliability::Reliable => builder.reliable(Duration::from_millis(100)),
        Reliability::BestEffort => builder.best_effort(),
    }
    .build()
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
