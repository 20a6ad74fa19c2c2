//! Simulated grippers that close: the service `pick`, and `picks`, which tells of each.

use minifactory_msgs::msg::PickEvent;
use minifactory_msgs::srv::{PickRequest, PickResponse};

use crate::pose::{self, UprightPose};

/// A gripper closes.
#[derive(Clone, Debug, PartialEq)]
pub struct GripRequest {
    /// The station whose gripper it is.
    pub station: String,
    /// Where its tool is, in the platen frame.
    pub tool_in_platen: UprightPose,
    /// Between the fingers before they close, m.
    pub opening_m: f64,
}

/// A grip as a request.
#[must_use]
pub fn to_request(grip: &GripRequest) -> PickRequest {
    PickRequest {
        station: grip.station.clone(),
        tool_in_platen: pose::to_message(&grip.tool_in_platen),
        gripper_opening_m: grip.opening_m,
    }
}

/// The grip of a request.
#[must_use]
pub fn from_request(message: PickRequest) -> GripRequest {
    GripRequest {
        station: message.station,
        tool_in_platen: pose::from_message(&message.tool_in_platen),
        opening_m: message.gripper_opening_m,
    }
}

/// The part that a gripper took, by its id, or why it took none.
pub type Gripped = Result<u32, String>;

/// An answer as a response.
#[must_use]
pub fn to_response(gripped: Gripped) -> PickResponse {
    match gripped {
        Ok(part_id) => PickResponse { picked: true, part_id, message: String::new() },
        Err(message) => PickResponse { picked: false, part_id: 0, message },
    }
}

/// The answer of a response.
#[expect(clippy::missing_errors_doc, reason = "an answer may be that nothing was taken")]
pub fn from_response(message: PickResponse) -> Gripped {
    if message.picked { Ok(message.part_id) } else { Err(message.message) }
}

/// A part that a gripper took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TakenPart {
    /// The part.
    pub id: u32,
    /// Index, in its class, of the resting pose in which it lay.
    pub resting_pose: u8,
}

/// A gripper has closed, as the truth has it, or a hand.
#[derive(Clone, Debug, PartialEq)]
pub struct GripperClosed {
    /// The station whose gripper it is; none for a hand.
    pub station: Option<String>,
    /// Where its tool was, in the platen frame.
    pub tool_in_platen: UprightPose,
    /// What it took.
    pub taken: Option<TakenPart>,
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_event(closed: &GripperClosed) -> PickEvent {
    PickEvent {
        station: closed.station.clone().unwrap_or_default(),
        picked: closed.taken.is_some(),
        part_id: closed.taken.map_or(0, |part| part.id),
        resting_pose: closed.taken.map_or(0, |part| part.resting_pose),
        tool_in_platen: pose::to_message(&closed.tool_in_platen),
        ..PickEvent::default()
    }
}

/// What a message tells.
#[must_use]
pub fn from_event(message: PickEvent) -> GripperClosed {
    let part = TakenPart { id: message.part_id, resting_pose: message.resting_pose };
    GripperClosed {
        station: Some(message.station).filter(|station| !station.is_empty()),
        tool_in_platen: pose::from_message(&message.tool_in_platen),
        taken: message.picked.then_some(part),
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Not as _;

    use proptest::prelude::*;

    use super::*;
    use crate::pose::tests::{poses, same};

    proptest! {
        #[test]
        fn a_grip_and_what_came_of_it_survive_the_round_trip(
            tool_in_platen in poses(),
            opening_m in 0.001..0.05_f64,
            part in prop::option::of((1..100_u32, 1..9_u8)),
            by_hand: bool,
        ) {
            let station = "station_2".to_owned();
            let sent = GripRequest { station: station.clone(), tool_in_platen, opening_m };
            let came = from_request(to_request(&sent));
            prop_assert!(same(&came.tool_in_platen, &sent.tool_in_platen));
            prop_assert_eq!(GripRequest { tool_in_platen, ..came }, sent);
            let taken = part.map(|(id, resting_pose)| TakenPart { id, resting_pose });
            let sent = GripperClosed { station: by_hand.not().then_some(station), tool_in_platen, taken };
            let came = from_event(to_event(&sent));
            prop_assert!(same(&came.tool_in_platen, &sent.tool_in_platen));
            prop_assert_eq!(GripperClosed { tool_in_platen, ..came }, sent);
        }
    }

    #[test]
    fn answers_survive_the_round_trip() {
        for answer in [Ok(7), Err("nothing lies between the fingers".to_owned())] {
            assert_eq!(from_response(to_response(answer.clone())), answer);
        }
    }
}
