//! What a player can be asked for while it plays.

/// What is told when a control has been obeyed.
pub struct Done<T>(Option<Box<dyn FnOnce(T) + Send>>);

impl<T> Done<T> {
    /// Nobody.
    #[must_use]
    pub fn nobody() -> Self {
        Self(None)
    }

    /// Whoever this function tells. It runs on the player's thread.
    #[must_use]
    pub fn tell(function: impl FnOnce(T) + Send + 'static) -> Self {
        Self(Some(Box::new(function)))
    }

    pub(super) fn call(self, outcome: T) {
        if let Some(function) = self.0 {
            function(outcome);
        }
    }
}

impl<T> std::fmt::Debug for Done<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.0.is_some() { "Done" } else { "nobody" })
    }
}

/// What a player can be asked for, named after the services of rosbag2's player.
#[derive(Debug)]
pub enum Control {
    /// Let time stand still.
    Pause(Done<()>),
    /// Let time pass again.
    Resume(Done<()>),
    /// The one or the other.
    TogglePaused(Done<()>),
    /// Whether time stands still.
    IsPaused(Done<bool>),
    /// Seconds of the bag per second; tells whether that is possible.
    SetRate(f64, Done<bool>),
    /// So many times the present rate.
    ScaleRate(f64),
    /// Seconds of the bag per second.
    GetRate(Done<f64>),
    /// In pause: play one message; tells whether there was one.
    PlayNext(Done<bool>),
    /// In pause: play so many messages at once, all that are left when zero; tells how many.
    Burst(u64, Done<u64>),
    /// Go to this time in the bag, ns; tells whether it lies within.
    Seek(u64, Done<bool>),
    /// Go forward or back, ns.
    SeekBy(i64),
    /// The external time is this, ns.
    Time(u64),
    /// End.
    Stop(Done<()>),
}
