//! `feeder look`: what the selector sees in pictures, a line of JSON for each.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use feeder_scenario::Scenario;
use feeder_scenario::plan::{NodeConfig as _, VisionSelectorConfig, load_with_model};
use feeder_vision::{CalibrationFault, Candidate, Misalignment, Selector, misalignment};
use image::GrayImage;
use nalgebra::Isometry2;
use serde::Serialize;

use crate::pictures::{self, Photo};

/// Say what the selector sees in pictures, a line of JSON for each
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct LookArgs {
    /// Scenario file (YAML) that states part, camera and tray; without it the built-in scenario
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// What the selector was taught, as `feeder teach` prints it, in place of what the scenario names
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Where the tray stood on the platen, in m, m and rad; without it at the scenario's feeding place
    #[arg(long, value_name = "X,Y,YAW", value_parser = pictures::parse_tray, allow_hyphen_values = true)]
    tray: Option<Isometry2<f64>>,
    /// The pictures: JPEG or PNG of the camera's size, or of a whole multiple of it
    #[arg(required = true, value_name = "PICTURE")]
    pictures: Vec<PathBuf>,
}

/// A line of the output.
#[derive(Debug, Serialize)]
struct Line {
    /// Name of the file, as it was given.
    picture: String,
    /// Every part seen, the surest match first.
    candidates: Vec<SeenPart>,
    /// What makes the picture doubtful, in words; nothing of a doubtful picture should be relied on.
    doubts: Vec<String>,
}

/// A part seen.
#[derive(Debug, Serialize)]
struct SeenPart {
    /// Name of its resting pose; nothing if that is not sure.
    pose: Option<String>,
    /// Place in the tray frame, m.
    x_m: f64,
    y_m: f64,
    /// Yaw in the tray frame, rad; nothing if the part looks the same from all sides.
    yaw_rad: Option<f64>,
    /// How sure the pose is, 0 to 1.
    confidence: f64,
    /// Whether this picture, taken for all there is to see, lets it be picked, whatever its pose.
    may_be_picked: bool,
    /// Free gap to the nearest other thing seen, m; where there is none, the width of the plateau.
    free_gap_m: f64,
    /// Free gap to the nearer wall, m.
    wall_gap_m: f64,
}

/// Prints the lines. Pictures that cannot be read have a line too, and make the command fail in the end.
pub(crate) fn run(args: &LookArgs) -> anyhow::Result<()> {
    let scenario = load_with_model(args.scenario.as_deref(), args.model.as_deref())?;
    let tray = pictures::tray_or_feeding_place(args.tray, &scenario);
    let mut eyes = Eyes::open(&scenario)?;
    let mut failed = 0;
    for file in &args.pictures {
        let line = eyes.look(file, &tray).unwrap_or_else(|error| {
            failed += 1;
            Line { picture: file.display().to_string(), candidates: Vec::new(), doubts: vec![format!("{error:#}")] }
        });
        println!("{}", serde_json::to_string(&line)?);
    }
    ensure!(failed == 0, "{failed} of {} pictures cannot be looked at", args.pictures.len());
    Ok(())
}

/// The selector of a scenario, and names for what it sees.
struct Eyes {
    selector: Selector,
    config: VisionSelectorConfig,
}

impl Eyes {
    fn open(scenario: &Scenario) -> anyhow::Result<Self> {
        let plan = scenario.plan()?;
        let config = plan.of_kind::<VisionSelectorConfig>().next();
        let (_, config) = config.with_context(|| format!("the run has no {}", VisionSelectorConfig::KIND))?;
        Ok(Self { selector: config.selector()?, config: config.clone() })
    }

    fn look(&mut self, file: &Path, tray: &Isometry2<f64>) -> anyhow::Result<Line> {
        let Photo { image, .. } = Photo::open(file, &self.config.camera, *tray)?;
        let found = self.selector.detect(&image, tray)?;
        // As in a run, nothing that lies where it cannot be told to lie is to be picked.
        let calibration = self.calibration(&image, tray);
        let candidates = found.iter().map(|candidate| self.seen(candidate, calibration.is_ok())).collect();
        let misplaced = match calibration {
            Ok(warning) => warning.map(|misalignment| misalignment.to_string()),
            Err(fault) => Some(fault.to_string()),
        };
        let causes = self.selector.health().causes().into_iter().map(|cause| cause.to_string());
        let doubts = misplaced.into_iter().chain(causes).collect();
        Ok(Line { picture: file.display().to_string(), candidates, doubts })
    }

    /// How far off the calibration is, if that is worth a warning.
    fn calibration(&self, image: &GrayImage, tray: &Isometry2<f64>) -> Result<Option<Misalignment>, CalibrationFault> {
        let VisionSelectorConfig { camera, tray: mounted, selector, .. } = &self.config;
        let Some(found) = misalignment(image, camera, mounted, tray)? else { return Ok(None) };
        selector.calibration.require(&found)?;
        Ok(Some(found).filter(|found| selector.calibration.warn_of(found)))
    }

    fn seen(&self, candidate: &Candidate, is_calibrated: bool) -> SeenPart {
        let geometry = &self.config.tray.geometry;
        SeenPart {
            pose: candidate.pose.and_then(|pose| self.config.poses.get(pose).cloned()),
            x_m: candidate.x_m,
            y_m: candidate.y_m,
            yaw_rad: candidate.yaw_rad,
            confidence: candidate.confidence,
            may_be_picked: is_calibrated && self.selector.admits(candidate),
            free_gap_m: candidate.part_gap_m.min(geometry.outer_radius_m - geometry.inner_radius_m),
            wall_gap_m: candidate.wall_gap_m,
        }
    }
}
