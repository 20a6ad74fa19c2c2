//! How a run went, for people and for programs.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use run_monitor::{Activity, FeederProgress, OdometryScore, Oracle, Progress};
use serde::Serialize;

/// The outcome of a run. Counts and slip are by ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Parts that entered the plateau; one that comes round again counts again.
    fed: u32,
    /// Distinct parts the selector saw on the plateau; for people only.
    #[serde(skip)]
    seen: u32,
    /// Distinct parts the selector called right.
    selected: u32,
    /// Parts picked.
    delivered: u32,
    /// Parts picked that lay in another pose than they were presented in.
    wrong_pose_delivered: u32,
    /// Parts picked that lay turned by more than 5° from how they were presented, and the largest such angle, rad; null: no
    /// part that has a yaw was picked.
    wrong_yaw_delivered: u32,
    max_yaw_error_rad: Option<f64>,
    /// Parts presented with less room about them than the gripper needs, and by how much it fell short at most, m.
    chosen_without_room: u32,
    room_short_m_max: f64,
    /// Parts picked whose slip could not be followed.
    slips_unknown: u32,
    /// Largest displacement in the tray frame of a delivered part between settled and picked, m; null: not known.
    max_slip_m: Option<f64>,
    /// Parts picked per minute of simulated time.
    pub delivered_per_minute: f64,
    /// How a delivery's time was spent, s: all that the planners did but idle, over the parts picked; null without any.
    per_delivery_s: Option<BTreeMap<&'static str, f64>>,
    /// How each feeder fed.
    feeding: Vec<Feeding>,
    /// Deliveries accepted by the planners.
    accepted: u32,
    /// Deliveries that ended with the part taken.
    succeeded: u32,
    /// Deliveries that failed, by outcome.
    failed: BTreeMap<&'static str, u32>,
    /// Parts that vanished.
    parts_lost: u32,
    /// Parts picked twice.
    parts_doubled: u32,
    /// How well the drivers knew where their couriers were; null: nothing was compared.
    odometry: Option<Odometry>,
    /// How couriers that share the platen kept apart; null: they do not.
    platen: Option<Platen>,
    /// Simulated time, s.
    pub sim_s: f64,
    /// Wall time of the run without start-up, s.
    wall_s: f64,
    /// Wall time from the command to the first tick, s.
    startup_s: f64,
    /// Simulated seconds per wall second.
    real_time_factor: f64,
}

/// How a feeder fed, and what its selector made of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Feeding {
    /// Name of the feeder.
    feeder: String,
    /// Parts per minute that passed the camera; and those that could be picked on their way over the plateau: right, wholly on
    /// it, and with the room that a gripper needs, for a moment at least.
    passed_per_min: f64,
    good_per_min: f64,
    /// Parts per minute picked from this feeder.
    delivered_per_min: f64,
    /// What an oracle would have delivered; null: there was no trip to go by.
    oracle: Option<OracleShare>,
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
}

/// What an oracle would have made of the same feed and moves.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct OracleShare {
    /// Right parts that could be picked, for each second of feeding.
    right_per_s: f64,
    /// Moves of a trip, there and back, s; and what a further stop took, the move and the hand-over, s; null: no trip had one.
    moves_s: f64,
    further_stop_s: Option<f64>,
    /// Parts it takes on a trip: as many as goals were open.
    stops: u32,
    /// Parts it delivers a minute; and what was delivered over that.
    per_min: f64,
    share: f64,
}

impl OracleShare {
    fn of(oracle: &Oracle, delivered_per_min: f64) -> Self {
        let per_min = oracle.per_minute();
        Self {
            right_per_s: oracle.right_per_s,
            moves_s: oracle.moves_s,
            further_stop_s: oracle.further_stop_s,
            stops: oracle.stops,
            per_min,
            share: delivered_per_min / per_min,
        }
    }
}

impl Feeding {
    fn of(feeder: &FeederProgress, sim_s: f64) -> Self {
        let (feed, report) = (&feeder.feed, &feeder.feed.report);
        let delivered_per_min = if sim_s > 0.0 { 60.0 * f64::from(feeder.delivered) / sim_s } else { 0.0 };
        Self {
            delivered_per_min,
            oracle: feeder.oracle().map(|oracle| OracleShare::of(&oracle, delivered_per_min)),
            feeder: feeder.name.clone(),
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
        }
    }

    fn rows(&self, named: bool, row: &mut impl FnMut(&str, String) -> fmt::Result) -> fmt::Result {
        if named {
            row("feeder", self.feeder.clone())?;
        }
        row("past the camera", format!("{:.1} /min", self.passed_per_min))?;
        row("could be picked", format!("{:.1} /min", self.good_per_min))?;
        if let Some(oracle) = &self.oracle {
            row("an oracle would deliver", format!("{:.1} /min", oracle.per_min))?;
            row("  delivered of that", format!("{:.0} %", 100.0 * oracle.share))?;
        }
        row("selected rightly", self.right_selections.to_string())?;
        row("  wrongly", self.wrong_selections.to_string())?;
        row("  missed", self.missed_selections.to_string())?;
        row("apart on the plateau", format!("{:.0} %", 100.0 * self.singulation))?;
        row("  mean gap", format!("{:.1} mm", 1e3 * self.gap_m))?;
        row("recirculation", format!("{:.1} s", self.recirculation_s))?;
        row("jams", self.jams.to_string())?;
        row("parts stranded", self.stranded.to_string())
    }
}

/// Odometry against the truth, and against it what the drivers said of themselves.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Odometry {
    /// Distance from the true position, m: the largest, and root mean square.
    error_m_max: f64,
    error_m_rms: f64,
    /// Difference from the true yaw, rad: the largest, and root mean square.
    error_rad_max: f64,
    error_rad_rms: f64,
    /// Largest distance from the set point, m, and yaw from it, rad, by the drivers' own figures.
    tracking_m_max: f64,
    tracking_rad_max: f64,
}

impl Odometry {
    fn of(score: &OdometryScore) -> Self {
        Self {
            error_m_max: score.error_m_max,
            error_m_rms: score.error_m_rms(),
            error_rad_max: score.error_rad_max,
            error_rad_rms: score.error_rad_rms(),
            tracking_m_max: score.tracking_m_max,
            tracking_rad_max: score.tracking_rad_max,
        }
    }

    fn rows(&self, row: &mut impl FnMut(&str, String) -> fmt::Result) -> fmt::Result {
        row("odometry off the truth, largest", format!("{:.1} µm", 1e6 * self.error_m_max))?;
        row("  rms", format!("{:.1} µm", 1e6 * self.error_m_rms))?;
        row("  yaw, largest", format!("{:.1} µrad", 1e6 * self.error_rad_max))?;
        row("  yaw, rms", format!("{:.1} µrad", 1e6 * self.error_rad_rms))?;
        row("off the set point, says the driver", format!("{:.1} µm", 1e6 * self.tracking_m_max))?;
        row("  yaw", format!("{:.1} µrad", 1e6 * self.tracking_rad_max))
    }
}

/// How couriers kept apart, from where they were in each tick.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Platen {
    /// Smallest distance between two couriers' centres, m; null with one courier.
    couriers_closest_m: Option<f64>,
    /// Ticks in which two couriers overlapped.
    collisions: u32,
    /// Ticks in which a courier reached out of the areas it held.
    out_of_area: u32,
}

/// The outcomes of a delivery, in the order of their numbers in `DeliverPart`'s result.
const OUTCOMES: [&str; 11] = [
    "delivered",
    "cancelled",
    "timed_out",
    "feeding_failed",
    "no_image",
    "move_failed",
    "area_refused",
    "part_lost",
    "no_handover",
    "not_taken",
    "fault",
];

impl Summary {
    /// The summary of a run of so many ticks that took `startup` until its first tick and `wall` from there.
    #[must_use]
    pub fn new(
        progress: &Progress,
        is_shared: bool,
        ticks: u64,
        tick_ns: u64,
        startup: Duration,
        wall: Duration,
    ) -> Self {
        let sim_s = Duration::from_nanos(ticks * tick_ns).as_secs_f64();
        let wall_s = wall.as_secs_f64();
        let delivered = progress.delivered();
        let rate = |count: f64, time_s: f64| if time_s > 0.0 { count / time_s } else { 0.0 };
        // A sum of nothing is -0.
        let spent_s = |activity| -> f64 {
            progress.feeders.iter().filter_map(|feeder| feeder.spent_s.get(&activity)).sum::<f64>() + 0.0
        };
        let per_delivery =
            Activity::OF_A_DELIVERY.map(|(activity, name)| (name, spent_s(activity) / f64::from(delivered)));
        let failed = OUTCOMES.iter().enumerate().filter_map(|(index, name)| {
            let count = progress.sum(|feeder| feeder.failed_by_outcome.get(index).copied().unwrap_or(0));
            (count > 0).then_some((*name, count))
        });
        Self {
            fed: progress.sum(|feeder| feeder.fed),
            seen: progress.seen(),
            selected: progress.selected(),
            delivered,
            wrong_pose_delivered: progress.sum(|feeder| feeder.wrong_pose_delivered),
            wrong_yaw_delivered: progress.sum(|feeder| feeder.wrong_yaw_delivered),
            max_yaw_error_rad: progress.max_yaw_error_rad(),
            chosen_without_room: progress.sum(|feeder| feeder.chosen_without_room),
            room_short_m_max: progress.room_short_m_max(),
            slips_unknown: progress.sum(|feeder| feeder.slips_unknown),
            max_slip_m: progress.max_slip_m(),
            delivered_per_minute: rate(60.0 * f64::from(delivered), sim_s),
            per_delivery_s: (delivered > 0).then(|| per_delivery.into()),
            feeding: progress.feeders.iter().map(|feeder| Feeding::of(feeder, sim_s)).collect(),
            accepted: progress.sum(|feeder| feeder.accepted),
            succeeded: progress.sum(|feeder| feeder.succeeded),
            failed: failed.collect(),
            parts_lost: progress.sum(|feeder| feeder.parts_lost),
            parts_doubled: progress.sum(|feeder| feeder.parts_doubled),
            odometry: Some(progress.odometry()).filter(|score| score.compared > 0).as_ref().map(Odometry::of),
            platen: is_shared.then_some(Platen {
                couriers_closest_m: progress.couriers_closest_m,
                collisions: progress.collisions,
                out_of_area: progress.out_of_area,
            }),
            sim_s,
            wall_s,
            startup_s: startup.as_secs_f64(),
            real_time_factor: rate(sim_s, wall_s),
        }
    }

    /// Counts to the start-up what came before the nodes were started.
    pub(crate) fn add_start_up(&mut self, wall: Duration) {
        self.startup_s += wall.as_secs_f64();
    }

    /// As JSON.
    ///
    /// # Errors
    /// A number that JSON cannot hold.
    pub fn to_json(&self) -> serde_json::Result<String> {
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
        if let Some(error_rad) = self.max_yaw_error_rad {
            row("  turned wrongly", self.wrong_yaw_delivered.to_string())?;
            row("  largest error of yaw", format!("{:.1} deg", error_rad.to_degrees()))?;
        }
        row("presented without room", self.chosen_without_room.to_string())?;
        if self.chosen_without_room > 0 {
            row("  short by at most", format!("{:.2} mm", 1e3 * self.room_short_m_max))?;
        }
        let slip = self.max_slip_m.map_or("not known".to_owned(), |slip_m| format!("{:.1} µm", slip_m * 1e6));
        row("largest slip of a delivered part", slip)?;
        if self.slips_unknown > 0 {
            row("  parts whose slip is not known", self.slips_unknown.to_string())?;
        }
        for (what, count) in [("parts lost", self.parts_lost), ("parts doubled", self.parts_doubled)] {
            if count > 0 {
                row(what, count.to_string())?;
            }
        }
        row("parts delivered a minute", format!("{:.1}", self.delivered_per_minute))?;
        for (_, name) in Activity::OF_A_DELIVERY {
            if let Some(spent_s) = self.per_delivery_s.as_ref().and_then(|spent_s| spent_s.get(name)) {
                row(&format!("  {name}, a delivery"), format!("{spent_s:.2} s"))?;
            }
        }
        for feeding in &self.feeding {
            feeding.rows(self.feeding.len() > 1, &mut row)?;
        }
        for (outcome, count) in &self.failed {
            row(&format!("deliveries failed: {outcome}"), count.to_string())?;
        }
        if let Some(odometry) = &self.odometry {
            odometry.rows(&mut row)?;
        }
        if let Some(platen) = &self.platen {
            if let Some(closest_m) = platen.couriers_closest_m {
                row("closest distance of two couriers", format!("{:.1} mm", closest_m * 1e3))?;
            }
            row("ticks with couriers overlapping", platen.collisions.to_string())?;
            row("ticks outside reserved areas", platen.out_of_area.to_string())?;
        }
        row("simulated time", format!("{:.2} s", self.sim_s))?;
        row("wall time", format!("{:.2} s", self.wall_s))?;
        row("start-up", format!("{:.2} s", self.startup_s))?;
        row("real-time factor", format!("{:.1}", self.real_time_factor))
    }
}
