//! The types' encoding against samples that another implementation of CDR wrote: `tests/data/cdr.txt`, one line of type
//! and hexadecimal bytes for each message type, comes from `tests/check_hashes.py --golden` with rosbags 0.11.9.

use std::collections::BTreeMap;

use byteorder::{BigEndian, LittleEndian};
use minifactory_msgs::{Message, MessageVisitor, visit_messages};

const SAMPLES: &str = include_str!("data/cdr.txt");

/// Encapsulation header: plain CDR, little endian.
const HEADER: &str = "00010000";

fn samples() -> BTreeMap<&'static str, Vec<u8>> {
    SAMPLES
        .lines()
        .map(|line| {
            let (name, sample) = line.split_once(' ').expect("two columns");
            (name, bytes(sample.strip_prefix(HEADER).expect("a header")))
        })
        .collect()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hexadecimal")).collect()
}

/// Takes each type's sample apart and puts it together again.
struct RoundTrip {
    samples: BTreeMap<&'static str, Vec<u8>>,
}

impl MessageVisitor for RoundTrip {
    fn visit<M: Message>(&mut self) {
        let name = M::INFO.ros_type();
        let sample = self.samples.remove(name.as_str()).unwrap_or_else(|| panic!("no sample of {name}"));
        let (message, consumed) = cdr_encoding::from_bytes::<M, LittleEndian>(&sample).expect(&name);
        assert_eq!(consumed, sample.len(), "{name}");
        assert_ne!(message, M::default(), "{name}: the sample proves little");
        let encoded = cdr_encoding::to_vec::<M, LittleEndian>(&message).expect(&name);
        assert_eq!(encoded, sample, "{name}");
    }
}

#[test]
fn every_message_is_encoded_as_rosbags_encodes_it() {
    let mut visitor = RoundTrip { samples: samples() };
    visit_messages(&mut visitor);
    assert!(visitor.samples.is_empty(), "types without Rust: {:?}", visitor.samples.keys());
}

/// Feeds each type with another type's sample, cut off at every length.
struct Foreign {
    samples: BTreeMap<&'static str, Vec<u8>>,
}

impl MessageVisitor for Foreign {
    fn visit<M: Message>(&mut self) {
        for sample in self.samples.values() {
            for end in (0..sample.len()).step_by(7) {
                // What comes out does not matter, nor whether anything does: only that this returns.
                let _ = cdr_encoding::from_bytes::<M, BigEndian>(&sample[..end]);
            }
        }
    }
}

#[test]
fn foreign_and_truncated_bytes_do_not_panic() {
    visit_messages(&mut Foreign { samples: samples() });
}
