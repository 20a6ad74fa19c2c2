//! Where pictures to teach from come from: a folder, in which the tray stands at one place, or a bag, which says where it
//! stood in each.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use feeder_model::camera::CameraModel;
use feeder_runtime::cdr;
use feeder_runtime::node::ns_of_stamp;
use feeder_scenario::Scenario;
use feeder_vision::{NoPose, PoseHistory, PoseHistoryConfig, TimedPose};
use feeder_wire::odometry::{self, EstimatedMotion};
use feeder_wire::topics;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::CompressedImage;
use nalgebra::Isometry2;
use ros2_bags::cdr::HEADER_BYTES;
use ros2_bags::{Bag, Query};

use crate::pictures::Photo;

/// Files that are taken for pictures.
const EXTENSIONS: [&str; 3] = ["jpg", "jpeg", "png"];
/// Pictures taken from a bag, spread evenly over it.
const BAG_PICTURES: usize = 10;
/// How far from the feeding place the tray may stand in them, m.
const NEAR_M: f64 = 0.01;

/// The pictures.
pub(crate) enum Source {
    Folder { files: Vec<PathBuf>, camera: Box<CameraModel>, platen_from_tray: Isometry2<f64> },
    Bag(Vec<Photo>),
}

impl Source {
    /// A folder of pictures with the tray at `platen_from_tray`, or a bag that holds the feeder's compressed images and its
    /// odometry.
    pub(crate) fn open(path: &Path, scenario: &Scenario, platen_from_tray: Isometry2<f64>) -> anyhow::Result<Self> {
        let camera = &scenario.camera.model;
        if path.join("metadata.yaml").is_file() || path.extension().is_some_and(|extension| extension == "mcap") {
            return Ok(Self::Bag(from_bag(path, scenario, &platen_from_tray)?));
        }
        Ok(Self::Folder { files: listed(path)?, camera: Box::new(camera.clone()), platen_from_tray })
    }

    /// Names of the pictures.
    pub(crate) fn names(&self) -> Vec<PathBuf> {
        match self {
            Self::Folder { files, .. } => files.clone(),
            Self::Bag(photos) => photos.iter().map(|photo| photo.file.clone()).collect(),
        }
    }

    /// Reads the picture of this index.
    pub(crate) fn photo(&self, index: usize) -> anyhow::Result<Photo> {
        match self {
            Self::Folder { files, camera, platen_from_tray } => Photo::open(&files[index], camera, *platen_from_tray),
            Self::Bag(photos) => Ok(photos[index].clone()),
        }
    }
}

/// The pictures in a folder, by name.
fn listed(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let problem = || format!("cannot read the folder {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(problem)? {
        let path = entry.with_context(problem)?.path();
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        if extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str())) {
            files.push(path);
        }
    }
    files.sort();
    ensure!(!files.is_empty(), "{} holds no picture; allowed: .jpg, .jpeg, .png, or a bag", folder.display());
    Ok(files)
}

/// Some pictures of a bag with the tray near `feeding_place`, each named by its stamp.
fn from_bag(path: &Path, scenario: &Scenario, feeding_place: &Isometry2<f64>) -> anyhow::Result<Vec<Photo>> {
    let bag = Bag::open(path)?;
    let topic = |name: String| {
        let at = bag.topics().iter().position(|topic| topic.name == name);
        at.with_context(|| format!("{} does not hold {name}", path.display()))
    };
    let namespace = scenario.namespace();
    let images = topic(topics::IMAGE_COMPRESSED.name_in(&namespace))?;
    let places = topic(topics::ODOMETRY.name_in(&namespace))?;
    // Everything is at hand: an image waits as long as it takes.
    let mut history = PoseHistory::new(PoseHistoryConfig::default());
    let mut waiting: VecDeque<CompressedImage> = VecDeque::new();
    let mut placed: Vec<(CompressedImage, Isometry2<f64>)> = Vec::new();
    let query = Query { topics: Some([images, places].into()), ..Query::default() };
    for message in bag.messages(&query) {
        let message = message?;
        let little_endian = message.data.get(1).is_none_or(|byte| byte & 1 == 1);
        let body = &message.data[HEADER_BYTES.min(message.data.len())..];
        if message.topic == images {
            waiting.push_back(cdr::decode(body, little_endian)?);
            continue;
        }
        let place: Odometry = cdr::decode(body, little_endian)?;
        let EstimatedMotion { position, velocity, .. } = odometry::from_message(&place);
        history.note(TimedPose { stamp_ns: ns_of_stamp(&place.header.stamp), position, velocity });
        while let Some(image) = waiting.pop_front() {
            match history.at(ns_of_stamp(&image.header.stamp)) {
                Ok(at) if (at.translation.vector - feeding_place.translation.vector).norm() <= NEAR_M => {
                    placed.push((image, at));
                }
                Err(NoPose::Ahead | NoPose::NoOdometry) => {
                    waiting.push_front(image);
                    break;
                }
                _ => {}
            }
        }
    }
    ensure!(!placed.is_empty(), "{} holds no image with the tray near its feeding place", path.display());
    let count = placed.len().min(BAG_PICTURES);
    let chosen = (0..count).map(|index| &placed[(2 * index + 1) * placed.len() / (2 * count)]);
    chosen
        .map(|(image, at)| {
            let stamp_ms = ns_of_stamp(&image.header.stamp) / 1_000_000;
            Photo::decoded(Path::new(&format!("{stamp_ms}_ms.png")), &image.data, &scenario.camera.model, *at)
        })
        .collect()
}
