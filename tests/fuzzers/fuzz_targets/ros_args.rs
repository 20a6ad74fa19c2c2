//! ROS arguments.

#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| feeder_tests::target("ros_args")(input));
