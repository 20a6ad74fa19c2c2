//! What a participant says of itself: that it is there, and that it has gone (SPDP; RTPS 2.3, 8.5.3); and how it asks others
//! what they have (SEDP; 8.5.4).
//!
//! RustDDS says the same by itself, 100 ms after it was made and every 10 s, to the multicast group, to those it knows
//! and to the first 12 participants of this host, and that cannot be changed. So others are told from here, in its words.

use std::net::SocketAddrV4;
use std::time::Duration;

use bytes::{BufMut, BytesMut};

use super::Guid;
use super::datagram::{VERSION_AND_VENDOR, parameter, put_destination, put_head, put_header, put_sequence, submessage};

/// The writer and reader of participants' announcements (RTPS 2.3, 9.3.1.5).
pub(super) const PARTICIPANT_WRITER: [u8; 4] = [0x00, 0x01, 0x00, 0xc2];
const PARTICIPANT_READER: [u8; 4] = [0x00, 0x01, 0x00, 0xc7];
/// Parameter list in little-endian CDR.
const ENCAPSULATION: [u8; 4] = [0, 3, 0, 0];
/// Disposed and unregistered.
const GONE: [u8; 4] = [0, 0, 0, 3];

/// Announcements of every kind of endpoint that RustDDS 0.15.1 has: participants, publications, subscriptions, topics,
/// and liveliness, each with writer and reader.
pub(super) const ALL_ENDPOINTS: u32 = 0x1800_0c3f;
/// Of all endpoints only the reader of announcements.
pub(super) const LISTENS_ONLY: u32 = 0x2;

/// A participant, as it announces itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Presence {
    /// It.
    pub(super) participant: Guid,
    /// Which endpoints of discovery it has.
    pub(super) endpoints: u32,
    /// Where discovery reaches it, at single addresses and at a group.
    pub(super) discovery: Vec<SocketAddrV4>,
    pub(super) discovery_group: Option<SocketAddrV4>,
    /// Where all else reaches it.
    pub(super) user: Vec<SocketAddrV4>,
    pub(super) user_group: Option<SocketAddrV4>,
    /// After how long without a word others are to forget it.
    pub(super) lease: Duration,
}

impl Presence {
    /// The message that says that it is there.
    pub(super) fn encode(&self) -> BytesMut {
        let mut to = begin(self.participant, 1, submessage::WITH_DATA);
        to.put_slice(&ENCAPSULATION);
        put(&mut to, parameter::PROTOCOL_VERSION, &[VERSION_AND_VENDOR[0], VERSION_AND_VENDOR[1], 0, 0]);
        put(&mut to, parameter::VENDOR_ID, &[VERSION_AND_VENDOR[2], VERSION_AND_VENDOR[3], 0, 0]);
        put(&mut to, parameter::PARTICIPANT_GUID, &self.participant.0);
        put(&mut to, parameter::BUILTIN_ENDPOINT_SET, &self.endpoints.to_le_bytes());
        let locators = [
            (parameter::METATRAFFIC_UNICAST_LOCATOR, self.discovery.as_slice()),
            (parameter::METATRAFFIC_MULTICAST_LOCATOR, self.discovery_group.as_slice()),
            (parameter::DEFAULT_UNICAST_LOCATOR, self.user.as_slice()),
            (parameter::DEFAULT_MULTICAST_LOCATOR, self.user_group.as_slice()),
        ];
        for (id, addresses) in locators {
            for address in addresses {
                put(&mut to, id, &locator(*address));
            }
        }
        let seconds = u32::try_from(self.lease.as_secs()).unwrap_or(u32::MAX);
        put(&mut to, parameter::PARTICIPANT_LEASE_DURATION, &[seconds.to_le_bytes(), [0; 4]].concat());
        put(&mut to, parameter::SENTINEL, &[]);
        to
    }
}

/// Later than every announcement of ours: they are counted from 1, one in ten seconds.
pub(super) const LAST_SEQUENCE: i64 = 1 << 32;

/// The message that says that a participant has gone, after those of so many numbers.
pub(super) fn encode_gone(participant: Guid, sequence: i64) -> BytesMut {
    let mut to = begin(participant, sequence, submessage::INLINE_QOS);
    put(&mut to, parameter::KEY_HASH, &participant.0);
    put(&mut to, parameter::STATUS_INFO, &GONE);
    put(&mut to, parameter::SENTINEL, &[]);
    to
}

/// Writers and readers of what endpoints a participant has: publications and subscriptions (RTPS 2.3, 9.3.1.5).
const ENDPOINT_WRITERS: [[u8; 4]; 2] = [[0x00, 0x00, 0x03, 0xc2], [0x00, 0x00, 0x04, 0xc2]];
const ENDPOINT_READERS: [[u8; 4]; 2] = [[0x00, 0x00, 0x03, 0xc7], [0x00, 0x00, 0x04, 0xc7]];

/// Whether RustDDS made a participant: others may not take counts that do not rise.
pub(super) fn can_be_asked(participant: &Guid) -> bool {
    participant.0[..2] == VERSION_AND_VENDOR[2..]
}

/// The message in which `asker` has heard nothing yet of the endpoints of those `asked`, who say at once how much there is:
/// empty acknowledgements that are not final (RTPS 2.3, 8.3.7.1). They take nothing back that was acknowledged, and where all
/// was, nothing comes of them. A question with the `number` of the one before is taken for the same.
pub(super) fn encode_question<'a>(asker: Guid, asked: impl IntoIterator<Item = &'a Guid>, number: u16) -> BytesMut {
    let mut to = BytesMut::with_capacity(512);
    put_header(&mut to, asker);
    for asked in asked {
        put_destination(&mut to, *asked);
        for (reader, writer) in ENDPOINT_READERS.iter().zip(&ENDPOINT_WRITERS) {
            put_head(&mut to, submessage::ACKNACK, submessage::LITTLE_ENDIAN, 24);
            to.put_slice(reader);
            to.put_slice(writer);
            put_sequence(&mut to, Some(1));
            // None is asked for by its sequence number.
            to.put_u32_le(0);
            // The reader's own count begins at 0 and rises.
            to.put_i32_le(-1 - i32::from(number));
        }
    }
    to
}

/// A message of one announcement, as far as its inline QoS or its payload.
fn begin(participant: Guid, sequence: i64, flags: u8) -> BytesMut {
    let mut to = BytesMut::with_capacity(512);
    put_header(&mut to, participant);
    put_head(&mut to, submessage::DATA, submessage::LITTLE_ENDIAN | flags, 0);
    to.put_u16_le(0);
    // From here to the inline QoS: reader, writer and sequence number.
    to.put_u16_le(16);
    to.put_slice(&PARTICIPANT_READER);
    to.put_slice(&PARTICIPANT_WRITER);
    put_sequence(&mut to, Some(sequence));
    to
}

/// A parameter whose value fills whole words.
fn put(to: &mut BytesMut, id: u16, value: &[u8]) {
    to.put_u16_le(id);
    to.put_u16_le(u16::try_from(value.len()).unwrap_or(0));
    to.put_slice(value);
}

/// An address as RTPS writes it (RTPS 2.3, 9.3.2.3).
fn locator(address: SocketAddrV4) -> [u8; 24] {
    const UDP_V4: u8 = 1;
    let mut bytes = [0; 24];
    bytes[0] = UDP_V4;
    bytes[4..8].copy_from_slice(&u32::from(address.port()).to_le_bytes());
    bytes[20..].copy_from_slice(&address.ip().octets());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid() -> Guid {
        let mut guid = [7; 16];
        guid[12..].copy_from_slice(&[0, 0, 1, 0xc1]);
        Guid(guid)
    }

    #[test]
    fn the_goodbye_is_the_one_of_the_specification() {
        let expected = [
            &b"RTPS\x02\x04\x01\x12"[..],
            &[7; 12],
            &[0x15, 3, 0, 0, 0, 0, 16, 0],
            &[0, 1, 0, 0xc7],
            &[0, 1, 0, 0xc2],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &[0x70, 0, 16, 0],
            &guid().0,
            &[0x71, 0, 4, 0, 0, 0, 0, 3],
            &[1, 0, 0, 0],
        ]
        .concat();
        assert_eq!(encode_gone(guid(), 1 << 32).as_ref(), expected);
    }

    #[test]
    fn only_participants_of_rust_dds_are_asked() {
        let of_vendor = |vendor: [u8; 2]| {
            let mut guid = guid();
            guid.0[..2].copy_from_slice(&vendor);
            guid
        };
        assert!(can_be_asked(&of_vendor([0x01, 0x12])));
        let (fast_dds, cyclone_dds) = (of_vendor([0x01, 0x0f]), of_vendor([0x01, 0x10]));
        assert!(!can_be_asked(&fast_dds) && !can_be_asked(&cyclone_dds));
    }

    #[test]
    fn the_question_is_the_one_of_the_specification() {
        let expected = [
            &b"RTPS\x02\x04\x01\x12"[..],
            &[7; 12],
            &[0x0e, 1, 12, 0],
            &[9; 12],
            &[6, 1, 24, 0, 0, 0, 3, 0xc7, 0, 0, 3, 0xc2],
            &[0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0xfe, 0xff, 0xff, 0xff],
            &[6, 1, 24, 0, 0, 0, 4, 0xc7, 0, 0, 4, 0xc2],
            &[0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0xfe, 0xff, 0xff, 0xff],
        ]
        .concat();
        assert_eq!(encode_question(guid(), &[Guid([9; 16])], 1).as_ref(), expected);
    }

    #[test]
    fn the_announcement_is_the_one_of_the_specification() {
        let presence = Presence {
            participant: guid(),
            endpoints: LISTENS_ONLY,
            discovery: vec!["10.1.2.3:7410".parse().unwrap()],
            discovery_group: Some("239.255.0.1:7400".parse().unwrap()),
            user: Vec::new(),
            user_group: None,
            lease: Duration::from_secs(5),
        };
        let expected = [
            &b"RTPS\x02\x04\x01\x12"[..],
            &[7; 12],
            &[0x15, 5, 0, 0, 0, 0, 16, 0],
            &[0, 1, 0, 0xc7],
            &[0, 1, 0, 0xc2],
            &[0, 0, 0, 0, 1, 0, 0, 0],
            &[0, 3, 0, 0],
            &[0x15, 0, 4, 0, 2, 4, 0, 0],
            &[0x16, 0, 4, 0, 1, 0x12, 0, 0],
            &[0x50, 0, 16, 0],
            &guid().0,
            &[0x58, 0, 4, 0, 2, 0, 0, 0],
            &[0x32, 0, 24, 0, 1, 0, 0, 0, 0xf2, 0x1c, 0, 0],
            &[0; 12],
            &[10, 1, 2, 3],
            &[0x33, 0, 24, 0, 1, 0, 0, 0, 0xe8, 0x1c, 0, 0],
            &[0; 12],
            &[239, 255, 0, 1],
            &[2, 0, 8, 0, 5, 0, 0, 0, 0, 0, 0, 0],
            &[1, 0, 0, 0],
        ]
        .concat();
        assert_eq!(presence.encode().as_ref(), expected);
    }
}
