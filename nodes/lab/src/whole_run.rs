//! Runs that a study counts: those that came to their end.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::ensure;
use feeder::summary::Summary;
use feeder::up::{self, Ended, UpArgs};
use feeder_scenario::plan::RunPlan;
use run_monitor::Progress;

/// Runs a plan as `args` say; `stop` is set by who wants no more runs.
///
/// # Errors
/// What keeps a run from its end, a signal and an order to the simulation too: its figures would be those of a shorter run, under the
/// name of the whole.
pub(crate) fn whole_run(plan: &RunPlan, args: &UpArgs, stop: &Arc<AtomicBool>) -> anyhow::Result<(Summary, Progress)> {
    let Ended { summary, progress, outcome, .. } = up::execute(plan, args, stop)?;
    outcome?;
    let (sim_s, duration_s) = (summary.sim_s, plan.run.duration_s);
    let is_goal_reached = plan.run.goal_delivered.is_some_and(|goal| progress.delivered() >= goal);
    ensure!(
        is_goal_reached || Duration::from_secs_f64(sim_s) >= Duration::from_secs_f64(duration_s),
        "interrupted after {sim_s} s of {duration_s} s: a run that did not come to its end is not counted"
    );
    Ok((summary, progress))
}
