//! Whom a participant lets come near, and where it looks for others: what a range of discovery means in sockets.

use std::collections::BTreeSet;
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;

use super::sockets::Sockets;
use super::{DiscoveryRange, Domain};

/// The group of every domain.
pub(super) const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// How many participants of a domain a host can have, by their ports (RTPS 2.3, 9.6.1.1).
const PARTICIPANTS_MAX: u16 = 120;

/// An address of this host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Own {
    pub(super) address: Ipv4Addr,
    pub(super) is_multicast: bool,
}

/// The addresses of this host.
pub(super) fn own_addresses() -> io::Result<Vec<Own>> {
    let interfaces = getifaddrs()?;
    let own = interfaces.filter_map(|interface| {
        let address = interface.address?.as_sockaddr_in()?.ip();
        Some(Own { address, is_multicast: interface.flags.contains(InterfaceFlags::IFF_MULTICAST) })
    });
    Ok(own.collect())
}

/// What a participant of a domain may reach, and who may reach it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Reach {
    domain: u16,
    /// The addresses it is to be reached at; all, if none are given.
    pub(super) networks: Option<Vec<Ipv4Addr>>,
    /// From whom it takes messages besides this host; from everybody, if nobody is given.
    sources: Option<BTreeSet<Ipv4Addr>>,
    /// Whether what goes to the group leaves this host.
    groups_leave: bool,
    /// Hosts on which others are looked for one by one.
    hosts: Vec<Ipv4Addr>,
}

impl Reach {
    pub(super) fn of(domain: &Domain, own: &[Own]) -> Self {
        // The same list may be given to all hosts; this one is looked for by its loopback interface.
        let is_other = |peer: &&Ipv4Addr| !own.iter().any(|own| own.address == **peer);
        let peers: Vec<Ipv4Addr> = domain.peers.hosts().iter().filter(is_other).copied().collect();
        let reach = Self { domain: domain.id, networks: None, sources: None, groups_leave: true, hosts: Vec::new() };
        let hosts = || [&[Ipv4Addr::LOCALHOST], peers.as_slice()].concat();
        match domain.range {
            DiscoveryRange::Off => Self { networks: Some(Vec::new()), sources: Some(BTreeSet::new()), ..reach },
            DiscoveryRange::Subnet => Self { hosts: hosts(), ..reach },
            DiscoveryRange::Localhost if domain.peers.hosts().is_empty() => Self {
                networks: Some(vec![Ipv4Addr::LOCALHOST]),
                sources: Some(BTreeSet::new()),
                hosts: hosts(),
                ..reach
            },
            DiscoveryRange::Localhost => {
                // What goes to the group comes back by the interface it would have left by.
                let sources = peers.iter().copied().chain(own.iter().map(|own| own.address)).collect();
                Self { sources: Some(sources), groups_leave: false, hosts: hosts(), ..reach }
            }
        }
    }

    /// Lets in whom it takes messages from.
    pub(super) fn open(&self, sockets: &Sockets) -> io::Result<()> {
        match &self.sources {
            None => sockets.accept_all(),
            Some(_) if self.hosts.is_empty() => sockets.refuse_all(),
            Some(sources) => sockets.accept_only(sources),
        }
    }

    /// Keeps on this host what must not leave it.
    pub(super) fn hold_back(&self, sockets: &Sockets) -> io::Result<()> {
        if self.groups_leave { Ok(()) } else { sockets.keep_groups_here() }
    }

    /// Where it says that it is to be reached, at a port.
    pub(super) fn addresses(&self, own: &[Own], port: u16) -> Vec<SocketAddrV4> {
        self.advertised(own).map(|own| SocketAddrV4::new(own.address, port)).collect()
    }

    /// The group at which it says that it is to be reached too: the one for discovery, or for all else.
    pub(super) fn group(&self, own: &[Own], kind: Kind) -> Option<SocketAddrV4> {
        let has_group = self.advertised(own).any(|own| own.is_multicast);
        let offset = if kind == Kind::Discovery { 0 } else { 1 };
        has_group.then(|| SocketAddrV4::new(GROUP, self.port(offset).unwrap_or_default()))
    }

    /// Where participants may listen for announcements: of this host, and of every static peer.
    pub(super) fn places(&self) -> impl Iterator<Item = SocketAddrV4> {
        let ports = (0..PARTICIPANTS_MAX).filter_map(|number| self.port(10 + 2 * number));
        ports.flat_map(|port| self.hosts.iter().map(move |host| SocketAddrV4::new(*host, port)))
    }

    /// Whether this is the address of a host where others are looked for one by one, besides this one.
    pub(super) fn is_peer(&self, address: Ipv4Addr) -> bool {
        !address.is_loopback() && self.hosts.contains(&address)
    }

    /// Whether there are such hosts.
    pub(super) fn has_peers(&self) -> bool {
        self.hosts.iter().any(|host| self.is_peer(*host))
    }

    /// The port of discovery of the participant of this number.
    pub(super) fn discovery_port(&self, participant: u16) -> u16 {
        self.port(10 + 2 * participant).unwrap_or_default()
    }

    fn advertised<'a>(&'a self, own: &'a [Own]) -> impl Iterator<Item = &'a Own> {
        own.iter().filter(|own| self.networks.as_ref().is_none_or(|networks| networks.contains(&own.address)))
    }

    /// A port of the domain (RTPS 2.3, 9.6.1.1).
    fn port(&self, offset: u16) -> Option<u16> {
        self.domain.checked_mul(250)?.checked_add(7400)?.checked_add(offset)
    }
}

/// What is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Discovery,
    User,
}

#[cfg(test)]
mod tests {
    use super::super::StaticPeers;
    use super::*;

    const PEER: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 2);

    fn own() -> [Own; 2] {
        [
            Own { address: Ipv4Addr::LOCALHOST, is_multicast: false },
            Own { address: Ipv4Addr::new(10, 0, 0, 1), is_multicast: true },
        ]
    }

    fn reach(range: DiscoveryRange, peers: &[Ipv4Addr]) -> Reach {
        let peers = StaticPeers::new(&peers.iter().copied().collect());
        Reach::of(&Domain { id: 3, range, peers }, &own())
    }

    fn at(address: &str) -> SocketAddrV4 {
        address.parse().unwrap()
    }

    #[test]
    fn without_static_peers_localhost_is_this_host_alone() {
        let reach = reach(DiscoveryRange::Localhost, &[]);
        assert_eq!(reach.addresses(&own(), 8_160), [at("127.0.0.1:8160")]);
        assert_eq!(reach.group(&own(), Kind::User), None);
        assert_eq!(reach.sources, Some(BTreeSet::new()));
        let places: Vec<_> = reach.places().collect();
        assert_eq!((places.len(), places[0], places[119]), (120, at("127.0.0.1:8160"), at("127.0.0.1:8398")));
    }

    #[test]
    fn with_static_peers_localhost_is_this_host_and_they() {
        let reach = reach(DiscoveryRange::Localhost, &[PEER, own()[1].address]);
        assert_eq!(reach.addresses(&own(), 8_160), [at("127.0.0.1:8160"), at("10.0.0.1:8160")]);
        assert_eq!(reach.group(&own(), Kind::User), Some(at("239.255.0.1:8151")));
        assert!(!reach.groups_leave);
        let sources = own().map(|own| own.address).into_iter().chain([PEER]).collect();
        assert_eq!(reach.sources, Some(sources));
        assert!(reach.places().any(|place| place == at("10.0.0.2:8160")));
    }

    #[test]
    fn subnet_is_open_and_off_is_closed() {
        let open = reach(DiscoveryRange::Subnet, &[PEER]);
        assert_eq!((&open.sources, open.groups_leave), (&None, true));
        assert_eq!(open.group(&own(), Kind::Discovery), Some(at("239.255.0.1:8150")));
        assert_eq!(open.places().count(), 240);
        let closed = reach(DiscoveryRange::Off, &[PEER]);
        assert_eq!((closed.addresses(&own(), 8_160), closed.places().count()), (Vec::new(), 0));
        assert_eq!(closed.networks, Some(Vec::new()));
    }

    #[test]
    fn the_last_domain_has_fewer_ports() {
        let domain = Domain { id: Domain::ID_MAX, range: DiscoveryRange::Localhost, peers: StaticPeers::default() };
        assert_eq!(Reach::of(&domain, &own()).places().count(), 63);
    }
}
