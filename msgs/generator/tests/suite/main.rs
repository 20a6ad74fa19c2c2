//! Tests of the generator, by what goes in and what comes out.

mod common;
mod definitions;
mod properties;
mod published_hashes;
mod rust_source;
