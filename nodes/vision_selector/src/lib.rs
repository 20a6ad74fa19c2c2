//! The vision selector: finds the parts on the plateau that lie right.
//!
//! It works from the compressed image, the calibration and the odometry at the image's stamp alone, with a model of the
//! part that was taught from pictures (`feeder teach`).
//!
//! Every part that lies wholly on the plateau is a detection, its bounding box in the tray frame, turned as the part is if
//! that has a yaw, its `id` the same from frame to frame. A detection's hypothesis names part and resting pose, as in `grommet/hole_up`, with the confidence as
//! its score. A part whose pose is not known, and one in a wanted pose that must not be picked (not sure enough, or no
//! room for the gripper), comes without hypothesis: it is only in the way.

use std::collections::VecDeque;
use std::time::Duration;

use feeder_core::camera::codec;
use feeder_core::scenario::Scenario;
use feeder_core::selection::{ImageFault, Selector, TrackedCandidate, draw_overlay};
use feeder_runtime::dds::Qos;
use feeder_runtime::node::{
    Declare, FeederNode, Latency, NodeError, Publisher, Settable, StepIo, Subscriber, ns_of_stamp,
};
use feeder_runtime::parameters::Range;
use image::GrayImage;
use minifactory_msgs::convert::{planar_isometry, planar_pose};
use minifactory_msgs::geometry_msgs::msg::Vector3;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::{CompressedImage, Image};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::vision_msgs::msg::{
    BoundingBox3D, Detection3D, Detection3DArray, ObjectHypothesis, ObjectHypothesisWithPose,
};
use nalgebra::Isometry2;

/// Frames in a row that may be missing before the camera counts as silent, and ticks that images may be under way.
const SILENT_PERIODS: u64 = 5;
const SLACK_TICKS: u64 = 20;

/// How many odometry messages are kept: images come later than the motion they show.
const ODOMETRY_KEPT: usize = 64;

/// Handles of the selector's ports.
pub struct Ports {
    image: Subscriber<CompressedImage>,
    odometry: Subscriber<Odometry>,
    candidates: Publisher<Detection3DArray>,
    annotated: Publisher<Image>,
}

/// The vision selector.
pub struct VisionSelector {
    ports: Ports,
    selector: Selector,
    names: Names,
    /// Stamp (ns) and pose of the tray, oldest first.
    poses: VecDeque<(u64, Isometry2<f64>)>,
    /// What was last wrong with an image, so that it is said once.
    fault: Option<LookError>,
    /// When an image came last, and how long none may come.
    seen_tick: u64,
    patience_ticks: u64,
}

/// Names of classes and frames.
struct Names {
    part: String,
    poses: Vec<String>,
    wanted_poses: Vec<usize>,
    tray_frame: String,
}

impl FeederNode for VisionSelector {
    const NAME: &'static str = "vision_selector";
    type Config = Scenario;
    type Ports = Ports;

    fn namespaces(config: &Scenario) -> Vec<String> {
        vec![config.namespace()]
    }

    fn tick(config: &Scenario) -> Duration {
        Duration::from_nanos(config.time.tick_ns())
    }

    fn declare(io: &mut Declare, _: &Scenario) -> Ports {
        Ports {
            image: io.subscriber("camera/image_raw/compressed", Latency::Forward, Qos::command()),
            odometry: io.subscriber("odometry", Latency::Forward, Qos::command()),
            candidates: io.publisher("candidates", Qos::command()),
            annotated: io.publisher("camera/annotated", Qos::sensor()),
        }
    }

    fn open(ports: Ports, config: &Scenario) -> Result<Self, NodeError> {
        let part = config.part_type().map_err(NodeError::new)?;
        let names = Names {
            poses: part.poses.iter().map(|pose| pose.name.clone()).collect(),
            wanted_poses: part.wanted_poses,
            part: part.name,
            tray_frame: format!("{}/tray", config.feeder),
        };
        let selector = config.taught_selector().map_err(NodeError::new)?;
        let period_ticks = config.camera.period_ms / config.time.tick_ms;
        Ok(Self {
            ports,
            selector,
            names,
            poses: VecDeque::new(),
            fault: None,
            seen_tick: 0,
            patience_ticks: SILENT_PERIODS * period_ticks + SLACK_TICKS,
        })
    }

    fn settable() -> &'static [Settable] {
        &[
            Settable {
                name: "selector.confidence_min",
                description: "Confidence over frames from which a part may be selected; set it where light and parts are",
                range: Some(Range::Double { from: 0.0, to: 1.0, step: 0.0 }),
            },
            Settable {
                name: "selector.part_clearance_m",
                description: "Free gap the gripper needs round a part, in metres; another gripper needs another",
                range: Some(Range::Double { from: 0.0, to: 0.1, step: 0.0 }),
            },
        ]
    }

    /// Tracks begin anew: what was seen was judged by the old thresholds.
    fn reconfigure(&mut self, config: &Scenario) {
        match config.taught_selector() {
            Ok(selector) => self.selector = selector,
            Err(error) => tracing::error!("the selector stays as it is: {error}"),
        }
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for message in io.take(&self.ports.odometry) {
            self.poses.push_back((ns_of_stamp(&message.header.stamp), planar_isometry(&message.pose.pose)));
            if self.poses.len() > ODOMETRY_KEPT {
                self.poses.pop_front();
            }
        }
        for message in io.take(&self.ports.image) {
            let seen = self.look(&message);
            let (tracked, fault) = match seen {
                Ok(picture) => {
                    if io.wanted(&self.ports.annotated) {
                        let image = self.annotate(&message.header, &picture);
                        io.publish(&self.ports.annotated, &image);
                    }
                    (picture.tracked, None)
                }
                Err(fault) => (Vec::new(), Some(fault)),
            };
            self.seen_tick = io.tick();
            self.tell(fault);
            let detections = self.names.detections(&message.header, &tracked, &self.selector);
            io.publish(&self.ports.candidates, &detections);
        }
        if io.tick() > self.seen_tick + self.patience_ticks {
            self.tell(Some(LookError::Silent));
        }
        Ok(())
    }
}

/// Why nothing is seen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
enum LookError {
    #[error("the camera has stopped: no image for {SILENT_PERIODS} periods")]
    Silent,
    #[error("no odometry at the stamp of the image")]
    NoOdometry,
    #[error("the image cannot be decoded: {0}")]
    Decode(String),
    #[error(transparent)]
    Image(#[from] ImageFault),
}

/// An image that was understood.
struct Picture {
    image: GrayImage,
    platen_from_tray: Isometry2<f64>,
    tracked: Vec<TrackedCandidate>,
}

impl VisionSelector {
    /// Says what is wrong when that changes.
    fn tell(&mut self, fault: Option<LookError>) {
        if fault == self.fault {
            return;
        }
        match &fault {
            // The tray is under way: nothing is wrong.
            None | Some(LookError::Image(ImageFault::PlateauOutOfView)) => {}
            Some(fault) => tracing::warn!("nothing is selected: {fault}"),
        }
        self.fault = fault;
    }

    fn look(&mut self, message: &CompressedImage) -> Result<Picture, LookError> {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        let (_, platen_from_tray) = *self.poses.iter().find(|(ns, _)| *ns == stamp_ns).ok_or(LookError::NoOdometry)?;
        let image = codec::decode(&message.data).map_err(|error| LookError::Decode(error.to_string()))?;
        let stamp_s = std::time::Duration::from_nanos(stamp_ns).as_secs_f64();
        let tracked = self.selector.process(stamp_s, &image, &platen_from_tray)?;
        Ok(Picture { image, platen_from_tray, tracked })
    }

    fn annotate(&self, header: &Header, picture: &Picture) -> Image {
        let drawn = draw_overlay(&picture.image, &picture.tracked, &self.selector, &picture.platen_from_tray);
        let (width, height) = drawn.dimensions();
        Image {
            header: header.clone(),
            height,
            width,
            encoding: "rgb8".to_owned(),
            is_bigendian: 0,
            step: 3 * width,
            data: drawn.into_raw(),
        }
    }
}

impl Names {
    fn detections(&self, image: &Header, tracked: &[TrackedCandidate], selector: &Selector) -> Detection3DArray {
        let header = Header { stamp: image.stamp, frame_id: self.tray_frame.clone() };
        // A track that coasts was not seen in this frame.
        let on_plateau = tracked.iter().filter(|part| part.candidate.on_plateau);
        let detections = on_plateau.map(|part| self.detection(&header, part, selector)).collect();
        Detection3DArray { header, detections }
    }

    fn detection(&self, header: &Header, part: &TrackedCandidate, selector: &Selector) -> Detection3D {
        let seen = &part.candidate;
        // A part that looks the same from all sides has no yaw of its own.
        let pose = planar_pose(seen.x_m, seen.y_m, 0.0, seen.yaw_rad.unwrap_or(0.0));
        let known = part.pose.filter(|pose| part.selectable || !self.wanted_poses.contains(pose));
        let results = known.and_then(|index| self.poses.get(index)).map(|name| {
            let class_id = format!("{}/{name}", self.part);
            let mut result = ObjectHypothesisWithPose {
                hypothesis: ObjectHypothesis { class_id, score: part.confidence },
                ..ObjectHypothesisWithPose::default()
            };
            result.pose.pose = pose;
            result
        });
        let [x, y, z] = selector.size_m(seen);
        let size = Vector3 { x, y, z };
        Detection3D {
            header: header.clone(),
            results: results.into_iter().collect(),
            bbox: BoundingBox3D { center: pose, size },
            id: part.id.to_string(),
        }
    }
}
