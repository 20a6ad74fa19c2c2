//! `feeder teach`: shows the selector pictures of a part in each of its stable poses, and prints what it learned.
//!
//! The pictures come from the scenario's camera with its noise, as a teaching session on the device would give them.

use std::path::PathBuf;

use anyhow::Context as _;
use feeder_model::seed::generator;
use feeder_scenario::PartSource;
use feeder_scenario::Scenario;
use feeder_vision::PartModel;
use nalgebra::Isometry2;

use crate::lesson;

/// Teach the selector a part and print the model (YAML)
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct TeachArgs {
    /// Name of a part of the catalogue; without it the scenario's part is taught
    part: Option<String>,
    /// Scenario file (YAML) that states camera, light and tray; without it the built-in scenario's are taken
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
}

/// Prints the model, as a scenario names it with `part_model`.
pub(crate) fn run(args: &TeachArgs) -> anyhow::Result<()> {
    let mut scenario = feeder_scenario::plan::load_untaught(args.scenario.as_deref())?;
    if let Some(part) = &args.part {
        scenario.part = PartSource::Name(part.clone());
    }
    let model = taught(&scenario)?;
    print!("{}", serde_saphyr::to_string(&model)?);
    Ok(())
}

/// What the selector learns of the scenario's part.
pub(crate) fn taught(scenario: &Scenario) -> anyhow::Result<PartModel> {
    let part = scenario.part_type()?;
    let mut random = generator(scenario.seed, "teach");
    let place = scenario.delivery.feeding_place;
    let platen_from_tray = Isometry2::new(place.xy(), place.z);
    let contrast = scenario.selector.contrast_min_levels;
    lesson::taught(&scenario.scene(&part), &part.poses, &platen_from_tray, contrast, &mut random)
        .with_context(|| format!("cannot teach {}", part.name))
}
