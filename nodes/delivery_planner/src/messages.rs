//! Between messages and the planner's own types.

use std::time::Duration;

use feeder_control::delivery::{CandidateFrame, Failure, OfferedPart};
use feeder_model::delivery::Outcome;
use feeder_runtime::node::ns_of_stamp;
use feeder_wire::part_candidates::{SeenPart, UnknownRefusal};
use minifactory_msgs::msg::PartCandidates;

/// The outcome by which the result of an action names a failure.
pub(crate) fn outcome(failure: &Failure) -> Outcome {
    match failure {
        Failure::Cancelled => Outcome::Cancelled,
        Failure::TimedOut(_) => Outcome::TimedOut,
        Failure::FeedRefused(_) | Failure::DidNotStop => Outcome::FeedingFailed,
        Failure::NoImage => Outcome::NoImage,
        Failure::Plan(_) | Failure::Move(_) => Outcome::MoveFailed,
        Failure::Area(_) => Outcome::AreaRefused,
        Failure::PartLost(_) | Failure::DidNotArrive => Outcome::PartLost,
        Failure::NoHandOver => Outcome::NoHandOver,
        Failure::NotTaken => Outcome::NotTaken,
        Failure::Fault(_) | Failure::Suspended(_) => Outcome::Fault,
    }
}

/// What a selector's message says of the parts wholly on the plateau.
pub(crate) fn candidate_frame(message: &PartCandidates) -> Result<CandidateFrame, UnknownRefusal> {
    let seen = feeder_wire::part_candidates::from_message(message)?;
    let candidate = |part: SeenPart| OfferedPart {
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
        is_blind: message.blind,
    })
}

#[cfg(test)]
mod tests {
    use feeder_model::part::Refusals;
    use feeder_wire::part_candidates::{ImageWorth, to_message};
    use feeder_wire::stamp_of;
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
        let seen = [seen(1, none), seen(2, near), seen(3, over_the_edge)];
        let mut message = to_message("block", &seen, &ImageWorth::default());
        message.header.stamp = stamp_of(Duration::from_millis(100));
        let frame = candidate_frame(&message).unwrap();
        let told: Vec<_> = frame.candidates.iter().map(|part| (part.id, part.refusals)).collect();
        assert_eq!((frame.stamp, told), (Duration::from_millis(100), vec![(1, none), (2, near)]));
        assert!(frame.candidates.iter().all(|part| part.part_class == "block"));
    }
}
