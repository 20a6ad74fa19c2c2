//! The score of one feeder, by ground truth.

use std::collections::BTreeSet;

use feeder_core::scenario::Scenario;
use feeder_runtime::dds::Qos;
use feeder_runtime::node::{Declare, Latency, Publisher, StepIo, Subscriber, ns_of_stamp};
use minifactory_msgs::msg::{DeliveryState, PartStates, PickEvent, RunProgress};
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use nalgebra::Vector2;

use crate::progress::{Activity, FeederProgress};
use crate::truth::Truth;

/// Handles of the ports for one feeder.
pub(crate) struct Ports {
    parts: Subscriber<PartStates>,
    candidates: Subscriber<Detection3DArray>,
    delivery: Subscriber<DeliveryState>,
    picks: Subscriber<PickEvent>,
    progress: Publisher<RunProgress>,
}

impl Ports {
    pub(crate) fn declare(io: &mut Declare, feeder: &str) -> Self {
        let name = |topic: &str| format!("/{feeder}/{topic}");
        Self {
            parts: io.subscriber(&name("parts"), Latency::Forward, Qos::sensor()),
            candidates: io.subscriber(&name("candidates"), Latency::Forward, Qos::command()),
            delivery: io.subscriber(&name("delivery_state"), Latency::Forward, Qos::command()),
            picks: io.subscriber(&name("picks"), Latency::Forward, Qos::command()),
            progress: io.publisher(&name("progress"), Qos::command()),
        }
    }
}

/// Scores one feeder.
pub(crate) struct FeederMonitor {
    ports: Ports,
    wanted_class: String,
    wanted_pose: u8,
    part_radius_m: f64,
    truth: Truth,
    /// Parts in the feeder, and those that were picked.
    present: BTreeSet<u32>,
    picked: BTreeSet<u32>,
    /// What the planner does, and since when, ns.
    activity: (Activity, u64),
    pub(crate) progress: FeederProgress,
}

impl FeederMonitor {
    pub(crate) fn new(ports: Ports, feeder: &str, config: &Scenario) -> Self {
        Self {
            ports,
            wanted_class: format!("{}/{}", config.part.name, config.part.wanted_pose),
            wanted_pose: u8::try_from(config.part.wanted_pose_index()).unwrap_or(u8::MAX),
            part_radius_m: config.part.radius_m(),
            truth: Truth::default(),
            present: BTreeSet::new(),
            picked: BTreeSet::new(),
            activity: (Activity::Idle, 0),
            progress: FeederProgress { name: feeder.to_owned(), ..FeederProgress::default() },
        }
    }

    pub(crate) fn hear(&mut self, io: &mut StepIo) {
        let picks = io.take(&self.ports.picks);
        for event in picks.iter().filter(|event| event.picked) {
            self.progress.parts_doubled += u32::from(!self.picked.insert(event.part_id));
        }
        for message in io.take(&self.ports.parts) {
            self.progress.fed = message.fed;
            self.count(&message);
            self.truth.learn(&message);
        }
        for message in io.take(&self.ports.candidates) {
            self.score_candidates(&message);
        }
        for message in io.take(&self.ports.delivery) {
            self.truth.settle(ns_of_stamp(&message.look_stamp));
            self.spend(&message);
        }
        for event in &picks {
            self.score_pick(event);
        }
    }

    pub(crate) fn publish(&self, io: &mut StepIo) {
        let message = self.message(io);
        io.publish(&self.ports.progress, &message);
    }

    /// Looks for parts that are gone without a pick, or back after one.
    fn count(&mut self, message: &PartStates) {
        let present: BTreeSet<u32> = message.parts.iter().map(|part| part.id).collect();
        let count = |parts: usize| u32::try_from(parts).unwrap_or(u32::MAX);
        let gone = self.present.difference(&present).filter(|id| !self.picked.contains(id)).count();
        let back = present.difference(&self.present).filter(|id| self.picked.contains(id)).count();
        self.progress.parts_lost += count(gone);
        self.progress.parts_doubled += count(back);
        self.present = present;
    }

    fn spend(&mut self, message: &DeliveryState) {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        let (activity, since_ns) = self.activity;
        let spent_s = std::time::Duration::from_nanos(stamp_ns.saturating_sub(since_ns)).as_secs_f64();
        *self.progress.spent_s.entry(activity).or_insert(0.0) += spent_s;
        self.activity = (activity_of(message.phase), stamp_ns);
        self.progress.accepted = message.accepted;
        self.progress.succeeded = message.delivered;
        self.progress.failed_by_outcome = message.failed_by_outcome.to_vec();
    }

    /// Finds out which parts the selector meant, by where they were when the picture was taken.
    fn score_candidates(&mut self, message: &Detection3DArray) {
        let stamp_ns = ns_of_stamp(&message.header.stamp);
        for detection in &message.detections {
            let center = &detection.bbox.center.position;
            let center = Vector2::new(center.x, center.y);
            let Some(id) = self.truth.part_at(stamp_ns, &center, self.part_radius_m) else { continue };
            self.progress.seen.insert(id);
            if detection.results.iter().any(|result| result.hypothesis.class_id == self.wanted_class) {
                self.progress.selected.insert(id);
            }
        }
    }

    fn score_pick(&mut self, event: &PickEvent) {
        if event.picked {
            self.progress.delivered += 1;
            self.progress.wrong_pose_delivered += u32::from(event.resting_pose != self.wanted_pose);
            match self.truth.slip_m(event.part_id) {
                Some(slip_m) => {
                    self.progress.max_slip_m = Some(self.progress.max_slip_m.map_or(slip_m, |most| most.max(slip_m)));
                }
                None => self.progress.slips_unknown += 1,
            }
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
        }
    }
}

fn activity_of(phase: u8) -> Activity {
    match phase {
        DeliveryState::FEEDING => Activity::Wait,
        DeliveryState::STOPPING => Activity::Stop,
        DeliveryState::SETTLING => Activity::Settle,
        DeliveryState::LOOKING => Activity::Look,
        DeliveryState::RESERVING => Activity::Reserve,
        DeliveryState::MOVING => Activity::Move,
        DeliveryState::PRESENTED => Activity::Pick,
        DeliveryState::RETURNING => Activity::Return,
        _ => Activity::Idle,
    }
}
