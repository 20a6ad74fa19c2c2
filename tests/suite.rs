//! The feeder from outside: what a user, an operating system or another DDS implementation sees of it.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod analysis;
mod bags;
mod cell;
mod common;
mod courier;
mod cyclone;
mod docs;
mod faults;
mod friction;
mod fuzz;
mod graph;
mod hosts;
mod interop;
mod managed;
mod package;
mod page;
mod page_pictures;
mod parameters;
mod part_file;
mod partner;
mod peers;
mod picking;
mod pictures;
mod reference;
mod release;
mod sabotage;
mod shapes;
mod simulation;
mod system;
mod tidy;
mod top;
mod view;
mod viewers;
mod wall_clock;
