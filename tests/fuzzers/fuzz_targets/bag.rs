//! Bags.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_tests::target("bag")(input));
