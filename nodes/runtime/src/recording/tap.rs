//! The node's end.

use std::collections::BTreeSet;
use std::io::{self, BufWriter, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;

use super::{Frame, Hello, RunTopic, Wanted, read_json, write_json};
use crate::node::Interface;

/// Frames are handed over in pieces of this size, or when the node waits.
const BUFFER_BYTES: usize = 64 * 1024;
/// Ticks after which they are handed over in any case.
const FLUSH_TICKS: u64 = 8;

/// Where a node hands over what it publishes. Each call waits while the listener is behind.
#[derive(Debug)]
pub(crate) struct Tap {
    stream: BufWriter<UnixStream>,
    wanted: BTreeSet<usize>,
}

impl Tap {
    /// Introduces the node to the listener at `socket`, which answers what it wants.
    pub(crate) fn open(socket: &Path, run_id: u64, node: &str, interface: &Interface) -> io::Result<Self> {
        let mut stream = BufWriter::with_capacity(BUFFER_BYTES, UnixStream::connect(socket)?);
        let hello = Hello { run_id, node: node.to_owned(), topics: RunTopic::all_of(interface) };
        write_json(&mut stream, &hello)?;
        let Wanted(wanted) = read_json(stream.get_mut())?;
        Ok(Self { stream, wanted: wanted.into_iter().collect() })
    }

    /// Whether messages of `port` are recorded.
    pub(crate) fn wants(&self, port: usize) -> bool {
        self.wanted.contains(&port)
    }

    /// Hands over a message that `port` published in `tick`, if it is wanted.
    pub(crate) fn add(&mut self, port: usize, tick: u64, payload: &[u8]) -> io::Result<()> {
        if self.wants(port) { Frame::write_message(&mut self.stream, port, tick, payload) } else { Ok(()) }
    }

    /// Says that everything before `tick` has been handed over.
    pub(crate) fn complete_until(&mut self, tick: u64) -> io::Result<()> {
        Frame::write_until(&mut self.stream, tick)?;
        if tick.is_multiple_of(FLUSH_TICKS) { self.flush() } else { Ok(()) }
    }

    /// Sends what waits in this end's buffer.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }

    /// Says that the node has come to its end.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        Frame::write_end(&mut self.stream)?;
        self.stream.flush()
    }
}
