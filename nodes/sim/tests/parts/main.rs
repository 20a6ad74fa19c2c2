//! Parts in bulk against theory, tables and conservation.

#[path = "../../../model/tests/rk4/mod.rs"]
mod rk4;
mod support;

mod bulk;
mod catalogue;
mod courier;
mod feed;
mod reference;
