//! What pictures show, to be sorted by somebody: sheets of numbered cut-outs, and a table with a line for each.

use std::path::Path;

use anyhow::{Context as _, ensure};
use feeder_vision::{Candidate, PICTURES_MIN, Selector, Thing, bare_plateau, things};
use image::GrayImage;

use super::Session;
use super::labels::{self, FOREIGN, OTHER, Row};
use super::sheet::{CutOut, sheets};
use super::source::Source;
use crate::pictures::Photo;

/// The table, and the first of the sheets.
const TABLE: &str = "labels.csv";
/// Cut-outs reach so many times as far as the part.
const REACH_RATIO: f64 = 1.5;

/// A thing in a picture, and what it seems to be.
struct Proposal<'a> {
    photo: &'a Photo,
    thing: Thing,
    pose: Option<usize>,
}

/// Writes sheets and table to `out`. What the drawing alone recognises is labelled already.
pub(crate) fn write(session: &Session, pictures: &Path, out: &Path) -> anyhow::Result<()> {
    let scenario = session.scenario;
    let camera = &scenario.camera.model;
    let source = Source::open(pictures, scenario, session.platen_from_tray)?;
    let photos: Vec<Photo> =
        (0..source.names().len()).map(|index| source.photo(index)).collect::<anyhow::Result<_>>()?;
    let images: Vec<&GrayImage> = photos.iter().map(|photo| &photo.image).collect();
    let bare = bare_plateau(&images).with_context(|| {
        format!(
            "{} pictures; allowed: {PICTURES_MIN} or more, so that what moves can be told from what stays",
            photos.len()
        )
    })?;
    let config = scenario.selector(&session.part);
    let mut selector = Selector::new(config, camera, &scenario.tray, &session.drawn()?)?;
    let mut proposals = Vec::new();
    for photo in &photos {
        let context = || photo.file.display().to_string();
        let seen = selector.detect(&photo.image, &photo.platen_from_tray).with_context(context)?;
        let found = things(&photo.image, &bare, camera, &scenario.tray, &photo.platen_from_tray);
        for thing in found.with_context(context)? {
            proposals.push(Proposal { photo, thing, pose: pose_of(&thing, &seen, &selector) });
        }
    }
    ensure!(!proposals.is_empty(), "nothing lies on the plateau in any of {} pictures", photos.len());
    // What looks alike stands together.
    proposals.sort_by(|a, b| {
        let key = |proposal: &Proposal| (proposal.pose.unwrap_or(usize::MAX), proposal.thing.area_px);
        key(a).cmp(&key(b)).then(a.thing.contrast_levels.total_cmp(&b.thing.contrast_levels))
    });
    std::fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let rows: Vec<Row> =
        (1..).zip(&proposals).map(|(number, proposal)| row(number, proposal, &session.poses)).collect();
    labels::write(&out.join(TABLE), &rows)?;
    let cut_outs: Vec<CutOut> = (1..)
        .zip(&proposals)
        .map(|(number, Proposal { photo, thing, .. })| CutOut { number, image: &photo.image, pixel: thing.pixel })
        .collect();
    let reach_px = REACH_RATIO * session.part.outline_radius_m() / camera.m_per_px(scenario.tray.plateau_height_m());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
    let sheets = sheets(&cut_outs, reach_px.ceil() as u32);
    for (page, sheet) in (1..).zip(&sheets) {
        let file = out.join(format!("sheet_{page}.png"));
        sheet.save(&file).with_context(|| format!("cannot write {}", file.display()))?;
    }
    eprintln!(
        "{} things in {} pictures, on {} sheets in {}. Sort them in {}: {}, {} or {}; a line without a label counts for nothing.",
        proposals.len(),
        photos.len(),
        sheets.len(),
        out.display(),
        out.join(TABLE).display(),
        session.poses.join(", "),
        OTHER,
        FOREIGN
    );
    Ok(())
}

/// The pose in which the drawing recognises a thing.
fn pose_of(thing: &Thing, seen: &[Candidate], selector: &Selector) -> Option<usize> {
    let near =
        seen.iter().find(|candidate| (candidate.centre() - thing.place).norm() <= 0.5 * selector.radius_m(candidate));
    near.and_then(|candidate| candidate.pose)
}

fn row(number: u32, proposal: &Proposal, poses: &[String]) -> Row {
    let Proposal { photo, thing, pose } = proposal;
    let place = photo.own_px(thing.pixel);
    let tenths = |value: f64| (10.0 * value).round() / 10.0;
    Row {
        number: Some(number),
        picture: photo.name(),
        x_px: tenths(place.x),
        y_px: tenths(place.y),
        label: pose.and_then(|pose| poses.get(pose).cloned()).unwrap_or_default(),
    }
}
