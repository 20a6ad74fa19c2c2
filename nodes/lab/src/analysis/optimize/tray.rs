//! `feeder-lab optimize tray`.

use std::path::Path;

use crate::design::{DesignedTray, Flow, Loading, PartKind, Period, TrayGoal, flow_in_two_dimensions, lane_flow};
use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::AxisLimits;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::super::chart::{Chart, Series};
use super::super::paper;
use super::{FrictionRange, SearchArgs, create_folder, write_yaml};

/// Steps of the progress bar for each design.
const BAR_STEPS: u64 = 1000;

/// The best tray with its waveform: parts per minute that arrive apart, for several spacings: the Pareto front.
///
/// One lane along the outer wall; parts are points that keep their length apart and do not touch. A part counts only if
/// the smallest spacing on the plateau, over all places of entry, is at least that wanted. Prints YAML; with --out,
/// each tray and waveform is also written to files of their own, and the front as chart and table.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// Length of the parts, m; several, separated by commas, for a family fed by one tray.
    #[arg(long, default_value = "0.005", value_delimiter = ',', allow_negative_numbers = true)]
    part_length: Vec<f64>,
    /// Spacings on the plateau to design for, in part lengths, separated by commas.
    #[arg(long, default_value = "1.5,2,3,3.93,5", value_delimiter = ',', allow_negative_numbers = true)]
    spacing: Vec<f64>,
    #[command(flatten)]
    friction: FrictionRange,
    /// Parts queue up on the ramp without gaps, instead of being let onto it one at a time.
    #[arg(long)]
    queued: bool,
    /// Radius of the outer wall, m.
    #[arg(long, default_value_t = TrayGeometry::PAPER.outer_radius_m, allow_negative_numbers = true)]
    outer_radius: f64,
    /// Smallest radius of the inner wall, m.
    #[arg(long, default_value_t = TrayGeometry::PAPER.inner_radius_m, allow_negative_numbers = true)]
    inner_radius: f64,
    /// Smallest rise, m [default: two part lengths].
    #[arg(long, allow_negative_numbers = true)]
    rise_min: Option<f64>,
    /// Largest angle of the ramp, degrees.
    #[arg(long, default_value_t = 300.0, allow_negative_numbers = true)]
    ramp_max_deg: f64,
    /// Period, s [default: free up to --period-max].
    #[arg(long, allow_negative_numbers = true)]
    period: Option<f64>,
    /// Longest period, s.
    #[arg(long, default_value_t = 0.2, allow_negative_numbers = true)]
    period_max: f64,
    /// Largest angular acceleration, rad/s².
    #[arg(long, default_value_t = 131.0, allow_negative_numbers = true)]
    a_max: f64,
    /// Largest angular speed, rad/s.
    #[arg(long, default_value_t = f64::INFINITY, allow_negative_numbers = true)]
    max_speed: f64,
    /// Largest yaw either way, degrees.
    #[arg(long, default_value_t = 2.0, allow_negative_numbers = true)]
    max_yaw_deg: f64,
    #[command(flatten)]
    search: SearchArgs,
}

#[derive(Debug, Serialize)]
struct TrayReport {
    /// The paper's tray and waveform with the nominal friction, queued.
    paper: Flow,
    nominal: Vec<Point>,
    robust: Vec<Point>,
}

/// One design of the front.
#[derive(Debug, Serialize)]
struct Point {
    spacing_parts: f64,
    parts_per_min: f64,
    times_paper: f64,
    /// The smallest spacing the two-dimensional engine measures for any kind and friction.
    spacing_in_two_dimensions: Option<f64>,
    /// Whether another design passes at least as many parts at a larger spacing.
    dominated: bool,
    design: DesignedTray,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let friction = &args.friction;
    let nominal_goal = args.goal(&[friction.mu]);
    let robust_goal = args.goal(&friction.robust()?);
    for &spacing_parts in &args.spacing {
        TrayGoal { spacing_parts, ..nominal_goal.clone() }.check()?;
    }
    let paper = paper_flow(&nominal_goal, friction.mu)?;
    let bar = ProgressBar::new(2 * BAR_STEPS * u64::try_from(args.spacing.len())?);
    bar.set_style(ProgressStyle::with_template("{msg:>24} [{bar:40}] {percent} % {eta}")?.progress_chars("=> "));
    let report = TrayReport {
        nominal: front(&nominal_goal, "nominal", args, &paper, &bar)?,
        robust: front(&robust_goal, "robust", args, &paper, &bar)?,
        paper,
    };
    bar.finish_and_clear();
    if let Some(folder) = &args.search.out {
        write(folder, &report)?;
    }
    print!("{}", serde_saphyr::to_string(&report)?);
    report.nominal.first().map(|_| ()).context("no tray within these limits feeds")
}

impl Args {
    fn goal(&self, frictions: &[f64]) -> TrayGoal {
        let kinds = self.part_length.iter().map(|&length_m| PartKind { length_m, frictions: frictions.to_vec() });
        let longest_m = self.part_length.iter().copied().fold(f64::NAN, f64::max);
        TrayGoal {
            kinds: kinds.collect(),
            spacing_parts: f64::NAN,
            loading: if self.queued { Loading::Queued } else { Loading::Metered },
            outer_radius_m: self.outer_radius,
            inner_radius_m: self.inner_radius,
            rise_min_m: self.rise_min.unwrap_or(2.0 * longest_m),
            ramp_angle_max_rad: self.ramp_max_deg.to_radians(),
            period: self.period.map_or(Period::UpTo(self.period_max), Period::Fixed),
            limits: AxisLimits {
                max_acceleration: self.a_max,
                max_speed: self.max_speed,
                max_stroke: 2.0 * self.max_yaw_deg.to_radians(),
            },
            gravity_m_s2: self.friction.gravity,
        }
    }
}

/// The paper's tray and waveform with parts of the first kind.
fn paper_flow(goal: &TrayGoal, mu: f64) -> Result<Flow> {
    let kind = goal.kinds.first().context("--part-length needs at least one length")?;
    lane_flow(&paper::tray(mu)?, &paper::fig15_waveform()?, kind.length_m, Loading::Queued, 1.0)?
        .context("parts of this friction and length do not climb the paper's tray")
}

fn front(goal: &TrayGoal, name: &str, args: &Args, paper: &Flow, bar: &ProgressBar) -> Result<Vec<Point>> {
    let mut points: Vec<Point> = Vec::new();
    for &spacing_parts in &args.spacing {
        let goal = TrayGoal { spacing_parts, ..goal.clone() };
        bar.set_message(format!("{name}, spacing {spacing_parts}"));
        let start = bar.position();
        let design = goal.best(args.search.segments, args.search.effort(), |share| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share between 0 and 1")]
            bar.set_position(start + (share * BAR_STEPS as f64) as u64);
        })?;
        bar.set_position(start + BAR_STEPS);
        let Some(design) = design.filter(|design| design.parts_per_min > 0.0) else {
            continue;
        };
        points.push(Point {
            spacing_parts,
            parts_per_min: design.parts_per_min,
            times_paper: design.parts_per_min / paper.parts_per_min,
            spacing_in_two_dimensions: measured_spacing(&goal, &design)?,
            dominated: false,
            design,
        });
    }
    for i in 0..points.len() {
        points[i].dominated = points.iter().any(|other| {
            other.spacing_parts > points[i].spacing_parts && other.parts_per_min >= points[i].parts_per_min
        });
    }
    Ok(points)
}

fn measured_spacing(goal: &TrayGoal, design: &DesignedTray) -> Result<Option<f64>> {
    let mut least = f64::INFINITY;
    for (kind, flows) in goal.kinds.iter().zip(&design.flows) {
        for (&friction, flow) in kind.frictions.iter().zip(flows) {
            let track = AnnularTrack::new(design.tray, Friction::uniform(friction)?, goal.gravity_m_s2)?;
            let measured = flow_in_two_dimensions(&track, &design.waveform, kind.length_m, flow)?;
            let Some(measured) = measured else {
                return Ok(None);
            };
            least = least.min(measured.plateau_spacing_parts);
        }
    }
    Ok(Some(least))
}

fn write(folder: &Path, report: &TrayReport) -> Result<()> {
    create_folder(folder)?;
    let mut series = Vec::new();
    for (name, points) in [("nominal", &report.nominal), ("robust", &report.robust)] {
        for point in points {
            let stem = format!("{name}_spacing_{}", point.spacing_parts);
            write_yaml(&folder.join(format!("tray_{stem}.yaml")), &point.design.tray)?;
            write_yaml(&folder.join(format!("waveform_{stem}.yaml")), &point.design.waveform)?;
        }
        let front = points.iter().filter(|point| !point.dominated);
        series.push(Series::line(name, front.map(|point| (point.spacing_parts, point.parts_per_min)).collect()));
    }
    let paper = (report.paper.plateau_spacing_parts, report.paper.parts_per_min);
    series.push(Series::dots("the paper's tray", vec![paper]));
    let chart = Chart {
        title: "Parts per minute against spacing on the plateau".into(),
        x: "spacing on the plateau, part lengths".into(),
        y: "parts per minute".into(),
        series,
    };
    chart.write(folder, "pareto")?;
    write_yaml(&folder.join("report.yaml"), report)
}
