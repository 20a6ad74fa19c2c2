//! Runs that a study counts: those that came to their end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::ensure;
use feeder::summary::Summary;
use feeder::up::{self, Ended, UpArgs};
use feeder_scenario::plan::RunPlan;
use run_monitor::Progress;

/// Runs a plan as `args` say; `stop` is set by who wants no more runs.
///
/// # Errors
/// What keeps a run from its end, a signal too: its figures would be those of a shorter run, under the name of the whole.
pub(crate) fn whole_run(plan: &RunPlan, args: &UpArgs, stop: &Arc<AtomicBool>) -> anyhow::Result<(Summary, Progress)> {
    let Ended { summary, progress, outcome } = up::execute(plan, args, stop)?;
    outcome?;
    ensure!(!stop.load(Ordering::Relaxed), "interrupted: a run that did not come to its end is not counted");
    Ok((summary, progress))
}
