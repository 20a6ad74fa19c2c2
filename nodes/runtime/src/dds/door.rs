//! A participant that nobody can meet until it has all its endpoints.
//!
//! RustDDS lets a participant meet others from the moment it is made, and can lock up where endpoints are made while
//! others are found (see `lull.rs`). So the kernel is told to let nothing through to its sockets at first. It announces
//! itself only 100 ms later, so that nobody answers in vain when its endpoints are made by then: some take 20 ms. On a
//! machine so busy that they are not, those who heard it already are made to say again that they are there.
//!
//! It is announced from here at once when the door opens, and now and then later: to all participants that this host can
//! have, of which RustDDS tells the first 12, and on the hosts of the static peers, of which it knows nothing.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::{DomainParticipant, RTPSEntity};
use tokio::time::sleep;

use super::presence::{ALL_ENDPOINTS, LAST_SEQUENCE, LISTENS_ONLY, Presence, encode_gone};
use super::reach::{Kind, Own, Reach};
use super::relay::{Relay, Source, Written};
use super::sockets::Sockets;
use super::{Domain, Guid};

/// When RustDDS announces a participant for the first time, after it was made (`discovery/discovery.rs`, 140), and less.
const ANNOUNCED_BY_ITSELF: Duration = Duration::from_millis(90);
/// After how long without a word others forget it: what RustDDS says of itself.
const LEASE: Duration = Duration::from_secs(50);
/// The same for a stranger that only asks.
const LEASE_OF_STRANGER: Duration = Duration::from_secs(3);
/// How long the stranger stays.
const STAY_OF_STRANGER: Duration = Duration::from_millis(500);
/// Pauses between announcements; the last one comes again and again.
const PAUSES: [Duration; 4] =
    [Duration::from_millis(300), Duration::from_secs(1), Duration::from_secs(3), Duration::from_secs(10)];

/// What others learn of a participant, and when.
pub(super) struct Door {
    /// None where the system does not tell them: then it is open from the start.
    sockets: Option<Arc<Sockets>>,
    reach: Reach,
    own: Vec<Own>,
    made: Instant,
    is_open: AtomicBool,
}

impl Door {
    /// Makes a participant by `make`, which is given where it may be reached, and closes its door.
    pub(super) fn shut<E>(
        domain: &Domain,
        make: impl FnOnce(&Reach) -> Result<DomainParticipant, E>,
    ) -> Result<(DomainParticipant, Self), E> {
        let own = super::reach::own_addresses().unwrap_or_else(|error| {
            tracing::warn!("the addresses of this host are not known: {error}");
            Vec::new()
        });
        let reach = Reach::of(domain, &own);
        let (participant, found) = Sockets::opened_by(|| make(&reach));
        let participant = participant?;
        let shut = found.and_then(|sockets| {
            reach.hold_back(&sockets)?;
            sockets.refuse_all()?;
            Ok(Arc::new(sockets))
        });
        let sockets = shut.inspect_err(|error| {
            tracing::warn!("the sockets of the DDS library cannot be held back, and are open to every host: {error}");
        });
        let sockets = sockets.ok();
        let is_open = AtomicBool::new(sockets.is_none());
        Ok((participant, Self { sockets, reach, own, made: Instant::now(), is_open }))
    }

    /// Whether others can be met.
    pub(super) fn is_open(&self) -> bool {
        self.is_open.load(Ordering::Acquire)
    }

    /// What takes messages for the group to static peers, if there are any.
    pub(super) fn relay(&self, participant: &DomainParticipant, written: &Written) -> Option<Relay> {
        let sockets = Arc::clone(self.sockets.as_ref().filter(|_| self.reach.has_peers())?);
        let (reach, written) = (self.reach.clone(), Arc::clone(written));
        let source =
            Source { participant: participant.clone(), guid: participant.guid().into(), sockets, reach, written };
        let started = Relay::start(&source, &self.own);
        started
            .inspect_err(|error| tracing::warn!("what goes to the group does not get to static peers: {error}"))
            .ok()?
    }

    /// Lets others in, and tells them that `participant` is there. What is to be done later is returned.
    pub(super) fn open(&self, participant: Guid, number: u16) -> Option<impl Future<Output = ()> + Send + 'static> {
        let sockets = Arc::clone(self.sockets.as_ref()?);
        if self.is_open.swap(true, Ordering::AcqRel) {
            return None;
        }
        if let Err(error) = self.reach.open(&sockets) {
            tracing::error!("the sockets of the DDS library stay closed: {error}");
        }
        let is_known_already = self.made.elapsed() >= ANNOUNCED_BY_ITSELF;
        let herald = self.herald(sockets, participant, number);
        let stranger = is_known_already.then(|| herald.stranger());
        if let Some(stranger) = &stranger {
            herald.tell(&stranger.encode());
        }
        herald.tell(&herald.presence.encode());
        Some(herald.go_on(stranger))
    }

    /// What tells others, when it is dropped, that `participant` has gone.
    pub(super) fn last_word(&self, participant: Guid, number: u16) -> LastWord {
        LastWord(self.sockets.as_ref().map(|sockets| self.herald(Arc::clone(sockets), participant, number)))
    }

    fn herald(&self, sockets: Arc<Sockets>, participant: Guid, number: u16) -> Herald {
        let presence = self.presence(&sockets, participant, number);
        Herald { sockets, reach: self.reach.clone(), port: self.reach.discovery_port(number), presence }
    }

    fn presence(&self, sockets: &Sockets, participant: Guid, number: u16) -> Presence {
        let discovery = self.reach.discovery_port(number);
        let (discovery_group, user_group) =
            (self.reach.group(&self.own, Kind::Discovery), self.reach.group(&self.own, Kind::User));
        // The next one, but where somebody else has taken it; endpoints tell theirs themselves.
        let user = Some(discovery + 1).filter(|port| sockets.ports().contains(port));
        let user = user.map(|port| self.reach.addresses(&self.own, port)).unwrap_or_default();
        Presence {
            participant,
            endpoints: ALL_ENDPOINTS,
            discovery: self.reach.addresses(&self.own, discovery),
            discovery_group,
            user,
            user_group,
            lease: LEASE,
        }
    }
}

/// Tells others that a participant has gone, when the DDS library has let go of it. The library says so to the group alone;
/// an announcement from here that came to a socket of its own just before may be read after that, on a busy machine, and
/// would bring the participant back as a ghost.
pub(super) struct LastWord(Option<Herald>);

impl Drop for LastWord {
    fn drop(&mut self) {
        if let Some(herald) = &self.0 {
            herald.tell(&encode_gone(herald.presence.participant, LAST_SEQUENCE));
        }
    }
}

/// Announces a participant.
struct Herald {
    sockets: Arc<Sockets>,
    reach: Reach,
    /// Where the participant itself listens.
    port: u16,
    presence: Presence,
}

impl Herald {
    /// Somebody who is there for a moment only, so that everybody answers whom he has not seen, to where the participant
    /// hears it.
    fn stranger(&self) -> Presence {
        let mut participant = self.presence.participant;
        // What tells participants apart; before it the vendor, behind it the kind.
        for byte in &mut participant.0[2..12] {
            *byte = !*byte;
        }
        let user = Vec::new();
        Presence { participant, endpoints: LISTENS_ONLY, user, lease: LEASE_OF_STRANGER, ..self.presence.clone() }
    }

    fn tell(&self, message: &[u8]) {
        let own = |port, host: std::net::Ipv4Addr| port == self.port && host.is_loopback();
        let places = self.reach.places().filter(|place| !own(place.port(), *place.ip()));
        let told = self.sockets.send_to(message, places);
        let group = self.presence.discovery_group.map_or(Ok(()), |group| self.sockets.send_to_group(message, group));
        // A host that is out of reach is tried again later.
        if let Err(error) = told.and(group) {
            tracing::debug!("not everybody was told of this participant: {error}");
        }
    }

    async fn go_on(self, stranger: Option<Presence>) {
        if let Some(stranger) = stranger {
            sleep(STAY_OF_STRANGER).await;
            self.tell(&encode_gone(stranger.participant, 2));
        }
        let message = self.presence.encode();
        let mut pauses = PAUSES.into_iter();
        let mut pause = PAUSES[0];
        loop {
            pause = pauses.next().unwrap_or(pause);
            sleep(pause).await;
            self.tell(&message);
        }
    }
}
