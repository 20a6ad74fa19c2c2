//! The run monitor: scores a run against ground truth. It is the only node besides viewers that hears the truth, and
//! nobody in the feeder hears what it finds.

mod feed;
mod truth;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use feeder_core::scenario::Scenario;
use feeder_runtime::dds::Qos;
use feeder_runtime::node::{Declare, FeederNode, Latency, NodeError, Publisher, StepIo, Subscriber, ns_of_stamp};
use minifactory_msgs::msg::{DeliveryState, FeedMetrics, PartStates, PickEvent, RunProgress};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use nalgebra::Vector2;

pub use feed::Feed;
use feed::FeedScore;
use truth::Truth;

/// Ticks between progress messages.
const PROGRESS_TICKS: u64 = 10;

/// Time between messages on how well the feeder feeds, ns.
const METRICS_NS: u64 = 1_000_000_000;

/// How a run has gone so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Progress {
    /// Entries to the plateau.
    pub fed: u32,
    /// Parts that the selector saw.
    pub seen: BTreeSet<u32>,
    /// Parts that the selector called right.
    pub selected: BTreeSet<u32>,
    /// Parts picked.
    pub delivered: u32,
    /// Parts picked in another pose than the wanted one.
    pub wrong_pose_delivered: u32,
    /// Largest displacement in the tray frame of a delivered part between settled and picked, m.
    pub max_slip_m: f64,
    /// How well the feeder feeds and the selector selects.
    pub feed: Feed,
    /// The same at every second of simulated time: stamp (s) and figures.
    pub history: Arc<Vec<(f64, Feed)>>,
}

/// Handles of the monitor's ports.
pub struct Ports {
    parts: Subscriber<PartStates>,
    candidates: Subscriber<Detection3DArray>,
    delivery: Subscriber<DeliveryState>,
    picks: Subscriber<PickEvent>,
    progress: Publisher<RunProgress>,
    metrics: Publisher<FeedMetrics>,
}

/// The run monitor.
pub struct RunMonitor {
    ports: Ports,
    wanted_classes: Vec<String>,
    wanted_poses: Vec<u8>,
    part_radius_m: f64,
    goal_delivered: Option<u32>,
    truth: Truth,
    score: FeedScore,
    /// When the next message on how well the feeder feeds is due, ns.
    metrics_ns: u64,
    progress: Progress,
    shown: Option<Arc<Mutex<Progress>>>,
}

impl FeederNode for RunMonitor {
    const NAME: &'static str = "run_monitor";
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
            parts: io.subscriber("parts", Latency::Forward, Qos::sensor()),
            candidates: io.subscriber("candidates", Latency::Forward, Qos::command()),
            delivery: io.subscriber("delivery_state", Latency::Forward, Qos::command()),
            picks: io.subscriber("picks", Latency::Forward, Qos::command()),
            progress: io.publisher("progress", Qos::command()),
            metrics: io.publisher("feed_metrics", Qos::command()),
        }
    }

    fn open(ports: Ports, config: &Scenario) -> Result<Self, NodeError> {
        Self::new(ports, config)
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for message in io.take(&self.ports.parts) {
            self.progress.fed = message.fed;
            self.truth.learn(&message);
            let stamp_ns = ns_of_stamp(&message.header.stamp);
            let time_s = Duration::from_nanos(stamp_ns).as_secs_f64();
            self.score.learn(time_s, &message);
            if stamp_ns >= self.metrics_ns {
                self.metrics_ns += METRICS_NS;
                self.progress.feed = self.score.feed();
                Arc::make_mut(&mut self.progress.history).push((time_s, self.progress.feed.clone()));
                let header = Header { stamp: message.header.stamp, frame_id: String::new() };
                io.publish(&self.ports.metrics, &self.progress.feed.message(header));
            }
        }
        for message in io.take(&self.ports.candidates) {
            self.score_candidates(&message);
        }
        for message in io.take(&self.ports.delivery) {
            self.truth.settle(ns_of_stamp(&message.look_stamp));
        }
        for event in io.take(&self.ports.picks) {
            self.score_pick(&event);
        }
        if let Some(shown) = &self.shown {
            shown.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&self.progress);
        }
        if io.tick().is_multiple_of(PROGRESS_TICKS) {
            io.publish(&self.ports.progress, &self.message(io));
        }
        if self.goal_delivered.is_some_and(|goal| self.progress.delivered >= goal) {
            io.reach_goal();
        }
        Ok(())
    }
}

impl RunMonitor {
    /// A monitor that also shows its findings in `shown`.
    ///
    /// # Errors
    /// If the scenario has no part.
    pub fn watched(ports: Ports, config: &Scenario, shown: Arc<Mutex<Progress>>) -> Result<Self, NodeError> {
        Ok(Self { shown: Some(shown), ..Self::new(ports, config)? })
    }

    fn new(ports: Ports, config: &Scenario) -> Result<Self, NodeError> {
        let part = config.part_type().map_err(NodeError::new)?;
        Ok(Self {
            ports,
            wanted_classes: part.wanted_pose_names().map(|pose| format!("{}/{pose}", part.name)).collect(),
            wanted_poses: part.wanted_poses.iter().filter_map(|&pose| u8::try_from(pose).ok()).collect(),
            part_radius_m: part.outline_radius_m(),
            goal_delivered: config.run.goal_delivered,
            score: FeedScore::new(config.tray.geometry, &part),
            metrics_ns: METRICS_NS,
            truth: Truth::default(),
            progress: Progress::default(),
            shown: None,
        })
    }

    /// Finds out which parts the selector meant, by where they were when the picture was taken.
    fn score_candidates(&mut self, message: &Detection3DArray) {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        for detection in &message.detections {
            let center = &detection.bbox.center.position;
            let center = Vector2::new(center.x, center.y);
            let part = self.truth.part_at(stamp_ns, &center, self.part_radius_m);
            let called_right =
                detection.results.iter().any(|result| self.wanted_classes.contains(&result.hypothesis.class_id));
            if called_right && self.truth.knows(stamp_ns) {
                self.score.selected(part);
            }
            let Some((id, _)) = part else { continue };
            self.progress.seen.insert(id);
            if called_right {
                self.progress.selected.insert(id);
            }
        }
    }

    fn score_pick(&mut self, event: &PickEvent) {
        if event.picked {
            self.progress.delivered += 1;
            self.progress.wrong_pose_delivered += u32::from(!self.wanted_poses.contains(&event.resting_pose));
            self.progress.max_slip_m = self.truth.slip_m(event.part_id).max(self.progress.max_slip_m);
        }
    }

    fn message(&self, io: &StepIo) -> RunProgress {
        let count = |set: &BTreeSet<u32>| u32::try_from(set.len()).unwrap_or(u32::MAX);
        RunProgress {
            header: io.header(""),
            fed: self.progress.fed,
            seen: count(&self.progress.seen),
            selected: count(&self.progress.selected),
            delivered: self.progress.delivered,
            wrong_pose_delivered: self.progress.wrong_pose_delivered,
            max_slip_m: self.progress.max_slip_m,
        }
    }
}
