//! The vision selector: finds the parts on the plateau that lie right.
//!
//! It works from the compressed image, the calibration and odometry, interpolated to the image's stamp, with a model of the
//! part that was taught from pictures (`feeder teach`). An image whose stamp is ahead of odometry waits a while. Why nothing
//! is selected is said once in the log, and on `/diagnostics`.
//!
//! Every part that lies wholly on the plateau is a detection, its bounding box in the tray frame, turned as the part is if
//! that has a yaw, its `id` the same from frame to frame. A detection's hypothesis names part and resting pose, as in `grommet/hole_up`, with the confidence as
//! its score; a part whose pose is not known has none. Viewers read that. Beside it goes a message with what was measured of
//! each part seen and what speaks against picking it, whatever its pose: planners read that, and add nothing but what is
//! asked of them.

use std::collections::VecDeque;
use std::time::Duration;

use feeder_runtime::node::{
    Declare, FeederNode, Health, HealthLevel, NodeError, Publisher, StepIo, Subscriber, ns_of_stamp,
};
use feeder_scenario::plan::{NodeConfig, VisionSelectorConfig};
use feeder_vision::{ImageFault, NoPose, PoseHistory, Selector, TimedPose, TrackedCandidate, draw_overlay};
use feeder_wire::odometry::{self, EstimatedMotion};
use feeder_wire::part_candidates::{self, SeenPart};
use feeder_wire::pictures::{self, Encoding};
use feeder_wire::{detections, frames, nodes, topics};
use image::GrayImage;
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticArray;
use minifactory_msgs::msg::PartCandidates;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::{CompressedImage, Image};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use nalgebra::Isometry2;

/// Frames in a row that may be missing before the camera counts as silent, and ticks that images may be under way.
const SILENT_PERIODS: u64 = 5;
const SLACK_TICKS: u64 = 20;

/// Between two messages on `/diagnostics`.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// Handles of the selector's ports.
pub struct Ports {
    image: Subscriber<CompressedImage>,
    odometry: Subscriber<Odometry>,
    candidates: Publisher<Detection3DArray>,
    part_candidates: Publisher<PartCandidates>,
    annotated: Publisher<Image>,
    diagnostics: Publisher<DiagnosticArray>,
}

/// The vision selector.
pub struct VisionSelector {
    ports: Ports,
    sight: Sight,
    names: Names,
    /// Images that wait for odometry, with the time of their arrival, ns; oldest first.
    waiting: VecDeque<(u64, CompressedImage)>,
    frames: Frames,
    diagnostics_ticks: u64,
    /// What was last wrong with an image, so that it is said once.
    fault: Option<LookError>,
    /// When an image came last, and how long none may come.
    seen_tick: u64,
    patience_ticks: u64,
}

/// Images so far.
#[derive(Debug, Default)]
struct Frames {
    /// Looked at, whatever was seen.
    looked_at: u64,
    /// Given up because the tray's pose was not known.
    without_pose: u64,
    /// Given up because of the image.
    without_sense: u64,
}

/// Names of classes and frames.
struct Names {
    part: String,
    poses: Vec<String>,
    tray_frame: String,
    node: String,
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
            diagnostics: io.publisher(&topics::DIAGNOSTICS),
        }
    }

    fn open(ports: Ports, config: &VisionSelectorConfig) -> Result<Self, NodeError> {
        let names = Names {
            poses: config.poses.clone(),
            part: config.part_class.clone(),
            tray_frame: frames::tray(&config.feeder),
            node: format!("/{}/{}", config.feeder, Self::NAME),
        };
        let selector = config.selector().map_err(NodeError::new)?;
        let period_ticks = config.camera_period_ms / config.tick_ms;
        Ok(Self {
            ports,
            sight: Sight { selector, poses: PoseHistory::new(config.selector.odometry) },
            names,
            waiting: VecDeque::new(),
            frames: Frames::default(),
            diagnostics_ticks: (DIAGNOSTICS_PERIOD.as_nanos() / Self::tick(config).as_nanos().max(1))
                .try_into()
                .unwrap_or(1),
            fault: None,
            seen_tick: 0,
            patience_ticks: SILENT_PERIODS * period_ticks + SLACK_TICKS,
        })
    }

    fn settable() -> &'static [&'static str] {
        &["selector.confidence_min", "selector.part_clearance_m"]
    }

    /// Tracks begin anew: what was seen was judged by the old thresholds.
    fn reconfigure(&mut self, config: &VisionSelectorConfig) {
        match config.selector() {
            Ok(selector) => self.sight.selector = selector,
            Err(error) => tracing::error!("the selector stays as it is: {error}"),
        }
    }

    fn not_parameters() -> &'static [&'static str] {
        &["part_model"]
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for message in io.take(&self.ports.odometry) {
            self.sight.poses.note(timed_pose(&message));
        }
        let now_ns = io.now_ns();
        let arrived = io.take(&self.ports.image);
        if !arrived.is_empty() {
            self.seen_tick = io.tick();
        }
        self.waiting.extend(arrived.into_iter().map(|image| (now_ns, image)));
        // What comes later waits too: parts are followed in order of time.
        while let Some((_, image)) = self.waiting.pop_front_if(|(arrived_ns, image)| {
            !self.sight.awaits_odometry(image, Duration::from_nanos(now_ns.saturating_sub(*arrived_ns)))
        }) {
            self.select(io, &image);
        }
        if io.tick() > self.seen_tick + self.patience_ticks {
            self.tell(io, Some(LookError::Silent));
        }
        if io.tick().is_multiple_of(self.diagnostics_ticks.max(1)) {
            self.publish_diagnostics(io);
        }
        Ok(())
    }
}

/// Odometry as the history takes it.
fn timed_pose(message: &Odometry) -> TimedPose {
    let EstimatedMotion { position, velocity, .. } = odometry::from_message(message);
    TimedPose { stamp_ns: ns_of_stamp(&message.header.stamp), position, velocity }
}

/// Why nothing is seen.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
enum LookError {
    #[error("the camera has stopped: no image for {SILENT_PERIODS} periods")]
    Silent,
    #[error(transparent)]
    Pose(#[from] NoPose),
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
    /// Looks at an image, and tells what is on it or why nothing is.
    fn select(&mut self, io: &mut StepIo, message: &CompressedImage) {
        let looked = self.sight.look(message);
        let count = match &looked {
            Ok(_) | Err(LookError::Image(ImageFault::PlateauOutOfView)) => &mut self.frames.looked_at,
            Err(LookError::Pose(_)) => &mut self.frames.without_pose,
            Err(_) => &mut self.frames.without_sense,
        };
        *count += 1;
        let (tracked, fault) = match looked {
            Ok(picture) => {
                if io.wanted(&self.ports.annotated) {
                    let image = self.sight.annotate(&message.header, &picture);
                    io.publish(&self.ports.annotated, &image);
                }
                (picture.tracked, None)
            }
            Err(fault) => (Vec::new(), Some(fault)),
        };
        self.tell(io, fault);
        let (shown, told) = self.names.messages(&message.header, &tracked, &self.sight.selector);
        io.publish(&self.ports.candidates, &shown);
        io.publish(&self.ports.part_candidates, &told);
    }

    /// Says what is wrong when that changes.
    fn tell(&mut self, io: &mut StepIo, fault: Option<LookError>) {
        if fault == self.fault {
            return;
        }
        if let Some(fault) = fault.as_ref().filter(|fault| fault.is_wrong()) {
            tracing::warn!("nothing is selected: {fault}");
        }
        self.fault = fault;
        self.publish_diagnostics(io);
    }

    fn publish_diagnostics(&self, io: &mut StepIo) {
        let level = match &self.fault {
            Some(fault) if fault.is_wrong() => HealthLevel::Warning,
            _ => HealthLevel::Good,
        };
        let message = self.fault.as_ref().map_or_else(|| "selecting".to_owned(), ToString::to_string);
        let values = [
            ("images looked at", self.frames.looked_at),
            ("images without a pose of the tray", self.frames.without_pose),
            ("images that make no sense", self.frames.without_sense),
        ];
        let values = values.map(|(name, count)| (name.to_owned(), count.to_string())).to_vec();
        let health = Health { name: self.names.node.clone(), level, message, hardware_id: String::new(), values };
        io.publish(&self.ports.diagnostics, &health.into_message(io.header("")));
    }
}

impl LookError {
    /// Whether something is wrong, and the tray is not just under way.
    fn is_wrong(&self) -> bool {
        !matches!(self, Self::Image(ImageFault::PlateauOutOfView))
    }
}

/// What turns images into parts.
struct Sight {
    selector: Selector,
    poses: PoseHistory,
}

impl Sight {
    /// Whether odometry that is still to come may tell where the tray stood, after the image has waited for so long.
    fn awaits_odometry(&self, message: &CompressedImage, waited: Duration) -> bool {
        let may_come =
            matches!(self.poses.at(ns_of_stamp(&message.header.stamp)), Err(NoPose::NoOdometry | NoPose::Ahead));
        may_come && waited.as_secs_f64() < self.poses.config().wait_s_max
    }

    fn look(&mut self, message: &CompressedImage) -> Result<Picture, LookError> {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        let platen_from_tray = self.poses.at(stamp_ns)?;
        let image = feeder_vision::decode(&message.data).map_err(|error| LookError::Decode(error.to_string()))?;
        let stamp_s = Duration::from_nanos(stamp_ns).as_secs_f64();
        let tracked = self.selector.process(stamp_s, &image, &platen_from_tray)?;
        Ok(Picture { image, platen_from_tray, tracked })
    }

    fn annotate(&self, header: &Header, picture: &Picture) -> Image {
        let drawn = draw_overlay(&picture.image, &picture.tracked, &self.selector, &picture.platen_from_tray);
        pictures::to_image(header.clone(), Encoding::Rgb, drawn.dimensions(), drawn.into_raw())
    }
}

impl Names {
    /// What was seen, for viewers and for planners.
    fn messages(
        &self,
        image: &Header,
        tracked: &[TrackedCandidate],
        selector: &Selector,
    ) -> (Detection3DArray, PartCandidates) {
        let header = Header { stamp: image.stamp, frame_id: self.tray_frame.clone() };
        let parts: Vec<SeenPart> = tracked.iter().map(|part| self.seen_part(part, selector)).collect();
        let sizes_m = tracked.iter().map(|part| selector.size_m(&part.candidate));
        let on_plateau = parts.iter().zip(sizes_m).filter(|(part, _)| !part.refusals.off_plateau);
        let shown = detections::to_message(&header, &self.part, on_plateau);
        (shown, PartCandidates { header, ..part_candidates::to_message(&self.part, &parts) })
    }

    fn seen_part(&self, part: &TrackedCandidate, selector: &Selector) -> SeenPart {
        SeenPart {
            id: part.id,
            position_in_tray_m: part.candidate.centre().coords,
            yaw_in_tray_rad: part.candidate.yaw_rad.unwrap_or(0.0),
            pose_class: part.pose.and_then(|pose| self.poses.get(pose)).cloned(),
            confidence: part.confidence,
            radius_m: selector.radius_m(&part.candidate),
            part_gap_m: part.candidate.part_gap_m,
            wall_gap_m: part.candidate.wall_gap_m,
            refusals: selector.refusals(part),
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

    use nalgebra::Vector3 as Vector;

    use super::*;

    const FRAME_NS: u64 = 80_000_000;

    /// A sight with the tray under the camera in the frames looked at, and the compressed picture of a part on the plateau.
    fn sight() -> (Sight, Vec<u8>) {
        let scenario = Scenario::default();
        let plan = scenario.plan().unwrap();
        let (_, config) = plan.of_kind::<VisionSelectorConfig>().next().unwrap();
        let place = scenario.delivery.feeding_place;
        let platen_from_tray = Isometry2::new(place.xy(), place.z);
        let poses = PoseHistory::new(config.selector.odometry);
        let mut sight = Sight { selector: config.selector().unwrap(), poses };
        (1..=8).for_each(|frame| sight.poses.note(standing(frame * FRAME_NS)));
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

    /// The tray at its feeding place.
    fn standing(stamp_ns: u64) -> TimedPose {
        let place = Scenario::default().delivery.feeding_place;
        TimedPose { stamp_ns, position: Vector::new(place.x, place.y, place.z), velocity: Vector::zeros() }
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
    fn an_image_between_two_odometry_messages_is_looked_at() {
        let (mut sight, good) = sight();
        sight.poses.note(standing(8 * FRAME_NS + 10_000_000));
        let mut between = message(8, &good);
        between.header.stamp = stamp_of_ns(8 * FRAME_NS + 3_000_000);
        assert_eq!(sight.look(&between).unwrap().tracked.len(), 1);
    }

    #[test]
    fn an_image_ahead_of_odometry_waits_for_so_long_and_one_that_is_too_old_does_not() {
        let (mut sight, good) = sight();
        let ahead = message(9, &good);
        assert!(sight.awaits_odometry(&ahead, Duration::from_millis(90)));
        assert!(!sight.awaits_odometry(&ahead, Duration::from_millis(100)));
        let fault = sight.look(&ahead).map(|picture| picture.tracked).unwrap_err();
        assert_eq!(fault, LookError::Pose(NoPose::Ahead));
        let old = message(0, &good);
        assert!(!sight.awaits_odometry(&old, Duration::ZERO));
        let fault = sight.look(&old).map(|picture| picture.tracked).unwrap_err();
        assert_eq!(fault, LookError::Pose(NoPose::TooOld));
        // The gap of 80 ms between two messages is longer than is interpolated across.
        let mut between = message(7, &good);
        between.header.stamp = stamp_of_ns(7 * FRAME_NS + 1);
        let fault = sight.look(&between).map(|picture| picture.tracked).unwrap_err();
        assert_eq!(fault, LookError::Pose(NoPose::Gap));
    }

    #[test]
    fn both_messages_tell_of_the_same_parts_and_one_of_what_speaks_against_them() {
        let (mut sight, good) = sight();
        let part = Scenario::default().part_type().unwrap();
        let poses = part.poses.iter().map(|pose| pose.name.clone()).collect();
        let names = Names { part: part.name.clone(), poses, tray_frame: "feeder/tray".to_owned(), node: String::new() };
        for frame in 1..=8 {
            let message = message(frame, &good);
            let tracked = sight.look(&message).unwrap().tracked;
            let header = message.header;
            let (shown, told) = names.messages(&header, &tracked, &sight.selector);
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
