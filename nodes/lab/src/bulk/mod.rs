//! `feeder-lab bulk`: parts in bulk on a tray that follows its waveform perfectly, without nodes, camera and delivery: how many
//! good parts a minute pass the camera, what becomes of the paper's claims, how fast the simulation runs, and whether small
//! motions part what touches.

mod claims;
mod load;
mod rapier;
mod shake;
mod speed;

use std::path::PathBuf;

use anyhow::Result;
use clap::ValueEnum;
use feeder_model::geometry::{RawMesh, ShapeSpec};
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::part::{PartSpec, PartType};
use feeder_model::range::OutOfRange;
use feeder_model::waveform::Waveform;
use feeder_scenario::{Scenario, WaveformSpec};
use nalgebra::Vector3;

use crate::experiment::feed::optimal_10_hz;

/// Servo period, s.
const SAMPLE_S: f64 = 5e-4;

/// Samples in a block of 10 ms.
const BLOCK_SAMPLES: u32 = 20;

/// What to find out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Question {
    /// Good parts a minute and singulation against the load
    Load,
    /// The paper's claims about parts in bulk, one by one
    Claims,
    /// Simulated seconds per wall second
    Speed,
    /// Whether small motions of the tray part parts that touch, beside feeding on
    Shake,
}

/// Run parts in bulk on the paper's tray without the nodes, and report throughput, claims, speed or what shaking parts
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// What to find out
    question: Question,
    /// Name of a part of the catalogue, or a part file (YAML)
    #[arg(long, default_value = "grommet")]
    part: String,
    /// The part is made this many times as large
    #[arg(long, default_value_t = 1.0)]
    scale: f64,
    /// Shares of the area outside the loading radius that parts cover
    #[arg(long, value_delimiter = ',', default_value = "0.05,0.1,0.2,0.3,0.4,0.5")]
    area_fraction: Vec<f64>,
    /// Numbers of parts (speed only)
    #[arg(long, value_delimiter = ',', default_value = "10,100,1000")]
    count: Vec<usize>,
    /// Clusters of each size, and states at most in which nothing can be picked (shake only)
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=1000))]
    tries: u32,
    /// Also run the same parts in the rigid-body engine rapier3d (speed only)
    #[arg(long)]
    rapier: bool,
    /// Simulated time of each run after it has settled, s [default: 600; speed: 10; rapier3d runs a hundredth of it]
    #[arg(long)]
    duration: Option<f64>,
    /// Seed of loading and landing
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for charts and tables (SVG and CSV); made if need be
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let duration_s = args.duration.unwrap_or(if args.question == Question::Speed { 10.0 } else { 600.0 });
    let duration_ok = duration_s > 0.0 && duration_s <= 86_400.0;
    OutOfRange::unless(duration_ok, "--duration", duration_s, "above 0, up to 86400 s")?;
    OutOfRange::unless(args.scale > 0.0 && args.scale <= 10.0, "--scale", args.scale, "above 0, up to 10")?;
    for &share in &args.area_fraction {
        OutOfRange::unless(share > 0.0 && share <= 0.9, "--area-fraction", share, "above 0, up to 0.9")?;
    }
    let part = PartType::new(&scaled(feeder::part::load(&args.part)?, args.scale)?)?;
    match args.question {
        Question::Load => load::run(args, &part, duration_s),
        Question::Claims => claims::run(args, &part, duration_s),
        Question::Speed => speed::run(args, &part, duration_s),
        Question::Shake => shake::run(args, &part, duration_s),
    }
}

/// A part of the same shape, larger or smaller.
fn scaled(spec: PartSpec, scale: f64) -> Result<PartSpec> {
    if (scale - 1.0).abs() < 1e-12 {
        return Ok(spec);
    }
    let mesh = spec.shape.mesh(spec.reflectance)?;
    let vertices_m = mesh.vertices().iter().map(|vertex| (vertex * scale).coords.into()).collect();
    let shape = ShapeSpec::Mesh(RawMesh { vertices_m, triangles: mesh.triangles().to_vec() });
    // What tells poses apart by their looks is lost with the solids, and with it their names.
    let wanted_poses = vec!["pose_1".to_owned()];
    Ok(PartSpec { shape, poses: Vec::new(), wanted_poses, drops: None, ..spec })
}

/// The waveforms compared: the paper's of Fig. 15, that of the scenarios designed for good parts a minute, and the one that is
/// optimal at 10 Hz on the ramp near the outer wall, for a friction a little less than the part's.
fn waveforms(part: &PartType) -> [(&'static str, WaveformSpec); 3] {
    let paper_m = 0.2 * feeder_model::gravity::STANDARD_GRAVITY_M_S2;
    [
        (
            "paper's, 30 Hz",
            WaveformSpec::StickSlip {
                period_s: Some(1.0 / 30.0),
                a_min_rad_s2: Some(9.0 * paper_m),
                a_max_rad_s2: 66.7 * paper_m,
            },
        ),
        (
            "stick-slip, 5.9 Hz",
            WaveformSpec::StickSlip { period_s: Some(0.17), a_min_rad_s2: Some(15.0), a_max_rad_s2: 300.0 },
        ),
        ("optimal, 10 Hz", optimal_10_hz(Some(0.9 * part.friction.kinetic_coefficient()))),
    ]
}

/// The built-in scenario with another part and waveform, for its tray and what follows from all three.
fn scenario(part: &PartType, waveform: &WaveformSpec) -> Result<(Scenario, Waveform, feeder_sim::parts::BulkSettings)> {
    let scenario = Scenario { waveform: waveform.clone(), ..Scenario::default() };
    let settings = scenario.bulk_settings(part)?;
    let waveform = scenario.waveform()?;
    Ok((scenario, waveform, settings))
}

/// A tray that follows its waveform perfectly, block by block: each sample has the mean acceleration of the waveform.
struct Shaking {
    waveform: Waveform,
    sample: u64,
}

impl Shaking {
    fn new(waveform: Waveform) -> Self {
        Self { waveform, sample: 0 }
    }

    fn next_block(&mut self) -> MotionBlock {
        let samples = (0..u64::from(BLOCK_SAMPLES)).map(|index| {
            let time_s = ((self.sample + index) as f64 * SAMPLE_S) % self.waveform.period_s();
            let state = self.waveform.state_at(time_s);
            MotionSample {
                position: Vector3::new(0.0, 0.0, state.position),
                velocity: Vector3::new(0.0, 0.0, state.velocity),
                acceleration: Vector3::new(0.0, 0.0, self.waveform.mean_acceleration(time_s, SAMPLE_S)),
            }
        });
        let samples = samples.collect();
        self.sample += u64::from(BLOCK_SAMPLES);
        MotionBlock { sample_period_s: SAMPLE_S, samples }
    }
}

/// Length of a block, s.
fn block_s() -> f64 {
    f64::from(BLOCK_SAMPLES) * SAMPLE_S
}
