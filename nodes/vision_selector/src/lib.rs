//! The vision selector: finds the parts on the plateau that lie right.
//!
//! It works from the images (compressed, or raw ones where `image_transport` says so), the calibration and odometry,
//! interpolated to the image's stamp, with a model of the part that was taught from pictures (`feeder teach`). An image whose
//! stamp is ahead of odometry waits a while; one that comes a second time, or after a later one, is left out, and one that was taken
//! while the tray went from place to place shows nothing. The tray's rim and hub are looked for in each: where they lie beside where they should be, nothing is selected. Why nothing is selected
//! is said once in the log, and on `/diagnostics`; so is what contradicts the calibration, in images or in `camera_info`.
//!
//! Every part that lies wholly on the plateau is a detection, its bounding box in the tray frame, turned as the part is if
//! that has a yaw, its `id` the same from frame to frame. A detection's hypothesis names part and resting pose, as in `grommet/hole_up`, with the confidence as
//! its score; a part whose pose is not known has none. Viewers read that. Beside it goes a message with what was measured of
//! each part seen and what speaks against picking it, whatever its pose: planners read that, and add nothing but what is
//! asked of them.

mod names;
mod sight;

use std::collections::VecDeque;
use std::time::Duration;

use feeder_runtime::node::{
    Declare, FeederNode, Health, HealthLevel, NodeError, Publisher, Start, StepIo, Subscriber, ns_of_stamp,
};
use feeder_scenario::plan::{ImageTransport, NodeConfig, VisionSelectorConfig};
use feeder_vision::{ImageFault, TimedPose};
use feeder_wire::odometry::{self, EstimatedMotion};
use feeder_wire::part_candidates::ImageWorth;
use feeder_wire::{frames, nodes, topics};
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticArray;
use minifactory_msgs::msg::PartCandidates;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::{CameraInfo, CompressedImage, Image};
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use minifactory_msgs::visualization_msgs::msg::MarkerArray;

use names::Names;
use sight::{Frame, LookError, Sight, WARNINGS};

/// Frames in a row that may be missing before the camera counts as silent, and ticks that images may be under way.
pub(crate) const SILENT_PERIODS: u64 = 5;
const SLACK_TICKS: u64 = 20;

/// Between two messages on `/diagnostics`.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// Handles of the selector's ports.
pub struct Ports {
    image: ImagePort,
    info: Subscriber<CameraInfo>,
    odometry: Subscriber<Odometry>,
    candidates: Publisher<Detection3DArray>,
    part_candidates: Publisher<PartCandidates>,
    annotated: Publisher<Image>,
    markers: Publisher<MarkerArray>,
    diagnostics: Publisher<DiagnosticArray>,
}

/// Where images come from.
enum ImagePort {
    Compressed(Subscriber<CompressedImage>),
    Raw(Subscriber<Image>),
}

/// The vision selector.
pub struct VisionSelector {
    ports: Ports,
    sight: Sight,
    names: Names,
    /// Images that wait for odometry, with the time of their arrival, ns; oldest first.
    waiting: VecDeque<(u64, Frame)>,
    frames: Frames,
    diagnostics_ticks: u64,
    /// What was last wrong with an image, so that it is said once.
    fault: Option<LookError>,
    /// Which warnings were in force last, so that each is said once.
    warned: [bool; WARNINGS],
    /// When the selector became active last.
    active_tick: u64,
    /// When an image came last since then, if ever, and how long none may come.
    seen_tick: Option<u64>,
    patience_ticks: u64,
}

/// Images so far.
#[derive(Debug, Default)]
struct Frames {
    /// Looked at, or for a tray that was elsewhere; whatever was seen.
    looked_at: u64,
    /// Given up because the tray's pose was not known.
    without_pose: u64,
    /// Given up because of the image.
    without_sense: u64,
    /// Left out because they, or later ones, had been looked at before.
    again: u64,
}

impl FeederNode for VisionSelector {
    const NAME: &'static str = nodes::VISION_SELECTOR;
    const START: Option<Start> = Some(Start::Active);
    type Config = VisionSelectorConfig;
    type Ports = Ports;

    fn tick(config: &VisionSelectorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &VisionSelectorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, config: &VisionSelectorConfig) -> Ports {
        Ports {
            image: match config.image_transport {
                ImageTransport::Compressed => ImagePort::Compressed(io.subscriber(&topics::IMAGE_COMPRESSED)),
                ImageTransport::Raw => ImagePort::Raw(io.subscriber(&topics::IMAGE_RAW)),
            },
            info: io.subscriber(&topics::CAMERA_INFO),
            odometry: io.subscriber(&topics::ODOMETRY),
            candidates: io.publisher(&topics::CANDIDATES),
            part_candidates: io.publisher(&topics::PART_CANDIDATES),
            annotated: io.publisher(&topics::IMAGE_ANNOTATED),
            markers: io.publisher(&topics::CANDIDATE_MARKERS),
            diagnostics: io.publisher(&topics::DIAGNOSTICS),
        }
    }

    fn open(ports: Ports, config: &VisionSelectorConfig) -> Result<Self, NodeError> {
        let names = Names {
            poses: config.poses.clone(),
            part: config.part_class.clone(),
            tray_frame: frames::tray(&config.feeder),
            plateau_m: config.tray.geometry.rise_m,
            node: format!("/{}/{}", config.feeder, Self::NAME),
        };
        let period_ticks = config.camera_period_ms / config.tick_ms;
        Ok(Self {
            ports,
            sight: Sight::new(config).map_err(NodeError::new)?,
            names,
            waiting: VecDeque::new(),
            frames: Frames::default(),
            diagnostics_ticks: (DIAGNOSTICS_PERIOD.as_nanos() / Self::tick(config).as_nanos().max(1))
                .try_into()
                .unwrap_or(1),
            fault: None,
            warned: [false; WARNINGS],
            active_tick: 0,
            seen_tick: None,
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
        for message in io.take(&self.ports.info) {
            self.sight.hear(message);
        }
        if !io.is_active() {
            // Where the tray is stays known; what comes of the camera is dropped.
            self.waiting.clear();
            self.seen_tick = None;
            return Ok(());
        }
        if io.is_activated() {
            self.active_tick = io.tick();
        }
        let now_ns = io.now_ns();
        let arrived: Vec<Frame> = match &self.ports.image {
            ImagePort::Compressed(port) => io.take(port).into_iter().map(Frame::Compressed).collect(),
            ImagePort::Raw(port) => io.take(port).into_iter().map(Frame::Raw).collect(),
        };
        if !arrived.is_empty() {
            self.seen_tick = Some(io.tick());
        }
        self.waiting.extend(arrived.into_iter().map(|image| (now_ns, image)));
        // What comes later waits too: parts are followed in order of time.
        while let Some((_, image)) = self.waiting.pop_front_if(|(arrived_ns, image)| {
            !self.sight.awaits_odometry(image, Duration::from_nanos(now_ns.saturating_sub(*arrived_ns)))
        }) {
            self.select(io, &image);
        }
        if io.tick() > self.seen_tick.unwrap_or(self.active_tick) + self.patience_ticks {
            let why = LookError::without_image(self.seen_tick.is_some());
            self.tell(io, Some(why));
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

impl VisionSelector {
    /// Looks at an image, and tells what is on it or why nothing is.
    fn select(&mut self, io: &mut StepIo, frame: &Frame) {
        // The same look twice would make a guess look sure.
        if !self.sight.is_new(frame) {
            self.frames.again += 1;
            return;
        }
        let header = frame.header();
        let looked = self.sight.look(frame);
        let count = match &looked {
            Ok(_) | Err(LookError::UnderWay | LookError::Image(ImageFault::PlateauOutOfView)) => {
                &mut self.frames.looked_at
            }
            Err(LookError::Pose(_)) => &mut self.frames.without_pose,
            Err(_) => &mut self.frames.without_sense,
        };
        *count += 1;
        let (tracked, worth, fault) = match looked {
            Ok(picture) => {
                if io.wanted(&self.ports.annotated) {
                    let image = self.sight.annotate(header, &picture);
                    io.publish(&self.ports.annotated, &image);
                }
                (picture.tracked, self.sight.worth(), None)
            }
            Err(fault) => (Vec::new(), ImageWorth::none(fault.to_string()), Some(fault)),
        };
        self.tell(io, fault);
        let seen = self.names.seen(&tracked, &self.sight.selector);
        if io.wanted(&self.ports.markers) {
            io.publish(&self.ports.markers, &self.names.markers(header, &seen));
        }
        let (shown, told) = self.names.messages(header, &tracked, &seen, &self.sight.selector, &worth);
        io.publish(&self.ports.candidates, &shown);
        io.publish(&self.ports.part_candidates, &told);
    }

    /// Says what is wrong when that changes.
    fn tell(&mut self, io: &mut StepIo, fault: Option<LookError>) {
        let same = match (&fault, &self.fault) {
            (Some(fault), Some(last)) => fault.is_like(last),
            (None, None) => true,
            _ => false,
        };
        if let Some(fault) = fault.as_ref().filter(|fault| !same && fault.is_wrong()) {
            tracing::warn!("nothing is selected: {fault}");
        }
        self.fault = fault;
        let warnings = self.sight.warnings();
        let warned = warnings.each_ref().map(Option::is_some);
        let new = warnings.into_iter().zip(self.warned).filter(|(_, before)| !before);
        new.filter_map(|(warning, _)| warning).for_each(|warning| tracing::warn!("{warning}"));
        if !same || warned != self.warned {
            self.warned = warned;
            self.publish_diagnostics(io);
        }
    }

    fn publish_diagnostics(&self, io: &mut StepIo) {
        let fault = LookError::in_force(self.fault.as_ref(), self.seen_tick.is_some());
        let wrong = fault.filter(|fault| fault.is_wrong()).map(ToString::to_string);
        let wrong: Vec<String> = wrong.into_iter().chain(self.sight.warnings().into_iter().flatten()).collect();
        let level = if wrong.is_empty() { HealthLevel::Good } else { HealthLevel::Warning };
        let state = || fault.map_or_else(|| "selecting".to_owned(), ToString::to_string);
        let message = if wrong.is_empty() { state() } else { wrong.join("; ") };
        let value = |name: &str, value: String| (name.to_owned(), value);
        let mut values = vec![
            value("images looked at", self.frames.looked_at.to_string()),
            value("images without a pose of the tray", self.frames.without_pose.to_string()),
            value("images that make no sense", self.frames.without_sense.to_string()),
            value("images that came again or late", self.frames.again.to_string()),
        ];
        if let Some(usual) = self.sight.calibration.usual() {
            values.push(value("error of the calibration, mm", format!("{:.3}", 1e3 * usual.error_m)));
        }
        let seen = self.sight.selector.health();
        values.push(value("share of the plateau covered", format!("{:.3}", seen.covered_ratio)));
        values.push(value("share of that explained", format!("{:.2}", seen.explained_ratio)));
        values.push(value("light on the plateau against that taught", format!("{:.2}", seen.plateau_ratio)));
        let hub = seen.hub_ratio.map(|ratio| value("light on the hub against that taught", format!("{ratio:.2}")));
        values.extend(hub);
        let change = seen.light_change_ratio;
        values.extend(change.map(|change| value("change of how it falls across the plateau", format!("{change:.4}"))));
        values.push(value("share of the plateau clipped", format!("{:.3}", seen.clipped_ratio)));
        let blur = seen.blur_excess_px2.map(|excess| value("blur beyond that taught, px²", format!("{excess:.2}")));
        values.extend(blur);
        let health = Health { name: self.names.node.clone(), level, message, hardware_id: String::new(), values };
        io.publish(&self.ports.diagnostics, &health.into_message(io.header("")));
    }
}

#[cfg(test)]
mod tests;
