//! Message bodies in CDR, the encoding every ROS 2 middleware uses on the wire.
//!
//! A body is what follows the four-byte encapsulation header. Bodies are written little endian;
//! both byte orders are read, since the header of each received sample says which one it has.

use byteorder::{BigEndian, LittleEndian};
use bytes::Bytes;
use serde::{Serialize, de::DeserializeOwned};

/// Bytes some middlewares append so that a body ends on a multiple of four.
const PADDING_MAX: usize = 3;

/// Why a body could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CdrError {
    /// The value has no CDR form (a map, or a sequence of unknown length).
    #[error("cannot write {type_name} as CDR: {reason}")]
    Encode {
        /// The Rust type that was to be written.
        type_name: &'static str,
        /// What the encoder said.
        reason: String,
    },
    /// The bytes are not a body of the type asked for.
    #[error("{length} bytes are no CDR body of {type_name}: {reason}")]
    Decode {
        /// The Rust type that was to be read.
        type_name: &'static str,
        /// Length of the whole body in bytes.
        length: usize,
        /// What the decoder said.
        reason: String,
    },
    /// The value ended long before the body did: the peer has another definition of the type.
    #[error(
        "a CDR body of {type_name} ends after {consumed} bytes, but {length} came (at most {PADDING_MAX} \
         bytes of padding are allowed): the peer has another definition of the type"
    )]
    Trailing {
        /// The Rust type that was read.
        type_name: &'static str,
        /// Length of the value in bytes.
        consumed: usize,
        /// Length of the whole body in bytes.
        length: usize,
    },
}

/// Writes a value as a little-endian CDR body.
///
/// # Errors
/// [`CdrError::Encode`] when the type has no CDR form.
pub fn encode<T: Serialize>(value: &T) -> Result<Bytes, CdrError> {
    // The body is kept by the writer until every reader has it, so it needs an allocation of its own.
    cdr_encoding::to_vec_with_size_hint::<T, LittleEndian>(value, 256)
        .map(Bytes::from)
        .map_err(|error| CdrError::Encode { type_name: std::any::type_name::<T>(), reason: error.to_string() })
}

/// Reads a value from a CDR body.
///
/// # Errors
/// [`CdrError::Decode`] when the bytes end too early or hold an impossible value,
/// [`CdrError::Trailing`] when more than padding is left over.
pub fn decode<T: DeserializeOwned>(body: &[u8], little_endian: bool) -> Result<T, CdrError> {
    let type_name = std::any::type_name::<T>();
    let length = body.len();
    let (value, consumed) = if little_endian {
        cdr_encoding::from_bytes::<T, LittleEndian>(body)
    } else {
        cdr_encoding::from_bytes::<T, BigEndian>(body)
    }
    .map_err(|error| CdrError::Decode { type_name, length, reason: error.to_string() })?;
    if length - consumed > PADDING_MAX {
        return Err(CdrError::Trailing { type_name, consumed, length });
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Mixed {
        id: u8,
        stamp: (i32, u32),
        name: String,
        values: Vec<f64>,
        flags: Vec<bool>,
        gid: [u8; 16],
    }

    fn mixed() -> impl Strategy<Value = Mixed> {
        let scalars = (any::<u8>(), any::<(i32, u32)>(), "[a-z/_é]{0,12}", any::<[u8; 16]>());
        (scalars, prop::collection::vec(-1e9..1e9f64, 0..20), prop::collection::vec(any::<bool>(), 0..20))
            .prop_map(|((id, stamp, name, gid), values, flags)| Mixed { id, stamp, name, values, flags, gid })
    }

    #[test]
    fn golden_bytes_of_a_string() {
        let body = encode(&"hi".to_string()).expect("a string has a CDR form");
        assert_eq!(body.as_ref(), [3, 0, 0, 0, b'h', b'i', 0]);
    }

    #[test]
    fn a_longer_body_is_refused_and_padding_is_not() {
        assert_eq!(decode::<u32>(&[7, 0, 0, 0, 0, 0, 0], true).expect("padding"), 7);
        assert!(matches!(decode::<u32>(&[7, 0, 0, 0, 1, 0, 0, 0], true), Err(CdrError::Trailing { .. })));
    }

    #[test]
    fn a_huge_length_is_refused_without_an_allocation() {
        assert!(decode::<Vec<f64>>(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0], true).is_err());
        assert!(decode::<String>(&[0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0], true).is_err());
    }

    proptest! {
        #[test]
        fn round_trip_in_both_byte_orders(value in mixed()) {
            let little = encode(&value).expect("has a CDR form");
            prop_assert_eq!(&decode::<Mixed>(&little, true).expect("own bytes"), &value);
            let big = cdr_encoding::to_vec::<_, BigEndian>(&value).expect("has a CDR form");
            prop_assert_eq!(&decode::<Mixed>(&big, false).expect("own bytes"), &value);
        }

        #[test]
        fn a_truncated_body_is_refused(value in mixed(), cut in 1usize..200) {
            let body = encode(&value).expect("has a CDR form");
            let keep = body.len().saturating_sub(cut);
            prop_assert!(decode::<Mixed>(&body[..keep], true).is_err());
        }

        #[test]
        fn foreign_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), little in any::<bool>()) {
            let _ = decode::<Mixed>(&bytes, little);
        }
    }
}
