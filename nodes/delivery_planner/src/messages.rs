//! Between messages and the planner's own types.

use std::time::Duration;

use feeder_control::courier::{AXES, Trajectory};
use feeder_control::delivery::{Candidate, CandidateFrame, DeliveryId, Failure, LeaseAnswer, Phase};
use feeder_control::platen::Area;
use feeder_runtime::node::{ns_of_stamp, stamp_of_ns};
use feeder_wire::pose::yaw_of_quaternion;
use minifactory_msgs::action::DeliverPartResult;
use minifactory_msgs::builtin_interfaces::msg::{Duration as DurationMessage, Time};
use minifactory_msgs::control_msgs::action::FollowJointTrajectoryGoal;
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::msg::{self, DeliveryState};
use minifactory_msgs::srv::ReserveAreaResponse;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use nalgebra::Vector2;

const DELIVERY_PREFIX: &str = "delivery_";

pub(crate) fn text_of_delivery(id: DeliveryId) -> String {
    format!("{DELIVERY_PREFIX}{}", id.0)
}

pub(crate) fn delivery_of_text(text: &str) -> Option<DeliveryId> {
    text.strip_prefix(DELIVERY_PREFIX)?.parse().ok().map(DeliveryId)
}

pub(crate) fn stamp(since_start: Duration) -> Time {
    stamp_of_ns(u64::try_from(since_start.as_nanos()).unwrap_or(u64::MAX))
}

pub(crate) fn phase_number(phase: Phase) -> u8 {
    match phase {
        Phase::Idle => DeliveryState::IDLE,
        Phase::Feeding => DeliveryState::FEEDING,
        Phase::Stopping => DeliveryState::STOPPING,
        Phase::Settling => DeliveryState::SETTLING,
        Phase::Looking => DeliveryState::LOOKING,
        Phase::Reserving => DeliveryState::RESERVING,
        Phase::Moving => DeliveryState::MOVING,
        Phase::Presented => DeliveryState::PRESENTED,
        Phase::Returning => DeliveryState::RETURNING,
        Phase::Purging => DeliveryState::PURGING,
        Phase::Fault => DeliveryState::FAULT,
    }
}

/// The outcome that the result of an action names a failure by.
pub(crate) fn outcome_number(failure: &Failure) -> u8 {
    match failure {
        Failure::Cancelled => DeliverPartResult::CANCELLED,
        Failure::TimedOut(_) => DeliverPartResult::TIMED_OUT,
        Failure::FeedRefused(_) | Failure::DidNotStop => DeliverPartResult::FEEDING_FAILED,
        Failure::NoImage => DeliverPartResult::NO_IMAGE,
        Failure::Plan(_) | Failure::Move(_) => DeliverPartResult::MOVE_FAILED,
        Failure::Area(_) => DeliverPartResult::AREA_REFUSED,
        Failure::PartLost(_) | Failure::DidNotArrive => DeliverPartResult::PART_LOST,
        Failure::NoHandOver => DeliverPartResult::NO_HANDOVER,
        Failure::NotTaken => DeliverPartResult::NOT_TAKEN,
        Failure::Fault(_) => DeliverPartResult::FAULT,
    }
}

/// An area as a message.
pub(crate) fn area(area: &Area) -> msg::Area {
    let points = area.points_m.iter().map(|point| Point { x: point.x, y: point.y, z: 0.0 }).collect();
    msg::Area { points, radius_m: area.radius_m }
}

/// What the arbiter answered.
pub(crate) fn lease_answer(response: ReserveAreaResponse) -> LeaseAnswer {
    match response.result {
        ReserveAreaResponse::GRANTED => Ok((response.lease_id, Duration::from_nanos(ns_of_stamp(&response.expires)))),
        _ => Err(response.message),
    }
}

/// The parts of a selector's message. What it could not classify is no candidate, but is in the gripper's way.
pub(crate) fn candidate_frame(message: &Detection3DArray) -> CandidateFrame {
    let outlines: Vec<(Vector2<f64>, f64)> = message
        .detections
        .iter()
        .map(|detection| {
            let center = &detection.bbox.center.position;
            (Vector2::new(center.x, center.y), 0.5 * detection.bbox.size.x.max(detection.bbox.size.y))
        })
        .collect();
    let candidates = message.detections.iter().enumerate().filter_map(|(index, detection)| {
        let best = detection.results.iter().max_by(|a, b| a.hypothesis.score.total_cmp(&b.hypothesis.score))?;
        let (part_class, pose_class) = best.hypothesis.class_id.split_once('/')?;
        let pose = &best.pose.pose;
        Some(Candidate {
            id: detection.id.parse().unwrap_or(0),
            radius_m: 0.5 * detection.bbox.size.x.max(detection.bbox.size.y),
            position_in_tray_m: Vector2::new(pose.position.x, pose.position.y),
            yaw_in_tray_rad: yaw_of_quaternion(&pose.orientation),
            part_class: part_class.to_owned(),
            pose_class: pose_class.to_owned(),
            confidence: best.hypothesis.score,
            clearance_m: clearance_m(&outlines, index),
            // The selector reports what lies wholly on the plateau, and nothing else.
            on_plateau: true,
        })
    });
    CandidateFrame {
        stamp: Duration::from_nanos(ns_of_stamp(&message.header.stamp)),
        candidates: candidates.collect(),
        seen: message.detections.len(),
    }
}

/// Distance from an outline to the nearest other one, m; infinite when it is alone.
fn clearance_m(outlines: &[(Vector2<f64>, f64)], index: usize) -> f64 {
    let (center, radius_m) = outlines[index];
    let others = outlines.iter().enumerate().filter(|(other, _)| *other != index);
    others
        .map(|(_, (other, other_radius_m))| (center - other).norm() - radius_m - other_radius_m)
        .fold(f64::INFINITY, f64::min)
}

/// A trajectory as a goal of `follow_joint_trajectory`.
pub(crate) fn trajectory_goal(trajectory: &Trajectory) -> FollowJointTrajectoryGoal {
    let mut goal = FollowJointTrajectoryGoal::default();
    goal.trajectory.joint_names = AXES.map(str::to_owned).to_vec();
    goal.trajectory.points = trajectory
        .points
        .iter()
        .map(|point| {
            let values = |vector: &nalgebra::Vector3<f64>| vector.iter().copied().collect();
            let time = Duration::from_secs_f64(point.time_s);
            JointTrajectoryPoint {
                positions: values(&point.position),
                velocities: point.velocity.as_ref().map(values).unwrap_or_default(),
                accelerations: point.acceleration.as_ref().map(values).unwrap_or_default(),
                effort: Vec::new(),
                time_from_start: DurationMessage {
                    sec: i32::try_from(time.as_secs()).unwrap_or(i32::MAX),
                    nanosec: time.subsec_nanos(),
                },
            }
        })
        .collect();
    goal
}
