//! What a person watching a run sees: the picture of it where there is a terminal, else a progress bar with the counts
//! that matter and the nodes' log lines above it.

use std::time::Duration;

use feeder_top::Screen;
use indicatif::{ProgressBar, ProgressStyle};
use run_monitor::Progress;

/// The display of a run.
pub(crate) struct View {
    /// While there is one, it is all that is seen.
    screen: Option<Screen>,
    bar: ProgressBar,
    tick_s: f64,
}

impl View {
    /// A progress bar, hidden where there is no terminal; with `screen` only should that close.
    pub(crate) fn new(end_tick: u64, tick_ns: u64, screen: Option<Screen>) -> Self {
        let bar = ProgressBar::new(end_tick);
        let template = "{elapsed_precise} wall  [{bar:32}]  {msg}";
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self { screen, bar, tick_s: Duration::from_nanos(tick_ns).as_secs_f64() }
    }

    /// Shows how far the run is.
    pub(crate) fn show(&mut self, tick: u64, progress: &Progress) {
        if let Some(screen) = &self.screen {
            if screen.is_open() {
                return;
            }
            self.screen = None;
        }
        #[expect(clippy::cast_precision_loss, reason = "shown with one decimal")]
        let sim_s = tick as f64 * self.tick_s;
        self.bar.set_position(tick);
        self.bar.set_message(format!(
            "{sim_s:.1} s simulated · fed {} · seen {} · selected {} · delivered {}",
            progress.sum(|feeder| feeder.fed),
            progress.seen(),
            progress.selected(),
            progress.delivered()
        ));
    }

    /// Shows a line of a node's log.
    pub(crate) fn line(&self, line: &str) {
        match &self.screen {
            Some(screen) => screen.line(line),
            None if self.bar.is_hidden() => eprintln!("{line}"),
            None => self.bar.println(line),
        }
    }

    pub(crate) fn close(self) {
        match self.screen {
            Some(screen) => drop(screen),
            None => self.bar.finish(),
        }
    }
}
