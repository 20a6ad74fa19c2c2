//! Topics that ROS 2 names itself.

use super::{EVERY_NODE, Namespace, Qos, TopicSpec, User};
use crate::diagnostic_msgs::msg::DiagnosticArray;
use crate::rcl_interfaces::msg::{Log, ParameterEvent};
use crate::rosgraph_msgs::msg::Clock;

/// In no namespace.
pub(super) const GLOBAL: Namespace = Namespace::Fixed("");

/// Stands for whoever keeps the time of a run, where a table says who is at an end of something.
pub const CLOCK_OF_A_RUN: &str = "the clock of a run";

/// Simulated time.
pub const CLOCK: TopicSpec<Clock> = TopicSpec::new(GLOBAL, "clock", Qos::sensor()).between(
    &[CLOCK_OF_A_RUN, "the player of a bag"],
    &[User::Outside("every node with use_sim_time, recorders, viewers")],
    "Simulated time, s and ns, once a tick",
);

/// How nodes fare.
pub const DIAGNOSTICS: TopicSpec<DiagnosticArray> = TopicSpec::new(GLOBAL, "diagnostics", Qos::command()).between(
    &[EVERY_NODE],
    &[User::Outside("viewers")],
    "Once a second: how courier and selector fare; what each node's endpoints have lost or refused",
);

/// What nodes log. Late readers get up to a thousand lines of the last ten seconds, as rcl does it.
pub const ROSOUT: TopicSpec<Log> =
    TopicSpec::new(GLOBAL, "rosout", Qos { depth: 1_000, backlog: 1_000, lifespan_s: Some(10), ..Qos::latched() })
        .between(&[EVERY_NODE], &[User::Outside("viewers")], "What the nodes log, with level and place in the code");

/// Changes of parameters.
pub const PARAMETER_EVENTS: TopicSpec<ParameterEvent> = TopicSpec::new(
    GLOBAL,
    "parameter_events",
    Qos { depth: 1_000, ..Qos::command() },
)
.between(&[EVERY_NODE], &[User::Outside("viewers")], "Parameters that were declared, changed or deleted");
