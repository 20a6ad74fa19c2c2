//! Models that were taught.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_tests::target("part_model")(input));
