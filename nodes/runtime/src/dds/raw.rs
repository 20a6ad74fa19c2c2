//! Samples as bytes, and the adapters that make the DDS library pass them on unread.

use std::time::{Duration, SystemTime};
use std::{fmt, io};

use bytes::Bytes;
use ros2_client::dds::rustdds::{
    GUID, RepresentationIdentifier, SampleIdentity, SequenceNumber,
    no_key::{self, Decode, DefaultDecoder, DeserializedCacheChange, DeserializerAdapter, SerializerAdapter},
};
use serde::de::DeserializeOwned;

use crate::cdr::{self, CdrError};

/// The identity of a DDS endpoint or participant.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Guid(pub [u8; 16]);

impl Guid {
    /// The twelve bytes all endpoints of a participant share. The first two name the DDS
    /// implementation, e.g. 01 0f Fast DDS, 01 10 Cyclone DDS, 01 12 RustDDS.
    #[must_use]
    pub fn participant(&self) -> [u8; 12] {
        std::array::from_fn(|i| self.0[i])
    }

    pub(super) fn to_dds(self) -> GUID {
        GUID::from_bytes(self.0)
    }
}

impl From<GUID> for Guid {
    fn from(guid: GUID) -> Self {
        Self(guid.to_bytes())
    }
}

impl fmt::Display for Guid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Guid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Which sample of which writer: how a reply says what it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SampleId {
    /// The writer (some clients put their reply reader here).
    pub guid: Guid,
    /// Its sequence number, or `None` when left open.
    pub sequence: Option<i64>,
}

impl SampleId {
    pub(super) fn to_dds(self) -> SampleIdentity {
        SampleIdentity {
            writer_guid: self.guid.to_dds(),
            sequence_number: self.sequence.map_or(SequenceNumber::UNKNOWN, SequenceNumber::from),
        }
    }
}

impl From<SampleIdentity> for SampleId {
    fn from(id: SampleIdentity) -> Self {
        let known = id.sequence_number != SequenceNumber::UNKNOWN;
        Self { guid: id.writer_guid.into(), sequence: known.then(|| id.sequence_number.into()) }
    }
}

/// What a reader hands over.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The CDR body, without encapsulation header.
    pub payload: Bytes,
    /// Byte order of the body.
    pub little_endian: bool,
    /// Who published it.
    pub writer_guid: Guid,
    /// Its number among the samples of that writer, counted from 1.
    pub sequence: i64,
    /// When the writer says it was published.
    pub source_timestamp: Option<SystemTime>,
    /// The sample this one answers, where the publisher says so.
    pub related: Option<SampleId>,
}

impl Sample {
    /// Reads the body as a message.
    ///
    /// # Errors
    /// [`CdrError`] when the body is not one of type `T`.
    pub fn decode<T: DeserializeOwned>(&self) -> Result<T, CdrError> {
        cdr::decode(&self.payload, self.little_endian)
    }

    pub(super) fn from_change(change: DeserializedCacheChange<Raw>) -> Self {
        let source_timestamp = change.source_timestamp().map(|stamp| {
            // NTP ticks of 2^-32 s since 1970.
            let ticks = stamp.to_ticks();
            let nanoseconds = ((ticks & 0xffff_ffff) * 1_000_000_000) >> 32;
            SystemTime::UNIX_EPOCH + Duration::from_secs(ticks >> 32) + Duration::from_nanos(nanoseconds)
        });
        Self {
            writer_guid: change.writer_guid.into(),
            sequence: change.sequence_number.into(),
            source_timestamp,
            related: change.related_sample_identity().map(SampleId::from),
            little_endian: change.sample.little_endian,
            payload: change.sample.payload,
        }
    }
}

/// A body on its way through the DDS library.
#[derive(Debug, Clone)]
pub(super) struct Raw {
    pub(super) payload: Bytes,
    pub(super) little_endian: bool,
}

/// Adapter of both directions: bytes in, bytes out.
pub(super) struct RawAdapter;

pub(super) type RawWriter = no_key::DataWriter<Raw, RawAdapter>;
pub(super) type RawReader = no_key::SimpleDataReader<Raw, RawAdapter>;

#[derive(Clone)]
pub(super) struct RawDecoder;

impl SerializerAdapter<Raw> for RawAdapter {
    type Error = io::Error;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Raw) -> io::Result<Bytes> {
        Ok(value.payload.clone())
    }
}

impl DeserializerAdapter<Raw> for RawAdapter {
    type Error = io::Error;
    type Decoded = Raw;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: Raw) -> Raw {
        decoded
    }
}

impl DefaultDecoder<Raw> for RawAdapter {
    type Decoder = RawDecoder;
    const DECODER: RawDecoder = RawDecoder;
}

impl Decode<'_, Raw> for RawDecoder {
    type Error = io::Error;

    fn decode_bytes(self, bytes: &[u8], encoding: RepresentationIdentifier) -> io::Result<Raw> {
        // Copied, since a slice would keep the whole receive buffer (256 kB) alive.
        Ok(Raw { payload: Bytes::copy_from_slice(bytes), little_endian: encoding == RepresentationIdentifier::CDR_LE })
    }
}
