//! When an endpoint may be made.
//!
//! Making one while the DDS library takes in many others can lock the participant up for good. Its discovery thread says
//! which known endpoints match the new one, and keeps its database locked for reading meanwhile (RustDDS 0.15.1,
//! `discovery.rs:1850` and `1872`). Where the queue it says so to, of 32, is full, it waits for the network thread, and
//! that one has to read the database when a participant announces itself (`dp_event_loop.rs:711`). Somebody who makes the
//! next endpoint then waits to write to the database, which lets no new reader in: none of the three goes on.
//!
//! The queue is full when many endpoints are found at once. So a node makes its endpoints before it can find anybody (see
//! `door.rs`): then there is nothing to say, and nothing waits. One that is made later is made when nobody has been found
//! for a while, and what the last one was compared with has passed. That makes it unlikely, not impossible.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::{
    DomainParticipant, DomainParticipantStatusEvent as Event, DomainParticipantStatusListener, GUID, LostReason,
    RTPSEntity, StatusEvented,
};

use super::others::{Leave, Others};

/// How long nobody must have been found.
const LULL: Duration = Duration::from_millis(20);
/// How long nothing must have happened at all: what is known is compared with the last endpoint.
const PAUSE: Duration = Duration::from_millis(5);
/// What the library's threads get for an endpoint before the next one, so that it shows what they compare it with.
const TURN: Duration = Duration::from_millis(1);
/// As many may be made in one go where nobody can be met: the library queues up to 100.
const BURST: usize = 16;
/// Between two looks.
const LOOK: Duration = Duration::from_millis(1);
/// Longest wait: nodes that come up together must not keep each other waiting.
const PATIENCE: Duration = Duration::from_millis(200);
/// How often what happens is taken in while no endpoint is made: the library keeps 2048 events, and drops what comes later.
const KEEP_UP: Duration = Duration::from_secs(1);

/// Watches what a participant finds.
pub(super) struct Lull {
    events: DomainParticipantStatusListener,
    own: GUID,
    /// When the last endpoint was made.
    made: Option<Instant>,
    /// How many were made where nobody can be met.
    unmet: usize,
    others: Others,
    /// Their endpoints.
    endpoints: BTreeSet<GUID>,
    /// Until when to wait for what has happened so far.
    until: Option<Instant>,
}

impl Lull {
    pub(super) fn of(participant: &DomainParticipant) -> Self {
        Self {
            events: participant.status_listener(),
            own: participant.guid(),
            made: None,
            unmet: 0,
            others: Others::default(),
            endpoints: BTreeSet::new(),
            until: None,
        }
    }

    /// Makes an endpoint: where others can be met, when nothing has been found for a while.
    pub(super) fn make<T>(&mut self, others_can_be_met: bool, make: impl FnOnce() -> T) -> T {
        if others_can_be_met {
            self.wait();
        } else {
            self.unmet += 1;
            if self.unmet.is_multiple_of(BURST) {
                sleep(TURN);
            }
        }
        let made = make();
        self.made = Some(Instant::now());
        made
    }

    /// The other participants, as far as has been heard.
    pub(super) fn others(&mut self) -> &Others {
        self.look();
        &self.others
    }

    /// Takes in what happens, for ever.
    pub(super) async fn keep_up(lull: Arc<Mutex<Self>>) {
        loop {
            tokio::time::sleep(KEEP_UP).await;
            // Whoever holds the lock takes it in.
            if let Ok(mut lull) = lull.try_lock() {
                lull.look();
            }
        }
    }

    fn wait(&mut self) {
        let since = Instant::now();
        let mut until = self.made.map_or(since, |made| made + TURN);
        while until < since + PATIENCE {
            self.look();
            until = until.max(self.until.unwrap_or(until));
            if Instant::now() >= until {
                return;
            }
            sleep(LOOK);
        }
    }

    /// Takes in what has happened since the last look.
    fn look(&mut self) {
        while let Some(event) = self.events.try_recv_status() {
            let is_new = match event {
                Event::ParticipantDiscovered { dpd } => {
                    if dpd.guid.prefix != self.own.prefix {
                        self.others.join(dpd.guid.into());
                    }
                    true
                }
                Event::ReaderDetected { reader: end } | Event::WriterDetected { writer: end } => {
                    if end.guid.prefix == self.own.prefix {
                        continue;
                    }
                    self.endpoints.insert(end.guid)
                }
                Event::ParticipantLost { id, reason } => {
                    let is_silent = matches!(reason, LostReason::Timeout { .. });
                    let participant = GUID { prefix: id, ..self.own };
                    self.others.leave(participant.into(), if is_silent { Leave::Silent } else { Leave::Announced });
                    self.endpoints.retain(|guid| guid.prefix != id);
                    continue;
                }
                Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => {
                    self.endpoints.remove(&guid);
                    continue;
                }
                _ => continue,
            };
            let until = Instant::now() + if is_new { LULL } else { PAUSE };
            self.until = self.until.max(Some(until));
        }
    }
}
