//! What is drawn of a run: every panel says what it should, on a terminal of any size.

use feeder_top::{Palette, Picture, draw};
use feeder_view::Sight;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::style::Color;
use serde_json::{Value, json};

fn sight() -> Sight {
    let event = |time_s: f64, kind: &str, level: &str, message: &str| {
        json!({ "time_s": time_s, "feeder": "feeder", "kind": kind, "level": level, "message": message,
                "delivery_id": null, "station": "station_1", "node": null })
    };
    let hello = json!({ "scenario": "the built-in scenario", "seed": 7, "source": "run", "end_s": 60.0, "feeders": [{ "name": "feeder" }] });
    let frame = json!({
        "time_s": 12.34, "paused": false, "ended": false, "real_time_factor": 9.81,
        "feeders": { "feeder": {
            "courier": { "x_m": 0.3, "y_m": 0.25, "yaw_rad": 0.0123 },
            "courier_state": { "vibrating": true, "moving": false, "position_error_m": 1.2e-5, "yaw_error_rad": 3.4e-4, "fault": null, "warning": null },
            "delivery": { "phase": "feeding", "station": "station_1", "delivered": 5, "accepted": 7, "failed": 1, "parts_lost": 1 },
            "feeding": true,
            "candidates": { "parts": [{ "may_be_picked": true }, { "may_be_picked": false }, { "may_be_picked": false }] },
            "track_speed_m_s": { "ramp": 0.0123, "plateau": 0.046 },
        } },
    });
    let status = json!({
        "feeders": { "feeder": {
            "progress": { "wrong_pose_delivered": 2, "slip_m_max": 3.2e-6, "odometry_error_m_max": 1.5e-5 },
            "metrics": { "good_per_min": 8.1, "passed_per_min": 24.0, "right_selections": 12, "wrong_selections": 0,
                         "missed_selections": 3, "singulation": 0.62, "gap_m": 0.0051, "jams": 0, "stranded": 1 },
            "state": { "state": "execute", "reason": "no_reason", "message": "", "open": 2 },
            "counts": { "parts": 19, "fed": 153 },
        } },
        "nodes": [
            { "name": "/feeder/courier_driver", "level": "ok", "message": "", "values": { "received": "12" } },
            { "name": "/feeder/vision_selector", "level": "warn", "message": "3 pictures lost", "values": {} },
        ],
    });
    let motion = json!({ "axis": "yaw", "errors": { "velocity_rms": [0.5, 0.002, 0.003, 0.0021] } });
    let events = vec![
        event(1.0, "goal", "info", "a delivery was accepted"),
        event(2.0, "phase", "info", "feeding"),
        event(9.5, "log", "error", "the camera is dark"),
    ];
    Sight { hello, frame, status, motion, events }
}

fn drawn(seen: &Sight, palette: Palette, (width, height): (u16, u16)) -> Buffer {
    let mut picture = Picture::new("to see it live: feeder view");
    picture.take(seen.clone());
    picture.line("INFO courier_driver: active");
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, &picture, palette)).unwrap();
    terminal.backend().buffer().clone()
}

fn lines(buffer: &Buffer) -> Vec<String> {
    let width = usize::from(buffer.area.width);
    buffer.content.chunks(width).map(|row| row.iter().map(ratatui::buffer::Cell::symbol).collect::<String>()).collect()
}

fn shown(picture: &Sight, size: (u16, u16)) -> String {
    lines(&drawn(picture, Palette::PLAIN, size)).join("\n")
}

#[track_caller]
fn assert_shows(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "no {word:?} in\n{text}");
    }
}

#[test]
fn the_headline_tells_time_and_pace() {
    let mut picture = sight();
    assert_shows(&shown(&picture, (80, 24)), &["12.34 s of 60 s", "9.81 times real time", "built-in scenario, seed 7"]);
    picture.frame["paused"] = json!(true);
    assert_shows(&shown(&picture, (80, 24)), &["paused"]);
    picture.frame = Value::Null;
    assert_shows(&shown(&picture, (80, 24)), &["nothing heard yet"]);
}

#[test]
fn a_scenario_that_is_not_what_runs_stands_in_front_of_everything() {
    let mut picture = sight();
    for size in [(80, 24), (40, 12), (30, 6)] {
        assert!(!lines(&drawn(&picture, Palette::PLAIN, size))[1].contains('▲'), "nothing is amiss");
    }
    let said =
        "what runs is not the scenario that is shown: it feeds grommet, not block; give --scenario what was given";
    picture.status["feeders"]["feeder"]["mismatch"] = json!(said);
    for size in [(80, 24), (40, 12), (30, 6)] {
        let lines = lines(&drawn(&picture, Palette::PLAIN, size));
        assert!(lines[1].starts_with("▲ what runs is not the"), "{lines:?}");
        assert_shows(&lines.join("\n"), &["12.34 s", "state", "execute"]);
    }
    assert_shows(&shown(&picture, (80, 24)), &["it feeds grommet, not", "5 of 7 accepted"]);
    let buffer = drawn(&picture, Palette::COLOURED, (80, 24));
    let line: Vec<_> = buffer.content.iter().skip(80).take(22).map(|cell| cell.fg).collect();
    assert_eq!(line, vec![Color::Yellow; 22]);
}

#[test]
fn the_feeders_panel_tells_state_phase_and_what_came_of_it() {
    let mut picture = sight();
    assert_shows(
        &shown(&picture, (80, 24)),
        &[
            "state     execute",
            "feeding for station_1, 2 open",
            "5 of 7 accepted, 1 failed",
            "2 in a wrong pose, 1 lost",
            "3.20 µm",
            "19 parts, 153 fed",
        ],
    );
    picture.status["feeders"]["feeder"]["state"] = json!({ "state": "held", "reason": "starved", "message": "" });
    assert_shows(&shown(&picture, (80, 24)), &["held: starved"]);
    picture.status["feeders"]["feeder"]["state"]["message"] = json!("no part came for 12 s");
    assert_shows(&shown(&picture, (80, 24)), &["held: no part came for 12 s"]);
}

#[test]
fn the_feeding_panel_tells_how_it_feeds() {
    assert_shows(
        &shown(&sight(), (100, 24)),
        &[
            "on, good 8.1, passed 24.0 /min",
            "1 of 3 seen",
            "12 right, 0 wrong, 3 missed",
            "62 %, mean gap 5.10 mm",
            "12.3 mm/s, plateau 46.0 mm/s",
            "0 jams, 1 stranded",
        ],
    );
}

#[test]
fn the_couriers_panel_tells_how_it_follows() {
    let mut picture = sight();
    assert_shows(
        &shown(&picture, (80, 24)),
        &[
            "vibrates",
            "300 mm, 250 mm, 12.3 mrad",
            "12.0 µm, 340 µrad off",
            "3.00 mrad/s rms off",
            "15.0 µm off the truth",
        ],
    );
    picture.frame["feeders"]["feeder"]["courier_state"]["fault"] = json!("tracking error 2 mm");
    let buffer = drawn(&picture, Palette::COLOURED, (80, 24));
    let red = buffer.content.iter().filter(|cell| cell.fg == Color::Red).map(ratatui::buffer::Cell::symbol);
    assert!(red.collect::<String>().contains("tracking error 2 mm"));
}

#[test]
fn the_nodes_panel_begins_with_those_that_do_not_fare_well() {
    let text = shown(&sight(), (80, 24));
    let place = |word: &str| text.find(word).unwrap_or_else(|| panic!("no {word} in\n{text}"));
    assert!(place("vision_selector") < place("courier_driver: "), "{text}");
    assert_shows(&text, &["Nodes: 2 report, 1 not well", "3 pictures lost"]);
}

#[test]
fn the_events_are_listed_with_the_newest_last_and_phases_are_in_the_band() {
    let text = shown(&sight(), (80, 24));
    assert_shows(&text, &["9.5 ✕ log", "the camera is dark", "a delivery was accepted", "Last 40 s", "ffffffff"]);
    assert!(text.find("accepted at").unwrap() < text.find("camera is dark").unwrap(), "{text}");
}

#[test]
fn the_log_has_a_panel_where_there_is_room() {
    assert_shows(&shown(&sight(), (80, 40)), &["INFO courier_driver: active"]);
}

#[test]
fn without_colours_nothing_is_coloured() {
    for (palette, coloured) in [(Palette::PLAIN, false), (Palette::COLOURED, true)] {
        let buffer = drawn(&sight(), palette, (100, 40));
        let has = buffer.content.iter().any(|cell| cell.fg != Color::Reset || cell.bg != Color::Reset);
        assert_eq!(has, coloured);
    }
}

#[test]
fn small_terminals_get_what_matters_most_and_none_is_too_small() {
    assert_shows(&shown(&sight(), (30, 6)), &["12.34 s", "execute", "5 of 7"]);
    assert_shows(
        &shown(&sight(), (60, 40)),
        &["5 of 7 accepted", "12 right", "vibrates", "pictures lost", "camera is dark"],
    );
    for width in [1, 2, 10, 39, 40, 75, 76, 200] {
        for height in [1, 2, 5, 11, 12, 24, 60] {
            drawn(&sight(), Palette::COLOURED, (width, height));
            drawn(&Sight::default(), Palette::COLOURED, (width, height));
        }
    }
}
