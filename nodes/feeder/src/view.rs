//! What a person watching a run sees: a progress bar with the counts that matter, and the nodes' log lines above it.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use run_monitor::Progress;

/// The progress display of a run.
pub(crate) struct View {
    bar: ProgressBar,
    tick_s: f64,
}

impl View {
    pub(crate) fn new(end_tick: u64, tick_ns: u64) -> Self {
        let bar = ProgressBar::new(end_tick);
        let template = "{elapsed_precise} wall  [{bar:32}]  {msg}";
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self { bar, tick_s: Duration::from_nanos(tick_ns).as_secs_f64() }
    }

    /// Shows how far the run is.
    pub(crate) fn show(&self, tick: u64, progress: &Progress) {
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
        if self.bar.is_hidden() {
            eprintln!("{line}");
        } else {
            self.bar.println(line);
        }
    }

    pub(crate) fn close(&self) {
        self.bar.finish();
    }
}
