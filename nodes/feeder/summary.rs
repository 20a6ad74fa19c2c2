//! How a run went, for people and for programs.

use std::fmt;
use std::time::Duration;

use run_monitor::Progress;
use serde::Serialize;

/// The outcome of a run. Counts and slip are by ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// Parts that entered the plateau; one that comes round again counts again.
    fed: u32,
    /// Distinct parts the selector saw on the plateau; for people only.
    #[serde(skip)]
    seen: usize,
    /// Distinct parts the selector called right.
    selected: usize,
    /// Parts picked.
    delivered: u32,
    /// Parts picked that lay in another pose than the wanted one.
    wrong_pose_delivered: u32,
    /// Largest displacement in the tray frame of a delivered part between settled and picked, m.
    max_slip_m: f64,
    /// Parts per minute that passed the camera, and of these those that lay right and apart.
    passed_per_min: f64,
    good_per_min: f64,
    /// What the selector called right and was; and was not; and good parts it never called right. Once a lap each.
    right_selections: u32,
    wrong_selections: u32,
    missed_selections: u32,
    /// Share of the parts on the plateau with a gap of one length or more, and the mean gap, m.
    singulation: f64,
    gap_m: f64,
    /// Mean time from leaving the plateau to entering it again, s.
    recirculation_s: f64,
    /// Jams on the ramp, and parts stranded at the end.
    jams: u32,
    stranded: u32,
    /// Simulated time, s.
    sim_s: f64,
    /// Wall time of the run without start-up, s.
    wall_s: f64,
    /// Wall time from the command to the first tick, s.
    startup_s: f64,
    /// Simulated seconds per wall second.
    real_time_factor: f64,
}

impl Summary {
    pub(crate) fn new(progress: &Progress, ticks: u64, tick_ns: u64, startup: Duration, wall: Duration) -> Self {
        let sim_s = Duration::from_nanos(ticks * tick_ns).as_secs_f64();
        let wall_s = wall.as_secs_f64();
        let feed = &progress.feed;
        let report = &feed.report;
        Self {
            fed: progress.fed,
            seen: progress.seen.len(),
            selected: progress.selected.len(),
            delivered: progress.delivered,
            wrong_pose_delivered: progress.wrong_pose_delivered,
            max_slip_m: progress.max_slip_m,
            passed_per_min: report.per_minute(report.passed),
            good_per_min: report.per_minute(report.good),
            right_selections: feed.right_selections,
            wrong_selections: feed.wrong_selections,
            missed_selections: feed.missed_selections,
            singulation: report.singulation,
            gap_m: report.gap_m,
            recirculation_s: report.recirculation_s,
            jams: feed.jams,
            stranded: feed.stranded,
            sim_s,
            wall_s,
            startup_s: startup.as_secs_f64(),
            real_time_factor: if wall_s > 0.0 { sim_s / wall_s } else { 0.0 },
        }
    }

    pub(crate) fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "  {name:<32} {value:>12}");
        row("parts fed to the plateau", self.fed.to_string())?;
        row("distinct parts seen", self.seen.to_string())?;
        row("distinct parts called right", self.selected.to_string())?;
        row("parts delivered", self.delivered.to_string())?;
        row("  of these in a wrong pose", self.wrong_pose_delivered.to_string())?;
        row("largest slip of a delivered part", format!("{:.1} µm", self.max_slip_m * 1e6))?;
        row("past the camera", format!("{:.1} /min", self.passed_per_min))?;
        row("  of these right and apart", format!("{:.1} /min", self.good_per_min))?;
        row("selected rightly", self.right_selections.to_string())?;
        row("  wrongly", self.wrong_selections.to_string())?;
        row("  missed", self.missed_selections.to_string())?;
        row("apart on the plateau", format!("{:.0} %", 100.0 * self.singulation))?;
        row("  mean gap", format!("{:.1} mm", 1e3 * self.gap_m))?;
        row("recirculation", format!("{:.1} s", self.recirculation_s))?;
        row("jams", self.jams.to_string())?;
        row("parts stranded", self.stranded.to_string())?;
        row("simulated time", format!("{:.2} s", self.sim_s))?;
        row("wall time", format!("{:.2} s", self.wall_s))?;
        row("start-up", format!("{:.2} s", self.startup_s))?;
        row("real-time factor", format!("{:.1}", self.real_time_factor))
    }
}
