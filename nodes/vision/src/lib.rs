//! Vision selector: from pictures to parts that may be picked.
//!
//! It works from the image, the camera's calibration, the tray's pose at the image's stamp ([`PoseHistory`]), the tray's
//! geometry and a model of the part learned from images ([`teach`]), and from nothing else. A frame passes five steps: `segment` parts the
//! plateau from what lies on it; `search` finds places where rings of brightness are those of a taught pose, whatever the
//! yaw, and of parts with a yaw where a glance at all yaws misses least; `align` tries yaws there and fits place and yaw to a fraction of a pixel; `detector` takes the best fits for parts
//! until nothing is left to explain, so that touching parts come apart; `candidate` tells pose, confidence and room. `sight` looks so
//! in the light taught first and, where that leaves much unexplained, in any. `track` follows parts from frame to frame, and `rule`
//! says which of them may be picked.
//!
//! Beside that, [`decode`] and [`RawPicture`] read what cameras send, [`misalignment`] tells by rim and hub whether the camera hangs
//! where it is said to, [`calibrate`] finds out where it hangs, and [`things`] shows what lies there before a part is taught.

mod align;
mod blobs;
mod calibration;
mod candidate;
mod config;
mod detector;
mod evidence;
mod filter;
mod flow;
mod health;
mod modes;
mod overlay;
mod picture;
mod pose_history;
mod room;
mod rule;
mod search;
mod segment;
mod sight;
mod sought;
mod surround;
mod survey;
mod teach;
mod template;
mod track;
mod view;

use image::GrayImage;
use nalgebra::{Isometry2, Point2};

use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::part::Refusals;
use feeder_model::range::OutOfRange;
use sight::Sight;
use track::Tracker;

pub use calibration::{
    Calibrated, CalibrationError, CalibrationFault, CalibrationLimits, CalibrationWatch, Misalignment, RimNotSeen,
    Shot, ToldOptics, ToldOtherwise, calibrate, misalignment,
};
pub use candidate::Candidate;
pub use config::SelectorConfig;
pub use health::{FrameHealth, HealthCause, HealthWatch};
pub use overlay::draw_overlay;
pub use picture::{PictureError, RawPicture, binned, decode};
pub use pose_history::{NoPose, PoseHistory, PoseHistoryConfig, TimedPose};
pub use survey::{PICTURES_MIN, Thing, bare_plateau, things};
pub use teach::{
    Click, ClickDoubt, ClickLabel, ClickLesson, ClickedPicture, FittedClick, LaidPart, OtherLights, PoseSpec,
    TeachError, TeachFrame, TeachSpec, fit_clicks, teach, teach_from_clicks,
};
pub use template::{LIGHTS_ALL_ROUND, LitPicture, PartModel, Plane, PoseTemplate};
pub use track::{TrackedCandidate, TrackerConfig, UNSEEN_MS_MAX};

/// Why a frame yields no candidates.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageFault {
    /// The image is not the calibrated camera's.
    #[error(
        "the image has {}x{} px; the camera has {}x{} px, and a picture of a whole multiple of that is binned",
        found.0, found.1, expected.0, expected.1
    )]
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
    /// Nothing looks like an evenly lit plateau, or too little of it is bare.
    #[error("no evenly lit plateau is to be seen: it is covered, or the light falls on it in spots")]
    NoBackground,
}

/// Selects parts from a stream of frames.
#[derive(Clone, Debug)]
pub struct Selector {
    config: SelectorConfig,
    sight: Sight,
    tracker: Tracker,
    /// Whether the tray may have been shaken since the frame before.
    shaken: bool,
    health: FrameHealth,
}

impl Selector {
    /// A selector for this camera over this tray, taught this part.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming what is out of range in configuration, tray or model, a wanted pose never taught, or a
    /// camera not above the tray.
    pub fn new(
        config: SelectorConfig,
        camera: &CameraModel,
        tray: &MountedTray,
        model: &PartModel,
    ) -> Result<Self, OutOfRange> {
        Self::check(&config, camera, tray, model)?;
        let symmetries = model.poses.iter().map(|pose| pose.yaw_symmetry).collect();
        let tracker = Tracker::new(config.tracker, symmetries);
        Ok(Self {
            config,
            sight: Sight::new(camera, tray, model),
            tracker,
            shaken: true,
            health: FrameHealth::default(),
        })
    }

    /// Checks what a selector is made of.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn check(
        config: &SelectorConfig,
        camera: &CameraModel,
        tray: &MountedTray,
        model: &PartModel,
    ) -> Result<(), OutOfRange> {
        config.validate()?;
        tray.validate()?;
        model.validate()?;
        require_above(camera, tray)?;
        for pose in &config.wanted_poses {
            let taught = *pose < model.poses.len();
            OutOfRange::unless(taught, "selector.wanted_poses", *pose as f64, "poses the part model was taught")?;
        }
        Ok(())
    }

    /// Takes whether the tray was shaken between the frame looked at last and the next one: if not, parts lie where they
    /// lay. Until it is told otherwise it may have been.
    pub fn note_shaken(&mut self, shaken: bool) {
        self.shaken = shaken;
    }

    /// Takes that until `stamp_s` nobody looked, and that the tray was not shaken: parts lie where they lay, and are known again
    /// however long that was.
    pub fn rest(&mut self, stamp_s: f64) {
        self.tracker.rest(stamp_s);
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
        let tracked = self.tracker.update(stamp_s, seen, self.shaken);
        candidates.map(|_| tracked)
    }

    /// Whether a frame with the tray at `platen_from_tray` shows any of the plateau, as far as that tells without a look at
    /// it. Tracks wait for the next one that does: nothing was missed.
    ///
    /// # Errors
    ///
    /// [`ImageFault::PlateauOutOfView`].
    pub fn glance(&self, platen_from_tray: &Isometry2<f64>) -> Result<(), ImageFault> {
        if self.sight.taught.view(platen_from_tray).plateau_window().is_none() {
            return Err(ImageFault::PlateauOutOfView);
        }
        Ok(())
    }

    /// The parts a single frame shows, the surest match first.
    ///
    /// # Errors
    ///
    /// [`ImageFault`] as for [`Self::process`].
    pub fn detect(
        &mut self,
        image: &GrayImage,
        platen_from_tray: &Isometry2<f64>,
    ) -> Result<Vec<Candidate>, ImageFault> {
        let (candidates, health) = self.sight.look(image, platen_from_tray, &self.config)?;
        self.health = health;
        Ok(candidates)
    }

    /// What the frame looked at last is worth.
    #[must_use]
    pub fn health(&self) -> &FrameHealth {
        &self.health
    }

    /// Convex outline of a part as the selector sees it, tray frame, m.
    #[must_use]
    pub fn outline(&self, candidate: &Candidate) -> Vec<Point2<f64>> {
        self.sight.taught.outline(candidate.likeness, candidate.centre(), candidate.yaw_rad.unwrap_or(0.0))
    }

    /// Length along the part's own x and y of what the selector sees it reach, and its height, m.
    #[must_use]
    pub fn size_m(&self, candidate: &Candidate) -> [f64; 3] {
        let Some(sought) = self.sight.taught.sought.get(candidate.likeness) else {
            return [0.0; 3];
        };
        let reach = |axis: usize| sought.outline_m.iter().map(|corner| corner[axis].abs()).fold(0.0, f64::max);
        [2.0 * reach(0), 2.0 * reach(1), sought.template.height_m]
    }

    /// Radius of a circle about the place of a part that holds its outline, m.
    #[must_use]
    pub fn radius_m(&self, candidate: &Candidate) -> f64 {
        self.sight.taught.sought.get(candidate.likeness).map_or(0.0, |sought| sought.radius_m)
    }

    /// What speaks against picking a part, whatever its pose.
    #[must_use]
    pub fn refusals(&self, part: &TrackedCandidate) -> Refusals {
        rule::refusals(&self.config, &part.candidate, part.pose, part.confidence)
    }

    /// Whether a single frame, taken for all there is to see, lets this candidate be picked, whatever its pose.
    #[must_use]
    pub fn admits(&self, candidate: &Candidate) -> bool {
        rule::refusals(&self.config, candidate, candidate.pose, candidate.confidence).may_be_picked()
    }

    /// Whether a resting pose is one in which parts are handed over unless something else is asked for.
    #[must_use]
    pub fn is_wanted(&self, pose: usize) -> bool {
        self.config.wanted_poses.contains(&pose)
    }
}

/// A camera must hang at least twice as high as the tray's walls stand.
fn require_above(camera: &CameraModel, tray: &MountedTray) -> Result<(), OutOfRange> {
    let height_m = camera.pose().height_m;
    let above = height_m >= 2.0 * tray.wall_top_m();
    OutOfRange::unless(above, "camera.pose.height_m", height_m, "at least twice the height of the tray's walls")
}

#[cfg(test)]
mod tests;
