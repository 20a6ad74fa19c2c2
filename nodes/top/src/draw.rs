//! Draws a picture of the run on a terminal of any size.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use crate::band::{LEGEND, band};
use crate::figures::{courier, delivery, feeding};
use crate::panels::{events, figures, log, nodes, titled};
use crate::picture::Picture;
use crate::units::{UNKNOWN, fixed, folded, text};

/// Below this width the panels stand below each other.
const BESIDE_MIN: u16 = 76;
/// Below this size only the most important lines are shown.
const SMALLEST: (u16, u16) = (40, 12);
/// With so many rows below the figures the log has a panel of its own.
const LOG_MIN: u16 = 9;

/// How things are set off: by colour, or without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Palette {
    coloured: bool,
}

impl Palette {
    /// With colours.
    pub const COLOURED: Self = Self { coloured: true };
    /// Without.
    pub const PLAIN: Self = Self { coloured: false };

    /// As the user's environment asks for: without colours where `NO_COLOR` says anything.
    #[must_use]
    pub fn from_env() -> Self {
        Self { coloured: std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()) }
    }

    fn or(self, colour: Color, modifier: Modifier) -> Style {
        if self.coloured {
            Style::new().fg(colour).add_modifier(Modifier::BOLD)
        } else {
            Style::new().add_modifier(modifier)
        }
    }

    pub(crate) fn good(self) -> Style {
        self.or(Color::Green, Modifier::empty())
    }

    pub(crate) fn warning(self) -> Style {
        self.or(Color::Yellow, Modifier::BOLD)
    }

    pub(crate) fn bad(self) -> Style {
        self.or(Color::Red, Modifier::REVERSED)
    }

    pub(crate) fn title(self) -> Style {
        self.or(Color::Cyan, Modifier::BOLD)
    }

    pub(crate) fn quiet(self) -> Style {
        Style::new().add_modifier(Modifier::DIM)
    }

    /// A cell of this colour.
    pub(crate) fn on(self, colour: Color) -> Option<Style> {
        self.coloured.then(|| Style::new().bg(colour).fg(Color::Black))
    }
}

/// Draws it.
pub fn draw(frame: &mut Frame<'_>, picture: &Picture, palette: Palette) {
    let area = frame.area();
    if area.width < SMALLEST.0 || area.height < SMALLEST.1 {
        return tiny(frame, picture, palette);
    }
    let warning = warning(picture, palette, area.width);
    let rows = u16::try_from(warning.len()).unwrap_or(u16::MAX).min(area.height / 3);
    let [top, below, body, bottom] =
        Layout::vertical([Constraint::Length(1), Constraint::Length(rows), Constraint::Fill(1), Constraint::Length(1)])
            .areas(area);
    frame.render_widget(headline(picture, palette), top);
    frame.render_widget(Paragraph::new(warning), below);
    let keys = if picture.names().count() > 1 { "q quit  Tab next feeder" } else { "q quit" };
    frame.render_widget(Line::styled(format!("{keys}  {}", picture.note), palette.quiet()), bottom);
    let (delivery, feeding, courier) =
        (delivery(picture, palette), feeding(picture, palette), courier(picture, palette));
    let name = format!("Feeder {}", picture.feeder());
    let rows = |figures: &[_]| u16::try_from(figures.len()).unwrap_or(u16::MAX).saturating_add(1);
    if area.width < BESIDE_MIN {
        let [first, second, third, strip, rest] = Layout::vertical([
            Constraint::Length(rows(&delivery)),
            Constraint::Length(rows(&feeding)),
            Constraint::Length(rows(&courier)),
            Constraint::Length(2),
            Constraint::Fill(1),
        ])
        .areas(body);
        figures(frame, first, &name, &delivery, palette);
        figures(frame, second, "Feeding", &feeding, palette);
        figures(frame, third, "Courier", &courier, palette);
        phases(frame, strip, picture, palette);
        let [of_nodes, of_events] = halves(rest, false);
        nodes(frame, of_nodes, picture, palette);
        events(frame, of_events, picture, palette);
        return;
    }
    let [first, second, strip, rest] = Layout::vertical([
        Constraint::Length(rows(&delivery).max(rows(&feeding))),
        Constraint::Length(rows(&courier)),
        Constraint::Length(2),
        Constraint::Fill(1),
    ])
    .areas(body);
    let ([left, right], [below, beside]) = (halves(first, true), halves(second, true));
    figures(frame, left, &name, &delivery, palette);
    figures(frame, right, "Feeding", &feeding, palette);
    figures(frame, below, "Courier", &courier, palette);
    nodes(frame, beside, picture, palette);
    phases(frame, strip, picture, palette);
    if rest.height >= LOG_MIN && !picture.lines.is_empty() {
        let [of_events, of_log] = halves(rest, false);
        events(frame, of_events, picture, palette);
        log(frame, of_log, picture, palette);
    } else {
        events(frame, rest, picture, palette);
    }
}

/// That what runs is not what is shown: nothing below it can be trusted.
fn warning(picture: &Picture, palette: Palette, width: u16) -> Vec<Line<'static>> {
    let text = picture.mismatch().map(|mismatch| format!("▲ {mismatch}")).unwrap_or_default();
    folded(&text, usize::from(width)).into_iter().map(|line| Line::styled(line, palette.warning())).collect()
}

fn halves(area: Rect, beside: bool) -> [Rect; 2] {
    let halves = [Constraint::Fill(1), Constraint::Fill(1)];
    if beside { Layout::horizontal(halves).spacing(2).areas(area) } else { Layout::vertical(halves).areas(area) }
}

/// What runs, when, and how fast.
fn headline(picture: &Picture, palette: Palette) -> Line<'static> {
    let Picture { hello, frame, .. } = picture;
    let (word, style) = pace(picture, palette);
    let end = hello["end_s"].as_f64().map(|end_s| format!(" of {end_s:.0} s")).unwrap_or_default();
    let what = if hello.is_null() { UNKNOWN } else { text(&hello["scenario"]) };
    Line::from_iter([
        Span::styled(
            format!("{:>10}{end}", fixed(&frame["time_s"], 2, " s")),
            Style::new().add_modifier(Modifier::BOLD),
        ),
        Span::raw("  "),
        Span::styled(word, style),
        Span::raw(format!("  {what}, seed {}, {}", hello["seed"], text(&hello["source"]))),
    ])
}

fn pace(picture: &Picture, palette: Palette) -> (String, Style) {
    let frame = &picture.frame;
    if frame.is_null() || frame["time_s"].is_null() {
        ("nothing heard yet".to_owned(), palette.warning())
    } else if frame["paused"] == true {
        ("paused".to_owned(), palette.warning())
    } else if frame["ended"] == true {
        ("silent: the run has ended".to_owned(), palette.warning())
    } else {
        (format!("{} times real time", fixed(&frame["real_time_factor"], 2, "")), Style::new())
    }
}

/// The phases of late, below what their letters mean.
fn phases(frame: &mut Frame<'_>, area: Rect, picture: &Picture, palette: Palette) {
    let inside = titled(frame, area, &format!("Last 40 s: {LEGEND}"), palette);
    frame.render_widget(band(picture, palette, inside.width), inside);
}

/// What fits on a terminal that is too small for the rest.
fn tiny(frame: &mut Frame<'_>, picture: &Picture, palette: Palette) {
    let delivery = delivery(picture, palette);
    let courier = courier(picture, palette);
    let figures = delivery.iter().take(3).chain(courier.first());
    let figures = figures.map(|figure| Line::styled(format!("{} {}", figure.name, figure.value), figure.style));
    let warning = warning(picture, palette, frame.area().width);
    let lines: Vec<Line<'_>> =
        std::iter::once(headline(picture, palette)).chain(warning.into_iter().take(1)).chain(figures).collect();
    frame.render_widget(Paragraph::new(lines), frame.area());
}
