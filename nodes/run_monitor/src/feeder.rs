//! What the monitor hears of one feeder, and tells of its score.

use std::fmt::Display;

use feeder_model::part::PartType;
use feeder_runtime::node::{Declare, Publisher, StepIo, Subscriber, ns_of_stamp};
use feeder_scenario::plan::RunMonitorConfig;
use feeder_wire::pick::GripperClosed;
use feeder_wire::{courier_state, delivery_state, odometry, part_candidates, parts, pick, topics, tray_motion};
use minifactory_msgs::msg::{
    CourierState, DeliveryState, FeedMetrics, PartCandidates, PartStates, PickEvent, RunProgress, TrayMotion,
};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::Vector2;

use crate::progress::FeederProgress;
use crate::score::FeederScore;
use crate::whereabouts::Whereabouts;

/// Handles of the ports for one feeder.
pub(crate) struct Ports {
    parts: Subscriber<PartStates>,
    part_candidates: Subscriber<PartCandidates>,
    delivery: Subscriber<DeliveryState>,
    picks: Subscriber<PickEvent>,
    motion: Subscriber<TrayMotion>,
    odometry: Subscriber<Odometry>,
    courier: Subscriber<CourierState>,
    progress: Publisher<RunProgress>,
    metrics: Publisher<FeedMetrics>,
}

impl Ports {
    pub(crate) fn declare(io: &mut Declare, feeder: &str) -> Self {
        let namespace = format!("/{feeder}");
        Self {
            parts: io.subscriber_in(&namespace, &topics::PARTS),
            part_candidates: io.subscriber_in(&namespace, &topics::PART_CANDIDATES),
            delivery: io.subscriber_in(&namespace, &topics::DELIVERY_STATE),
            picks: io.subscriber_in(&namespace, &topics::PICKS),
            motion: io.subscriber_in(&namespace, &topics::TRAY_MOTION),
            odometry: io.subscriber_in(&namespace, &topics::ODOMETRY),
            courier: io.subscriber_in(&namespace, &topics::COURIER_STATE),
            progress: io.publisher_in(&namespace, &topics::PROGRESS),
            metrics: io.publisher_in(&namespace, &topics::FEED_METRICS),
        }
    }
}

/// Watches one feeder.
pub(crate) struct FeederMonitor {
    ports: Ports,
    whereabouts: Whereabouts,
    score: FeederScore,
}

impl FeederMonitor {
    pub(crate) fn new(ports: Ports, feeder: &str, config: &RunMonitorConfig, part: &PartType) -> Self {
        Self { ports, whereabouts: Whereabouts::default(), score: FeederScore::new(feeder, config, part) }
    }

    /// How the feeder has done.
    pub(crate) fn progress(&self) -> &FeederProgress {
        &self.score.progress
    }

    pub(crate) fn hear(&mut self, io: &mut StepIo) {
        self.locate(io);
        let closed: Vec<GripperClosed> = io.take(&self.ports.picks).into_iter().map(pick::from_event).collect();
        closed.iter().filter_map(|closed| closed.taken).for_each(|part| self.score.note_taken(&part));
        for message in io.take(&self.ports.parts) {
            let stamp = message.header.stamp;
            let Some(truth) = understood("parts", parts::from_message(message)) else { continue };
            if self.score.learn(ns_of_stamp(&stamp), &truth) {
                let header = Header { stamp, frame_id: String::new() };
                io.publish(&self.ports.metrics, &self.score.progress.feed.message(header));
            }
        }
        for message in io.take(&self.ports.part_candidates) {
            let Some(seen) = understood("part_candidates", part_candidates::from_message(&message)) else { continue };
            self.score.hear_selector(ns_of_stamp(&message.header.stamp), &seen);
        }
        for message in io.take(&self.ports.delivery) {
            let stamp_ns = ns_of_stamp(&message.header.stamp);
            let Some(stand) = understood("delivery_state", delivery_state::from_message(message)) else { continue };
            self.score.hear_planner(stamp_ns, &stand);
        }
        let by_grippers = closed.iter().filter(|closed| closed.station.is_some());
        by_grippers.filter_map(|closed| closed.taken).for_each(|part| self.score.score_pick(&part));
    }

    /// Where the courier's centre truly is on the platen, m.
    pub(crate) fn place_m(&self) -> Option<Vector2<f64>> {
        self.whereabouts.truth.map(|position| position.xy())
    }

    /// Compares what the driver says of its courier with the truth.
    fn locate(&mut self, io: &mut StepIo) {
        for message in io.take(&self.ports.odometry) {
            let position = odometry::from_message(&message).position;
            self.whereabouts.say(ns_of_stamp(&message.header.stamp), position);
        }
        for message in io.take(&self.ports.motion) {
            // A block begins at its stamp.
            let block = understood("tray_motion", tray_motion::from_message(&message));
            if let Some(first) = block.as_ref().and_then(|block| block.samples.first()) {
                self.whereabouts.learn(ns_of_stamp(&message.header.stamp), first.position);
            }
        }
        for message in io.take(&self.ports.courier) {
            let activity = courier_state::from_message(message);
            self.whereabouts.score.hear(activity.position_error_m, activity.yaw_error_rad);
        }
        self.score.progress.odometry = self.whereabouts.score;
    }

    pub(crate) fn publish(&self, io: &mut StepIo) {
        let message = self.progress().message(io.header(""));
        io.publish(&self.ports.progress, &message);
    }
}

/// What a message says, if it can be understood.
fn understood<T>(topic: &str, said: Result<T, impl Display>) -> Option<T> {
    said.inspect_err(|error| tracing::warn!("{topic} passed over: {error}")).ok()
}
