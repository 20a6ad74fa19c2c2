//! The `feeder` command.

fn main() {}
