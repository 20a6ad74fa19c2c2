//! What operators may ask of a run as a whole, by the services of `simulation_interfaces`. None of it changes a result.

mod desk;
mod steps;
#[cfg(test)]
mod tests;

use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use minifactory_msgs::simulation_interfaces::msg::Result as Answer;

use super::clock::LoopClock;
use super::runner::{Incoming, RunError};
use crate::dds::Participant;
use crate::node::{Asker, AskerInner, Output, StepIo};
use crate::public::PublicSide;
use desk::Desk;

/// How long answers may take to arrive when the run has ended.
const SETTLE_LIMIT: Duration = Duration::from_secs(2);
/// Between looks whether they have.
const SETTLE_POLL: Duration = Duration::from_millis(1);

/// Why a run cannot be started again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ResetRefusal {
    /// It can be later.
    Now(String),
    /// It never can.
    Never(String),
}

/// What is to become of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// Time is to stand still, or to pass.
    Pause(bool),
    /// The run is to be started again.
    Reset,
    /// The run is to end.
    End,
}

/// Asks whether anything keeps the run from being started again.
pub(super) type Refusal<'a> = &'a dyn Fn() -> Option<ResetRefusal>;

/// The services and the action, on the graph.
pub(super) struct Control {
    desk: Desk,
    io: StepIo,
    public: PublicSide,
    inbox: Receiver<Incoming>,
    opened_at: Instant,
}

impl Control {
    /// Offers everything. A run that `stands` at its beginning waits for somebody who lets it play.
    ///
    /// # Errors
    /// [`RunError`] when DDS refuses an endpoint.
    pub(super) fn open(participant: &Participant, stands: bool) -> Result<Self, RunError> {
        let (desk, interface) = Desk::declare(stands).map_err(RunError::Node)?;
        let (sender, inbox) = channel();
        let public = PublicSide::open(participant, &interface, &sender)?;
        // Its time is wall time: what is asked for comes while simulated time stands still, too.
        let io = StepIo::new(interface.ports.len(), 0);
        Ok(Self { desk, io, public, inbox, opened_at: Instant::now() })
    }

    /// Answers what has come.
    pub(super) fn serve(&mut self, clock: &mut LoopClock, refusal: Refusal) -> Vec<Wish> {
        for incoming in self.inbox.try_iter() {
            if let Incoming::Outside(port, arrival) = incoming {
                self.io.arrive(port, arrival);
            }
        }
        self.io.begin(0, u64::try_from(self.opened_at.elapsed().as_nanos()).unwrap_or(u64::MAX));
        let wishes = self.desk.serve(&mut self.io, clock, refusal);
        self.send();
        wishes
    }

    /// Answers those who still wait, as the run has come to its end at `tick`.
    pub(super) fn close(&mut self, tick: u64) {
        self.desk.close(&mut self.io, tick);
        self.send();
    }

    /// Waits until all answers have arrived: who asked for the end is to hear that it comes.
    pub(super) fn settle(&self) {
        let since = Instant::now();
        while self.public.replies_on_the_way() > 0 && since.elapsed() < SETTLE_LIMIT {
            std::thread::sleep(SETTLE_POLL);
        }
    }

    fn send(&mut self) {
        for output in std::mem::take(&mut self.io.outputs) {
            match output {
                Output::Message { port, payload } => self.public.publish(port, payload),
                Output::Reply { asker: Asker(AskerInner::Graph(handle)), payload, .. } => handle.send(payload),
                Output::Reply { .. } | Output::Request { .. } => {}
            }
        }
    }
}

fn answer(result: u8, message: &str) -> Answer {
    Answer { result, error_message: message.to_owned() }
}

fn ok() -> Answer {
    answer(Answer::RESULT_OK, "")
}
