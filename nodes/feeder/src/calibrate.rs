//! `feeder calibrate`: where the camera hangs, from pictures of the tray.

use std::path::PathBuf;

use feeder_model::camera::CameraModel;
use feeder_scenario::plan::load_untaught;
use feeder_vision::{CalibrationError, Shot, calibrate, misalignment};
use nalgebra::Isometry2;
use serde::Serialize;

use crate::pictures::{self, Photo};

/// Find where the camera hangs from pictures of the tray, and print its section of the scenario (YAML)
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct CalibrateArgs {
    /// Scenario file (YAML) that states tray and camera, the latter to some 5 mm; without it the built-in scenario
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Where the tray stood on the platen, in m, m and rad; without it at the scenario's feeding place
    #[arg(long, value_name = "X,Y,YAW", value_parser = pictures::parse_tray, allow_hyphen_values = true)]
    tray: Option<Isometry2<f64>>,
    /// Keep the scenario's lens coefficient k1 instead of fitting it
    #[arg(long)]
    keep_k1: bool,
    /// The pictures, with parts or without: JPEG or PNG of the camera's size, or of a whole multiple of it
    #[arg(required = true, value_name = "PICTURE")]
    pictures: Vec<PathBuf>,
}

/// The section of a scenario.
#[derive(Serialize)]
struct Section<'a> {
    camera: Camera<'a>,
}

#[derive(Serialize)]
struct Camera<'a> {
    model: &'a CameraModel,
}

/// Prints the section, and how well it fits beside it.
pub(crate) fn run(args: &CalibrateArgs) -> anyhow::Result<()> {
    let scenario = load_untaught(args.scenario.as_deref())?;
    let (camera, tray) = (&scenario.camera.model, &scenario.tray);
    let platen_from_tray = pictures::tray_or_feeding_place(args.tray, &scenario);
    let open = |file| Photo::open(file, camera, platen_from_tray);
    let photos: Vec<Photo> = args.pictures.iter().map(|file| open(file)).collect::<anyhow::Result<_>>()?;
    let shots: Vec<Shot> = photos.iter().map(|photo| Shot { image: &photo.image, platen_from_tray }).collect();
    let found = calibrate(&shots, camera, tray, !args.keep_k1).map_err(|error| {
        let file = match &error {
            CalibrationError::Picture { index, .. } | CalibrationError::NoRim { index, .. } => {
                args.pictures.get(*index)
            }
            _ => None,
        };
        anyhow::Error::new(error).context(file.map_or_else(String::new, |file| file.display().to_string()))
    })?;
    eprintln!("{} places on edges fit to {:.3} px", found.edges, found.miss_px);
    for (name, camera) in [("before", camera), ("after", &found.camera)] {
        for Photo { file, image, .. } in &photos {
            let told = match misalignment(image, camera, tray, &platen_from_tray) {
                Ok(Some(misalignment)) => misalignment.to_string(),
                Ok(None) => "too little of the rim is in the picture to tell".to_owned(),
                Err(error) => error.to_string(),
            };
            eprintln!("{name}, {}: {told}", file.display());
        }
    }
    print!("{}", serde_saphyr::to_string(&Section { camera: Camera { model: &found.camera } })?);
    Ok(())
}
