//! What changes slowly: scores, what the feeders say of themselves, and how the nodes fare.

use std::collections::BTreeMap;

use minifactory_msgs::diagnostic_msgs::msg::DiagnosticStatus;
use minifactory_msgs::msg::{FeedMetrics, FeederState, RunProgress};
use serde_json::{Map, Value, json};

use crate::description::{Description, Feeder};
use crate::frame::time_s;
use crate::heard::{FeederHeard, Heard};
use crate::mismatch::mismatch;
use crate::numbers::{coarse, fine, finite, metres, seconds};

/// A node that has said nothing for so long is shown so, simulated s. Nodes speak once a second.
const STALE_S: f64 = 3.0;

/// How the nodes fare, as far as they have said.
#[derive(Default)]
pub(crate) struct Health {
    nodes: BTreeMap<String, NodeHealth>,
}

struct NodeHealth {
    said_s: f64,
    level: u8,
    message: String,
    values: Map<String, Value>,
}

impl Health {
    /// Takes in what was said since the last time.
    pub(crate) fn hear(&mut self, heard: &Heard) {
        for message in heard.diagnostics.take() {
            let said_s = time_s(&message.header.stamp);
            for DiagnosticStatus { level, name, message, values, .. } in message.status {
                let values = values.into_iter().map(|entry| (entry.key, Value::String(entry.value))).collect();
                self.nodes.insert(name, NodeHealth { said_s, level, message, values });
            }
        }
    }

    fn shown(&self, now_s: f64) -> Vec<Value> {
        let shown = |(name, node): (&String, &NodeHealth)| {
            let level = match node.level {
                _ if now_s - node.said_s > STALE_S => "stale",
                DiagnosticStatus::OK => "ok",
                DiagnosticStatus::WARN => "warn",
                DiagnosticStatus::ERROR => "error",
                _ => "stale",
            };
            json!({ "name": name, "level": level, "message": node.message, "values": node.values })
        };
        self.nodes.iter().map(shown).collect()
    }
}

/// The message.
pub(crate) fn status(cell: &Description, heard: &Heard, health: &Health, now_s: Option<f64>, viewers: usize) -> Value {
    let feeders: Map<String, Value> = cell
        .feeders
        .iter()
        .zip(&heard.feeders)
        .map(|(feeder, inboxes)| (feeder.name.clone(), feeder_status(cell, feeder, inboxes)))
        .collect();
    json!({
        "type": "status",
        "time_s": now_s.map(seconds),
        "feeders": feeders,
        "nodes": health.shown(now_s.unwrap_or_default()),
        "viewers": viewers,
    })
}

fn feeder_status(cell: &Description, feeder: &Feeder, heard: &FeederHeard) -> Value {
    let counts = heard.parts.latest().map(|truth| {
        json!({
            "fed": truth.fed, "recirculated": truth.recirculated, "picked": truth.picked,
            "jams": truth.jams, "parts": truth.parts.len(),
        })
    });
    json!({
        "progress": heard.progress.latest().map(|message| progress(&message)),
        "metrics": heard.metrics.latest().map(|message| metrics(&message)),
        "state": heard.state.latest().map(|message| state(&message)),
        "counts": counts,
        "mismatch": mismatch(cell, feeder, heard),
    })
}

fn progress(message: &RunProgress) -> Value {
    json!({
        "fed": message.fed,
        "seen": message.seen,
        "selected": message.selected,
        "delivered": message.delivered,
        "wrong_pose_delivered": message.wrong_pose_delivered,
        "slip_m_max": Some(fine(message.max_slip_m)).filter(|slip_m| *slip_m >= 0.0),
        "odometry_error_m_max": finite(fine(message.odometry_error_m_max)),
        "odometry_error_m_rms": finite(fine(message.odometry_error_m_rms)),
    })
}

fn metrics(message: &FeedMetrics) -> Value {
    json!({
        "passed_per_min": coarse(message.passed_per_min),
        "good_per_min": coarse(message.good_per_min),
        "right_selections": message.right_selections,
        "wrong_selections": message.wrong_selections,
        "missed_selections": message.missed_selections,
        "plateau_parts": coarse(message.plateau_parts),
        "singulation": coarse(message.singulation),
        "gap_m": metres(message.gap_m),
        "recirculation_s": coarse(message.recirculation_s),
        "jams": message.jams,
        "stranded": message.stranded,
    })
}

fn state(message: &FeederState) -> Value {
    let state = match message.state {
        FeederState::STOPPED => "stopped",
        FeederState::IDLE => "idle",
        FeederState::EXECUTE => "execute",
        FeederState::SUSPENDED => "suspended",
        FeederState::HELD => "held",
        FeederState::ABORTED => "aborted",
        FeederState::CLEARING => "clearing",
        _ => "unknown",
    };
    let reason = match message.reason {
        FeederState::NO_REASON => "no_reason",
        FeederState::STARVED => "starved",
        FeederState::WAITING_FOR_HANDOVER => "waiting_for_handover",
        FeederState::WAITING_FOR_AREA => "waiting_for_area",
        FeederState::FAULT => "fault",
        FeederState::BADLY_FED => "badly_fed",
        FeederState::UNRECOGNISED => "unrecognised",
        _ => "unknown",
    };
    json!({
        "state": state,
        "reason": reason,
        "message": message.message,
        "open": message.open,
        "stations": message.stations,
    })
}
