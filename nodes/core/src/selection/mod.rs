//! Vision selector: from pictures to parts that may be picked.
//!
//! It works from the image, the camera's calibration, the tray's pose at the image's stamp, the tray's geometry and a
//! taught model of the part, and from nothing else. A frame passes four steps: `segment` parts the plateau from what lies
//! on it, `circles` finds discs and measures their rims, [`PartModel`] tells which way up each lies, and `track` follows
//! them from frame to frame.

mod blobs;
mod circles;
mod config;
mod detector;
mod overlay;
mod part_model;
mod segment;
mod teach;
mod track;
mod view;

use image::GrayImage;
use nalgebra::{Isometry2, Point2};

use crate::camera::{CameraModel, InvalidValue, MountedTray, require};
use circles::Disc;
use detector::Detector;
use segment::Segmentation;
use track::Tracker;
use view::View;

pub use config::SelectorConfig;
pub use overlay::draw_overlay;
pub use part_model::{PartModel, PoseTemplate};
pub use teach::{TeachError, TeachFrame, TeachSpec, teach};
pub use track::{TrackedCandidate, TrackerConfig};

/// Mean square change of brightness from ring to ring at which a face tells its centre about half as well as a rim.
const FACE_SHARPNESS: f64 = 1e-3;
/// Reach of a part's own side and shadow beyond its rim, in radii and in its height: what is seen there is no obstacle of
/// its own.
const HALO_RADII: f64 = 0.2;
const HALO_HEIGHTS: f64 = 0.3;
/// Strip along the plateau's edges, px, where the walls' shade may pass for an obstacle and is not taken for one.
const EDGE_STRIP_PX: f64 = 4.0;
/// How far into a wall a part that touches it may be measured, px.
const WALL_MISS_PX: f64 = 1.5;

/// Why a frame yields no candidates.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageFault {
    /// The image is not the calibrated camera's.
    #[error("the image has {found:?} px; the camera has {expected:?} px")]
    WrongSize {
        /// Width and height of the image.
        found: (u32, u32),
        /// Width and height of the camera's images.
        expected: (u32, u32),
    },
    /// The tray stands where the camera does not see its plateau.
    #[error("the camera does not see the plateau")]
    PlateauOutOfView,
    /// The plateau is black.
    #[error("the plateau is black: the image is blank or under-exposed")]
    UnderExposed,
    /// The plateau is white.
    #[error("the plateau is white: the image is over-exposed")]
    OverExposed,
    /// Nothing looks like an evenly lit plateau.
    #[error("no evenly lit plateau is to be seen")]
    NoBackground,
}

/// A part as one frame shows it, in the tray frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Centre, x, m.
    pub x_m: f64,
    /// Centre, y, m.
    pub y_m: f64,
    /// Diameter measured, m.
    pub diameter_m: f64,
    /// Resting pose; `None` if no taught face is recognised.
    pub pose: Option<usize>,
    /// How sure the pose is, 0 to 1.
    pub confidence: f64,
    /// Free gap to the nearest other thing seen on the plateau, m.
    pub part_gap_m: f64,
    /// Free gap to the nearer wall, m; about 0 for a part that touches.
    pub wall_gap_m: f64,
    /// Whether its whole outline lies within the plateau sector.
    pub on_plateau: bool,
}

impl Candidate {
    /// Free gap to the nearest other thing or wall, m.
    #[must_use]
    pub fn isolation_m(&self) -> f64 {
        self.part_gap_m.min(self.wall_gap_m)
    }

    /// Centre in the tray frame, m.
    #[must_use]
    pub fn centre(&self) -> Point2<f64> {
        Point2::new(self.x_m, self.y_m)
    }
}

/// Selects parts from a stream of frames.
#[derive(Clone, Debug)]
pub struct Selector {
    config: SelectorConfig,
    model: PartModel,
    detector: Detector,
    tracker: Tracker,
}

impl Selector {
    /// A selector for this camera over this tray, taught this part.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming what is out of range in configuration, tray or model, a wanted pose never taught, or a
    /// camera not above the tray.
    pub fn new(
        config: SelectorConfig,
        camera: &CameraModel,
        tray: &MountedTray,
        model: PartModel,
    ) -> Result<Self, InvalidValue> {
        config.validate()?;
        tray.validate()?;
        model.validate()?;
        require_above(camera, tray)?;
        for pose in &config.wanted_poses {
            let taught = *pose < model.poses.len();
            require(taught, "selector.wanted_poses", *pose as f64, "poses the part model was taught")?;
        }
        let tracker = Tracker::new(config.tracker, model.poses.len());
        Ok(Self { config, model, detector: Detector::new(camera, tray), tracker })
    }

    /// Looks at a frame taken at `stamp_s` with the tray at `platen_from_tray`; returns the parts it shows, tracked, in
    /// the order of their identities.
    ///
    /// # Errors
    ///
    /// [`ImageFault`] if the frame shows no plateau to look at; what was tracked before is then coasting.
    pub fn process(
        &mut self,
        stamp_s: f64,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
    ) -> Result<Vec<TrackedCandidate>, ImageFault> {
        let candidates = self.detect(image, platen_from_tray);
        let seen = candidates.as_ref().map_or(&[][..], Vec::as_slice);
        let mut tracked = self.tracker.update(stamp_s, seen);
        candidates?;
        for part in &mut tracked {
            part.selectable = self.is_selectable(part);
        }
        Ok(tracked)
    }

    /// The parts a single frame shows, in the order of their places in the image.
    ///
    /// # Errors
    ///
    /// [`ImageFault`] as for [`Self::process`].
    pub fn detect(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
    ) -> Result<Vec<Candidate>, ImageFault> {
        let size = self.model.size();
        let (discs, background) =
            self.detector.discs(image, platen_from_tray, size, self.config.contrast_min_levels)?;
        let Detector { camera, tray, segmentation, .. } = &mut self.detector;
        let view = View { camera, tray, platen_from_tray: *platen_from_tray };
        let (height_m, face_height_m) = (size.rim_height_m(tray), size.face_height_m(tray));
        let radius_m = self.model.diameter_m / 2.0;
        let mut candidates = Vec::new();
        for disc in discs {
            let diameter_m = 2.0 * disc.radius_m;
            let sized = (diameter_m - self.model.seen_diameter_m).abs() <= self.model.diameter_tolerance_m;
            if !sized || disc.support < self.config.rim_support_min {
                continue;
            }
            let Some(face) =
                part_model::sample_face(segmentation, &background, &view, face_height_m, disc.centre, radius_m)
            else {
                continue;
            };
            let (pose, confidence) = recognise(&self.model, &self.config, &face);
            let centre = disc.centre + (face.centre - disc.centre) * trust_in_face(&face, &disc);
            let centre_m = centre.coords.norm();
            let geometry = &tray.geometry;
            let wall_gap_m = (geometry.outer_radius_m - centre_m).min(centre_m - geometry.inner_radius_m) - radius_m;
            // A part cannot lie in a wall.
            if wall_gap_m < -WALL_MISS_PX * camera.m_per_px(height_m) {
                continue;
            }
            candidates.push(Candidate {
                x_m: centre.x,
                y_m: centre.y,
                diameter_m,
                pose,
                confidence: confidence * disc.support,
                part_gap_m: f64::INFINITY,
                wall_gap_m,
                on_plateau: tray.inside_sector_m(centre) >= radius_m,
            });
        }
        let reach_m = radius_m + HALO_RADII * radius_m + HALO_HEIGHTS * size.height_m;
        measure_gaps(segmentation, &view, (height_m, radius_m, reach_m), &mut candidates);
        Ok(candidates)
    }

    fn is_selectable(&self, part: &TrackedCandidate) -> bool {
        let candidate = &part.candidate;
        candidate.on_plateau
            && part.confidence >= self.config.confidence_min
            && part.pose.is_some_and(|pose| self.config.wanted_poses.contains(&pose))
            && candidate.pose == part.pose
            && candidate.part_gap_m >= self.config.part_clearance_m
            && candidate.wall_gap_m >= self.config.wall_clearance_m
    }
}

/// How far to follow the face's centre rather than the rim's, 0 to 1. The rim errs towards shadows and where neighbours
/// hide it, the face, if it has structure, towards the lamp; both err less together.
fn trust_in_face(face: &part_model::Face, disc: &Disc) -> f64 {
    let of_face = face.sharpness / (face.sharpness + FACE_SHARPNESS);
    let of_rim = (2.0 * disc.support - 1.0).max(0.1);
    of_face / (of_face + of_rim)
}

/// The pose whose taught face this is, and how sure that is.
fn recognise(model: &PartModel, config: &SelectorConfig, face: &part_model::Face) -> (Option<usize>, f64) {
    let (mut best, mut best_correlation, mut second_correlation) = (None, -1.0, -1.0);
    for (pose, template) in model.poses.iter().enumerate() {
        let correlation = template.correlation(&face.rings);
        if correlation > best_correlation {
            (best, second_correlation, best_correlation) = (Some(pose), best_correlation, correlation);
        } else if correlation > second_correlation {
            second_correlation = correlation;
        }
    }
    let lead = best_correlation - second_correlation;
    let (least, lead_least) = (config.correlation_min, config.correlation_lead_min);
    if best_correlation < least || lead < lead_least {
        return (None, 0.0);
    }
    // Certainty grows from ½ at the least accepted to 1: with the match, and with the lead over the next face.
    let share = |value: f64, low: f64, high: f64| 0.5 + 0.5 * ((value - low) / (high - low)).clamp(0.0, 1.0);
    let match_share = share(best_correlation, least, (least + 1.0) / 2.0);
    (best, match_share.min(share(lead, lead_least, 2.0 * lead_least)))
}

/// A camera must hang at least twice as high as the tray's walls stand.
fn require_above(camera: &CameraModel, tray: &MountedTray) -> Result<(), InvalidValue> {
    let height_m = camera.pose().height_m;
    let above = height_m >= 2.0 * tray.wall_top_m();
    require(above, "camera.pose.height_m", height_m, "at least twice the height of the tray's walls")
}

/// Free gaps between candidates, all discs of `radius_m` whose shadows end at `reach_m`, and to whatever else stands out
/// from the plateau.
fn measure_gaps(
    frame: &mut Segmentation,
    view: &View,
    (height_m, radius_m, reach_m): (f64, f64, f64),
    candidates: &mut [Candidate],
) {
    // What the candidates and their shadows do not explain are obstacles.
    for candidate in &*candidates {
        frame.clear_disc(view, height_m, candidate.centre(), reach_m);
    }
    let obstacles = frame.foreground_points(view, height_m, EDGE_STRIP_PX);
    let centres: Vec<Point2<f64>> = candidates.iter().map(Candidate::centre).collect();
    for (index, candidate) in candidates.iter_mut().enumerate() {
        let centre = centres[index];
        let others = centres.iter().enumerate().filter(|(other, _)| *other != index);
        let to_parts = others.map(|(_, other)| (other - centre).norm() - 2.0 * radius_m);
        let to_obstacles = obstacles.iter().map(|obstacle| (obstacle - centre).norm() - radius_m);
        candidate.part_gap_m = to_parts.chain(to_obstacles).fold(f64::INFINITY, f64::min);
    }
}

#[cfg(test)]
mod tests;
