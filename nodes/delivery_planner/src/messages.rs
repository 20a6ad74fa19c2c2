//! Between messages and the planner's own types.

use std::time::Duration;

use feeder_control::courier::{AXES, Trajectory};
use feeder_control::delivery::{Candidate, CandidateFrame, DeliveryId, Failure, LeaseAnswer, Phase};
use feeder_control::platen::Area;
use feeder_runtime::node::{ns_of_stamp, stamp_of_ns};
use feeder_wire::part_candidates::{SeenPart, UnknownRefusal};
use minifactory_msgs::action::DeliverPartResult;
use minifactory_msgs::builtin_interfaces::msg::{Duration as DurationMessage, Time};
use minifactory_msgs::control_msgs::action::FollowJointTrajectoryGoal;
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::msg::{self, DeliveryState, PartCandidates};
use minifactory_msgs::srv::ReserveAreaResponse;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;

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

/// What a selector's message says of the parts wholly on the plateau.
pub(crate) fn candidate_frame(message: &PartCandidates) -> Result<CandidateFrame, UnknownRefusal> {
    let seen = feeder_wire::part_candidates::from_message(message)?;
    let candidate = |part: SeenPart| Candidate {
        id: part.id,
        position_in_tray_m: part.position_in_tray_m,
        yaw_in_tray_rad: part.yaw_in_tray_rad,
        part_class: message.part_class.clone(),
        pose_class: part.pose_class,
        radius_m: part.radius_m,
        part_gap_m: part.part_gap_m,
        refusals: part.refusals,
    };
    Ok(CandidateFrame {
        stamp: Duration::from_nanos(ns_of_stamp(&message.header.stamp)),
        candidates: seen.into_iter().filter(|part| !part.refusals.off_plateau).map(candidate).collect(),
    })
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

#[cfg(test)]
mod tests {
    use feeder_model::part::Refusals;
    use feeder_wire::part_candidates::to_message;
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn what_the_selector_refuses_the_planner_refuses_and_nothing_else() {
        let seen = |id, refusals| SeenPart {
            id,
            position_in_tray_m: Vector2::new(0.0, -0.06),
            yaw_in_tray_rad: 0.0,
            pose_class: Some("flat".to_owned()),
            confidence: 0.1,
            radius_m: 0.0036,
            part_gap_m: -0.001,
            wall_gap_m: -0.001,
            refusals,
        };
        let none = Refusals::default();
        let near = Refusals { part_too_near: true, ..none };
        let over_the_edge = Refusals { off_plateau: true, ..none };
        let mut message = to_message("block", &[seen(1, none), seen(2, near), seen(3, over_the_edge)]);
        message.header.stamp = stamp(Duration::from_millis(100));
        let frame = candidate_frame(&message).unwrap();
        let told: Vec<_> = frame.candidates.iter().map(|part| (part.id, part.refusals)).collect();
        assert_eq!((frame.stamp, told), (Duration::from_millis(100), vec![(1, none), (2, near)]));
        assert!(frame.candidates.iter().all(|part| part.part_class == "block"));
    }
}
