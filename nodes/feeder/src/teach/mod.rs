//! `feeder teach`: shows the selector pictures of a part in each of its stable poses, and prints what it learned.
//!
//! Without pictures, these come from the scenario's camera with its noise, as a teaching session on the device would give
//! them: the drawing alone teaches. Pictures of the true camera, in which somebody has sorted what lies there, refine that.

mod album;
mod exam;
mod labels;
mod proposals;
mod sheet;
mod source;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use feeder_model::part::PartType;
use feeder_model::seed::generator;
use feeder_scenario::PartSource;
use feeder_scenario::Scenario;
use feeder_scenario::plan::load_untaught;
use feeder_vision::{ClickLesson, ClickedPicture, PartModel, TeachError, teach_from_clicks};
use nalgebra::Isometry2;

use crate::{lesson, pictures};
use album::Album;
pub use labels::fuzz as fuzz_labels;
use source::Source;

/// Teach the selector a part and print the model (YAML)
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct TeachArgs {
    /// Name of a part of the catalogue; without it the scenario's part is taught
    part: Option<String>,
    /// Scenario file (YAML) that states camera, light and tray; without it the built-in scenario's are taken
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Pictures of parts on the plateau, to teach from beside the part's drawing: a folder of JPEG or PNG, or a bag that holds
    /// compressed images and odometry
    #[arg(long, value_name = "DIR|BAG")]
    pictures: Option<PathBuf>,
    /// What lies in the pictures: a table (CSV) with the columns picture,x_px,y_px,label, a label being a pose's name, other
    /// for the part in another pose, or foreign for what is no such part
    #[arg(long, value_name = "FILE", requires = "pictures")]
    labels: Option<PathBuf>,
    /// Write to this folder what the pictures show, to be sorted: sheets of numbered cut-outs, and a table of labels
    #[arg(long, value_name = "DIR", requires = "pictures", conflicts_with = "labels")]
    propose: Option<PathBuf>,
    /// Where the tray stood on the platen, in m, m and rad; without it at the scenario's feeding place
    #[arg(long, value_name = "X,Y,YAW", value_parser = pictures::parse_tray, allow_hyphen_values = true, requires = "pictures")]
    tray: Option<Isometry2<f64>>,
    /// Teach without holding pictures out for an exam, which takes three times as long
    #[arg(long, requires = "labels")]
    no_exam: bool,
}

/// Prints the model, as a scenario names it with `part_model`, and beside it how well it does.
pub(crate) fn run(args: &TeachArgs) -> anyhow::Result<()> {
    let mut scenario = load_untaught(args.scenario.as_deref())?;
    if let Some(part) = &args.part {
        scenario.part = PartSource::Name(part.clone());
    }
    let session = Session::new(&scenario, args.tray)?;
    let model = match (&args.pictures, &args.labels, &args.propose) {
        (None, ..) => session.drawn()?,
        (Some(pictures), Some(table), _) => session.learn(pictures, table, !args.no_exam)?,
        (Some(pictures), None, Some(out)) => return proposals::write(&session, pictures, out),
        (Some(_), None, None) => {
            bail!(
                "--pictures teaches nothing alone: --propose DIR writes a table of what they show, --labels FILE reads it"
            )
        }
    };
    print!("{}", serde_saphyr::to_string(&model)?);
    Ok(())
}

/// What is known before pictures are looked at.
struct Session<'a> {
    scenario: &'a Scenario,
    part: PartType,
    poses: Vec<String>,
    platen_from_tray: Isometry2<f64>,
}

impl<'a> Session<'a> {
    fn new(scenario: &'a Scenario, tray: Option<Isometry2<f64>>) -> anyhow::Result<Self> {
        let part = scenario.part_type()?;
        let platen_from_tray = pictures::tray_or_feeding_place(tray, scenario);
        let poses = part.poses.iter().map(|pose| pose.name.clone()).collect();
        Ok(Self { scenario, poses, platen_from_tray, part })
    }

    /// What the drawing of the part teaches the selector.
    fn drawn(&self) -> anyhow::Result<PartModel> {
        let Self { scenario, part, .. } = self;
        let mut random = generator(scenario.seed, "teach");
        let place = scenario.delivery.feeding_place;
        let platen_from_tray = Isometry2::new(place.xy(), place.z);
        let contrast = scenario.selector.contrast_min_levels;
        lesson::taught(&scenario.scene(part), &part.poses, &platen_from_tray, contrast, &mut random)
            .with_context(|| format!("cannot teach {}", part.name))
    }

    /// Learns from pictures, and says what becomes of pictures that were held out.
    fn learn(&self, pictures: &Path, table: &Path, examine: bool) -> anyhow::Result<PartModel> {
        let source = Source::open(pictures, self.scenario, self.platen_from_tray)?;
        let album = Album::open(&source, table, &self.poses)?;
        let drawn = self.drawn()?;
        let lesson = self.teach(&drawn, &album.shown(|_| true)).map_err(|error| self.named(error, &album))?;
        exam::tell_doubts(&album, &lesson.fits, &self.poses, table);
        if examine {
            exam::hold_out(self, &drawn, &album)?;
        }
        Ok(lesson.model)
    }

    fn teach(&self, drawn: &PartModel, pictures: &[ClickedPicture]) -> Result<ClickLesson, TeachError> {
        let Scenario { camera, tray, selector, .. } = self.scenario;
        teach_from_clicks(pictures, &[], drawn, &camera.model, tray, selector.contrast_min_levels)
    }

    /// The error, with the file and the pose that it means.
    fn named(&self, error: TeachError, album: &Album) -> anyhow::Error {
        let what = match &error {
            TeachError::Frame { index, .. } | TeachError::HubOutOfView { index } => {
                album.photos.get(*index).map(|photo| photo.file.display().to_string())
            }
            TeachError::TooFew { pose, .. } | TeachError::NotRecognised { pose, .. } => self.poses.get(*pose).cloned(),
            _ => None,
        };
        let error = anyhow::Error::new(error);
        what.map_or_else(|| anyhow::anyhow!("{error:#}"), |what| anyhow::anyhow!("{what}: {error:#}"))
    }
}
