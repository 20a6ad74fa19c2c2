//! A bound for what a process may take of the machine's memory.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// What a process of the suite may take, bytes: several times what the largest one needs at full speed.
///
/// The DDS library takes what the size in a message says, up to 4 GB, before it has seen more than one fragment.
pub const MEMORY_BYTES_MAX: u64 = 2 << 30;

/// From now on this process is ended where it would take more than [`MEMORY_BYTES_MAX`]; a lower limit that it was started
/// with stays. Where the system has no such limit a warning says so.
pub fn bound_memory() {
    let given = getrlimit(Resource::Data);
    let bound = |limit: Option<u64>| Some(limit.map_or(MEMORY_BYTES_MAX, |limit| limit.min(MEMORY_BYTES_MAX)));
    let limit = Rlimit { current: bound(given.current), maximum: given.maximum };
    if let Err(error) = setrlimit(Resource::Data, limit) {
        tracing::warn!("memory is not bounded: {error}");
    }
}
