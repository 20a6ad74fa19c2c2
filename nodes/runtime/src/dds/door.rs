//! A participant that nobody can meet until it has all its endpoints.
//!
//! RustDDS lets a participant meet others from the moment it is made, and can lock up where endpoints are made while
//! others are found (see `lull.rs`). So the kernel is told to let nothing through to its sockets at first. It announces
//! itself only 100 ms later, so that nobody answers in vain when its endpoints are made by then: some take 20 ms. On a
//! machine so busy that they are not, those who heard it already are made to say again that they are there.
//!
//! A word of others still comes in while the participant is being made, before its sockets can be found. RustDDS answers
//! it, to everybody. All that follows is lost at the shut door, where each side takes the other for told, and is sent again
//! only after a second (`rtps/constant.rs`, `HEARTBEAT_PERIOD_SLOW`). So those who may have heard the answer are made to say
//! again that they are there, and whenever a participant finds somebody new it asks all it knows a few times what they have.
//!
//! It is announced from here at once when the door opens, and now and then later: to all participants that this host can
//! have, of which RustDDS tells the first 12, and on the hosts of the static peers, of which it knows nothing.

use std::collections::BTreeSet;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::{DomainParticipant, RTPSEntity};
use tokio::time::sleep;

use super::presence::{
    ALL_ENDPOINTS, LAST_SEQUENCE, LISTENS_ONLY, Presence, can_be_asked, encode_gone, encode_question,
};
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
/// Pauses between announcements; the last one comes again and again. The stranger stays for the first.
const PAUSES: [Duration; 4] =
    [Duration::from_millis(300), Duration::from_secs(1), Duration::from_secs(3), Duration::from_secs(10)];
/// How long a participant asks those it knows, between two looks at who is there, and how often when somebody new is.
const CURIOUS_FOR: Duration = Duration::from_secs(5);
const LOOK: Duration = Duration::from_millis(40);
const QUESTIONS: u32 = 4;
/// How many are asked in one message, which fits one packet.
const ASKED_AT_ONCE: usize = 16;
/// In a larger crowd nobody is asked, since every question goes to each of its places: RustDDS's own heartbeat will do.
const CROWD: usize = 32;

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

    /// Lets others in, and tells them that `participant` is there, which has `known` some at a time. What is to be done
    /// later is returned.
    pub(super) fn open(
        &self,
        participant: Guid,
        number: u16,
        known: impl Fn() -> BTreeSet<Guid> + Send + 'static,
    ) -> Option<impl Future<Output = ()> + Send + 'static> {
        let sockets = Arc::clone(self.sockets.as_ref()?);
        if self.is_open.swap(true, Ordering::AcqRel) {
            return None;
        }
        if let Err(error) = self.reach.open(&sockets) {
            tracing::error!("the sockets of the DDS library stay closed: {error}");
        }
        let is_known_already = self.made.elapsed() >= ANNOUNCED_BY_ITSELF || !known().is_empty();
        let herald = self.herald(sockets, participant, number);
        let stranger = is_known_already.then(|| herald.stranger());
        if let Some(stranger) = &stranger {
            herald.tell(&stranger.encode());
        }
        herald.tell(&herald.presence.encode());
        Some(herald.go_on(stranger, known))
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

    /// Asks others what endpoints they have.
    fn ask(&self, others: &BTreeSet<Guid>, number: u16) {
        let others: Vec<&Guid> = others.iter().filter(|other| can_be_asked(other)).collect();
        if others.len() > CROWD {
            return;
        }
        for asked in others.chunks(ASKED_AT_ONCE) {
            self.tell(&encode_question(self.presence.participant, asked.iter().copied(), number));
        }
    }

    fn tell(&self, message: &[u8]) {
        let own = |port, host: Ipv4Addr| port == self.port && host.is_loopback();
        let places = self.reach.places().filter(|place| !own(place.port(), *place.ip()));
        let told = self.sockets.send_to(message, places);
        let group = self.presence.discovery_group.map_or(Ok(()), |group| self.sockets.send_to_group(message, group));
        // A host that is out of reach is tried again later.
        if let Err(error) = told.and(group) {
            tracing::debug!("not everybody was told of this participant: {error}");
        }
    }

    async fn go_on(self, stranger: Option<Presence>, known: impl Fn() -> BTreeSet<Guid>) {
        futures::join!(self.announce(stranger), self.ask_around(known));
    }

    async fn announce(&self, mut stranger: Option<Presence>) {
        let message = self.presence.encode();
        let mut pauses = PAUSES.into_iter();
        let mut pause = PAUSES[0];
        loop {
            pause = pauses.next().unwrap_or(pause);
            sleep(pause).await;
            if let Some(stranger) = stranger.take() {
                self.tell(&encode_gone(stranger.participant, 2));
            }
            self.tell(&message);
        }
    }

    async fn ask_around(&self, known: impl Fn() -> BTreeSet<Guid>) {
        let began = Instant::now();
        let (mut acquainted, mut number, mut questions) = (BTreeSet::new(), 0_u16, 0);
        while began.elapsed() < CURIOUS_FOR {
            let others = known();
            if !others.is_subset(&acquainted) {
                questions = QUESTIONS;
            }
            if questions > 0 {
                self.ask(&others, number);
                (number, questions) = (number.wrapping_add(1), questions - 1);
            }
            acquainted = others;
            sleep(LOOK).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::sync::{Mutex, PoisonError};

    use super::super::{DiscoveryRange, StaticPeers};
    use super::*;

    const DOMAIN: u16 = 229;

    /// A participant of some vendor.
    fn guid(vendor: [u8; 2], byte: u8) -> Guid {
        let mut guid = [byte; 16];
        guid[..2].copy_from_slice(&vendor);
        Guid(guid)
    }

    /// A socket where the participant of some number listens, from this number on.
    fn listen(reach: &Reach, from: u16) -> (UdpSocket, u16) {
        let bound = (from..100).find_map(|number| {
            let socket = UdpSocket::bind(("0.0.0.0", reach.discovery_port(number))).ok()?;
            Some((socket, number))
        });
        let (socket, number) = bound.expect("a port is free");
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        (socket, number)
    }

    fn heard(by: &UdpSocket) -> Vec<u8> {
        let mut message = [0; 1_500];
        let bytes = by.recv(&mut message).unwrap();
        message[..bytes].to_vec()
    }

    /// A door to be opened by the participant of the returned number, where another listens, and what lets the next test in:
    /// all listen on the first ports that are free.
    fn door() -> (Door, u16, UdpSocket, impl Drop) {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        let one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let domain = Domain { id: DOMAIN, range: DiscoveryRange::Localhost, peers: StaticPeers::default() };
        let reach = Reach::of(&domain, &[]);
        // The socket is found as a new one, and goes on as a duplicate.
        let ((_, number), sockets) = Sockets::opened_by(|| listen(&reach, 0));
        let (other, _) = listen(&reach, number + 1);
        let sockets = Some(Arc::new(sockets.unwrap()));
        let is_open = AtomicBool::new(false);
        (Door { sockets, reach, own: Vec::new(), made: Instant::now(), is_open }, number, other, one)
    }

    #[test]
    fn all_that_are_known_are_asked_when_somebody_new_is() {
        let (door, number, other, _one) = door();
        let [me, one, two] = [7, 1, 2].map(|byte| guid([0x01, 0x12], byte));
        let all = Arc::new(Mutex::new(BTreeSet::from([one, guid([0x01, 0x0f], 3)])));
        let known = {
            let all = Arc::clone(&all);
            move || all.lock().unwrap().clone()
        };
        let later = door.open(me, number, known).unwrap();
        let herald = door.herald(Arc::clone(door.sockets.as_ref().unwrap()), me, number);
        assert_eq!(heard(&other), herald.stranger().encode(), "others say again that they are there");
        assert_eq!(heard(&other), herald.presence.encode(), "they know it before it asks");
        std::thread::spawn(|| {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
            runtime.block_on(later);
        });
        for number in 0..4 {
            assert_eq!(heard(&other), encode_question(me, &[one], number));
        }
        assert_eq!(heard(&other), encode_gone(herald.stranger().participant, 2), "the stranger leaves");
        assert_eq!(heard(&other), herald.presence.encode(), "it is announced again");
        all.lock().unwrap().insert(two);
        for number in 4..8 {
            assert_eq!(heard(&other), encode_question(me, &[one, two], number));
        }
    }

    #[test]
    fn a_crowd_is_not_asked() {
        let (door, number, other, _one) = door();
        let me = guid([0x01, 0x12], 200);
        let herald = door.herald(Arc::clone(door.sockets.as_ref().unwrap()), me, number);
        let crowd: BTreeSet<Guid> = (0..33).map(|byte| guid([0x01, 0x12], byte)).collect();
        herald.ask(&crowd, 0);
        herald.tell(b"next");
        assert_eq!(heard(&other), b"next");
        herald.ask(&crowd.iter().copied().take(32).collect(), 1);
        let asked: Vec<&Guid> = crowd.iter().take(32).collect();
        for asked in asked.chunks(16) {
            assert_eq!(heard(&other), encode_question(me, asked.iter().copied(), 1));
        }
    }
}
