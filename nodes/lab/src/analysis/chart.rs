//! Charts: the same curves as SVG to look at and as CSV to compute with.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use plotters::prelude::*;

/// Size of a drawing, and where its legend begins, in pixels.
const SIZE: (u32, u32) = (1040, 600);
const LEGEND_X: i32 = 780;

/// A named set of points.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
    pub(crate) mark: Mark,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    Line,
    Dots,
}

impl Series {
    pub(crate) fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, mark: Mark::Line }
    }

    pub(crate) fn dots(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points, mark: Mark::Dots }
    }
}

/// A chart of several series over common axes.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    pub(crate) title: String,
    pub(crate) x: String,
    pub(crate) y: String,
    pub(crate) series: Vec<Series>,
}

impl Chart {
    /// Writes `<stem>.svg` and `<stem>.csv` into a directory.
    pub(crate) fn write(&self, directory: &Path, stem: &str) -> Result<()> {
        let path = directory.join(format!("{stem}.csv"));
        self.write_csv(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let path = directory.join(format!("{stem}.svg"));
        self.write_svg(&path).with_context(|| format!("cannot draw {}", path.display()))
    }

    fn write_csv(&self, path: &Path) -> Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        writeln!(file, "series,{},{}", quoted(&self.x), quoted(&self.y))?;
        for series in &self.series {
            for (x, y) in &series.points {
                writeln!(file, "{},{x},{y}", quoted(&series.name))?;
            }
        }
        Ok(file.flush()?)
    }

    fn write_svg(&self, path: &Path) -> Result<()> {
        let area = SVGBackend::new(path, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let (plot, legend) = area.split_horizontally(LEGEND_X);
        let all =
            || self.series.iter().flat_map(|series| &series.points).filter(|(x, y)| x.is_finite() && y.is_finite());
        let x = padded(all().map(|p| p.0)).ok_or_else(|| anyhow!("there is nothing to draw"))?;
        let y = padded(all().map(|p| p.1)).ok_or_else(|| anyhow!("there is nothing to draw"))?;
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(64)
            .build_cartesian_2d(x, y)?;
        chart.configure_mesh().x_desc(&self.x).y_desc(&self.y).light_line_style(WHITE).draw()?;
        for (index, series) in self.series.iter().enumerate() {
            let color = Palette99::pick(index).to_rgba();
            let points = series.points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite());
            match series.mark {
                Mark::Line => chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?,
                Mark::Dots => chart.draw_series(points.map(|point| Circle::new(point, 3, color.filled())))?,
            };
            let row = 60 + 22 * i32::try_from(index)?;
            match series.mark {
                Mark::Line => legend.draw(&PathElement::new([(0, row), (18, row)], color.stroke_width(3)))?,
                Mark::Dots => legend.draw(&Circle::new((9, row), 4, color.filled()))?,
            }
            legend.draw(&Text::new(series.name.as_str(), (24, row - 7), ("sans-serif", 13)))?;
        }
        area.present()?;
        Ok(())
    }
}

/// The range of some values with room around it; `None` of none.
fn padded(values: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let room = if high > low { 0.04 * (high - low) } else { 0.5 * low.abs().max(1e-9) };
    (low <= high).then_some(low - room..high + room)
}
