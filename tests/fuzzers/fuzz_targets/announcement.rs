//! Announcements of nodes.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_tests::target("announcement")(input));
