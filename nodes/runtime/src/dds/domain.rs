//! The DDS domain, and how far others are looked for, as the environment says.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, ToSocketAddrs as _};

use super::DdsError;
use super::sockets::SOURCES_MAX;

const DOMAIN_ID: &str = "ROS_DOMAIN_ID";
const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
const STATIC_PEERS: &str = "ROS_STATIC_PEERS";
const LOCALHOST_ONLY: &str = "ROS_LOCALHOST_ONLY";

/// How far participants are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DiscoveryRange {
    /// This host only, and the static peers: from nobody else anything is taken. Without static peers nothing is sent to,
    /// or advertised on, any network interface but loopback.
    ///
    /// Participants on this host are found whatever their own range, as long as they listen on the
    /// loopback interface. A Cyclone DDS that multicasts on another interface does not: it needs the
    /// range `LOCALHOST` too (in its own terms: no multicast, participant index `auto`, peer
    /// `localhost`), or this side [`Subnet`](Self::Subnet).
    Localhost,
    /// Every interface that can multicast, and the static peers. What ROS 2 does without further settings.
    Subnet,
    /// Nobody is looked for, nothing is advertised, and nothing is taken.
    Off,
}

/// Addresses of hosts on which participants are looked for one by one, as multicast may not get there.
///
/// They are kept for the life of the process: it reads them once.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct StaticPeers(&'static [Ipv4Addr]);

impl StaticPeers {
    /// These hosts.
    #[must_use]
    pub fn new(hosts: &BTreeSet<Ipv4Addr>) -> Self {
        Self(Vec::leak(hosts.iter().copied().collect()))
    }

    /// The hosts, in order.
    #[must_use]
    pub fn hosts(&self) -> &'static [Ipv4Addr] {
        self.0
    }

    /// Reads addresses and names of hosts with a `;` between them.
    fn parse(text: &str) -> Option<Self> {
        let words = text.split(';').map(str::trim).filter(|word| !word.is_empty());
        let hosts = words.map(ipv4).collect::<Option<BTreeSet<_>>>()?;
        (hosts.len() <= SOURCES_MAX).then(|| Self::new(&hosts))
    }
}

/// The address of a host; of one with a name the first that the system finds.
fn ipv4(host: &str) -> Option<Ipv4Addr> {
    let found = (host, 0).to_socket_addrs().ok()?;
    found.into_iter().find_map(|address| if let IpAddr::V4(address) = address.ip() { Some(address) } else { None })
}

/// A DDS domain and how far discovery reaches in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Domain {
    /// Domain number, 0 to [`Domain::ID_MAX`].
    pub id: u16,
    /// How far participants are looked for.
    pub range: DiscoveryRange,
    /// Where they are looked for besides; nobody is where the range is [`DiscoveryRange::Off`].
    pub peers: StaticPeers,
}

impl Domain {
    /// The largest domain whose ports (7400 + 250 · id and following) are valid UDP ports.
    ///
    /// On Linux, domains 102 to 214 share their ports with those the system hands out for a short
    /// time, so a participant there may find its port taken. A domain holds up to 120 participants
    /// on one host, domain 232 only 62.
    pub const ID_MAX: u16 = 232;

    /// The domain the environment asks for, read as ROS 2 reads it.
    ///
    /// - `ROS_DOMAIN_ID`: 0 when unset or empty.
    /// - `ROS_AUTOMATIC_DISCOVERY_RANGE`: `LOCALHOST`, `SUBNET`, `OFF`, or `SYSTEM_DEFAULT`, which
    ///   is `SUBNET` without static peers, as ROS 2's middlewares have it; nothing is `SUBNET`.
    /// - `ROS_STATIC_PEERS`: IPv4 addresses or names of hosts, with a `;` between them. Names are looked up at once.
    /// - `ROS_LOCALHOST_ONLY`: `1` means `LOCALHOST` whatever the range says (older than it, and
    ///   still honoured by ROS 2); `0` or nothing leaves the range alone.
    ///
    /// # Errors
    /// [`DdsError::Environment`] names the variable, its value and what is allowed.
    pub fn from_env() -> Result<Self, DdsError> {
        Self::from_lookup(|variable| std::env::var_os(variable).map(|value| value.to_string_lossy().into_owned()))
    }

    /// As [`from_env`](Self::from_env), with the variables taken from a function.
    ///
    /// # Errors
    /// As [`from_env`](Self::from_env).
    pub fn from_lookup(lookup: impl Fn(&str) -> Option<String>) -> Result<Self, DdsError> {
        let set = |variable| lookup(variable).filter(|value| !value.is_empty());
        let id = match set(DOMAIN_ID) {
            None => 0,
            Some(value) => value.parse().ok().filter(|id| *id <= Self::ID_MAX).ok_or(DdsError::Environment {
                variable: DOMAIN_ID,
                value,
                allowed: "a number from 0 to 232",
            })?,
        };
        let range = match set(RANGE).as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => DiscoveryRange::Subnet,
            Some("LOCALHOST") => DiscoveryRange::Localhost,
            Some("OFF") => DiscoveryRange::Off,
            Some(other) => {
                return Err(DdsError::Environment {
                    variable: RANGE,
                    value: other.to_owned(),
                    allowed: "LOCALHOST, SUBNET, OFF, SYSTEM_DEFAULT",
                });
            }
        };
        let range = match set(LOCALHOST_ONLY).as_deref() {
            None | Some("0") => range,
            Some("1") => DiscoveryRange::Localhost,
            Some(other) => {
                return Err(DdsError::Environment {
                    variable: LOCALHOST_ONLY,
                    value: other.to_owned(),
                    allowed: "0, 1",
                });
            }
        };
        let peers = match set(STATIC_PEERS) {
            Some(_) if set(RANGE).as_deref() == Some("SYSTEM_DEFAULT") => {
                tracing::warn!("{RANGE}=SYSTEM_DEFAULT changes no setting of discovery: {STATIC_PEERS} is left out");
                StaticPeers::default()
            }
            None => StaticPeers::default(),
            Some(value) => StaticPeers::parse(&value).ok_or(DdsError::Environment {
                variable: STATIC_PEERS,
                value,
                allowed: "IPv4 addresses, or names of hosts that the system finds one for, with a ; between them, 250 at most",
            })?,
        };
        Ok(Self { id, range, peers })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(variables: &[(&str, &str)]) -> Result<Domain, DdsError> {
        Domain::from_lookup(|name| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
    }

    #[test]
    fn nothing_set_is_what_ros_does() {
        let domain = Domain { id: 0, range: DiscoveryRange::Subnet, peers: StaticPeers::default() };
        assert_eq!(read(&[]).expect("defaults"), domain);
        assert_eq!(read(&[(DOMAIN_ID, ""), (RANGE, "")]).expect("empty is unset"), domain);
    }

    #[test]
    fn values_are_read() {
        let read = |variables| read(variables).expect("good values");
        assert_eq!(read(&[(DOMAIN_ID, "232")]).id, 232);
        assert_eq!(read(&[(RANGE, "LOCALHOST")]).range, DiscoveryRange::Localhost);
        assert_eq!(read(&[(RANGE, "OFF")]).range, DiscoveryRange::Off);
        assert_eq!(read(&[(RANGE, "SYSTEM_DEFAULT")]).range, DiscoveryRange::Subnet);
        assert_eq!(read(&[(RANGE, "SUBNET"), (LOCALHOST_ONLY, "1")]).range, DiscoveryRange::Localhost);
        assert_eq!(read(&[(RANGE, "LOCALHOST"), (LOCALHOST_ONLY, "0")]).range, DiscoveryRange::Localhost);
    }

    #[test]
    fn static_peers_are_read() {
        let read = |variables| read(variables).expect("good values").peers;
        let two = StaticPeers::new(&BTreeSet::from([Ipv4Addr::new(10, 0, 0, 9), Ipv4Addr::new(192, 168, 0, 1)]));
        assert_eq!(read(&[(STATIC_PEERS, "192.168.0.1; 10.0.0.9;")]), two);
        assert_eq!(read(&[(STATIC_PEERS, "10.0.0.9;192.168.0.1;10.0.0.9"), (RANGE, "LOCALHOST")]), two);
        assert_eq!(read(&[(STATIC_PEERS, "localhost")]).hosts(), [Ipv4Addr::LOCALHOST]);
        assert_eq!(read(&[(STATIC_PEERS, "")]), StaticPeers::default());
        assert_eq!(read(&[(STATIC_PEERS, "10.0.0.9"), (RANGE, "SYSTEM_DEFAULT")]), StaticPeers::default());
    }

    #[test]
    fn a_bad_value_is_refused_by_name() {
        for (variable, value) in [
            (DOMAIN_ID, "233"),
            (DOMAIN_ID, "-1"),
            (DOMAIN_ID, "1.5"),
            (DOMAIN_ID, "zero"),
            (DOMAIN_ID, "99999999999999999999"),
            (RANGE, "localhost"),
            (RANGE, "EVERYWHERE"),
            (LOCALHOST_ONLY, "yes"),
            (STATIC_PEERS, "10.0.0.9,10.0.0.10"),
            (STATIC_PEERS, "fe80::1"),
            (STATIC_PEERS, "10.0.0.9:7400"),
        ] {
            let message = read(&[(variable, value)]).expect_err(value).to_string();
            assert!(message.contains(variable) && message.contains(value) && message.contains("allowed"), "{message}");
        }
    }
}
