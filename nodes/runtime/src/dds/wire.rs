//! The two forms in which ROS 2 services travel over DDS, and telling them apart.
//!
//! - *Related* (Fast DDS and most others): the request's identity travels beside the body, as the
//!   "related sample identity" of the RPC-over-DDS specification.
//! - *Header* (Cyclone DDS): sixteen bytes before the body, eight that name the client and a
//!   sequence number, in requests and replies alike.
//!
//! Nothing in discovery says which form an endpoint speaks, but its GUID names the implementation,
//! and each implementation of ROS 2 speaks one form.

use bytes::{BufMut, Bytes, BytesMut};

use super::{Guid, Sample, SampleId};

/// Bytes of the header form before the body; a multiple of eight, so that the body's alignment holds.
const HEADER_BYTES: usize = 16;

/// How a request says which reply it expects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RequestForm {
    /// By the header that the reply is to repeat.
    Header([u8; HEADER_BYTES]),
    /// By the identity that the reply is to carry.
    Related(SampleId),
}

/// Why a sample is no request or no reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{length} bytes cannot hold the header of {HEADER_BYTES} bytes that Cyclone DDS puts before a body")]
pub(super) struct WireError {
    length: usize,
}

/// Whether peers of this implementation speak the header form.
pub(super) fn speaks_header(peer: Guid) -> bool {
    peer.0[..2] == [0x01, 0x10]
}

/// Whether peers of this implementation always speak the related form.
pub(super) fn speaks_related(peer: Guid) -> bool {
    peer.0[..2] == [0x01, 0x0f]
}

/// Tells a request's form and returns it with the bare body.
pub(super) fn read_request(sample: &Sample) -> Result<(RequestForm, Bytes), WireError> {
    let client = sample.writer_guid;
    let header = split_header(&sample.payload);
    // RustDDS clients speak either form. In the header form they send their identity beside the
    // body as well, and the header begins with its second half.
    let looks_like_header = || match (sample.related, header) {
        (Some(related), Some(header)) => header[..8] == related.guid.0[8..],
        _ => false,
    };
    if speaks_header(client) || (!speaks_related(client) && looks_like_header()) {
        let header = header.ok_or(WireError { length: sample.payload.len() })?;
        return Ok((RequestForm::Header(header), sample.payload.slice(HEADER_BYTES..)));
    }
    // Fast DDS clients name their reply reader and leave the number open: it is the request's own.
    let (guid, sequence) = match sample.related {
        Some(related) => (related.guid, related.sequence.unwrap_or(sample.sequence)),
        None => (client, sample.sequence),
    };
    Ok((RequestForm::Related(SampleId { guid, sequence: Some(sequence) }), sample.payload.clone()))
}

impl RequestForm {
    /// The reply's payload, and the identity to send beside it.
    pub(super) fn reply(self, body: Bytes) -> (Bytes, Option<SampleId>) {
        match self {
            Self::Header(header) => (with_header(header, &body), None),
            Self::Related(id) => (body, Some(id)),
        }
    }

    /// Which of a reply writer's readers the reply is for: the one the request names, else all in the
    /// client's participant. To others it must not go: a reply of one form disturbs clients of the other.
    pub(super) fn reply_readers(self, client: Guid, matched: impl Iterator<Item = Guid> + Clone) -> Vec<Guid> {
        match self {
            Self::Related(id) if matched.clone().any(|reader| reader == id.guid) => vec![id.guid],
            _ => matched.filter(|reader| reader.participant() == client.participant()).collect(),
        }
    }
}

/// A client's names in the two forms.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClientId {
    /// Its request writer.
    pub(super) writer: Guid,
    /// Its reply reader.
    pub(super) reader: Guid,
}

/// Which request a reply answers: numbers of the two forms are counted apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ReplyTo {
    /// The number in the header.
    Header(i64),
    /// The request's sequence number as a DDS sample.
    Related(i64),
}

impl ClientId {
    /// A request's payload in the header form.
    pub(super) fn header_request(self, number: i64, body: &Bytes) -> Bytes {
        let mut header = [0; HEADER_BYTES];
        header[..8].copy_from_slice(&self.writer.0[8..]);
        header[8..].copy_from_slice(&number.to_le_bytes());
        with_header(header, body)
    }

    /// What a request in the related form carries beside its body.
    pub(super) fn related_request(self) -> SampleId {
        SampleId { guid: self.reader, sequence: None }
    }

    /// Which request of this client a sample answers, with the bare body; `None` when it answers
    /// another client's.
    pub(super) fn read_reply(self, sample: &Sample) -> Result<Option<(ReplyTo, Bytes)>, WireError> {
        if speaks_header(sample.writer_guid) {
            let header = split_header(&sample.payload).ok_or(WireError { length: sample.payload.len() })?;
            let number: [u8; 8] = std::array::from_fn(|i| header[8 + i]);
            let number = if sample.little_endian { i64::from_le_bytes(number) } else { i64::from_be_bytes(number) };
            let mine = header[..8] == self.writer.0[8..];
            return Ok(mine.then(|| (ReplyTo::Header(number), sample.payload.slice(HEADER_BYTES..))));
        }
        let mine = sample.related.filter(|related| related.guid == self.reader || related.guid == self.writer);
        Ok(mine.and_then(|related| related.sequence).map(|number| (ReplyTo::Related(number), sample.payload.clone())))
    }
}

fn split_header(payload: &Bytes) -> Option<[u8; HEADER_BYTES]> {
    payload.get(..HEADER_BYTES)?.try_into().ok()
}

fn with_header(header: [u8; HEADER_BYTES], body: &Bytes) -> Bytes {
    let mut payload = BytesMut::with_capacity(HEADER_BYTES + body.len());
    payload.put_slice(&header);
    payload.put_slice(body);
    payload.freeze()
}

/// Reads a sample of any vendor as a request and as a reply; see [`crate::fuzzing`].
pub(crate) fn fuzz(input: &[u8]) {
    let [vendor, related, rest @ ..] = input else { return };
    let mut guid = [3; 16];
    guid[..2].copy_from_slice(&[1, 0x0f + vendor % 4]);
    let (named, payload) = rest.split_at(rest.len().min(16));
    let related = (related & 1 == 1).then(|| {
        let mut guid = [0; 16];
        guid[..named.len()].copy_from_slice(named);
        SampleId { guid: Guid(guid), sequence: (related & 2 == 2).then_some(i64::from(*related)) }
    });
    let sample = Sample {
        payload: Bytes::copy_from_slice(payload),
        little_endian: vendor & 16 == 0,
        writer_guid: Guid(guid),
        sequence: 1,
        source_timestamp: None,
        related,
    };
    if let Ok((form, body)) = read_request(&sample) {
        let (reply, _) = form.reply(body.clone());
        assert!(reply.len() >= body.len() && reply.ends_with(&body), "a reply has lost its body");
    }
    let client = ClientId { writer: Guid([4; 16]), reader: Guid([5; 16]) };
    let _ = client.read_reply(&sample);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FAST: [u8; 2] = [0x01, 0x0f];
    const CYCLONE: [u8; 2] = [0x01, 0x10];
    const RUSTDDS: [u8; 2] = [0x01, 0x12];

    fn guid(vendor: [u8; 2], rest: u8) -> Guid {
        let mut guid = [rest; 16];
        guid[..2].copy_from_slice(&vendor);
        Guid(guid)
    }

    fn sample(writer_guid: Guid, related: Option<SampleId>, payload: Bytes) -> Sample {
        Sample { payload, little_endian: true, writer_guid, sequence: 42, source_timestamp: None, related }
    }

    #[test]
    fn a_fast_dds_request_names_its_reply_reader() {
        let (writer, reader) = (guid(FAST, 3), guid(FAST, 4));
        let request = sample(writer, Some(SampleId { guid: reader, sequence: None }), Bytes::from_static(b"body"));
        let (form, body) = read_request(&request).expect("well formed");
        assert_eq!(body.as_ref(), b"body");
        assert_eq!(form, RequestForm::Related(SampleId { guid: reader, sequence: Some(42) }));
        let others = guid(FAST, 5);
        assert_eq!(form.reply_readers(writer, [reader, others].into_iter()), [reader]);
        assert_eq!(
            form.reply(body),
            (Bytes::from_static(b"body"), Some(SampleId { guid: reader, sequence: Some(42) }))
        );
    }

    #[test]
    fn a_cyclone_request_is_answered_with_its_own_header() {
        let writer = guid(CYCLONE, 3);
        let request = sample(writer, None, Bytes::from_static(b"0123456789abcdefbody"));
        let (form, body) = read_request(&request).expect("well formed");
        assert_eq!((form, body.as_ref()), (RequestForm::Header(*b"0123456789abcdef"), b"body".as_slice()));
        assert_eq!(form.reply(Bytes::from_static(b"reply")), (Bytes::from_static(b"0123456789abcdefreply"), None));
        let mut same_participant = writer;
        same_participant.0[15] = 7;
        assert_eq!(form.reply_readers(writer, [same_participant, guid(CYCLONE, 9)].into_iter()), [same_participant]);
        assert_eq!(read_request(&sample(writer, None, Bytes::from_static(b"short"))), Err(WireError { length: 5 }));
    }

    #[test]
    fn a_ros2_client_request_is_told_by_its_content() {
        let writer = guid(RUSTDDS, 3);
        let mut headed = writer.0[8..].to_vec();
        headed.extend_from_slice(b"\0\0\0\0\x01\0\0\0body");
        let id = SampleId { guid: writer, sequence: Some(1) };
        let (form, body) = read_request(&sample(writer, Some(id), headed.into())).expect("well formed");
        assert!(matches!(form, RequestForm::Header(_)));
        assert_eq!(body.as_ref(), b"body");
        let (form, _) =
            read_request(&sample(writer, None, Bytes::from_static(b"a body of some length"))).expect("bare");
        assert_eq!(form, RequestForm::Related(SampleId { guid: writer, sequence: Some(42) }));
    }

    #[test]
    fn replies_in_both_forms_find_their_request() {
        let client = ClientId { writer: guid(RUSTDDS, 1), reader: guid(RUSTDDS, 2) };
        let stranger = ClientId { writer: guid(RUSTDDS, 3), reader: guid(RUSTDDS, 4) };
        let request = client.header_request(7, &Bytes::from_static(b"request"));
        assert_eq!(&request[16..], b"request");
        let echo = with_header(split_header(&request).expect("long enough"), &Bytes::from_static(b"reply"));
        let reply = sample(guid(CYCLONE, 9), None, echo);
        assert_eq!(client.read_reply(&reply), Ok(Some((ReplyTo::Header(7), Bytes::from_static(b"reply")))));
        assert_eq!(stranger.read_reply(&reply), Ok(None));

        for guid_in_reply in [client.reader, client.writer] {
            let id = SampleId { guid: guid_in_reply, sequence: Some(3) };
            let reply = sample(guid(FAST, 9), Some(id), Bytes::from_static(b"reply"));
            assert_eq!(client.read_reply(&reply), Ok(Some((ReplyTo::Related(3), Bytes::from_static(b"reply")))));
            assert_eq!(stranger.read_reply(&reply), Ok(None));
        }
    }

    fn any_sample() -> impl Strategy<Value = Sample> {
        let vendor = prop_oneof![Just(FAST), Just(CYCLONE), Just(RUSTDDS), any::<[u8; 2]>()];
        let related = prop::option::of((any::<[u8; 16]>(), prop::option::of(any::<i64>())));
        (vendor, any::<u8>(), related, prop::collection::vec(any::<u8>(), 0..64), any::<bool>()).prop_map(
            |(vendor, rest, related, payload, little_endian)| Sample {
                little_endian,
                ..sample(
                    guid(vendor, rest),
                    related.map(|(guid, sequence)| SampleId { guid: Guid(guid), sequence }),
                    payload.into(),
                )
            },
        )
    }

    proptest! {
        #[test]
        fn no_sample_panics_or_grows(sample in any_sample()) {
            if let Ok((_, body)) = read_request(&sample) {
                prop_assert!(sample.payload.ends_with(&body));
            }
            let client = ClientId { writer: guid(RUSTDDS, 1), reader: guid(RUSTDDS, 2) };
            if let Ok(Some((_, body))) = client.read_reply(&sample) {
                prop_assert!(sample.payload.ends_with(&body));
            }
        }

        #[test]
        fn a_request_of_ours_is_read_back(body in prop::collection::vec(any::<u8>(), 0..64)) {
            let client = ClientId { writer: guid(RUSTDDS, 1), reader: guid(RUSTDDS, 2) };
            let sent = sample(client.writer, Some(client.related_request()), body.clone().into());
            let (form, read) = read_request(&sent).expect("own request");
            prop_assert_eq!(&read, &body);
            let (payload, related) = form.reply(read);
            let reply = sample(guid(RUSTDDS, 9), related, payload);
            prop_assert_eq!(client.read_reply(&reply), Ok(Some((ReplyTo::Related(42), body.into()))));
        }
    }
}
