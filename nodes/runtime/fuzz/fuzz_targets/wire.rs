//! Requests and replies as they come off the wire.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_runtime::fuzzing::target("wire")(input));
