//! Parts in bulk against theory, tables and conservation.

mod support;

mod bulk;
mod catalogue;
mod courier;
mod feed;
mod reference;
