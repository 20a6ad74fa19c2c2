//! What was learned, asked about pictures that it was not learned from.

use std::path::Path;

use feeder_vision::{Candidate, ClickDoubt, ClickLabel, FittedClick, PartModel, Selector};
use nalgebra::Point2;

use super::Session;
use super::album::Album;
use crate::pictures::Photo;

/// Pictures are held out in so many groups, one after the other.
const GROUPS: usize = 3;
/// How far a click may miss the middle of what it means, m.
const CLICK_MISS_M: f64 = 0.001_5;

/// Names the clicks that what was learned does not bear out.
pub(crate) fn tell_doubts(album: &Album, fits: &[FittedClick], poses: &[String], table: &Path) {
    let sound = fits.iter().filter(|fit| fit.doubt.is_none()).count();
    eprintln!("learned from {sound} of {} clicks on parts in {} pictures", fits.len(), album.photos.len());
    for fit in fits {
        let Some(doubt) = fit.doubt else { continue };
        let photo = &album.photos[fit.picture];
        let click = album.clicks[fit.picture][fit.click];
        let said = match click.label {
            ClickLabel::Pose(pose) => poses[pose].as_str(),
            ClickLabel::Other => super::labels::OTHER,
            ClickLabel::Foreign => super::labels::FOREIGN,
        };
        let why = match doubt {
            ClickDoubt::NotFound => "nothing there looks like that".to_owned(),
            ClickDoubt::LooksLike { pose } => format!("it looks more like {}", poses[pose]),
            ClickDoubt::FitsBadly { ratio } => format!("it fits {ratio:.1} times worse than others"),
            ClickDoubt::Twice => "another click means the same part".to_owned(),
            ClickDoubt::NotAsDrawn => format!("{said} stays as drawn: most of what is labelled so looks otherwise"),
        };
        let line = album.lines[fit.picture][fit.click];
        let place = photo.own_px(click.pixel);
        eprintln!(
            "left out: {} line {line}, {} at {:.0}, {:.0} px, labelled {said}: {why}",
            table.display(),
            photo.name(),
            place.x,
            place.y
        );
    }
}

/// What became of the labelled things of one kind.
#[derive(Clone, Debug, Default)]
struct Tally {
    shown: usize,
    recognised: usize,
    missed: Vec<String>,
    taken: Vec<String>,
}

/// Teaches from some pictures and asks about the others, in turn, and prints what would be missed and what taken wrongly.
pub(crate) fn hold_out(session: &Session, drawn: &PartModel, album: &Album) -> anyhow::Result<()> {
    let groups = GROUPS.min(album.photos.len());
    if groups < 2 {
        eprintln!("no exam: a picture can be held out only where there are two");
        return Ok(());
    }
    let mut tallies = vec![Tally::default(); session.poses.len() + 2];
    for group in 0..groups {
        let held_out = |index: usize| index % groups == group;
        let lesson = match session.teach(drawn, &album.shown(|index| !held_out(index))) {
            Ok(lesson) => lesson,
            Err(error) => {
                eprintln!("no exam: with every {groups}th picture held out, {error}");
                return Ok(());
            }
        };
        let scenario = session.scenario;
        let config = scenario.selector(&session.part);
        let mut selector = Selector::new(config, &scenario.camera.model, &scenario.tray, &lesson.model)?;
        for index in (0..album.photos.len()).filter(|index| held_out(*index)) {
            let photo = &album.photos[index];
            let candidates = selector.detect(&photo.image, &photo.platen_from_tray)?;
            mark(session, album, index, &selector, &candidates, &mut tallies);
        }
    }
    print(session, &tallies);
    Ok(())
}

/// Compares what is seen in a picture with what was said of it.
fn mark(
    session: &Session,
    album: &Album,
    index: usize,
    selector: &Selector,
    candidates: &[Candidate],
    tallies: &mut [Tally],
) {
    let photo = &album.photos[index];
    let poses = session.poses.len();
    let asked = |pose: usize| album.clicks.iter().flatten().any(|click| click.label == ClickLabel::Pose(pose));
    for click in &album.clicks[index] {
        let seen = tray_point(session, photo, click.pixel).and_then(|place| {
            let distance_m = |candidate: &&Candidate| (candidate.centre() - place).norm();
            let near =
                |candidate: &&Candidate| distance_m(candidate) <= CLICK_MISS_M.max(0.5 * selector.radius_m(candidate));
            candidates.iter().filter(near).min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
        });
        let pose = seen.and_then(|candidate| candidate.pose);
        let place = photo.own_px(click.pixel);
        let at = |what: &str| format!("{} at {:.0}, {:.0} px{what}", photo.name(), place.x, place.y);
        let taken = pose.filter(|_| seen.is_some_and(|candidate| selector.admits(candidate)));
        let tally = match click.label {
            ClickLabel::Pose(pose) => &mut tallies[pose],
            ClickLabel::Other => &mut tallies[poses],
            ClickLabel::Foreign => &mut tallies[poses + 1],
        };
        tally.shown += 1;
        let right = match click.label {
            ClickLabel::Pose(said) => pose == Some(said),
            // Whatever the drawing knows and nobody has named may be the other pose.
            ClickLabel::Other => pose.is_none_or(|pose| !asked(pose)),
            ClickLabel::Foreign => pose.is_none(),
        };
        if right {
            tally.recognised += 1;
        } else if let Some(pose) = taken {
            tally.taken.push(at(&format!(" for {}", session.poses[pose])));
        } else if matches!(click.label, ClickLabel::Pose(_)) {
            tally
                .missed
                .push(at(pose.map_or(String::new(), |pose| format!(", unsure, for {}", session.poses[pose])).as_str()));
        }
    }
}

/// The place on the plateau that a pixel shows, tray frame, m.
fn tray_point(session: &Session, photo: &Photo, pixel: Point2<f64>) -> Option<Point2<f64>> {
    let Session { scenario, .. } = session;
    let on_platen = scenario.camera.model.back_project(pixel, scenario.tray.plateau_height_m())?;
    Some(photo.platen_from_tray.inverse_transform_point(&on_platen))
}

fn print(session: &Session, tallies: &[Tally]) {
    let kinds = session.poses.iter().map(String::as_str).chain([super::labels::OTHER, super::labels::FOREIGN]);
    eprintln!("asked about pictures held out:");
    for (kind, tally) in kinds.zip(tallies).filter(|(_, tally)| tally.shown > 0) {
        let Tally { shown, recognised, missed, taken } = tally;
        eprintln!(
            "  {kind:<12} {shown:>4} shown, {recognised:>4} right, {:>3} missed, {:>3} taken wrongly",
            missed.len(),
            taken.len()
        );
    }
    for (kind, tally) in session.poses.iter().zip(tallies) {
        tally.missed.iter().for_each(|what| eprintln!("  missed: {kind}, {what}"));
    }
    let kinds = session.poses.iter().map(String::as_str).chain([super::labels::OTHER, super::labels::FOREIGN]);
    for (kind, tally) in kinds.zip(tallies) {
        tally.taken.iter().for_each(|what| eprintln!("  taken wrongly: {kind}, {what}"));
    }
}
