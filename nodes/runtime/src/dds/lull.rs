//! When an endpoint may be made.
//!
//! Making one while the DDS library takes in many others can lock the participant up for good. Its discovery thread says
//! which known endpoints match the new one, and keeps its database locked for reading meanwhile (RustDDS 0.15.1,
//! `discovery.rs:1850` and `1872`). Where the queue it says so to, of 32, is full, it waits for the network thread, and
//! that one has to read the database when a participant announces itself (`dp_event_loop.rs:711`). Somebody who makes the
//! next endpoint then waits to write to the database, which lets no new reader in: none of the three goes on. The queue
//! is full when many endpoints are found at once, so what finds nothing for a while is on the safe side. A node makes its
//! endpoints before it finds anybody and does not wait.

use std::thread::sleep;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::{
    DomainParticipant, DomainParticipantStatusEvent as Event, DomainParticipantStatusListener, GUID, RTPSEntity,
    StatusEvented,
};

/// How long nothing must have been found.
const LULL: Duration = Duration::from_millis(50);
/// Between two looks.
const LOOK: Duration = Duration::from_millis(5);
/// Longest wait: an endpoint is made in the end, however busy the graph is.
const PATIENCE: Duration = Duration::from_secs(2);

/// Watches what a participant finds.
pub(super) struct Lull {
    found: DomainParticipantStatusListener,
    own: GUID,
}

impl Lull {
    pub(super) fn of(participant: &DomainParticipant) -> Self {
        Self { found: participant.status_listener(), own: participant.guid() }
    }

    /// Waits until nothing has been found for a while.
    pub(super) fn wait(&self) {
        let since = Instant::now();
        let mut found_at = None;
        while since.elapsed() < PATIENCE {
            if self.has_found() {
                found_at = Some(Instant::now());
            }
            if found_at.is_none_or(|at| at.elapsed() >= LULL) {
                return;
            }
            sleep(LOOK);
        }
    }

    /// Whether others have come, or were compared with an endpoint of this participant, since the last look.
    fn has_found(&self) -> bool {
        let mut found = false;
        while let Some(event) = self.found.try_recv_status() {
            found |= match event {
                Event::ParticipantDiscovered { .. } => true,
                Event::ReaderDetected { reader: found } | Event::WriterDetected { writer: found } => {
                    found.guid.prefix != self.own.prefix
                }
                _ => false,
            };
        }
        found
    }
}
