//! DDS endpoints that ROS 2 takes for its own.
//!
//! - [`Domain`]: which domain, and how far discovery reaches, as `ROS_DOMAIN_ID` and its kin say.
//! - [`Participant`]: one node's presence on the network. It announces the node and its endpoints
//!   on `ros_discovery_info`, so that `ros2 node` and `ros2 topic` list them.
//! - [`Server`], [`Client`]: services, in the wire forms of Fast DDS and Cyclone DDS alike.
//! - [`Writer`], [`Reader`]: topics, as bytes ([`crate::cdr`] makes them from messages).
//! - [`Loss`]: what endpoints have lost or refused; nothing is dropped uncounted.
//!
//! # Threads
//! Each participant owns one thread that drains all its readers the moment samples arrive and calls
//! the functions given to [`Participant::reader`] and its like. They must not block: while one runs,
//! no other reader of the participant is drained, and a reader that is not drained loses samples,
//! reliable or not. Hand the sample to a channel and return.
//!
//! # Leaving
//! Dropping the last handle of a participant (clones, readers, writers) says goodbye: readers,
//! then the thread, then the participant, so that peers forget it at once instead of after a lease
//! of most of a minute. A process that is killed leaves a ghost for that long.
//!
//! # Limits
//! - A body of up to [`BODY_BYTES_MAX_IN_ONE_DATAGRAM`] travels between processes of one host in a
//!   single datagram. A larger one, and over Ethernet one of more than about 1.3 kB, is cut into
//!   fragments of 256 bytes, packed into datagrams of the interface's MTU; peers with default socket
//!   buffers lose parts of bodies of hundreds of kilobytes. Keep what must arrive below that limit.
//! - Buffers of [`SOCKET_BUFFER_BYTES`] are asked of the system, which may grant less:
//!   raise `net.core.rmem_max` and `net.core.wmem_max`.

mod client;
mod datagram;
mod domain;
mod door;
mod drain;
mod error;
mod executor;
mod farewell;
mod graph;
mod loops;
mod lull;
mod names;
mod others;
mod participant;
mod peers;
mod presence;
mod qos;
mod raw;
mod reach;
mod reader;
mod relay;
mod server;
mod signals;
mod sockets;
mod tally;
mod wire;
mod writer;

pub use client::{Call, CallError, Client, Reply};
pub use domain::{DiscoveryRange, Domain, StaticPeers};
pub use error::{DdsError, PublishError};
pub use graph::{Endpoint, Graph, NodeInfo};
pub use minifactory_msgs::interface::{Durability, Qos, Reliability};
pub use names::NodeName;
pub use participant::Participant;
pub use raw::{Guid, Sample, SampleId};
pub use reader::Reader;
pub use server::{ReplyHandle, Request, Server, ServerCounts};
pub use tally::Loss;
pub use writer::Writer;

pub(crate) use executor::Task as BackgroundTask;
pub(crate) use graph::fuzz_announcement;
pub(crate) use names::check_absolute;
pub(crate) use tally::Counter;
pub(crate) use wire::fuzz as fuzz_wire;
pub(crate) use writer::Outlet;

/// The largest body in bytes that leaves in one datagram over the loopback interface
/// (MTU 65,536, less headers).
pub const BODY_BYTES_MAX_IN_ONE_DATAGRAM: usize = 65_000;

/// Socket buffer asked of the system for each direction.
pub const SOCKET_BUFFER_BYTES: usize = 4 * 1024 * 1024;
