//! The phases of a feeder's deliveries over the last while, as a band of letters and colours.

use ratatui::style::Color;
use ratatui::text::{Line, Span};
use serde_json::Value;

use crate::draw::Palette;
use crate::picture::Picture;
use crate::units::text;

/// Simulated seconds that the band shows.
const SPAN_S: f64 = 40.0;

/// A phase's letter and colour.
fn look(phase: &str) -> (char, Color) {
    match phase {
        "feeding" => ('f', Color::Green),
        "purging" => ('u', Color::Green),
        "stopping" | "settling" => ('s', Color::Yellow),
        "looking" => ('l', Color::Yellow),
        "reserving" => ('a', Color::DarkGray),
        "moving" => ('m', Color::Blue),
        "presented" => ('P', Color::Magenta),
        "returning" => ('r', Color::Blue),
        "fault" => ('X', Color::Red),
        _ => ('·', Color::DarkGray),
    }
}

/// What the letters mean.
pub(crate) const LEGEND: &str = "f(eed) s(ettle) l(ook) a(rea) m(ove) P(resented) r(eturn) X(fault)";

/// The phase that began with this event, and when, s; for the feeder of this name.
fn beginning<'a>(event: &'a Value, feeder: &str) -> Option<(f64, &'a str)> {
    let is_phase = matches!(text(&event["kind"]), "phase" | "presented");
    (is_phase && event["feeder"] == feeder)
        .then(|| (event["time_s"].as_f64(), text(&event["message"])))
        .and_then(|(time_s, phase)| Some((time_s?, phase)))
}

/// The band, so many cells wide: the newest at its right end.
pub(crate) fn band(picture: &Picture, palette: Palette, width: u16) -> Line<'static> {
    let now_s = picture.frame["time_s"].as_f64().unwrap_or(0.0);
    let phases: Vec<(f64, &str)> = picture
        .events
        .iter()
        .filter_map(|event| beginning(event, picture.feeder()))
        .filter(|(from_s, _)| *from_s <= now_s)
        .collect();
    let from_s = (now_s - SPAN_S).max(0.0);
    let cell_s = (now_s - from_s) / f64::from(width.max(1));
    let newest = text(&picture.now()["delivery"]["phase"]);
    let at = |cell: u16| {
        let middle_s = from_s + (f64::from(cell) + 0.5) * cell_s;
        // Whoever came late knows only what is now.
        let before = if phases.is_empty() { newest } else { "" };
        look(phases.iter().rev().find(|(begin_s, _)| *begin_s <= middle_s).map_or(before, |(_, phase)| phase))
    };
    let cells = (0..width).map(|cell| {
        let (letter, colour) = at(cell);
        Span::styled(letter.to_string(), palette.on(colour).unwrap_or_default())
    });
    Line::from_iter(cells)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_band_shows_each_phase_for_as_long_as_it_took() {
        let event = |time_s: f64, phase: &str| json!({ "kind": "phase", "feeder": "feeder", "time_s": time_s, "message": phase });
        let picture = Picture {
            hello: json!({ "feeders": [{ "name": "feeder" }] }),
            frame: json!({ "time_s": 40.0, "feeders": { "feeder": { "delivery": { "phase": "moving" } } } }),
            events: [event(0.0, "feeding"), event(20.0, "looking"), event(30.0, "moving")].into(),
            ..Picture::default()
        };
        assert_eq!(
            band(&picture, Palette::PLAIN, 40).to_string(),
            format!("{}{}{}", "f".repeat(20), "l".repeat(10), "m".repeat(10))
        );
        let late = Picture { events: [].into(), ..picture };
        assert_eq!(band(&late, Palette::PLAIN, 4).to_string(), "mmmm");
    }
}
