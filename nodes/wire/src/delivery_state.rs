//! Where the planner stands, as `delivery_state` tells it.

use std::time::Duration;

use feeder_model::delivery::Phase;
use minifactory_msgs::msg::DeliveryState;
use minifactory_msgs::ns_of_stamp;
use nalgebra::Vector2;

use crate::numbered::{UnknownNumber, numbered};
use crate::pose::{self, UprightPose};
use crate::stamp_of;

numbered! {
    /// The number of a phase.
    pub(crate) phase_number,
    /// The phase of a number.
    pub(crate) phase_of,
    "phase", "0 to 10",
    Phase as u8 {
        Idle = DeliveryState::IDLE,
        Feeding = DeliveryState::FEEDING,
        Stopping = DeliveryState::STOPPING,
        Settling = DeliveryState::SETTLING,
        Looking = DeliveryState::LOOKING,
        Reserving = DeliveryState::RESERVING,
        Moving = DeliveryState::MOVING,
        Presented = DeliveryState::PRESENTED,
        Returning = DeliveryState::RETURNING,
        Purging = DeliveryState::PURGING,
        Fault = DeliveryState::FAULT,
    }
}

/// A part that was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenPart {
    /// Stamp of the image on which the choice rests, after the start of the run's clock.
    pub look: Duration,
    /// Where the part lies in the tray frame, m.
    pub position_in_tray_m: Vector2<f64>,
    /// How it is turned in the tray frame, rad.
    pub yaw_in_tray_rad: f64,
    /// Its resting pose as the selector saw it, if that is known.
    pub pose_class: Option<String>,
}

/// Where the planner stands, and counts since the start.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerStand {
    /// The phase.
    pub phase: Phase,
    /// The delivery under way.
    pub delivery_id: Option<String>,
    /// The station to deliver to.
    pub station: Option<String>,
    /// The part that is presented.
    pub chosen: Option<ChosenPart>,
    /// Why the planner cannot go on, for people.
    pub fault: Option<String>,
    /// Deliveries accepted.
    pub accepted: u32,
    /// Parts delivered.
    pub delivered: u32,
    /// Deliveries that failed, by the number of their outcome.
    pub failed_by_outcome: [u32; 11],
}

impl PlannerStand {
    /// At the start: nothing was asked for.
    #[must_use]
    pub fn idle() -> Self {
        Self {
            phase: Phase::Idle,
            delivery_id: None,
            station: None,
            chosen: None,
            fault: None,
            accepted: 0,
            delivered: 0,
            failed_by_outcome: [0; 11],
        }
    }
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_message(stand: &PlannerStand) -> DeliveryState {
    let mut message = DeliveryState {
        phase: phase_number(stand.phase),
        delivery_id: stand.delivery_id.clone().unwrap_or_default(),
        station: stand.station.clone().unwrap_or_default(),
        reason: stand.fault.clone().unwrap_or_default(),
        accepted: stand.accepted,
        delivered: stand.delivered,
        failed: stand.failed_by_outcome.iter().sum(),
        failed_by_outcome: stand.failed_by_outcome,
        ..DeliveryState::default()
    };
    if let Some(ChosenPart { look, position_in_tray_m, yaw_in_tray_rad, pose_class }) = &stand.chosen {
        message.look_stamp = stamp_of(*look);
        message.pose_class = pose_class.clone().unwrap_or_default();
        let (x_m, y_m) = (position_in_tray_m.x, position_in_tray_m.y);
        message.part_in_tray = pose::to_message(&UprightPose { x_m, y_m, z_m: 0.0, yaw_rad: *yaw_in_tray_rad });
    }
    message
}

/// What a message tells.
///
/// # Errors
/// A phase that is not known.
pub fn from_message(message: DeliveryState) -> Result<PlannerStand, UnknownNumber> {
    let stated = |text: String| Some(text).filter(|text| !text.is_empty());
    let UprightPose { x_m, y_m, yaw_rad, .. } = pose::from_message(&message.part_in_tray);
    let look = Duration::from_nanos(ns_of_stamp(&message.look_stamp));
    let chosen = ChosenPart {
        look,
        position_in_tray_m: Vector2::new(x_m, y_m),
        yaw_in_tray_rad: yaw_rad,
        pose_class: stated(message.pose_class),
    };
    Ok(PlannerStand {
        phase: phase_of(message.phase)?,
        delivery_id: stated(message.delivery_id),
        station: stated(message.station),
        chosen: (!look.is_zero()).then_some(chosen),
        fault: stated(message.reason),
        accepted: message.accepted,
        delivered: message.delivered,
        failed_by_outcome: message.failed_by_outcome,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_the_planner_stands_survives_the_round_trip_in_every_phase() {
        let phases: Vec<Phase> = (0..=u8::MAX).filter_map(|number| phase_of(number).ok()).collect();
        assert_eq!(phases.len(), 11);
        let chosen = ChosenPart {
            look: Duration::from_millis(12_080),
            position_in_tray_m: Vector2::new(0.03, -0.06),
            yaw_in_tray_rad: 0.5,
            pose_class: Some("face_up".to_owned()),
        };
        for phase in phases {
            let sent = PlannerStand {
                phase,
                delivery_id: Some("delivery_3".to_owned()),
                station: Some("station_2".to_owned()),
                chosen: Some(chosen.clone()),
                fault: Some("the tray is full of soup".to_owned()),
                accepted: 30,
                delivered: 7,
                failed_by_outcome: std::array::from_fn(|index| [0, 1, 2, 4][index % 4]),
            };
            let message = to_message(&sent);
            assert_eq!(message.failed, 17);
            let mut came = from_message(message).unwrap();
            let yaw_rad = &mut came.chosen.as_mut().unwrap().yaw_in_tray_rad;
            assert!((std::mem::replace(yaw_rad, 0.5) - 0.5).abs() < 1e-12);
            assert_eq!(came, sent);
        }
        assert_eq!(from_message(to_message(&PlannerStand::idle())), Ok(PlannerStand::idle()));
        assert_eq!(to_message(&PlannerStand::idle()), DeliveryState::default());
    }
}
