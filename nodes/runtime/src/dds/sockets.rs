//! The sockets of a participant, and what the kernel lets through to them.
//!
//! RustDDS 0.15.1 binds its sockets to every interface, whichever it is given (`dds/participant.rs`, `0.0.0.0`), reads
//! them from the start, and hands none of them out. So they are found as what is new among this process's descriptors
//! when the participant has been made. A duplicate shares everything with the original: a filter that is set on the one
//! holds for the other, and what is sent by it comes from the same port.

use std::collections::BTreeSet;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use filedescriptor::FileDescriptor;
use socket2::{Domain, SockFilter, Socket, Type};

/// Where Linux lists what a process has open.
const DESCRIPTORS: &str = "/proc/self/fd";
/// Filters have at most 256 places to jump to.
pub(super) const SOURCES_MAX: usize = 250;

/// The sockets of one participant.
pub(super) struct Sockets {
    /// Those it reads, and the one it sends from to single addresses, which nobody writes to.
    unbound: Vec<Socket>,
    /// Those it sends from to groups, one for each interface, by its address.
    to_groups: Vec<Socket>,
}

impl Sockets {
    /// Makes a participant by `open`, and finds its sockets; none where the system does not tell them.
    pub(super) fn opened_by<T>(open: impl FnOnce() -> T) -> (T, io::Result<Self>) {
        /// Participants that are made at once would take each other's sockets for their own.
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let before = sockets();
        let opened = open();
        let found = before.and_then(|before| Self::among(sockets()?.difference(&before)));
        (opened, found)
    }

    fn among<'a>(new: impl Iterator<Item = &'a (String, i32)>) -> io::Result<Self> {
        let (mut unbound, mut to_groups) = (Vec::new(), Vec::new());
        for (_, number) in new {
            // One that another thread has closed meanwhile is none of ours.
            let Ok(socket) = duplicate(*number) else { continue };
            let is_udp = socket.domain().is_ok_and(|domain| domain == Domain::IPV4)
                && socket.r#type().is_ok_and(|t| t == Type::DGRAM);
            let Some(address) =
                socket.local_addr().ok().filter(|_| is_udp).and_then(|address| address.as_socket_ipv4())
            else {
                continue;
            };
            if address.ip().is_unspecified() { unbound.push(socket) } else { to_groups.push(socket) }
        }
        if unbound.is_empty() {
            return Err(io::Error::other("no socket of the DDS library was found"));
        }
        Ok(Self { unbound, to_groups })
    }

    /// Lets nothing through any more.
    pub(super) fn refuse_all(&self) -> io::Result<()> {
        self.filter(&[take(0)])
    }

    /// Lets everything through.
    pub(super) fn accept_all(&self) -> io::Result<()> {
        self.filter(&[take(u32::MAX)])
    }

    /// Lets through what comes from this host by its loopback interface, and from these addresses, at most
    /// [`SOURCES_MAX`].
    pub(super) fn accept_only(&self, sources: &BTreeSet<Ipv4Addr>) -> io::Result<()> {
        if sources.len() > SOURCES_MAX {
            return Err(io::Error::other(format!("{} sources, allowed: at most {SOURCES_MAX}", sources.len())));
        }
        self.filter(&only(loopback()?, sources))
    }

    /// Keeps what goes to groups on this host, where it can still be heard.
    pub(super) fn keep_groups_here(&self) -> io::Result<()> {
        self.to_groups.iter().try_for_each(|socket| socket.set_multicast_ttl_v4(0))
    }

    /// Sends a message to single addresses; the first reason for which one of them did not get it.
    pub(super) fn send_to(&self, message: &[u8], addresses: impl Iterator<Item = SocketAddrV4>) -> io::Result<()> {
        // Any of them will do.
        let Some(socket) = self.unbound.first() else { return Ok(()) };
        addresses
            .map(|address| socket.send_to(message, &SocketAddr::from(address).into()).map(|_| ()))
            .fold(Ok(()), Result::and)
    }

    /// Sends a message to a group by every interface.
    pub(super) fn send_to_group(&self, message: &[u8], group: SocketAddrV4) -> io::Result<()> {
        let send = |socket: &Socket| socket.send_to(message, &SocketAddr::from(group).into()).map(|_| ());
        self.to_groups.iter().map(send).fold(Ok(()), Result::and)
    }

    /// The ports it reads from.
    pub(super) fn ports(&self) -> BTreeSet<u16> {
        let addresses = self.unbound.iter().filter_map(|socket| socket.local_addr().ok()?.as_socket_ipv4());
        addresses.map(|address| address.port()).collect()
    }

    fn filter(&self, program: &[SockFilter]) -> io::Result<()> {
        self.unbound.iter().try_for_each(|socket| socket.attach_filter(program))
    }
}

/// The sockets that this process has open: what tells them apart for ever, and their numbers.
fn sockets() -> io::Result<BTreeSet<(String, i32)>> {
    let describe = |path: &Path| {
        let number = path.file_name()?.to_str()?.parse().ok()?;
        let what = std::fs::read_link(path).ok()?.to_str()?.to_owned();
        what.starts_with("socket:").then_some((what, number))
    };
    let entries = std::fs::read_dir(DESCRIPTORS)?;
    Ok(entries.filter_map(|entry| describe(&entry.ok()?.path())).collect())
}

fn duplicate(number: i32) -> io::Result<Socket> {
    let file = FileDescriptor::dup(&number).and_then(|descriptor| descriptor.as_file()).map_err(io::Error::other)?;
    Ok(Socket::from(OwnedFd::from(file)))
}

/// The index of the loopback interface.
fn loopback() -> io::Result<u32> {
    Ok(nix::net::if_::if_nametoindex("lo")?)
}

/// Ends a filter: so many bytes of a message are taken.
const fn take(bytes: u32) -> SockFilter {
    const RETURN: u16 = 0x06;
    SockFilter::new(RETURN, 0, 0, bytes)
}

/// The filter that takes only what comes by the interface `loopback`, or from these addresses. That they are not borrowed
/// is the kernel's care: it drops what comes from outside in the name of this host.
fn only(loopback: u32, sources: &BTreeSet<Ipv4Addr>) -> Vec<SockFilter> {
    const LOAD_WORD: u16 = 0x20;
    const JUMP_IF_EQUAL: u16 = 0x15;
    /// Where the kernel keeps the interface's index, and the sender's address in the IP header.
    const INTERFACE: u32 = 0xffff_f008;
    const SENDER: u32 = 0xfff0_000c;
    let compare = |value: u32, left: usize| {
        // Over what is left to be compared, and the refusal.
        let to_the_end = u8::try_from(left + 1).unwrap_or(u8::MAX);
        SockFilter::new(JUMP_IF_EQUAL, to_the_end, 0, value)
    };
    let load = |what: u32| SockFilter::new(LOAD_WORD, 0, 0, what);
    let mut program = vec![load(INTERFACE), compare(loopback, sources.len() + 1), load(SENDER)];
    let left = (0..sources.len()).rev();
    program.extend(sources.iter().zip(left).map(|(source, left)| compare((*source).into(), left)));
    program.extend([take(0), take(u32::MAX)]);
    program
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::time::Duration;

    use super::*;

    /// Stands in for a participant: a socket that hears all, and one that speaks by the loopback interface.
    fn participant() -> (UdpSocket, UdpSocket, Sockets) {
        let (opened, sockets) = Sockets::opened_by(|| {
            let hears = UdpSocket::bind("0.0.0.0:0").unwrap();
            hears.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
            (hears, UdpSocket::bind("127.0.0.1:0").unwrap())
        });
        (opened.0, opened.1, sockets.unwrap())
    }

    fn ask(to: &UdpSocket, from: Ipv4Addr, word: &[u8]) {
        let port = to.local_addr().unwrap().port();
        UdpSocket::bind((from, 0)).unwrap().send_to(word, (Ipv4Addr::LOCALHOST, port)).unwrap();
    }

    fn heard(by: &UdpSocket) -> Vec<u8> {
        let mut word = [0; 16];
        let bytes = by.recv(&mut word).unwrap();
        word[..bytes].to_vec()
    }

    #[test]
    fn what_is_refused_is_never_heard() {
        let (hears, speaks, sockets) = participant();
        assert!(sockets.ports().contains(&hears.local_addr().unwrap().port()));
        assert!(!sockets.ports().contains(&speaks.local_addr().unwrap().port()));
        sockets.refuse_all().unwrap();
        ask(&hears, Ipv4Addr::LOCALHOST, b"lost");
        sockets.accept_all().unwrap();
        ask(&hears, Ipv4Addr::LOCALHOST, b"heard");
        assert_eq!(heard(&hears), b"heard");
    }

    #[test]
    fn a_filter_goes_by_the_interface_and_by_the_sender() {
        let (here, friend, stranger) = (Ipv4Addr::LOCALHOST, Ipv4Addr::new(127, 0, 0, 7), Ipv4Addr::new(127, 0, 0, 9));
        let friends = BTreeSet::from([Ipv4Addr::new(127, 0, 0, 6), friend, Ipv4Addr::new(127, 0, 0, 8)]);
        let (hears, _speaks, sockets) = participant();
        sockets.accept_only(&BTreeSet::new()).unwrap();
        ask(&hears, stranger, b"local");
        assert_eq!(heard(&hears), b"local", "all of loopback is this host");
        // As if loopback were another interface.
        sockets.filter(&only(loopback().unwrap() + 1, &friends)).unwrap();
        for source in [stranger, here] {
            ask(&hears, source, b"refused");
        }
        for source in &friends {
            ask(&hears, *source, b"friend");
            assert_eq!(heard(&hears), b"friend");
        }
        let many = (0..=SOURCES_MAX).map(|n| Ipv4Addr::from_bits(u32::try_from(n).unwrap())).collect();
        assert!(sockets.accept_only(&many).unwrap_err().to_string().contains("251"));
    }
}
