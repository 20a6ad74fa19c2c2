//! The score of one feeder, by ground truth.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use feeder_model::delivery::Phase;
use feeder_model::part::PartType;
use feeder_runtime::node::{Declare, Publisher, StepIo, Subscriber, ns_of_stamp};
use feeder_scenario::plan::RunMonitorConfig;
use feeder_wire::delivery_state::PlannerStand;
use feeder_wire::part_candidates::SeenPart;
use feeder_wire::parts::TrueParts;
use feeder_wire::pick::TakenPart;
use feeder_wire::{courier_state, delivery_state, odometry, part_candidates, parts, pick, topics, tray_motion};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::msg::{
    CourierState, DeliveryState, FeedMetrics, PartCandidates, PartStates, PickEvent, RunProgress, TrayMotion,
};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::Vector2;

use crate::feed::FeedScore;
use crate::progress::{Activity, FeederProgress};
use crate::truth::Truth;
use crate::whereabouts::Whereabouts;

/// Time between messages on how well the feeder feeds, ns.
const METRICS_NS: u64 = 1_000_000_000;

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

/// Scores one feeder.
pub(crate) struct FeederMonitor {
    ports: Ports,
    wanted_pose_names: Vec<String>,
    wanted_poses: Vec<u8>,
    part_radius_m: f64,
    truth: Truth,
    whereabouts: Whereabouts,
    score: FeedScore,
    /// When the next message on how well the feeder feeds is due, ns.
    metrics_ns: u64,
    /// Parts in the feeder, and those that were picked.
    present: BTreeSet<u32>,
    picked: BTreeSet<u32>,
    /// What the planner does, and since when, ns.
    activity: (Activity, u64),
    pub(crate) progress: FeederProgress,
}

impl FeederMonitor {
    pub(crate) fn new(ports: Ports, feeder: &str, config: &RunMonitorConfig, part: &PartType) -> Self {
        Self {
            ports,
            wanted_pose_names: part.wanted_pose_names().map(str::to_owned).collect(),
            wanted_poses: part.wanted_poses.iter().filter_map(|&pose| u8::try_from(pose).ok()).collect(),
            part_radius_m: part.outline_radius_m(),
            truth: Truth::default(),
            whereabouts: Whereabouts::default(),
            score: FeedScore::new(config.tray, part),
            metrics_ns: METRICS_NS,
            present: BTreeSet::new(),
            picked: BTreeSet::new(),
            activity: (Activity::Idle, 0),
            progress: FeederProgress { name: feeder.to_owned(), ..FeederProgress::default() },
        }
    }

    pub(crate) fn hear(&mut self, io: &mut StepIo) {
        self.locate(io);
        let taken: Vec<TakenPart> =
            io.take(&self.ports.picks).into_iter().filter_map(|message| pick::from_event(message).taken).collect();
        for part in &taken {
            self.progress.parts_doubled += u32::from(!self.picked.insert(part.id));
        }
        for message in io.take(&self.ports.parts) {
            let stamp = message.header.stamp;
            let Some(truth) = understood("parts", parts::from_message(message)) else { continue };
            self.progress.fed = truth.fed;
            self.count(&truth);
            self.truth.learn(ns_of_stamp(&stamp), &truth.parts);
            self.score_feed(io, stamp, &truth);
        }
        for message in io.take(&self.ports.part_candidates) {
            let Some(seen) = understood("part_candidates", part_candidates::from_message(&message)) else { continue };
            self.score_candidates(ns_of_stamp(&message.header.stamp), &seen);
        }
        for message in io.take(&self.ports.delivery) {
            let stamp_ns = ns_of_stamp(&message.header.stamp);
            let Some(stand) = understood("delivery_state", delivery_state::from_message(message)) else { continue };
            if let Some(chosen) = &stand.chosen {
                self.truth.settle(u64::try_from(chosen.look.as_nanos()).unwrap_or(u64::MAX));
            }
            self.spend(stamp_ns, &stand);
        }
        for part in &taken {
            self.score_pick(part);
        }
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
        self.progress.odometry = self.whereabouts.score;
    }

    pub(crate) fn publish(&self, io: &mut StepIo) {
        let message = self.message(io);
        io.publish(&self.ports.progress, &message);
    }

    /// Scores what the tray feeds, and tells it once a second.
    fn score_feed(&mut self, io: &mut StepIo, stamp: Time, truth: &TrueParts) {
        let stamp_ns = ns_of_stamp(&stamp);
        let time_s = Duration::from_nanos(stamp_ns).as_secs_f64();
        self.score.learn(time_s, truth);
        if stamp_ns >= self.metrics_ns {
            self.metrics_ns += METRICS_NS;
            self.progress.feed = self.score.feed();
            Arc::make_mut(&mut self.progress.history).push((time_s, self.progress.feed.clone()));
            let header = Header { stamp, frame_id: String::new() };
            io.publish(&self.ports.metrics, &self.progress.feed.message(header));
        }
    }

    /// Looks for parts that are gone without a pick, or back after one.
    fn count(&mut self, truth: &TrueParts) {
        let present: BTreeSet<u32> = truth.parts.iter().map(|part| part.id).collect();
        let count = |parts: usize| u32::try_from(parts).unwrap_or(u32::MAX);
        let gone = self.present.difference(&present).filter(|id| !self.picked.contains(id)).count();
        let back = present.difference(&self.present).filter(|id| self.picked.contains(id)).count();
        self.progress.parts_lost += count(gone);
        self.progress.parts_doubled += count(back);
        self.present = present;
    }

    fn spend(&mut self, stamp_ns: u64, stand: &PlannerStand) {
        let (activity, since_ns) = self.activity;
        let spent_s = Duration::from_nanos(stamp_ns.saturating_sub(since_ns)).as_secs_f64();
        *self.progress.spent_s.entry(activity).or_insert(0.0) += spent_s;
        self.activity = (activity_of(stand.phase), stamp_ns);
        self.progress.accepted = stand.accepted;
        self.progress.succeeded = stand.delivered;
        self.progress.failed_by_outcome = stand.failed_by_outcome.to_vec();
    }

    /// Finds out which parts the selector meant, by where they were when the picture was taken.
    fn score_candidates(&mut self, stamp_ns: u64, seen: &[SeenPart]) {
        for seen in seen.iter().filter(|part| !part.refusals.off_plateau) {
            let part = self.truth.part_at(stamp_ns, &seen.position_in_tray_m, self.part_radius_m);
            let is_wanted = seen.pose_class.as_ref().is_some_and(|pose| self.wanted_pose_names.contains(pose));
            let called_right = seen.refusals.may_be_picked() && is_wanted;
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

    fn score_pick(&mut self, part: &TakenPart) {
        self.progress.delivered += 1;
        self.progress.wrong_pose_delivered += u32::from(!self.wanted_poses.contains(&part.resting_pose));
        match self.truth.slip_m(part.id) {
            Some(slip_m) => {
                self.progress.max_slip_m = Some(self.progress.max_slip_m.map_or(slip_m, |most| most.max(slip_m)));
            }
            None => self.progress.slips_unknown += 1,
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
            max_slip_m: self.progress.max_slip_m.unwrap_or(-1.0),
            odometry_error_m_max: self.progress.odometry.error_m_max,
            odometry_error_m_rms: self.progress.odometry.error_m_rms(),
            odometry_error_rad_max: self.progress.odometry.error_rad_max,
            odometry_error_rad_rms: self.progress.odometry.error_rad_rms(),
        }
    }
}

/// What a message says, if it can be understood.
fn understood<T>(topic: &str, said: Result<T, impl Display>) -> Option<T> {
    said.inspect_err(|error| tracing::warn!("{topic} passed over: {error}")).ok()
}

fn activity_of(phase: Phase) -> Activity {
    match phase {
        Phase::Feeding => Activity::Wait,
        Phase::Stopping => Activity::Stop,
        Phase::Settling => Activity::Settle,
        Phase::Looking => Activity::Look,
        Phase::Reserving => Activity::Reserve,
        Phase::Moving => Activity::Move,
        Phase::Presented => Activity::Pick,
        Phase::Returning => Activity::Return,
        Phase::Idle | Phase::Purging | Phase::Fault => Activity::Idle,
    }
}
