//! Teaches by clicks: somebody points at parts in a few pictures and says in what pose they lie; place and yaw are fitted.
//!
//! A model rendered from the part's drawing, whatever its light, finds each part near its click. The templates are learned
//! anew from the parts found, in turns with the fits; a click that what was learned does not bear out is named.

use image::GrayImage;
use nalgebra::{Isometry2, Point2};

use super::super::align::Fit;
use super::super::detector::{Detector, belief_of_light};
use super::super::modes::{Belief, Light};
use super::super::template::PartModel;
use super::super::view::View;
use super::exam::Exam;
use super::{Known, LaidPart, PoseSpec, TeachError, TeachFrame, TeachSpec, learn};
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::range::OutOfRange;

/// How far a click may miss the middle of a part, m.
const CLICK_MISS_M: f64 = 0.001_5;
/// Turns of fitting and learning.
const ROUNDS: usize = 2;
/// A part that fits worse than the usual one of its pose by this factor is not what was said.
const MISFIT_RATIO: f32 = 3.0;
/// Mean square miss from which a part does not look as drawn, and share of a pose's clicks that must: how the others lie would be
/// learned from a few that fit by chance. In 26 sound path-traced lessons of seven parts 14 of 17 clicks of a pose and more look as drawn,
/// of gleaming nuts on edge 0 of 25. Both are set by hand.
const DRAWN_MISS_MAX: f32 = 1.25;
const AS_DRAWN_RATIO_MIN: f64 = 0.5;

/// What somebody says of a thing in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClickLabel {
    /// A part in this resting pose.
    Pose(usize),
    /// A part in some pose that is not asked for.
    Other,
    /// No part: it must not be taken for one.
    Foreign,
}

impl ClickLabel {
    /// The pose it names, if it names one.
    fn pose(self) -> Option<usize> {
        match self {
            Self::Pose(pose) => Some(pose),
            Self::Other | Self::Foreign => None,
        }
    }
}

/// A thing pointed at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Click {
    /// About its middle, px, the middle of the first pixel being 0: at most 1.5 mm beside it.
    pub pixel: Point2<f64>,
    /// What it is.
    pub label: ClickLabel,
}

/// A picture and what somebody pointed at in it. What nobody pointed at counts as unknown.
#[derive(Clone, Copy, Debug)]
pub struct ClickedPicture<'a> {
    /// The picture.
    pub image: &'a GrayImage,
    /// Pose of the tray when it was taken.
    pub platen_from_tray: Isometry2<f64>,
    /// The things pointed at.
    pub clicks: &'a [Click],
}

/// What speaks against a click.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClickDoubt {
    /// Nothing there looks like the part in the pose said.
    NotFound,
    /// It looks more like another pose.
    LooksLike {
        /// Which.
        pose: usize,
    },
    /// It fits much worse than others of the pose do: by this factor.
    FitsBadly {
        /// Mean square miss over the usual one.
        ratio: f32,
    },
    /// Another click means the same part.
    Twice,
    /// Most clicks on parts in its pose show something else than the drawing does in any light, as where the part gleams: how
    /// they are turned is not known, and the pose stays as drawn.
    NotAsDrawn,
}

/// A click on a part, with the part found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedClick {
    /// Index of the picture, and of the click in it.
    pub picture: usize,
    /// As for the picture.
    pub click: usize,
    /// The part, if one was found.
    pub part: Option<LaidPart>,
    /// Mean square miss of its picture, in standard deviations.
    pub miss: f32,
    /// What speaks against it; such a part is not learned from.
    pub doubt: Option<ClickDoubt>,
}

/// What was learned from clicks.
#[derive(Clone, Debug)]
pub struct ClickLesson {
    /// The part.
    pub model: PartModel,
    /// The clicks on parts, in the order of pictures and clicks.
    pub fits: Vec<FittedClick>,
}

/// Finds the parts that clicks point at, with a model of the part in any light.
///
/// # Errors
///
/// [`TeachError`] if a click names a pose that the model does not know, or a picture cannot be used.
pub fn fit_clicks(
    pictures: &[ClickedPicture],
    model: &PartModel,
    camera: &CameraModel,
    tray: &MountedTray,
    contrast_min_levels: f64,
) -> Result<Vec<FittedClick>, TeachError> {
    for pose in pictures.iter().flat_map(|picture| picture.clicks).filter_map(|at| at.label.pose()) {
        let known = pose < model.poses.len();
        OutOfRange::unless(known, "teach.clicks.pose", pose as f64, "an index of the poses taught")?;
    }
    let mut detector = Detector::new(camera, tray, model, Light::Any);
    let look = |detector: &mut Detector, index: usize| -> Result<_, TeachError> {
        let ClickedPicture { image, platen_from_tray, .. } = pictures[index];
        let fault = |source| TeachError::Frame { index, source };
        detector.look(image, &platen_from_tray, contrast_min_levels).map_err(fault)?;
        let view = View { camera, tray, platen_from_tray };
        Ok((view, detector.open_belief(&view)))
    };
    // One light falls on all that is shown: each part alone may be taken for one in another light that lies elsewhere.
    let mut alone = Vec::new();
    for (picture, shown) in pictures.iter().enumerate() {
        let (view, open) = look(&mut detector, picture)?;
        let near = |at: &Click| detector.near(&view, at.label.pose()?, (at.pixel, CLICK_MISS_M), &open);
        alone.extend(shown.clicks.iter().filter_map(near));
    }
    let mut fits = Vec::new();
    for (picture, shown) in pictures.iter().enumerate() {
        let (view, open) = look(&mut detector, picture)?;
        let belief = belief_of_light(&alone, &open).unwrap_or(open);
        let first = fits.len();
        for (click, at) in shown.clicks.iter().enumerate() {
            let Some(pose) = at.label.pose() else { continue };
            let mut fitted = fit(&detector, &view, pose, at.pixel, &belief);
            let same = |other: &FittedClick| match (other.part, fitted.part) {
                (Some(a), Some(b)) => (a.place - b.place).norm() < 0.5 * detector.sought[pose].radius_m,
                _ => false,
            };
            if fits[first..].iter().any(same) {
                fitted.doubt = Some(ClickDoubt::Twice);
            }
            fits.push(FittedClick { picture, click, ..fitted });
        }
    }
    doubt_misfits(&mut fits, model.poses.len());
    Ok(fits)
}

/// The part in a pose near a pixel.
fn fit(detector: &Detector, view: &View, pose: usize, pixel: Point2<f64>, belief: &Belief) -> FittedClick {
    let none = FittedClick { picture: 0, click: 0, part: None, miss: 0.0, doubt: Some(ClickDoubt::NotFound) };
    let near = |pose: usize| detector.near(view, pose, (pixel, CLICK_MISS_M), belief);
    let Some(found) = near(pose) else { return none };
    let Fit { centre, yaw_rad, cost, .. } = found;
    // Another pose must not do better in the same place.
    let better = (0..detector.sought.len())
        .filter(|other| *other != pose)
        .find(|other| near(*other).is_some_and(|other| other.cost < found.cost && other.evidence > found.evidence));
    FittedClick {
        part: Some(LaidPart { pose, place: centre, yaw_rad }),
        miss: cost,
        doubt: better.map(|pose| ClickDoubt::LooksLike { pose }),
        ..none
    }
}

/// Names the parts that fit much worse than the usual one of their pose.
fn doubt_misfits(fits: &mut [FittedClick], poses: usize) {
    for pose in 0..poses {
        let of_pose = |fit: &FittedClick| fit.doubt.is_none() && fit.part.is_some_and(|part| part.pose == pose);
        let mut misses: Vec<f32> = fits.iter().filter(|fit| of_pose(fit)).map(|fit| fit.miss).collect();
        misses.sort_by(f32::total_cmp);
        let Some(usual) = misses.get(misses.len() / 2).copied() else { continue };
        for fit in fits.iter_mut().filter(|fit| of_pose(fit) && fit.miss > MISFIT_RATIO * usual) {
            fit.doubt = Some(ClickDoubt::FitsBadly { ratio: fit.miss / usual });
        }
    }
}

/// In what pose somebody said the part lies.
fn said_pose(pictures: &[ClickedPicture], fit: &FittedClick) -> Option<usize> {
    pictures[fit.picture].clicks[fit.click].label.pose()
}

/// Whether enough of what was said to lie in a pose looks as that is drawn, by fits to the drawing.
fn looks_as_drawn(pictures: &[ClickedPicture], fits: &[FittedClick], pose: usize) -> bool {
    let said: Vec<&FittedClick> = fits.iter().filter(|fit| said_pose(pictures, fit) == Some(pose)).collect();
    let alike = said.iter().filter(|fit| fit.part.is_some() && fit.miss <= DRAWN_MISS_MAX).count();
    alike as f64 >= AS_DRAWN_RATIO_MIN * said.len() as f64
}

/// Learns a part from clicks in pictures, beginning with a model rendered from its drawing for the same camera. `bare` are
/// pictures of the plateau without parts, with the tray's pose; without any the plateau is learned between the parts.
///
/// # Errors
///
/// [`TeachError`] as for [`teach`](super::teach), for a drawn model of another camera, and where no click shows a part as it is drawn.
pub fn teach_from_clicks(
    pictures: &[ClickedPicture],
    bare: &[(&GrayImage, Isometry2<f64>)],
    drawn: &PartModel,
    camera: &CameraModel,
    tray: &MountedTray,
    contrast_min_levels: f64,
) -> Result<ClickLesson, TeachError> {
    drawn.validate()?;
    let pose = |pose: &super::super::template::PoseTemplate| PoseSpec {
        height_m: pose.height_m,
        outline_m: pose.outline_m.clone(),
        yaw_symmetry: pose.yaw_symmetry,
    };
    let spec = TeachSpec { poses: drawn.poses.iter().map(pose).collect(), contrast_min_levels };
    let mut fits = fit_clicks(pictures, drawn, camera, tray, contrast_min_levels)?;
    let as_drawn: Vec<bool> = (0..drawn.poses.len()).map(|pose| looks_as_drawn(pictures, &fits, pose)).collect();
    let mut round = 1;
    loop {
        for fit in &mut fits {
            if said_pose(pictures, fit).is_some_and(|pose| !as_drawn[pose]) {
                fit.doubt = Some(ClickDoubt::NotAsDrawn);
            }
        }
        if fits.iter().all(|fit| fit.doubt.is_some()) {
            return Err(TeachError::NothingAsDrawn { clicks: fits.len() });
        }
        let laid: Vec<Vec<LaidPart>> = (0..pictures.len())
            .map(|picture| {
                let sound = fits.iter().filter(|fit| fit.picture == picture && fit.doubt.is_none());
                sound.filter_map(|fit| fit.part).collect()
            })
            .collect();
        let shown = pictures.iter().zip(&laid).filter(|(_, parts)| !parts.is_empty()).map(|(picture, parts)| {
            TeachFrame { image: picture.image, platen_from_tray: picture.platen_from_tray, parts }
        });
        let bare = bare.iter().map(|(image, platen_from_tray)| TeachFrame {
            image,
            platen_from_tray: *platen_from_tray,
            parts: &[],
        });
        let frames: Vec<TeachFrame> = bare.chain(shown).collect();
        let mut model = learn(&frames, camera, tray, &spec, &Known::Drawn(drawn))?;
        if round > ROUNDS {
            Exam { frames: &frames, camera, tray, spec: &spec }.complete(&mut model)?;
            return Ok(ClickLesson { model, fits });
        }
        Exam { frames: &frames, camera, tray, spec: &spec }.measure_rings(&mut model)?;
        fits = fit_clicks(pictures, &model, camera, tray, contrast_min_levels)?;
        round += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_the_drawing_badly_or_is_not_found_does_not_look_as_drawn() {
        let image = GrayImage::new(1, 1);
        let click = Click { pixel: Point2::origin(), label: ClickLabel::Pose(1) };
        let clicks = [[click; 4].as_slice(), &[Click { label: ClickLabel::Pose(0), ..click }]].concat();
        let shown = [ClickedPicture { image: &image, platen_from_tray: Isometry2::identity(), clicks: &clicks }];
        let part = Some(LaidPart { pose: 1, place: Point2::origin(), yaw_rad: 0.0 });
        let looks = |misses: [Option<f32>; 4]| {
            let fit = |(click, miss): (usize, Option<f32>)| FittedClick {
                picture: 0,
                click,
                part: part.filter(|_| miss.is_some()),
                miss: miss.unwrap_or_default(),
                doubt: None,
            };
            // What lies in another pose does not count.
            let fits: Vec<FittedClick> = misses.into_iter().chain([None]).enumerate().map(fit).collect();
            looks_as_drawn(&shown, &fits, 1)
        };
        assert!(looks([Some(1.2), Some(1.2), Some(1.3), None]));
        assert!(!looks([Some(1.2), Some(1.3), Some(1.3), Some(4.0)]));
        assert!(!looks([Some(1.2), None, None, None]));
    }
}
