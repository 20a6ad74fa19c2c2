//! What drives the time that is shown, how fast, and what may be asked of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::json;
use tokio::sync::Notify;

use crate::Shared;
use crate::control_table::{Control, controls};
use crate::description::{Description, Source};

/// Between two looks at who drives the time, and how.
const LOOK: Duration = Duration::from_secs(1);

/// What is known of the clock.
pub(crate) struct Clockwork {
    /// What was said at the start: a graph may turn out to be a bag.
    told: Source,
    read_only: bool,
    state: Mutex<State>,
    /// Somebody has asked for something that changes the pace.
    asked: Notify,
}

struct State {
    source: Source,
    controls: Vec<Control>,
    pace: Option<(Option<f64>, bool)>,
    now_s: Option<f64>,
}

impl Clockwork {
    pub(crate) fn new(cell: &Description, told: Source, read_only: bool) -> Self {
        let controls = controls(cell, told, read_only);
        let state = Mutex::new(State { source: told, controls, pace: None, now_s: None });
        Self { told, read_only, state, asked: Notify::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The first message of every viewer.
    pub(crate) fn hello(&self, cell: &Description) -> String {
        let state = self.state();
        cell.hello(state.source, self.read_only, &json!(state.controls)).to_string()
    }

    /// What is shown.
    pub(crate) fn source(&self) -> Source {
        self.state().source
    }

    /// The control of this name.
    pub(crate) fn control(&self, name: &str) -> Option<Control> {
        self.state().controls.iter().find(|control| control.name == name).cloned()
    }

    /// How fast time may pass, nothing for no limit, and whether it stands still; nothing where nobody says.
    pub(crate) fn pace(&self) -> Option<(Option<f64>, bool)> {
        self.state().pace
    }

    /// The time that is shown, s.
    pub(crate) fn now_s(&self) -> Option<f64> {
        self.state().now_s
    }

    /// Takes in the time that is shown.
    pub(crate) fn set_now_s(&self, now_s: Option<f64>) {
        self.state().now_s = now_s;
    }

    /// Has the clock asked at once how fast it goes.
    pub(crate) fn look_now(&self) {
        self.asked.notify_one();
    }
}

/// Keeps an eye on the clock until it is dropped.
pub(crate) async fn follow(shared: Arc<Shared>) {
    let clockwork = &shared.clockwork;
    loop {
        if clockwork.told != Source::Run {
            let source = if shared.clients.has_player() { Source::Bag } else { Source::Graph };
            if source != clockwork.source() {
                {
                    let mut state = clockwork.state();
                    state.source = source;
                    state.controls = controls(&shared.cell, source, clockwork.read_only);
                    state.pace = None;
                }
                shared.board.hello.send_replace(Some(clockwork.hello(&shared.cell).into()));
            }
        }
        let source = clockwork.source();
        if shared.viewers.count() > 0 {
            let there = shared.clients.has_clock(source);
            let pace = if there { shared.clients.pace(source).await } else { None };
            clockwork.state().pace = pace;
        }
        tokio::select! {
            () = clockwork.asked.notified() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}
