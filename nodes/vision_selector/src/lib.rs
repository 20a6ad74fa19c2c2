//! The vision selector: finds the parts on the plateau that lie right.
//!
//! It works from the compressed image, the calibration and the odometry at the image's stamp alone, with a model of the
//! part that was taught from pictures (`feeder teach`).
//!
//! Every part that lies wholly on the plateau is a detection, its bounding box in the tray frame, turned as the part is if
//! that has a yaw, its `id` the same from frame to frame. A detection's hypothesis names part and resting pose, as in `grommet/hole_up`, with the confidence as
//! its score; a part whose pose is not known has none. Viewers read that. Beside it goes a message with what was measured of
//! each part seen and what speaks against picking it, whatever its pose: planners read that, and add nothing but what is
//! asked of them.

use std::collections::VecDeque;
use std::time::Duration;

use feeder_runtime::node::{Declare, FeederNode, NodeError, Publisher, Settable, StepIo, Subscriber, ns_of_stamp};
use feeder_runtime::parameters::Range;
use feeder_scenario::plan::{NodeConfig, VisionSelectorConfig};
use feeder_vision::{ImageFault, Selector, TrackedCandidate, draw_overlay};
use feeder_wire::part_candidates::{self, SeenPart};
use feeder_wire::pose::{planar_isometry, planar_pose};
use feeder_wire::{nodes, topics};
use image::GrayImage;
use minifactory_msgs::geometry_msgs::msg::Vector3;
use minifactory_msgs::msg::PartCandidates;
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
    part_candidates: Publisher<PartCandidates>,
    annotated: Publisher<Image>,
}

/// The vision selector.
pub struct VisionSelector {
    ports: Ports,
    sight: Sight,
    names: Names,
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
    tray_frame: String,
}

impl FeederNode for VisionSelector {
    const NAME: &'static str = nodes::VISION_SELECTOR;
    type Config = VisionSelectorConfig;
    type Ports = Ports;

    fn tick(config: &VisionSelectorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &VisionSelectorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, _: &VisionSelectorConfig) -> Ports {
        Ports {
            image: io.subscriber(&topics::IMAGE_COMPRESSED),
            odometry: io.subscriber(&topics::ODOMETRY),
            candidates: io.publisher(&topics::CANDIDATES),
            part_candidates: io.publisher(&topics::PART_CANDIDATES),
            annotated: io.publisher(&topics::IMAGE_ANNOTATED),
        }
    }

    fn open(ports: Ports, config: &VisionSelectorConfig) -> Result<Self, NodeError> {
        let names = Names {
            poses: config.poses.clone(),
            part: config.part_class.clone(),
            tray_frame: format!("{}/tray", config.feeder),
        };
        let selector = config.selector().map_err(NodeError::new)?;
        let period_ticks = config.camera_period_ms / config.tick_ms;
        Ok(Self {
            ports,
            sight: Sight { selector, poses: VecDeque::new() },
            names,
            fault: None,
            seen_tick: 0,
            patience_ticks: SILENT_PERIODS * period_ticks + SLACK_TICKS,
        })
    }

    fn settable() -> &'static [Settable] {
        &[
            Settable {
                name: "selector.confidence_min",
                description: "Confidence over frames from which a part may be picked; set it where light and parts are",
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
    fn reconfigure(&mut self, config: &VisionSelectorConfig) {
        match config.selector() {
            Ok(selector) => self.sight.selector = selector,
            Err(error) => tracing::error!("the selector stays as it is: {error}"),
        }
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for message in io.take(&self.ports.odometry) {
            self.sight.stand(ns_of_stamp(&message.header.stamp), planar_isometry(&message.pose.pose));
        }
        for message in io.take(&self.ports.image) {
            let (tracked, fault) = match self.sight.look(&message) {
                Ok(picture) => {
                    if io.wanted(&self.ports.annotated) {
                        let image = self.sight.annotate(&message.header, &picture);
                        io.publish(&self.ports.annotated, &image);
                    }
                    (picture.tracked, None)
                }
                Err(fault) => (Vec::new(), Some(fault)),
            };
            self.seen_tick = io.tick();
            self.tell(fault);
            let detections = self.names.detections(&message.header, &tracked, &self.sight.selector);
            io.publish(&self.ports.candidates, &detections);
            let parts = self.names.part_candidates(&message.header, &tracked, &self.sight.selector);
            io.publish(&self.ports.part_candidates, &parts);
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
}

/// What turns images into parts.
struct Sight {
    selector: Selector,
    /// Stamp (ns) and pose of the tray, oldest first.
    poses: VecDeque<(u64, Isometry2<f64>)>,
}

impl Sight {
    /// The tray stands at `platen_from_tray` at this time.
    fn stand(&mut self, stamp_ns: u64, platen_from_tray: Isometry2<f64>) {
        self.poses.push_back((stamp_ns, platen_from_tray));
        if self.poses.len() > ODOMETRY_KEPT {
            self.poses.pop_front();
        }
    }

    fn look(&mut self, message: &CompressedImage) -> Result<Picture, LookError> {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        let (_, platen_from_tray) = *self.poses.iter().find(|(ns, _)| *ns == stamp_ns).ok_or(LookError::NoOdometry)?;
        let image = feeder_vision::decode(&message.data).map_err(|error| LookError::Decode(error.to_string()))?;
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
    fn header(&self, image: &Header) -> Header {
        Header { stamp: image.stamp, frame_id: self.tray_frame.clone() }
    }

    fn part_candidates(&self, image: &Header, tracked: &[TrackedCandidate], selector: &Selector) -> PartCandidates {
        let part = |part: &TrackedCandidate| SeenPart {
            id: part.id,
            position_in_tray_m: part.candidate.centre().coords,
            yaw_in_tray_rad: part.candidate.yaw_rad.unwrap_or(0.0),
            pose_class: self.pose_name(part).cloned(),
            confidence: part.confidence,
            radius_m: selector.radius_m(&part.candidate),
            part_gap_m: part.candidate.part_gap_m,
            wall_gap_m: part.candidate.wall_gap_m,
            refusals: selector.refusals(part),
        };
        let parts: Vec<SeenPart> = tracked.iter().map(part).collect();
        PartCandidates { header: self.header(image), ..part_candidates::to_message(&self.part, &parts) }
    }

    fn pose_name(&self, part: &TrackedCandidate) -> Option<&String> {
        part.pose.and_then(|pose| self.poses.get(pose))
    }

    fn detections(&self, image: &Header, tracked: &[TrackedCandidate], selector: &Selector) -> Detection3DArray {
        let header = self.header(image);
        // A track that coasts was not seen in this frame.
        let on_plateau = tracked.iter().filter(|part| part.candidate.on_plateau);
        let detections = on_plateau.map(|part| self.detection(&header, part, selector)).collect();
        Detection3DArray { header, detections }
    }

    fn detection(&self, header: &Header, part: &TrackedCandidate, selector: &Selector) -> Detection3D {
        let seen = &part.candidate;
        // A part that looks the same from all sides has no yaw of its own.
        let pose = planar_pose(seen.x_m, seen.y_m, 0.0, seen.yaw_rad.unwrap_or(0.0));
        let results = self.pose_name(part).map(|name| {
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

#[cfg(test)]
mod tests {
    use feeder_model::seed::generator;
    use feeder_runtime::node::stamp_of_ns;
    use feeder_scenario::Scenario;
    use feeder_sim::camera::codec;
    use feeder_sim::camera::{PartView, Renderer, TrayShot};
    use minifactory_msgs::msg::PartCandidate;

    use super::*;

    const FRAME_NS: u64 = 100_000_000;

    /// A sight with the tray under the camera in the frames looked at, and the compressed picture of a part on the plateau.
    fn sight() -> (Sight, Vec<u8>) {
        let scenario = Scenario::default();
        let plan = scenario.plan().unwrap();
        let (_, config) = plan.of_kind::<VisionSelectorConfig>().next().unwrap();
        let place = scenario.delivery.feeding_place;
        let platen_from_tray = Isometry2::new(place.xy(), place.z);
        let mut sight = Sight { selector: config.selector().unwrap(), poses: VecDeque::new() };
        (1..=8).for_each(|frame| sight.stand(frame * FRAME_NS, platen_from_tray));
        let part = scenario.part_type().unwrap();
        let scene = scenario.scene(&part);
        let tray = &scenario.tray.geometry;
        let radius_m = 0.5 * (tray.inner_radius_m + tray.outer_radius_m);
        let angle_rad = 0.5 * (tray.ramp_angle_rad + std::f64::consts::TAU);
        let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
        let view = PartView { x_m, y_m, z_m: tray.rise_m, pose: part.wanted_poses[0], ..PartView::default() };
        let mut image = GrayImage::default();
        let renderer = Renderer::new(&scene).unwrap();
        renderer.render(&TrayShot::still(platen_from_tray), &[view], &mut generator(1, "camera"), &mut image).unwrap();
        (sight, codec::encode(&image, codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).unwrap())
    }

    fn message(frame: u64, data: &[u8]) -> CompressedImage {
        let mut message = CompressedImage { data: data.into(), ..CompressedImage::default() };
        message.header.stamp = stamp_of_ns(frame * FRAME_NS);
        message
    }

    #[test]
    fn a_corrupt_image_is_named_and_the_next_good_one_is_seen() {
        let (mut sight, good) = sight();
        assert_eq!(sight.look(&message(1, &good)).unwrap().tracked.len(), 1);
        let noise: Vec<u8> = good.iter().map(|byte| byte.wrapping_mul(31).wrapping_add(7)).collect();
        for (frame, bad) in [(2, &[][..]), (3, &good[..100]), (4, &noise[..]), (5, b"not an image")] {
            let fault = sight.look(&message(frame, bad)).map(|picture| picture.tracked).unwrap_err();
            assert!(matches!(fault, LookError::Decode(_)), "{fault}");
        }
        // Half of it may decode: then the rest is grey, and whatever is seen is seen in what came.
        let _ = sight.look(&message(6, &good[..good.len() / 2]));
        assert_eq!(sight.look(&message(7, &good)).unwrap().tracked.len(), 1);
    }

    #[test]
    fn an_image_of_another_camera_is_a_fault_with_both_sizes() {
        let (mut sight, _) = sight();
        let small = codec::encode(&GrayImage::new(320, 240), codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).unwrap();
        let fault = sight.look(&message(1, &small)).map(|picture| picture.tracked).unwrap_err();
        assert_eq!(fault.to_string(), "the image has (320, 240) px; the camera has (640, 480) px");
    }

    #[test]
    fn an_image_from_a_time_without_odometry_selects_nothing() {
        let (mut sight, good) = sight();
        let fault = sight.look(&message(9, &good)).map(|picture| picture.tracked).unwrap_err();
        assert_eq!(fault, LookError::NoOdometry);
    }

    #[test]
    fn both_messages_tell_of_the_same_parts_and_one_of_what_speaks_against_them() {
        let (mut sight, good) = sight();
        let part = Scenario::default().part_type().unwrap();
        let poses = part.poses.iter().map(|pose| pose.name.clone()).collect();
        let names = Names { part: part.name.clone(), poses, tray_frame: "feeder/tray".to_owned() };
        for frame in 1..=8 {
            let message = message(frame, &good);
            let tracked = sight.look(&message).unwrap().tracked;
            let header = message.header;
            let told = names.part_candidates(&header, &tracked, &sight.selector);
            let shown = names.detections(&header, &tracked, &sight.selector);
            assert_eq!((&told.header, told.parts.len()), (&shown.header, 1));
            assert_eq!(told.parts[0].id.to_string(), shown.detections[0].id);
            // A first look alone is not sure enough; eight are.
            match frame {
                1 => assert_eq!(told.parts[0].refusals, PartCandidate::POSE_UNSURE, "{told:?}"),
                8 => assert_eq!(told.parts[0].refusals, 0, "{told:?}"),
                _ => {}
            }
        }
    }
}
