//! Bags from outside the crate.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cdr;
mod check;
mod common;
mod compare;
mod damaged;
mod round_trip;
