//! Why nothing can be opened or published.

use bytes::Bytes;

/// Why something could not be opened on the network.
#[derive(Debug, thiserror::Error)]
pub enum DdsError {
    /// An environment variable holds a value that means nothing.
    #[error("environment variable {variable} is {value:?}; allowed: {allowed}")]
    Environment {
        /// Name of the variable.
        variable: &'static str,
        /// What it holds.
        value: String,
        /// What it may hold.
        allowed: &'static str,
    },
    /// A name breaks the rules of ROS 2 names.
    #[error("{what} {value:?} is no ROS 2 name: {reason}")]
    Name {
        /// What the name is for, e.g. "topic".
        what: &'static str,
        /// The name.
        value: String,
        /// The rule it breaks.
        reason: String,
    },
    /// The participant could not join its domain.
    #[error("node {node} cannot join DDS domain {domain}: {reason}")]
    Join {
        /// Fully qualified name of the node.
        node: String,
        /// The domain.
        domain: u16,
        /// What the middleware or the system said.
        reason: String,
    },
    /// A reader or writer could not be made.
    #[error("cannot make a {what} of {name}: {reason}")]
    Endpoint {
        /// "reader" or "writer".
        what: &'static str,
        /// DDS name of the topic.
        name: String,
        /// What the middleware said.
        reason: String,
    },
}

/// Why a sample was not accepted.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// Some reliable reader has left too many samples unacknowledged. Nothing was sent: try again
    /// later with the returned body, or give it up.
    #[error("{topic}: a reliable reader has fallen behind, the writer holds {backlog} unacknowledged samples")]
    Full {
        /// DDS name of the topic.
        topic: String,
        /// Samples the writer may hold.
        backlog: u32,
        /// The body that was not sent.
        payload: Bytes,
    },
    /// The writer is of no use any more.
    #[error("{topic}: the writer is closed: {reason}")]
    Closed {
        /// DDS name of the topic.
        topic: String,
        /// What the middleware said.
        reason: String,
    },
}
