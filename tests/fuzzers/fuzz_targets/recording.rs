//! Tables of a slipping part.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_tests::target("recording")(input));
