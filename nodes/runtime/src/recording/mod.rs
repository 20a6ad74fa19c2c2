//! What a simulated run publishes, on its way to whoever records it.
//!
//! Every node of the loop, and the clock, hands its messages to one [`RunListener`] over a local socket, tick by tick,
//! and waits when the listener falls behind: the recorder holds the nodes back as they hold back each other, so
//! nothing is lost, and it gets what a [`Digest`](crate::digest::Digest) covers. The listener puts the streams together
//! in the order of ticks, then of nodes in the contract, then in which each node published; the order depends on
//! nothing else.

mod listener;
mod tap;

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};

pub use listener::{RunEvent, RunListener};
pub(crate) use tap::Tap;

use crate::dds::{Durability, Qos, Reliability};
use crate::node::{Interface, Port, PortKind};

/// A topic that a node of the run publishes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunTopic {
    /// Its name.
    pub name: String,
    /// Its type, `package/msg/Name`.
    pub ros_type: String,
    /// Whether lost samples are sent again.
    pub reliable: bool,
    /// Whether late readers get earlier samples.
    pub transient_local: bool,
    /// History depth, samples.
    pub depth: u16,
}

impl RunTopic {
    fn of(port: &Port) -> Self {
        let Qos { reliability, durability, depth, .. } = port.qos;
        Self {
            name: port.name.clone(),
            ros_type: port.ros_type.clone(),
            reliable: reliability == Reliability::Reliable,
            transient_local: durability == Durability::TransientLocal,
            depth,
        }
    }

    /// The topics of `interface`, beside the number of the port of each.
    fn all_of(interface: &Interface) -> Vec<(usize, Self)> {
        let published = interface.ports.iter().enumerate().filter(|(_, port)| port.kind == PortKind::Publish);
        published
            .filter(|(_, port)| crate::digest::covered(&port.name))
            .map(|(at, port)| (at, Self::of(port)))
            .collect()
    }
}

/// What a node says of itself before anything else.
#[derive(Debug, Serialize, Deserialize)]
struct Hello {
    run_id: u64,
    node: String,
    topics: Vec<(usize, RunTopic)>,
}

/// The listener's answer: the ports whose messages it wants.
#[derive(Debug, Serialize, Deserialize)]
struct Wanted(Vec<usize>);

/// What a node hands over.
#[derive(Debug, PartialEq, Eq)]
enum Frame {
    /// A message that a port published in a tick.
    Message { port: u32, tick: u64, payload: Vec<u8> },
    /// Everything before this tick has been handed over.
    Until(u64),
    /// The node has come to its end.
    End,
}

const MESSAGE: u8 = 0;
const UNTIL: u8 = 1;
const END: u8 = 2;
/// Both ends are of this program: a longer frame is no frame.
const FRAME_BYTES_MAX: u32 = 1 << 30;

impl Frame {
    fn write_message(to: &mut impl Write, port: usize, tick: u64, payload: &[u8]) -> io::Result<()> {
        let port = u32::try_from(port).map_err(io::Error::other)?;
        let length = u32::try_from(payload.len()).ok().filter(|length| *length <= FRAME_BYTES_MAX);
        let length = length.ok_or_else(|| io::Error::other(format!("a message of {} bytes", payload.len())))?;
        to.write_all(&[MESSAGE])?;
        to.write_all(&port.to_le_bytes())?;
        to.write_all(&tick.to_le_bytes())?;
        to.write_all(&length.to_le_bytes())?;
        to.write_all(payload)
    }

    fn write_until(to: &mut impl Write, tick: u64) -> io::Result<()> {
        to.write_all(&[UNTIL])?;
        to.write_all(&tick.to_le_bytes())
    }

    fn write_end(to: &mut impl Write) -> io::Result<()> {
        to.write_all(&[END])
    }

    fn read(from: &mut impl Read) -> io::Result<Self> {
        match read_array::<1>(from)?[0] {
            MESSAGE => {
                let port = u32::from_le_bytes(read_array(from)?);
                let tick = u64::from_le_bytes(read_array(from)?);
                Ok(Self::Message { port, tick, payload: read_bytes(from)? })
            }
            UNTIL => Ok(Self::Until(u64::from_le_bytes(read_array(from)?))),
            END => Ok(Self::End),
            kind => Err(io::Error::new(io::ErrorKind::InvalidData, format!("frame of unknown kind {kind}"))),
        }
    }
}

fn read_array<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn read_bytes(from: &mut impl Read) -> io::Result<Vec<u8>> {
    let length = u32::from_le_bytes(read_array(from)?);
    if length > FRAME_BYTES_MAX {
        return Err(io::Error::new(io::ErrorKind::InvalidData, format!("frame of {length} bytes")));
    }
    let mut bytes = Vec::new();
    from.take(length.into()).read_to_end(&mut bytes)?;
    if bytes.len() == length as usize { Ok(bytes) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

fn write_json<T: Serialize>(to: &mut impl Write, value: &T) -> io::Result<()> {
    let text = serde_json::to_vec(value)?;
    to.write_all(&u32::try_from(text.len()).map_err(io::Error::other)?.to_le_bytes())?;
    to.write_all(&text)?;
    to.flush()
}

fn read_json<T: for<'a> Deserialize<'a>>(from: &mut impl Read) -> io::Result<T> {
    Ok(serde_json::from_slice(&read_bytes(from)?)?)
}

#[cfg(test)]
mod tests;
