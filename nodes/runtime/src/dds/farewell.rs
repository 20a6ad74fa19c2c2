//! A participant's goodbye.
//!
//! RustDDS tells others that a participant and its endpoints have gone by samples whose payload is the key, 28 bytes.
//! Fast DDS 2 takes a key as payload for a bare GUID and ignores one of more than 16 bytes (2.14.4,
//! `src/cpp/rtps/messages/MessageReceiver.cpp`, 881): it keeps our topics until the lease runs out, 50 s that RustDDS
//! 0.15.1 does not let us shorten (`discovery/discovery.rs`, 304 and 1451). What Fast DDS itself sends has no payload: the
//! key is in the inline QoS (RTPS 2.3, 9.6.3.8). So its participants are told once more, in that form.

use std::{collections::BTreeSet, net::SocketAddr, thread::sleep, time::Duration};

use ros2_client::dds::rustdds::{DomainParticipant, RTPSEntity};

use super::{
    Guid, datagram, graph,
    presence::{LAST_SEQUENCE, encode_gone},
    wire,
};

/// How long a participant stays after its last endpoint has gone. The DDS library stops its sending thread without
/// looking whether it has sent everything, and on a busy machine it has not: what is lost then stays on the graph as a
/// ghost for most of a minute.
const STAY: Duration = Duration::from_millis(30);

/// Lets the goodbyes of what was dropped before it be sent, and sends one to those who cannot read them.
pub(super) struct Farewell {
    participant: DomainParticipant,
}

impl Farewell {
    pub(super) fn of(participant: &DomainParticipant) -> Self {
        Self { participant: participant.clone() }
    }
}

impl Drop for Farewell {
    fn drop(&mut self) {
        sleep(STAY);
        let message = encode_gone(self.participant.guid().into(), LAST_SEQUENCE);
        for address in addresses(&self.participant) {
            // Without it they forget us when the lease runs out.
            if let Err(error) = datagram::send(&message, &[address]) {
                tracing::debug!(%address, "no goodbye: {error}");
            }
        }
    }
}

/// Where the participants of Fast DDS listen for announcements: its port is the one before that for messages
/// (RTPS 2.3, 9.6.1.4), and only those are told to the application.
fn addresses(participant: &DomainParticipant) -> BTreeSet<SocketAddr> {
    let of_fast_dds = |endpoint: &Guid| wire::speaks_related(*endpoint);
    let for_announcements = |mut address: SocketAddr| {
        address.set_port(address.port().saturating_sub(1));
        address
    };
    graph::addresses(participant, of_fast_dds).into_iter().map(for_announcements).collect()
}
