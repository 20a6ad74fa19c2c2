//! Takes what a participant sends to the group to hosts where multicast may not get.
//!
//! RustDDS 0.15.1 sends to the group whatever a reader says can be reached there (`rtps/writer.rs`, 1889 and 1900), and
//! says so of its own readers wherever an interface can multicast; neither can be changed. So what this participant sends
//! to the group is heard on this host, where it comes back, and sent once more to those of the static peers' participants
//! whom it concerns. What arrives twice is dropped there by its sequence number.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::DomainParticipant;
use socket2::{Domain, Protocol, Socket, Type};

use super::presence::PARTICIPANT_WRITER;
use super::reach::{GROUP, Kind, Own, Reach};
use super::sockets::Sockets;
use super::{Guid, SOCKET_BUFFER_BYTES, graph};

/// How long a relay takes to notice that it is to stop.
const LOOK: Duration = Duration::from_millis(50);
/// How often it looks who is there.
const REFRESH: Duration = Duration::from_millis(200);
/// How long everybody who may be on a peer is told what this participant has; from those it has found it knows where they are.
const INTRODUCTION: Duration = Duration::from_secs(2);
/// The largest message.
const MESSAGE_BYTES_MAX: usize = 65_507;

/// DDS topics of a participant's writers, by the last four bytes of their identity.
pub(super) type Written = Arc<Mutex<BTreeMap<[u8; 4], String>>>;

/// The relay of one participant, until it is dropped.
pub(super) struct Relay {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("the relay to static peers had panicked");
            }
        }
    }
}

/// What a relay needs to know of its participant.
#[derive(Clone)]
pub(super) struct Source {
    pub(super) participant: DomainParticipant,
    pub(super) guid: Guid,
    pub(super) sockets: Arc<Sockets>,
    pub(super) reach: Reach,
    pub(super) written: Written,
}

impl Relay {
    /// Relays what `source` sends to the group; nothing where no interface can multicast.
    pub(super) fn start(source: &Source, own: &[Own]) -> io::Result<Option<Self>> {
        let mut relay = Self { stop: Arc::default(), threads: Vec::new() };
        for kind in [Kind::Discovery, Kind::User] {
            let Some(group) = source.reach.group(own, kind) else { return Ok(None) };
            let socket = listen(group.port(), own)?;
            let (source, stop) = (source.clone(), Arc::clone(&relay.stop));
            let thread = std::thread::Builder::new().name("dds relay".to_owned());
            relay.threads.push(thread.spawn(move || Rounds::new(source, kind).run(&socket, &stop))?);
        }
        Ok(Some(relay))
    }
}

/// Hears what is sent to the group, of this host too.
fn listen(port: u16, own: &[Own]) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.set_reuse_port(true)?;
    socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
    for own in own.iter().filter(|own| own.is_multicast) {
        // An interface with several addresses has been joined by the first.
        let _ = socket.join_multicast_v4(&GROUP, &own.address);
    }
    socket.set_read_timeout(Some(LOOK))?;
    Ok(socket.into())
}

/// One of the two threads.
struct Rounds {
    source: Source,
    kind: Kind,
    began: Instant,
    looked: Option<Instant>,
    /// Where the participants on peers are, and for each topic those that hear it.
    known: BTreeSet<SocketAddrV4>,
    hearing: BTreeMap<String, BTreeSet<SocketAddrV4>>,
}

impl Rounds {
    fn new(source: Source, kind: Kind) -> Self {
        let (known, hearing) = (BTreeSet::new(), BTreeMap::new());
        Self { source, kind, began: Instant::now(), looked: None, known, hearing }
    }

    fn run(mut self, socket: &UdpSocket, stop: &AtomicBool) {
        let mut buffer = vec![0; MESSAGE_BYTES_MAX];
        while !stop.load(Ordering::Acquire) {
            match socket.recv(&mut buffer) {
                Ok(bytes) => self.pass_on(&buffer[..bytes]),
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
                Err(error) => {
                    tracing::warn!("what goes to the group no longer gets to static peers: {error}");
                    return;
                }
            }
        }
    }

    fn pass_on(&mut self, message: &[u8]) {
        if message.get(8..20) != Some(&self.source.guid.participant()[..]) {
            return;
        }
        if self.looked.is_none_or(|last| last.elapsed() >= REFRESH) {
            self.look();
            self.looked = Some(Instant::now());
        }
        let writer = writer_of(message);
        let sent = match self.kind {
            Kind::Discovery if writer == Some(PARTICIPANT_WRITER) || self.began.elapsed() < INTRODUCTION => {
                let places = self.source.reach.places().filter(|place| !place.ip().is_loopback());
                self.source.sockets.send_to(message, places)
            }
            Kind::Discovery => {
                // The port before that for all else (RTPS 2.3, 9.6.1.4).
                let before =
                    |address: &SocketAddrV4| SocketAddrV4::new(*address.ip(), address.port().saturating_sub(1));
                self.source.sockets.send_to(message, self.known.iter().map(before))
            }
            Kind::User => {
                let written = self.source.written.lock().unwrap_or_else(PoisonError::into_inner);
                let topic = writer.and_then(|writer| written.get(&writer));
                let hearing = topic.and_then(|topic| self.hearing.get(topic));
                self.source.sockets.send_to(message, hearing.into_iter().flatten().copied())
            }
        };
        // What is lost is sent again, as anything that UDP loses.
        if let Err(error) = sent {
            tracing::debug!("not relayed: {error}");
        }
    }

    fn look(&mut self) {
        let on_peers = |address: &SocketAddr| match address {
            SocketAddr::V4(address) if self.source.reach.is_peer(*address.ip()) => Some(*address),
            _ => None,
        };
        self.known = graph::addresses(&self.source.participant, |_| true).iter().filter_map(on_peers).collect();
        self.hearing.clear();
        for (topic, addresses) in graph::reader_addresses_by_topic(&self.source.participant) {
            self.hearing.entry(topic).or_default().extend(addresses.iter().filter_map(on_peers));
        }
    }
}

/// The writer of a message's first submessage that has one, by the last four bytes of its identity (RTPS 2.3, 9.4.5).
fn writer_of(message: &[u8]) -> Option<[u8; 4]> {
    const HEADER_BYTES: usize = 20;
    const HEARTBEAT: u8 = 0x07;
    const GAP: u8 = 0x08;
    const DATA: u8 = 0x15;
    const DATA_FRAG: u8 = 0x16;
    let mut rest = message.get(HEADER_BYTES..)?;
    loop {
        let (head, body) = rest.split_first_chunk::<4>()?;
        let at = match head[0] {
            DATA | DATA_FRAG => Some(8),
            HEARTBEAT | GAP => Some(4),
            _ => None,
        };
        if let Some(at) = at {
            return body.get(at..at + 4)?.try_into().ok();
        }
        let length = [head[2], head[3]];
        let length = if head[1] & 1 == 1 { u16::from_le_bytes(length) } else { u16::from_be_bytes(length) };
        // The last one may be as long as it likes.
        rest = body.get(usize::from(length)..).filter(|_| length > 0)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(submessages: &[&[u8]]) -> Vec<u8> {
        [&[0; 20][..], &submessages.concat()].concat()
    }

    #[test]
    fn the_writer_of_a_message_is_found_behind_what_has_none() {
        let time = [9, 1, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let data = [0x15, 5, 0, 0, 0, 0, 16, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0];
        let heartbeat = [7, 1, 28, 0, 1, 1, 1, 1, 3, 3, 3, 3, 0];
        assert_eq!(writer_of(&message(&[&time, &data])), Some([2; 4]));
        assert_eq!(writer_of(&message(&[&heartbeat, &data])), Some([3; 4]));
        for broken in [message(&[&time]), message(&[&time, &data[..10]]), vec![0; 19], message(&[&[9, 1, 255, 255, 0]])]
        {
            assert_eq!(writer_of(&broken), None);
        }
    }
}
