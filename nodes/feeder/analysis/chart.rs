//! Charts: the same curves as SVG to look at and as CSV to compute with.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use plotters::prelude::*;

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
        let area = SVGBackend::new(path, (960, 600)).into_drawing_area();
        area.fill(&WHITE)?;
        let all =
            || self.series.iter().flat_map(|series| &series.points).filter(|(x, y)| x.is_finite() && y.is_finite());
        let x_range = padded(all().map(|p| p.0)).ok_or_else(|| anyhow!("there is nothing to draw"))?;
        let y_range = padded(all().map(|p| p.1)).ok_or_else(|| anyhow!("there is nothing to draw"))?;
        let mut chart = ChartBuilder::on(&area)
            .caption(&self.title, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(64)
            .build_cartesian_2d(x_range, y_range)?;
        chart.configure_mesh().x_desc(&self.x).y_desc(&self.y).light_line_style(WHITE).draw()?;
        for (index, series) in self.series.iter().enumerate() {
            let color = Palette99::pick(index).to_rgba();
            let points = series.points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite());
            let drawn = match series.mark {
                Mark::Line => chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?,
                Mark::Dots => chart.draw_series(points.map(|point| Circle::new(point, 3, color.filled())))?,
            };
            drawn
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(3)));
        }
        chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.4)).draw()?;
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
