//! What is shown now: the newest message of every kind, for any number of viewers.
//!
//! Nothing queues. A viewer that is slow finds the newest when it comes back; only the servo's samples, of which none
//! may be missing, wait for it, and few at that.

use tokio::sync::{broadcast, watch};

use crate::description::Description;
use axum::body::Bytes;
use axum::extract::ws::Utf8Bytes;

/// Blocks of servo samples that wait for a slow viewer.
const SERVO_WAITING: usize = 32;

/// The newest of one kind of message; nothing yet at first.
pub(crate) type Newest<T> = watch::Sender<Option<T>>;

/// What is shown of a feeder to those who ask for it.
pub(crate) struct FeederBoard {
    /// The motion over the newest period.
    pub(crate) motion: Newest<Utf8Bytes>,
    /// The waveform.
    pub(crate) waveform: Newest<Utf8Bytes>,
    /// The picture, with a header.
    pub(crate) picture: Newest<Bytes>,
    /// Blocks of samples.
    pub(crate) servo: broadcast::Sender<Utf8Bytes>,
}

/// All that is shown.
pub(crate) struct Board {
    /// Begins every conversation.
    pub(crate) hello: Newest<Utf8Bytes>,
    /// The state of everything.
    pub(crate) frame: Newest<Utf8Bytes>,
    /// What changes slowly.
    pub(crate) status: Newest<Utf8Bytes>,
    /// What is shown of every feeder.
    pub(crate) feeders: Vec<FeederBoard>,
}

fn nothing<T>() -> Newest<T> {
    watch::Sender::new(None)
}

impl Board {
    /// Empty, but for the first message.
    pub(crate) fn new(cell: &Description, hello: String) -> Self {
        let feeder = |_| FeederBoard {
            motion: nothing(),
            waveform: nothing(),
            picture: nothing(),
            servo: broadcast::Sender::new(SERVO_WAITING),
        };
        Self {
            hello: watch::Sender::new(Some(hello.into())),
            frame: nothing(),
            status: nothing(),
            feeders: cell.feeders.iter().map(feeder).collect(),
        }
    }

    /// Shows nothing of what was, and the first message again.
    pub(crate) fn begin_anew(&self) {
        self.frame.send_replace(None);
        self.status.send_replace(None);
        for feeder in &self.feeders {
            feeder.motion.send_replace(None);
            feeder.picture.send_replace(None);
        }
        self.hello.send_modify(|_| {});
    }
}
