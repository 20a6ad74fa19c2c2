//! A sample in one datagram, for a reader that cannot take it in fragments.
//!
//! RustDDS 0.15.1 writes the inline QoS of a fragment with a byte too many (`messages/submessages/data_frag.rs`, where an
//! `Option` is written for its content). Fast DDS cannot read such a fragment, and what the writer sends to that reader
//! afterwards waits behind it for ever. Of what ROS 2 sends only replies carry inline QoS: the identity of the request.
//! A reply to Fast DDS that RustDDS would send in fragments therefore goes out as one DATA submessage (RTPS 2.3, 9.4.5.3),
//! which IP takes apart and puts together, with the sequence number that comes next; then RustDDS is given a stand-in
//! without identity for that number. The reader takes what comes first, and acknowledges it to RustDDS; a client that
//! only gets the stand-in, as the datagram was lost, takes it for nobody's answer.

use std::net::{SocketAddr, UdpSocket};

use bytes::{BufMut, BytesMut};

use super::{Guid, SampleId};

/// Bodies of samples that are larger may leave in fragments, bytes. RustDDS decides by the path's MTU, 1,500 bytes or
/// more, less its own headers.
pub(super) const FRAGMENTED_ABOVE_BYTES: usize = 1_000;

/// Largest body that fits a datagram (65,507 bytes) with what stands before it.
const BODY_BYTES_MAX: usize = 65_000;

/// RTPS version and vendor as RustDDS announces them.
pub(super) const VERSION_AND_VENDOR: [u8; 4] = [2, 4, 0x01, 0x12];
/// Little-endian CDR.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

pub(super) mod submessage {
    pub(in super::super) const ACKNACK: u8 = 0x06;
    pub(in super::super) const INFO_TS: u8 = 0x09;
    pub(in super::super) const INFO_DST: u8 = 0x0e;
    pub(in super::super) const DATA: u8 = 0x15;
    pub(in super::super) const LITTLE_ENDIAN: u8 = 0x01;
    pub(in super::super) const INLINE_QOS: u8 = 0x02;
    pub(in super::super) const WITH_DATA: u8 = 0x04;
}

pub(super) mod parameter {
    pub(in super::super) const SENTINEL: u16 = 0x0001;
    pub(in super::super) const PARTICIPANT_LEASE_DURATION: u16 = 0x0002;
    pub(in super::super) const PROTOCOL_VERSION: u16 = 0x0015;
    pub(in super::super) const VENDOR_ID: u16 = 0x0016;
    pub(in super::super) const DEFAULT_UNICAST_LOCATOR: u16 = 0x0031;
    pub(in super::super) const METATRAFFIC_UNICAST_LOCATOR: u16 = 0x0032;
    pub(in super::super) const METATRAFFIC_MULTICAST_LOCATOR: u16 = 0x0033;
    pub(in super::super) const DEFAULT_MULTICAST_LOCATOR: u16 = 0x0048;
    pub(in super::super) const PARTICIPANT_GUID: u16 = 0x0050;
    pub(in super::super) const BUILTIN_ENDPOINT_SET: u16 = 0x0058;
    pub(in super::super) const KEY_HASH: u16 = 0x0070;
    pub(in super::super) const STATUS_INFO: u16 = 0x0071;
    pub(in super::super) const RELATED_SAMPLE_IDENTITY: u16 = 0x0083;
    /// What Fast DDS and others called it before it had a number.
    pub(in super::super) const RELATED_SAMPLE_IDENTITY_CUSTOM: u16 = 0x800f;
}

/// A sample that is about to be written, and the reader that must have it whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct WholeSample<'a> {
    pub(super) writer: Guid,
    pub(super) reader: Guid,
    pub(super) sequence: i64,
    pub(super) related: SampleId,
    pub(super) since_1970: std::time::Duration,
    pub(super) body: &'a [u8],
}

/// The body is too large for a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a reply of {bytes} bytes does not fit a datagram, and Fast DDS cannot read it in fragments; allowed: {BODY_BYTES_MAX}"
)]
pub(super) struct TooLarge {
    bytes: usize,
}

impl WholeSample<'_> {
    /// The message, ready to be sent.
    pub(super) fn encode(&self) -> Result<BytesMut, TooLarge> {
        if self.body.len() > BODY_BYTES_MAX {
            return Err(TooLarge { bytes: self.body.len() });
        }
        let mut to = BytesMut::with_capacity(self.body.len() + 256);
        put_header(&mut to, self.writer);

        put_destination(&mut to, self.reader);

        put_head(&mut to, submessage::INFO_TS, submessage::LITTLE_ENDIAN, 8);
        // Seconds and 2^-32 of them.
        to.put_u32_le(u32::try_from(self.since_1970.as_secs()).unwrap_or(u32::MAX));
        let fraction = (u64::from(self.since_1970.subsec_nanos()) << 32) / 1_000_000_000;
        to.put_u32_le(u32::try_from(fraction).unwrap_or(u32::MAX));

        let flags = submessage::LITTLE_ENDIAN | submessage::INLINE_QOS | submessage::WITH_DATA;
        // The last submessage, which ends with the datagram.
        put_head(&mut to, submessage::DATA, flags, 0);
        to.put_u16_le(0);
        // From here to the inline QoS: reader, writer and sequence number.
        to.put_u16_le(16);
        to.put_slice(&self.reader.0[12..]);
        to.put_slice(&self.writer.0[12..]);
        put_sequence(&mut to, Some(self.sequence));
        for id in [parameter::RELATED_SAMPLE_IDENTITY, parameter::RELATED_SAMPLE_IDENTITY_CUSTOM] {
            to.put_u16_le(id);
            to.put_u16_le(24);
            to.put_slice(&self.related.guid.0);
            put_sequence(&mut to, self.related.sequence);
        }
        to.put_u16_le(parameter::SENTINEL);
        to.put_u16_le(0);
        to.put_slice(&ENCAPSULATION);
        to.put_slice(self.body);
        Ok(to)
    }
}

/// What every message of a participant begins with; `of` is it or one of its endpoints.
pub(super) fn put_header(to: &mut BytesMut, of: Guid) {
    to.put_slice(b"RTPS");
    to.put_slice(&VERSION_AND_VENDOR);
    to.put_slice(&of.participant());
}

/// The participant that the submessages behind are for; `of` is it or one of its endpoints.
pub(super) fn put_destination(to: &mut BytesMut, of: Guid) {
    put_head(to, submessage::INFO_DST, submessage::LITTLE_ENDIAN, 12);
    to.put_slice(&of.participant());
}

/// The head of a submessage of so many bytes; 0 for the last one, which ends with the datagram.
pub(super) fn put_head(to: &mut BytesMut, kind: u8, flags: u8, bytes: u16) {
    to.put_u8(kind);
    to.put_u8(flags);
    to.put_u16_le(bytes);
}

/// A sequence number, high half first; −1 and 0 stand for an unknown one.
pub(super) fn put_sequence(to: &mut BytesMut, sequence: Option<i64>) {
    let bytes = sequence.unwrap_or(-1 << 32).to_le_bytes();
    to.put_slice(&bytes[4..]);
    to.put_slice(&bytes[..4]);
}

/// Sends a message to every address at which a reader may be reached.
///
/// # Errors
/// What the system says when no address takes it.
pub(super) fn send(message: &[u8], addresses: &[SocketAddr]) -> std::io::Result<()> {
    let mut outcome = Err(std::io::Error::other("the reader has announced no address"));
    for address in addresses {
        let any: SocketAddr = match address {
            SocketAddr::V4(_) => ([0, 0, 0, 0], 0).into(),
            SocketAddr::V6(_) => ([0u16; 8], 0).into(),
        };
        let sent = UdpSocket::bind(any).and_then(|socket| socket.send_to(message, address)).map(|_| ());
        if sent.is_ok() || outcome.is_err() {
            outcome = sent;
        }
    }
    outcome
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn sample(body: &[u8]) -> WholeSample<'_> {
        let related = SampleId { guid: Guid([7; 16]), sequence: Some(0x1_0000_0002) };
        let since_1970 = Duration::new(3, 500_000_000);
        WholeSample { writer: Guid([1; 16]), reader: Guid([2; 16]), sequence: 5, related, since_1970, body }
    }

    #[test]
    fn the_message_is_the_one_of_the_specification() {
        let message = sample(b"body").encode().unwrap();
        let expected = [
            &b"RTPS\x02\x04\x01\x12"[..],
            &[1; 12],
            &[0x0e, 1, 12, 0],
            &[2; 12],
            &[0x09, 1, 8, 0, 3, 0, 0, 0, 0, 0, 0, 0x80],
            &[0x15, 7, 0, 0, 0, 0, 16, 0],
            &[2; 4],
            &[1; 4],
            &[0, 0, 0, 0, 5, 0, 0, 0],
            &[0x83, 0, 24, 0],
            &[7; 16],
            &[1, 0, 0, 0, 2, 0, 0, 0],
            &[0x0f, 0x80, 24, 0],
            &[7; 16],
            &[1, 0, 0, 0, 2, 0, 0, 0],
            &[1, 0, 0, 0],
            &[0, 1, 0, 0],
            b"body",
        ]
        .concat();
        assert_eq!(message.as_ref(), expected);
    }

    #[test]
    fn what_no_datagram_holds_is_refused_with_its_size() {
        let body = vec![0; BODY_BYTES_MAX];
        assert!(sample(&body).encode().unwrap().len() <= 65_507);
        let body = vec![0; BODY_BYTES_MAX + 1];
        assert!(sample(&body).encode().unwrap_err().to_string().contains("65001 bytes"));
    }
}
