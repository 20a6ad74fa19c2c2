//! Announcements of nodes by other participants.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_runtime::fuzzing::target("announcement")(input));
