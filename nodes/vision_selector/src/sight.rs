//! From an image to the parts on it, or to why nothing is selected.

use std::time::Duration;

use feeder_runtime::node::ns_of_stamp;
use feeder_scenario::ScenarioError;
use feeder_scenario::plan::VisionSelectorConfig;
use feeder_vision::{
    CalibrationFault, CalibrationWatch, HealthCause, HealthWatch, ImageFault, NoPose, PictureError, PoseHistory,
    RawPicture, Selector, ToldOptics, ToldOtherwise, TrackedCandidate, UNSEEN_MS_MAX, binned, decode, draw_overlay,
};
use feeder_wire::part_candidates::ImageWorth;
use feeder_wire::pictures::{self, Encoding};
use image::GrayImage;
use minifactory_msgs::sensor_msgs::msg::{CameraInfo, CompressedImage, Image};
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::Isometry2;

use crate::SILENT_PERIODS;

/// Kinds of warnings.
pub(crate) const WARNINGS: usize = 4;

/// So many images in a row that come too seldom are no accident.
const SELDOM_MIN: u32 = 5;

/// An image as the camera sent it.
pub(crate) enum Frame {
    Compressed(CompressedImage),
    Raw(Image),
}

impl Frame {
    pub(crate) fn header(&self) -> &Header {
        match self {
            Self::Compressed(message) => &message.header,
            Self::Raw(message) => &message.header,
        }
    }

    pub(crate) fn stamp_ns(&self) -> u64 {
        ns_of_stamp(&self.header().stamp)
    }

    fn grey(&self) -> Result<GrayImage, PictureError> {
        match self {
            Self::Compressed(message) => decode(&message.data),
            Self::Raw(message) => RawPicture {
                width_px: message.width,
                height_px: message.height,
                encoding: &message.encoding,
                is_bigendian: message.is_bigendian != 0,
                step: message.step,
                data: &message.data,
            }
            .grey(),
        }
    }
}

/// Why nothing is selected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum LookError {
    #[error("the camera has stopped: no image for {SILENT_PERIODS} periods")]
    Silent,
    #[error("no image has come yet: is there a camera, and on this topic?")]
    NeverSeen,
    #[error(transparent)]
    Pose(#[from] NoPose),
    #[error("the image cannot be decoded: {0}")]
    Decode(String),
    #[error("the tray is under way")]
    UnderWay,
    #[error(transparent)]
    Image(#[from] ImageFault),
    #[error(transparent)]
    Calibration(#[from] CalibrationFault),
}

impl LookError {
    /// What it means that no image comes, where one `came_before` or none ever did.
    pub(crate) fn without_image(came_before: bool) -> Self {
        if came_before { Self::Silent } else { Self::NeverSeen }
    }

    /// Why nothing is selected, by what was `last` wrong with an image: before the first one nothing is known to be well.
    pub(crate) fn in_force(last: Option<&Self>, came_before: bool) -> Option<&Self> {
        last.or((!came_before).then_some(&Self::NeverSeen))
    }

    /// Whether something is wrong, and the tray is not just elsewhere.
    pub(crate) fn is_wrong(&self) -> bool {
        !matches!(self, Self::UnderWay | Self::Image(ImageFault::PlateauOutOfView))
    }

    /// Whether it is the same thing that is wrong, whatever its numbers.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Calibration(_), Self::Calibration(_)) | (Self::Decode(_), Self::Decode(_)) => true,
            _ => self == other,
        }
    }
}

/// An image that was understood.
pub(crate) struct Picture {
    pub(crate) image: GrayImage,
    pub(crate) platen_from_tray: Isometry2<f64>,
    pub(crate) tracked: Vec<TrackedCandidate>,
}

/// What turns images into parts.
pub(crate) struct Sight {
    config: VisionSelectorConfig,
    pub(crate) selector: Selector,
    pub(crate) poses: PoseHistory,
    pub(crate) calibration: CalibrationWatch,
    pub(crate) health: HealthWatch,
    /// Stamp of the latest image, and of the latest in which tracks were followed, ns.
    latest_ns: u64,
    followed_ns: u64,
    /// Images in a row before which parts were fed unseen for too long to be known again.
    seldom: u32,
    /// What the camera said last of itself, without its stamp, and how that contradicts the scenario.
    info: Option<CameraInfo>,
    told_otherwise: Option<ToldOtherwise>,
}

impl Sight {
    pub(crate) fn new(config: &VisionSelectorConfig) -> Result<Self, ScenarioError> {
        let limits = config.selector.calibration;
        Ok(Self {
            config: config.clone(),
            selector: config.selector()?,
            poses: PoseHistory::new(config.selector.odometry),
            calibration: CalibrationWatch::new(limits, config.camera.clone(), config.tray),
            health: HealthWatch::default(),
            latest_ns: 0,
            followed_ns: 0,
            seldom: 0,
            info: None,
            told_otherwise: None,
        })
    }

    /// Hears what the camera says of itself.
    pub(crate) fn hear(&mut self, info: CameraInfo) {
        let info = CameraInfo { header: Header::default(), ..info };
        if self.info.as_ref() == Some(&info) {
            return;
        }
        let told = ToldOptics {
            size_px: (info.width, info.height),
            distortion_model: &info.distortion_model,
            distortion: &info.d,
            intrinsics_px: info.k,
        };
        let VisionSelectorConfig { camera, tray, selector, .. } = &self.config;
        self.told_otherwise = told.compare(camera, tray, &selector.calibration).err();
        self.info = Some(info);
    }

    /// What does not keep parts from being selected, but somebody should see to, by kind: always the same number of them.
    pub(crate) fn warnings(&self) -> [Option<String>; WARNINGS] {
        let calibration = self.calibration.warning();
        [
            calibration.map(|misalignment| format!("the camera drifts off its calibration: {misalignment}")),
            self.told_otherwise.as_ref().map(ToString::to_string),
            self.doubts(),
            (self.seldom >= SELDOM_MIN).then(|| {
                format!("images come more than {UNSEEN_MS_MAX} ms apart while parts are fed: they are not known again from one to the next")
            }),
        ]
    }

    /// What makes images doubtful since some time; nothing if they are sound.
    fn doubts(&self) -> Option<String> {
        let causes: Vec<String> = self.health.causes().map(|cause| cause.to_string()).collect();
        (!causes.is_empty()).then(|| causes.join("; "))
    }

    /// What the latest image is worth; one that was not looked at shows nothing.
    pub(crate) fn worth(&self) -> ImageWorth {
        let health = self.selector.health();
        let causes: Vec<HealthCause> = self.health.causes().collect();
        ImageWorth {
            covered_ratio: health.covered_ratio,
            explained_ratio: health.explained_ratio,
            is_blind: causes.contains(&HealthCause::NothingRecognised),
            doubts: causes.iter().map(ToString::to_string).collect(),
        }
    }

    /// Whether an image was taken after all that were looked at. One with a stamp that nobody can place makes no other old.
    pub(crate) fn is_new(&mut self, frame: &Frame) -> bool {
        let stamp_ns = frame.stamp_ns();
        let is_new = stamp_ns > self.latest_ns;
        if is_new && self.poses.at(stamp_ns).is_ok() {
            self.latest_ns = stamp_ns;
        }
        is_new
    }

    /// Whether odometry that is still to come may tell where the tray stood, after the image has waited for so long.
    pub(crate) fn awaits_odometry(&self, frame: &Frame, waited: Duration) -> bool {
        let may_come = matches!(self.poses.at(frame.stamp_ns()), Err(NoPose::NoOdometry | NoPose::Ahead));
        may_come && waited.as_secs_f64() < self.poses.config().wait_s_max
    }

    pub(crate) fn look(&mut self, frame: &Frame) -> Result<Picture, LookError> {
        let stamp_ns = frame.stamp_ns();
        let platen_from_tray = self.poses.at(stamp_ns)?;
        let stamp_s = Duration::from_nanos(stamp_ns).as_secs_f64();
        // Nobody picks from a tray that is on its way, and its parts lie as they lay.
        let seen = if self.poses.is_under_way(stamp_ns) {
            Err(LookError::UnderWay)
        } else {
            self.selector.glance(&platen_from_tray).map_err(LookError::from)
        };
        if let Err(elsewhere) = seen {
            if !self.poses.shaken_since(self.followed_ns) {
                self.selector.rest(stamp_s);
                self.followed_ns = stamp_ns;
            }
            return Err(elsewhere);
        }
        let camera = &self.config.camera;
        let image = frame.grey().map_err(|error| LookError::Decode(error.to_string()))?;
        let image = binned(image, (camera.width_px(), camera.height_px()));
        // A picture in which no plateau is to be seen says that first, and where the rim is not after it.
        let shaken = self.poses.shaken_since(self.followed_ns);
        let unseen_ms = stamp_ns.saturating_sub(self.followed_ns) / 1_000_000;
        self.seldom = if shaken && unseen_ms > UNSEEN_MS_MAX { self.seldom.saturating_add(1) } else { 0 };
        self.selector.note_shaken(shaken);
        self.followed_ns = stamp_ns;
        let tracked = self.selector.process(stamp_s, &image, &platen_from_tray)?;
        self.health.note(self.selector.health());
        self.calibration.look(&image, &platen_from_tray)?;
        Ok(Picture { image, platen_from_tray, tracked })
    }

    pub(crate) fn annotate(&self, header: &Header, picture: &Picture) -> Image {
        let drawn = draw_overlay(&picture.image, &picture.tracked, &self.selector, &picture.platen_from_tray);
        pictures::to_image(header.clone(), Encoding::Rgb, drawn.dimensions(), drawn.into_raw())
    }
}
