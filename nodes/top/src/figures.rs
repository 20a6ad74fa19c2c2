//! The figures of a feeder, each with a name, in three groups.

use ratatui::style::Style;
use serde_json::Value;

use crate::draw::Palette;
use crate::picture::Picture;
use crate::units::{UNKNOWN, count, fixed, percent, si, text, words};

/// A figure: its name, its value, and how it is set off.
pub(crate) struct Figure {
    pub(crate) name: &'static str,
    pub(crate) value: String,
    pub(crate) style: Style,
}

fn figure(name: &'static str, value: String) -> Figure {
    Figure { name, value, style: Style::new() }
}

fn styled(name: &'static str, value: String, style: Style) -> Figure {
    Figure { name, value, style }
}

/// States of a feeder in which nothing comes of it.
fn state_style(state: &Value, palette: Palette) -> Style {
    match text(&state["state"]) {
        "aborted" => palette.bad(),
        "held" | "stopped" => palette.warning(),
        "execute" => palette.good(),
        _ => Style::new(),
    }
}

/// What it is asked for, and what came of it.
pub(crate) fn delivery(picture: &Picture, palette: Palette) -> Vec<Figure> {
    let (now, scores) = (picture.now(), picture.scores());
    let (state, delivery, progress, counts) =
        (&scores["state"], &now["delivery"], &scores["progress"], &scores["counts"]);
    let word = if state.is_null() { UNKNOWN.to_owned() } else { words(&state["state"]) };
    let reason = match (text(&state["reason"]), text(&state["message"])) {
        ("no_reason" | "", "") => String::new(),
        (_, "") => format!(": {}", words(&state["reason"])),
        (_, message) => format!(": {message}"),
    };
    let to = delivery["station"].as_str().map(|station| format!(" for {station}")).unwrap_or_default();
    let open = state["open"].as_u64().filter(|open| *open > 1).map(|open| format!(", {open} open")).unwrap_or_default();
    let phase = if delivery.is_null() { UNKNOWN.to_owned() } else { words(&delivery["phase"]) };
    let failed = delivery["failed"].as_u64().filter(|failed| *failed > 0);
    let failed = failed.map(|failed| format!(", {failed} failed")).unwrap_or_default();
    let wrong = progress["wrong_pose_delivered"].as_u64().unwrap_or(0) + delivery["parts_lost"].as_u64().unwrap_or(0);
    vec![
        styled("state", format!("{word}{reason}"), state_style(state, palette)),
        figure("phase", format!("{phase}{to}{open}")),
        figure(
            "delivered",
            format!("{} of {} accepted{failed}", count(&delivery["delivered"]), count(&delivery["accepted"])),
        ),
        styled(
            "amiss",
            format!(
                "{} in a wrong pose, {} lost",
                count(&progress["wrong_pose_delivered"]),
                count(&delivery["parts_lost"])
            ),
            if wrong > 0 { palette.warning() } else { Style::new() },
        ),
        figure("slip", si(&progress["slip_m_max"], "m")),
        figure("in tray", format!("{} parts, {} fed so far", count(&counts["parts"]), count(&counts["fed"]))),
    ]
}

/// How it feeds, and what its selector makes of it.
pub(crate) fn feeding(picture: &Picture, palette: Palette) -> Vec<Figure> {
    let (now, metrics) = (picture.now(), &picture.scores()["metrics"]);
    let seen = now["candidates"]["parts"].as_array();
    let offered = seen.map_or_else(
        || UNKNOWN.to_owned(),
        |seen| {
            let may = seen.iter().filter(|part| part["may_be_picked"] == true).count();
            format!("{may} of {} seen", seen.len())
        },
    );
    let on = match now["feeding"].as_bool() {
        Some(true) => "on",
        Some(false) => "off",
        None => UNKNOWN,
    };
    let stuck = metrics["jams"].as_u64().unwrap_or(0) + metrics["stranded"].as_u64().unwrap_or(0);
    let speeds = &now["track_speed_m_s"];
    vec![
        figure(
            "feeding",
            format!(
                "{on}, good {}, passed {}",
                fixed(&metrics["good_per_min"], 1, ""),
                fixed(&metrics["passed_per_min"], 1, " /min")
            ),
        ),
        figure("offered", offered),
        figure(
            "selected",
            format!(
                "{} right, {} wrong, {} missed",
                count(&metrics["right_selections"]),
                count(&metrics["wrong_selections"]),
                count(&metrics["missed_selections"])
            ),
        ),
        figure("apart", format!("{}, mean gap {}", percent(&metrics["singulation"]), si(&metrics["gap_m"], "m"))),
        figure("ramp", format!("{}, plateau {}", si(&speeds["ramp"], "m/s"), si(&speeds["plateau"], "m/s"))),
        styled(
            "stuck",
            format!("{} jams, {} stranded", count(&metrics["jams"]), count(&metrics["stranded"])),
            if stuck > 0 { palette.warning() } else { Style::new() },
        ),
    ]
}

/// How the courier follows its commands.
pub(crate) fn courier(picture: &Picture, palette: Palette) -> Vec<Figure> {
    let now = picture.now();
    let (place, state, progress) = (&now["courier"], &now["courier_state"], &picture.scores()["progress"]);
    let (doing, style) = match (state["fault"].as_str(), state["warning"].as_str()) {
        (Some(fault), _) => (fault.to_owned(), palette.bad()),
        (None, Some(warning)) => (warning.to_owned(), palette.warning()),
        (None, None) => {
            let doing = match (state["vibrating"].as_bool(), state["moving"].as_bool()) {
                (Some(true), _) => "vibrates",
                (_, Some(true)) => "travels",
                (Some(false), _) => "at rest",
                _ => UNKNOWN,
            };
            (doing.to_owned(), Style::new())
        }
    };
    let unit = if text(&picture.motion["axis"]) == "yaw" { "rad/s" } else { "m/s" };
    vec![
        styled("courier", doing, style),
        figure(
            "place",
            format!("{}, {}, {}", si(&place["x_m"], "m"), si(&place["y_m"], "m"), si(&place["yaw_rad"], "rad")),
        ),
        figure(
            "tracking",
            format!("{}, {} off", si(&state["position_error_m"], "m"), si(&state["yaw_error_rad"], "rad")),
        ),
        figure(
            "learning",
            learning_error(&picture.motion)
                .map_or_else(|| UNKNOWN.to_owned(), |error| format!("{} rms off", si(&Value::from(error), unit))),
        ),
        figure("odometry", format!("{} off the truth at most", si(&progress["odometry_error_m_max"], "m"))),
    ]
}

/// The error of velocity of late: the median of some periods, as those in which it starts and stops are far off.
fn learning_error(motion: &Value) -> Option<f64> {
    const PERIODS: usize = 9;
    let errors = motion["errors"]["velocity_rms"].as_array()?;
    let mut newest: Vec<f64> = errors.iter().rev().take(PERIODS).filter_map(Value::as_f64).collect();
    newest.sort_by(f64::total_cmp);
    newest.get(newest.len() / 2).copied()
}
