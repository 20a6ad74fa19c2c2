//! Vision selector: from pictures to parts that may be picked.
//!
//! It works from the image, the camera's calibration, the tray's pose at the image's stamp, the tray's geometry and a
//! taught model of the part, and from nothing else. A frame passes four steps: `segment` parts the plateau from what lies
//! on it, `circles` finds discs and measures their rims, [`PartModel`] tells which way up each lies, and `track` follows
//! them from frame to frame.

mod blobs;
mod circles;
mod overlay;
mod part_model;
mod segment;
mod track;
mod view;

use image::GrayImage;
use nalgebra::{Isometry2, Point2};
use serde::{Deserialize, Serialize};

use crate::camera::{CameraModel, InvalidValue, MountedTray, require};
use circles::{Disc, Votes};
use segment::{Background, Segmentation};
use track::Tracker;
use view::{RayTable, View};

pub use overlay::draw_overlay;
pub use part_model::{PartModel, PoseTemplate, TeachError, TeachFrame, TeachSpec, teach};
pub use track::{TrackedCandidate, TrackerConfig};

/// Where between foot (0) and upper face (1) the measured rim of a part lies: the lower edge shows on the side towards the
/// camera, the upper edge on the far side.
const RIM_HEIGHT_RATIO: f64 = 0.5;
/// Reach of a part's own shadow and side beyond its rim, in radii: what is seen there is no obstacle of its own.
const HALO_RATIO: f64 = 0.35;
/// Strip along the plateau's edges, px, where the walls' shade may pass for an obstacle and is not taken for one.
const EDGE_STRIP_PX: f64 = 4.0;
/// How far into a wall a part that touches it may be measured, px.
const WALL_MISS_PX: f64 = 1.5;
/// Smallest thing that counts as an obstacle, px.
const BLOB_PX_MIN: usize = 9;

/// What the selector is asked for and how sure it must be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SelectorConfig {
    /// Resting poses in which a part is right.
    pub wanted_poses: Vec<usize>,
    /// Confidence over frames from which a part may be selected, 0 to 1.
    pub confidence_min: f64,
    /// Free gap the gripper needs round a part to the next thing on the plateau, m.
    pub part_clearance_m: f64,
    /// Free gap the gripper needs between a part and the walls, m; below 0 parts at the wall are welcome.
    pub wall_clearance_m: f64,
    /// Grey levels by which something must differ from the plateau to be seen.
    pub contrast_min_levels: f64,
    /// Share of a part's rim that must be seen.
    pub rim_support_min: f64,
    /// Correlation with the taught face from which a face counts as recognised.
    pub correlation_min: f64,
    /// Lead in correlation over the second-best face.
    pub correlation_lead_min: f64,
    /// Following parts from frame to frame.
    pub tracker: TrackerConfig,
}

impl Default for SelectorConfig {
    fn default() -> Self {
        Self {
            wanted_poses: vec![0],
            confidence_min: 0.6,
            part_clearance_m: 0.001,
            wall_clearance_m: -0.001,
            contrast_min_levels: 10.0,
            rim_support_min: 0.55,
            correlation_min: 0.75,
            correlation_lead_min: 0.25,
            tracker: TrackerConfig::default(),
        }
    }
}

impl SelectorConfig {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        for (field, value) in [
            ("selector.confidence_min", self.confidence_min),
            ("selector.rim_support_min", self.rim_support_min),
            ("selector.correlation_min", self.correlation_min),
            ("selector.correlation_lead_min", self.correlation_lead_min),
        ] {
            require((0.0..=1.0).contains(&value), field, value, "0 to 1")?;
        }
        for (field, value) in [
            ("selector.part_clearance_m", self.part_clearance_m),
            ("selector.wall_clearance_m", self.wall_clearance_m),
        ] {
            require((-0.1..=0.1).contains(&value), field, value, "-0.1 to 0.1 m")?;
        }
        let contrast = self.contrast_min_levels;
        require(
            (2.0..=128.0).contains(&contrast),
            "selector.contrast_min_levels",
            contrast,
            "2 to 128",
        )?;
        self.tracker.validate()
    }
}

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
    /// Turn about the vertical, rad; `None` for a face without a mark to tell it by.
    pub yaw_rad: Option<f64>,
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

/// Finds parts in single frames.
#[derive(Clone, Debug)]
struct Detector {
    camera: CameraModel,
    tray: MountedTray,
    rays: RayTable,
    segmentation: Segmentation,
    votes: Votes,
}

impl Detector {
    fn new(camera: &CameraModel, tray: &MountedTray) -> Self {
        Self {
            camera: camera.clone(),
            tray: *tray,
            rays: RayTable::new(camera),
            segmentation: Segmentation::default(),
            votes: Votes::default(),
        }
    }

    /// Finds discs of about `diameter_m` and part height `height_m`; hands each to `judge` with what it takes to judge it.
    fn discs(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
        size: PartSize,
        contrast_min_levels: f64,
    ) -> Result<(Vec<Disc>, Background), ImageFault> {
        let expected = (self.camera.width_px(), self.camera.height_px());
        if image.dimensions() != expected {
            return Err(ImageFault::WrongSize {
                found: image.dimensions(),
                expected,
            });
        }
        let view = View {
            camera: &self.camera,
            tray: &self.tray,
            platen_from_tray: *platen_from_tray,
        };
        let background =
            self.segmentation
                .look(&view, &self.rays, image, contrast_min_levels, BLOB_PX_MIN)?;
        let height_m = size.rim_height_m(&self.tray);
        let radius_m = size.diameter_m / 2.0;
        let radius_px = crate::camera::single(radius_m / self.camera.m_per_px(height_m));
        let discs = self
            .votes
            .centres(&self.segmentation, radius_px)
            .into_iter()
            .filter_map(|pixel| {
                let centre = view.tray_point(pixel.map(f64::from), height_m)?;
                circles::measure(&self.segmentation, &view, height_m, centre, radius_m)
            })
            .collect();
        Ok((discs, background))
    }
}

/// Size of the part looked for.
#[derive(Clone, Copy, Debug)]
struct PartSize {
    diameter_m: f64,
    height_m: f64,
}

impl PartSize {
    /// The plane above the platen in which rims are measured, m.
    fn rim_height_m(self, tray: &MountedTray) -> f64 {
        tray.plateau_height_m() + RIM_HEIGHT_RATIO * self.height_m
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
            require(
                taught,
                "selector.wanted_poses",
                *pose as f64,
                "poses the part model was taught",
            )?;
        }
        let tracker = Tracker::new(config.tracker, model.poses.len());
        Ok(Self {
            config,
            model,
            detector: Detector::new(camera, tray),
            tracker,
        })
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
        let (discs, background) = self.detector.discs(
            image,
            platen_from_tray,
            size,
            self.config.contrast_min_levels,
        )?;
        let Detector {
            camera,
            tray,
            segmentation,
            ..
        } = &mut self.detector;
        let view = View {
            camera,
            tray,
            platen_from_tray: *platen_from_tray,
        };
        let height_m = size.rim_height_m(tray);
        let radius_m = self.model.diameter_m / 2.0;
        let mut candidates = Vec::new();
        for disc in discs {
            let diameter_m = 2.0 * disc.radius_m;
            let sized =
                (diameter_m - self.model.seen_diameter_m).abs() <= self.model.diameter_tolerance_m;
            if !sized || disc.support < self.config.rim_support_min {
                continue;
            }
            let Some(face) =
                part_model::sample_face(segmentation, &background, &view, height_m, &disc)
            else {
                continue;
            };
            let (pose, confidence) = recognise(&self.model, &self.config, &face);
            let centre_m = disc.centre.coords.norm();
            let geometry = &tray.geometry;
            let wall_gap_m = (geometry.outer_radius_m - centre_m)
                .min(centre_m - geometry.inner_radius_m)
                - radius_m;
            // A part cannot lie in a wall.
            if wall_gap_m < -WALL_MISS_PX * camera.m_per_px(height_m) {
                continue;
            }
            candidates.push(Candidate {
                x_m: disc.centre.x,
                y_m: disc.centre.y,
                yaw_rad: None,
                diameter_m,
                pose,
                confidence: confidence * disc.support,
                part_gap_m: f64::INFINITY,
                wall_gap_m,
                on_plateau: tray.inside_sector_m(disc.centre) >= radius_m,
            });
        }
        measure_gaps(segmentation, &view, height_m, radius_m, &mut candidates);
        Ok(candidates)
    }

    fn is_selectable(&self, part: &TrackedCandidate) -> bool {
        let candidate = &part.candidate;
        candidate.on_plateau
            && part.confidence >= self.config.confidence_min
            && part
                .pose
                .is_some_and(|pose| self.config.wanted_poses.contains(&pose))
            && candidate.pose == part.pose
            && candidate.part_gap_m >= self.config.part_clearance_m
            && candidate.wall_gap_m >= self.config.wall_clearance_m
    }
}

/// The pose whose taught face this is, and how sure that is.
fn recognise(
    model: &PartModel,
    config: &SelectorConfig,
    face: &part_model::Face,
) -> (Option<usize>, f64) {
    let (mut best, mut best_correlation, mut second_correlation) = (None, -1.0, -1.0);
    for (pose, template) in model.poses.iter().enumerate() {
        let correlation = template.correlation(face);
        if correlation > best_correlation {
            (best, second_correlation, best_correlation) =
                (Some(pose), best_correlation, correlation);
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
    let share = |value: f64, low: f64, high: f64| {
        0.5 + 0.5 * ((value - low) / (high - low)).clamp(0.0, 1.0)
    };
    let match_share = share(best_correlation, least, (least + 1.0) / 2.0);
    (
        best,
        match_share.min(share(lead, lead_least, 2.0 * lead_least)),
    )
}

/// A camera must hang at least twice as high as the tray's walls stand.
fn require_above(camera: &CameraModel, tray: &MountedTray) -> Result<(), InvalidValue> {
    let height_m = camera.pose().height_m;
    let above = height_m >= 2.0 * tray.wall_top_m();
    require(
        above,
        "camera.pose.height_m",
        height_m,
        "at least twice the height of the tray's walls",
    )
}

/// Free gaps between candidates, all discs of `radius_m`, and to whatever else stands out from the plateau.
fn measure_gaps(
    frame: &mut Segmentation,
    view: &View,
    height_m: f64,
    radius_m: f64,
    candidates: &mut [Candidate],
) {
    // What the candidates and their shadows do not explain are obstacles.
    for candidate in &*candidates {
        frame.clear_disc(
            view,
            height_m,
            candidate.centre(),
            radius_m * (1.0 + HALO_RATIO),
        );
    }
    let obstacles = frame.foreground_points(view, height_m, EDGE_STRIP_PX);
    let centres: Vec<Point2<f64>> = candidates.iter().map(Candidate::centre).collect();
    for (index, candidate) in candidates.iter_mut().enumerate() {
        let centre = centres[index];
        let others = centres
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != index);
        let to_parts = others.map(|(_, other)| (other - centre).norm() - 2.0 * radius_m);
        let to_obstacles = obstacles
            .iter()
            .map(|obstacle| (obstacle - centre).norm() - radius_m);
        candidate.part_gap_m = to_parts.chain(to_obstacles).fold(f64::INFINITY, f64::min);
    }
}
