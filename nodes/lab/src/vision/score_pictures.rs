//! `feeder-lab score-pictures`: the selector against pictures of parts whose places somebody knows.
//!
//! The folder holds pictures and `truth.json`, a list of objects, one for each picture:
//!
//! - `picture`: file, relative to the folder; `part`: a part of the catalogue, or null for the bare plateau; `light`:
//!   name of the circumstances; `layout`: kind of picture, of which some are to learn from. Those not learned from are scored.
//! - `parts`: for each part `pose` (index in the part file's order), `x_m`, `y_m`, `yaw_rad` in the tray frame, `gap_m` to the
//!   nearest thing, and `isolated`: lies as wanted, has room for the gripper, and lies wholly on the plateau.
//! - `foreign`: whatever else lies there, with `x_m` and `y_m`.
//!
//! The selector is taught from rendered pictures alone, or further from a few of the folder's taken under one light, by
//! clicks. What may be picked and is not a part in the pose said, where and as it is said to lie, with room for the gripper, is
//! wrong.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use feeder_model::camera::CameraModel;
use feeder_model::part::PartType;
use feeder_model::seed::generator;
use feeder_scenario::{PartSource, Scenario};
use feeder_vision::{
    Candidate, Click, ClickLabel, ClickedPicture, FittedClick, PartModel, Selector, SelectorConfig, decode,
    teach_from_clicks,
};
use image::GrayImage;
use nalgebra::{Isometry2, Point2, Point3, Vector2};
use rand::{Rng, RngExt};
use serde::Deserialize;

use super::score::Score;
use feeder::lesson;

/// A candidate nearer than this to a part, relative to the part's radius, means that part.
const SAME_RATIO: f64 = 0.5;
/// A quarter of a millimetre decides nothing: room for the gripper is too little by this much or it is not wrong, m.
const TOLERANCE_M: f64 = 0.000_25;
/// What is selected further than this from where the part lies, or turned by more than that, is wrong.
const OFF_MAX_M: f64 = 0.000_5;
const OFF_MAX_RAD: f64 = 0.17;
/// Name of teaching from rendered pictures alone.
const RENDERED: &str = "rendered";

/// Score the selector against pictures with a truth.json
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Folder of pictures with their truth.json
    folder: PathBuf,
    /// Parts to score; all that the folder has if none is named
    parts: Vec<String>,
    /// Scenario file (YAML) that states camera and tray; without it the built-in scenario's are taken
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Light whose pictures teach what rendering has not, as often as there are lights to compare; `rendered` stands for
    /// rendered pictures alone, and is what is scored without this
    #[arg(long = "light", value_name = "LIGHT")]
    lights: Vec<String>,
    /// Layout of the pictures that teach
    #[arg(long, default_value = "teach")]
    layout: String,
    /// Pictures taken to teach at most
    #[arg(long, default_value_t = 6)]
    pictures: usize,
    /// How far a click may miss the middle of a part, m
    #[arg(long, default_value_t = 0.001)]
    click_error_m: f64,
    /// Do not show look-alikes when teaching; whatever is foreign in the teaching pictures is clicked otherwise
    #[arg(long)]
    no_negatives: bool,
    /// Print a line for each part missed and each thing taken wrongly
    #[arg(long)]
    verbose: bool,
    /// Seed of rendered pictures and of clicks
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// What is known of a picture.
#[derive(Debug, Clone, Deserialize)]
struct Truth {
    picture: PathBuf,
    part: Option<String>,
    light: String,
    layout: String,
    parts: Vec<TruePart>,
    #[serde(default)]
    foreign: Vec<ForeignThing>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct TruePart {
    pose: usize,
    x_m: f64,
    y_m: f64,
    yaw_rad: f64,
    isolated: bool,
    gap_m: f64,
}

impl TruePart {
    fn place(&self) -> Point2<f64> {
        Point2::new(self.x_m, self.y_m)
    }
}

#[derive(Debug, Clone, Deserialize)]
struct ForeignThing {
    #[serde(default)]
    kind: String,
    x_m: f64,
    y_m: f64,
}

/// Prints a table: a line for each part and circumstance.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let file = args.folder.join("truth.json");
    let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
    let truths: Vec<Truth> =
        serde_json::from_str(&text).with_context(|| format!("{} is not as described in --help", file.display()))?;
    let known: BTreeSet<String> = truths.iter().filter_map(|truth| truth.part.clone()).collect();
    let parts = if args.parts.is_empty() { known.into_iter().collect() } else { args.parts.clone() };
    println!("{HEADER}");
    for part in &parts {
        score(part, &truths, args).with_context(|| format!("part {part}"))?;
    }
    Ok(())
}

const HEADER: &str =
    "part      taught     light layout  frames isolated recall% selected wrong found% p95 mm p95 deg select ms";

fn score(name: &str, truths: &[Truth], args: &Args) -> anyhow::Result<()> {
    let mut scenario = feeder_scenario::plan::load_untaught(args.scenario.as_deref())?;
    scenario.part = PartSource::Name(name.to_owned());
    let part = scenario.part_type()?;
    let place = scenario.delivery.feeding_place;
    let platen_from_tray = Isometry2::new(place.xy(), place.z);
    let random = |of: &str| generator(args.seed, &format!("score pictures {} {of}", part.name));
    let contrast = scenario.selector.contrast_min_levels;
    let drawn =
        lesson::taught(&scenario.scene(&part), &part.poses, &platen_from_tray, contrast, &mut random(RENDERED))?;
    let rendered = [RENDERED.to_owned()];
    let lights = if args.lights.is_empty() { &rendered[..] } else { &args.lights[..] };
    let trial = Trial { scenario: &scenario, part: &part, platen_from_tray, drawn: &drawn, args };
    let of_part: Vec<&Truth> = truths.iter().filter(|truth| truth.part.as_deref() == Some(name)).collect();
    for light in lights {
        trial.run(light, &of_part, &mut random(light)).with_context(|| format!("taught under {light}"))?;
    }
    Ok(())
}

/// A part whose selector is put to the test.
struct Trial<'a> {
    scenario: &'a Scenario,
    part: &'a PartType,
    platen_from_tray: Isometry2<f64>,
    drawn: &'a PartModel,
    args: &'a Args,
}

impl Trial<'_> {
    /// Teaches under a light, and looks at all pictures that were not learned from.
    fn run(&self, light: &str, truths: &[&Truth], random: &mut impl Rng) -> anyhow::Result<()> {
        let Self { scenario, part, args, .. } = self;
        let to_learn = |truth: &&Truth| truth.layout == args.layout && truth.light == light;
        let lessons: Vec<&Truth> = truths.iter().copied().filter(to_learn).take(args.pictures).collect();
        let model = if light == RENDERED { self.drawn.clone() } else { self.taught(&lessons, random)? };
        let scene = scenario.scene(part);
        let config = scenario.selector(part);
        let mut selector = Selector::new(config.clone(), &scene.camera, &scene.tray, &model)?;
        let mut kinds: BTreeMap<(&str, &str), Score> = BTreeMap::new();
        for truth in truths.iter().filter(|truth| lessons.iter().all(|lesson| lesson.picture != truth.picture)) {
            let image = read(&args.folder.join(&truth.picture))?;
            let begin = super::score::cpu_time();
            let candidates = selector.detect(&image, &self.platen_from_tray)?;
            let score = kinds.entry((truth.light.as_str(), truth.layout.as_str())).or_default();
            score.select += super::score::cpu_time() - begin;
            judge(truth, part, &selector, &config, &candidates, score, args.verbose);
        }
        let mut total = Score::default();
        for ((seen, layout), score) in &kinds {
            println!("{}", line(&part.name, light, seen, layout, score));
            total.add(score);
        }
        println!("{}", line(&part.name, light, "all", "", &total));
        Ok(())
    }

    /// What the selector learns from pictures.
    fn taught(&self, lessons: &[&Truth], random: &mut impl Rng) -> anyhow::Result<PartModel> {
        let Self { scenario, part, platen_from_tray, args, .. } = self;
        anyhow::ensure!(!lessons.is_empty(), "no picture of layout {} to teach from", args.layout);
        let scene = scenario.scene(part);
        let images: Vec<GrayImage> =
            lessons.iter().map(|truth| read(&args.folder.join(&truth.picture))).collect::<anyhow::Result<_>>()?;
        let clicks: Vec<Vec<Click>> = lessons.iter().map(|truth| self.clicks(truth, &scene.camera, random)).collect();
        let pictures: Vec<ClickedPicture<'_>> = images
            .iter()
            .zip(&clicks)
            .map(|(image, clicks)| ClickedPicture { image, platen_from_tray: *platen_from_tray, clicks })
            .collect();
        let contrast = scenario.selector.contrast_min_levels;
        let lesson = teach_from_clicks(&pictures, &[], self.drawn, &scene.camera, &scene.tray, contrast)?;
        if args.verbose {
            tell_fits(&lesson.fits, lessons, part);
        }
        Ok(lesson.model)
    }

    /// Clicks on what a picture shows.
    fn clicks(&self, truth: &Truth, camera: &CameraModel, random: &mut impl Rng) -> Vec<Click> {
        let height_m = self.scenario.tray.plateau_height_m();
        let parts = truth.parts.iter().map(|part| (part.place(), ClickLabel::Pose(part.pose)));
        let foreign = truth.foreign.iter().filter(|_| !self.args.no_negatives);
        let foreign = foreign.map(|thing| (Point2::new(thing.x_m, thing.y_m), ClickLabel::Foreign));
        parts
            .chain(foreign)
            .filter_map(|(place, label)| {
                let on_platen = self.platen_from_tray * (place + miss(self.args.click_error_m, random));
                let pixel = camera.project(Point3::new(on_platen.x, on_platen.y, height_m))?;
                Some(Click { pixel, label })
            })
            .collect()
    }
}

/// Says how well the fitted clicks are, against the truth.
fn tell_fits(fits: &[FittedClick], lessons: &[&Truth], part: &PartType) {
    for (pose, stable) in part.poses.iter().enumerate() {
        let (mut errors_m, mut errors_rad, mut doubted) = (Vec::new(), Vec::new(), 0);
        for fit in fits {
            let truth = lessons[fit.picture].parts[fit.click];
            if truth.pose != pose {
                continue;
            }
            match (fit.part, fit.doubt) {
                (Some(found), None) => {
                    errors_m.push((found.place - truth.place()).norm());
                    errors_rad.push(yaw_error_rad(found.yaw_rad, truth.yaw_rad, stable.yaw_symmetry));
                }
                _ => doubted += 1,
            }
        }
        eprintln!(
            "{} {}: {} clicks fitted, p95 {:.3} mm {:.2} deg; {doubted} doubted",
            part.name,
            stable.name,
            errors_m.len(),
            1e3 * Score::p95(&errors_m),
            Score::p95(&errors_rad).to_degrees()
        );
    }
}

/// Smallest difference of two yaws of a part of this symmetry, rad; 0 if any turn leaves it as it was.
fn yaw_error_rad(a_rad: f64, b_rad: f64, symmetry: u32) -> f64 {
    if symmetry == 0 {
        return 0.0;
    }
    let period_rad = std::f64::consts::TAU / f64::from(symmetry);
    let turns = (a_rad - b_rad) / period_rad;
    (turns - turns.round()).abs() * period_rad
}

/// Adds what the selector made of a picture to a score.
fn judge(
    truth: &Truth,
    part: &PartType,
    selector: &Selector,
    config: &SelectorConfig,
    candidates: &[Candidate],
    score: &mut Score,
    verbose: bool,
) {
    score.frames += 1;
    let may_be_picked = |candidate: &Candidate| candidate.pose.is_some() && selector.admits(candidate);
    let selected =
        |candidate: &Candidate| candidate.pose.is_some_and(|pose| selector.is_wanted(pose)) && may_be_picked(candidate);
    let reach_m = |pose: usize| SAME_RATIO * part.poses[pose].outline.radius_m;
    let name = truth.picture.display();
    for candidate in candidates.iter().filter(|candidate| may_be_picked(candidate)) {
        score.selected += u32::from(selected(candidate));
        match what_is_wrong(truth, part, config, candidate) {
            Ok(right) if selected(candidate) => {
                score.position_errors_m.push((right.place() - candidate.centre()).norm());
                let symmetry = part.poses[right.pose].yaw_symmetry;
                let error_rad = |yaw_rad| yaw_error_rad(yaw_rad, right.yaw_rad, symmetry);
                score.yaw_errors_rad.extend(candidate.yaw_rad.map(error_rad));
            }
            Ok(_) => {}
            Err(what) => {
                score.wrong += 1;
                if verbose {
                    let (x_mm, y_mm) = (1e3 * candidate.x_m, 1e3 * candidate.y_m);
                    eprintln!("{name}: wrong, {what} at {x_mm:.1}, {y_mm:.1} mm: {candidate:?}");
                }
            }
        }
    }
    for truth in &truth.parts {
        score.parts += 1;
        let distance_m = |candidate: &&Candidate| (truth.place() - candidate.centre()).norm();
        let near = candidates.iter().filter(|candidate| distance_m(candidate) < reach_m(truth.pose));
        let seen = near.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        score.found += u32::from(seen.is_some());
        if truth.isolated {
            score.isolated += 1;
            let right = seen.is_some_and(|seen| selected(seen) && seen.pose == Some(truth.pose));
            score.isolated_selected += u32::from(right);
            if verbose && !right {
                let (x_mm, y_mm) = (1e3 * truth.x_m, 1e3 * truth.y_m);
                eprintln!("{name}: missed at {x_mm:.1}, {y_mm:.1} mm: {seen:?}");
            }
        }
    }
}

/// The part that a candidate which may be picked means, or why it must not be.
fn what_is_wrong<'a>(
    truth: &'a Truth,
    part: &PartType,
    config: &SelectorConfig,
    candidate: &Candidate,
) -> Result<&'a TruePart, String> {
    let distance_m = |part: &TruePart| (part.place() - candidate.centre()).norm();
    let nearest = truth.parts.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
    let Some(right) = nearest.filter(|right| distance_m(right) < part.poses[right.pose].outline.radius_m) else {
        let near = |thing: &&ForeignThing| {
            (Point2::new(thing.x_m, thing.y_m) - candidate.centre()).norm() < part.outline_radius_m()
        };
        return Err(truth.foreign.iter().find(near).map_or("nothing".to_owned(), |thing| thing.kind.clone()));
    };
    let off_m = distance_m(right);
    let symmetry = part.poses[right.pose].yaw_symmetry;
    let off_rad = candidate.yaw_rad.map_or(0.0, |yaw_rad| yaw_error_rad(yaw_rad, right.yaw_rad, symmetry));
    if candidate.pose != Some(right.pose) {
        Err(format!("a part in pose {}", right.pose))
    } else if right.gap_m < config.part_clearance_m - TOLERANCE_M {
        Err(format!("a gap of {:.2} mm", 1e3 * right.gap_m))
    } else if off_m > OFF_MAX_M || off_rad > OFF_MAX_RAD {
        Err(format!("a part {:.2} mm and {:.1} deg beside", 1e3 * off_m, off_rad.to_degrees()))
    } else {
        Ok(right)
    }
}

fn line(name: &str, taught: &str, light: &str, layout: &str, score: &Score) -> String {
    let yaw = if score.yaw_errors_rad.is_empty() {
        "     -".to_owned()
    } else {
        format!("{:6.2}", Score::p95(&score.yaw_errors_rad).to_degrees())
    };
    format!(
        "{name:9} {taught:9} {light:>6} {layout:9} {:6} {:8} {:7.1} {:8} {:5} {:6.1} {:6.3} {yaw} {:9.2}",
        score.frames,
        score.isolated,
        100.0 * score.recall(),
        score.selected,
        score.wrong,
        100.0 * f64::from(score.found) / f64::from(score.parts.max(1)),
        1e3 * Score::p95(&score.position_errors_m),
        1e3 * score.select.as_secs_f64() / f64::from(score.frames.max(1)),
    )
}

/// A miss of so much at most, any way.
fn miss(most_m: f64, random: &mut impl Rng) -> Vector2<f64> {
    let angle_rad = random.random_range(0.0..std::f64::consts::TAU);
    let far_m = most_m * random.random_range(0.0..1.0_f64).sqrt();
    Vector2::new(angle_rad.cos(), angle_rad.sin()) * far_m
}

fn read(file: &Path) -> anyhow::Result<GrayImage> {
    let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    decode(&bytes).with_context(|| format!("{} cannot be decoded", file.display()))
}
