//! The panels that the screen is made of.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::Style;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use serde_json::Value;

use crate::draw::Palette;
use crate::figures::Figure;
use crate::picture::Picture;
use crate::units::{UNKNOWN, text, words};

/// Columns for the name of a figure.
const NAME_CELLS: usize = 10;

/// Draws a title and returns what is left below it.
pub(crate) fn titled(frame: &mut Frame<'_>, area: Rect, title: &str, palette: Palette) -> Rect {
    let [top, inside] = Layout::vertical([Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    frame.render_widget(Line::styled(title.to_owned(), palette.title()), top);
    inside
}

/// Figures below each other.
pub(crate) fn figures(frame: &mut Frame<'_>, area: Rect, title: &str, figures: &[Figure], palette: Palette) {
    let inside = titled(frame, area, title, palette);
    let line = |figure: &Figure| {
        let name = Span::styled(format!("{:<NAME_CELLS$}", figure.name), palette.quiet());
        Line::from_iter([name, Span::styled(figure.value.clone(), figure.style)])
    };
    frame.render_widget(Paragraph::new(figures.iter().map(line).collect::<Vec<_>>()), inside);
}

/// The sign of a level, and how it is set off.
fn mark(level: &Value, palette: Palette) -> (&'static str, Style) {
    match text(level) {
        "ok" => ("●", palette.good()),
        "warn" => ("▲", palette.warning()),
        "error" => ("✕", palette.bad()),
        "info" => ("·", Style::new()),
        _ => ("○", palette.warning()),
    }
}

/// How the nodes fare, those that fare badly first.
pub(crate) fn nodes(frame: &mut Frame<'_>, area: Rect, picture: &Picture, palette: Palette) {
    let mut nodes: Vec<&Value> = picture.status["nodes"].as_array().into_iter().flatten().collect();
    let is_well = |node: &&Value| text(&node["level"]) == "ok";
    let ill = nodes.iter().filter(|node| !is_well(node)).count();
    let title = match (nodes.len(), ill) {
        (0, _) => "Nodes: none has reported yet".to_owned(),
        (all, 0) => format!("Nodes: {all} report, all well"),
        (all, ill) => format!("Nodes: {all} report, {ill} not well"),
    };
    let inside = titled(frame, area, &title, palette);
    nodes.sort_by_key(is_well);
    let (own, several) = (format!("{}/", picture.feeder()), picture.names().count() > 1);
    let line = |node: &Value| {
        let (sign, style) = mark(&node["level"], palette);
        let values = node["values"].as_object().into_iter().flatten();
        let values: Vec<String> = values.take(3).map(|(key, value)| format!("{key} {}", text(value))).collect();
        let said = match (text(&node["level"]), text(&node["message"])) {
            ("stale", _) => "is silent".to_owned(),
            ("ok", _) | (_, "") => values.join(", "),
            (_, message) => message.to_owned(),
        };
        let name = text(&node["name"]).trim_start_matches('/');
        // Of one feeder alone it goes without saying.
        let name = name.strip_prefix(&own).filter(|_| !several).unwrap_or(name);
        Line::from_iter([Span::styled(sign, style), Span::raw(format!(" {name}: {said}"))])
    };
    frame.render_widget(Paragraph::new(nodes.into_iter().map(line).collect::<Vec<_>>()), inside);
}

/// What has happened, the newest last. Phases are left to the band.
pub(crate) fn events(frame: &mut Frame<'_>, area: Rect, picture: &Picture, palette: Palette) {
    let inside = titled(frame, area, "Events", palette);
    let listed = picture.events.iter().filter(|event| !matches!(text(&event["kind"]), "phase" | "presented"));
    let several = picture.names().count() > 1;
    let line = |event: &Value| {
        let (sign, style) = mark(&event["level"], palette);
        let time = event["time_s"].as_f64().map_or_else(|| UNKNOWN.to_owned(), |time_s| format!("{time_s:.1}"));
        let who = event["node"].as_str().or(event["feeder"].as_str().filter(|_| several)).unwrap_or_default();
        let at = event["station"].as_str().map(|station| format!(" at {station}")).unwrap_or_default();
        let gap = if who.is_empty() { "" } else { " " };
        let kind = words(&event["kind"]);
        Line::from_iter([
            Span::styled(format!("{time:>8} "), palette.quiet()),
            Span::styled(sign, style),
            Span::raw(format!(" {kind}{gap}{who}: {}{at}", text(&event["message"]))),
        ])
    };
    let lines: Vec<Line<'_>> = listed.rev().take(usize::from(inside.height)).map(line).collect();
    frame.render_widget(Paragraph::new(lines.into_iter().rev().collect::<Vec<_>>()), inside);
}

/// What was logged, the newest last.
pub(crate) fn log(frame: &mut Frame<'_>, area: Rect, picture: &Picture, palette: Palette) {
    let inside = titled(frame, area, "Log", palette);
    let newest = picture.lines.len().saturating_sub(usize::from(inside.height));
    let lines: Vec<Line<'_>> = picture.lines.range(newest..).map(|line| Line::raw(line.as_str())).collect();
    frame.render_widget(Paragraph::new(lines), inside);
}
