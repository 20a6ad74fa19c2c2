//! Deliveries as the action `deliver_part` states them: what is asked for, how far it is, and how it ended.

use std::time::Duration;

use feeder_model::delivery::{Outcome, Phase};
use minifactory_msgs::action::{DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::geometry_msgs::msg::Pose;

use crate::delivery_state::{phase_number, phase_of};
use crate::numbered::{UnknownNumber, numbered};
use crate::pose::{self, UprightPose};

const NAME_PREFIX: &str = "delivery_";

/// The name of a delivery, by its number.
#[must_use]
pub fn name_of(number: u64) -> String {
    format!("{NAME_PREFIX}{number}")
}

/// The number of a delivery; nothing for a text that names none.
#[must_use]
pub fn number_of(name: &str) -> Option<u64> {
    name.strip_prefix(NAME_PREFIX)?.parse().ok()
}

numbered! {
    /// The number of an outcome.
    pub outcome_number,
    /// The outcome of a number.
    outcome_of,
    "outcome", "0 to 10",
    Outcome as u8 {
        Delivered = DeliverPartResult::DELIVERED,
        Cancelled = DeliverPartResult::CANCELLED,
        TimedOut = DeliverPartResult::TIMED_OUT,
        FeedingFailed = DeliverPartResult::FEEDING_FAILED,
        NoImage = DeliverPartResult::NO_IMAGE,
        MoveFailed = DeliverPartResult::MOVE_FAILED,
        AreaRefused = DeliverPartResult::AREA_REFUSED,
        PartLost = DeliverPartResult::PART_LOST,
        NoHandOver = DeliverPartResult::NO_HANDOVER,
        NotTaken = DeliverPartResult::NOT_TAKEN,
        Fault = DeliverPartResult::FAULT,
    }
}

/// What an agent asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct PartWanted {
    /// The station to deliver to.
    pub station: String,
    /// Class of part, as the factsheet names it; nothing: the one that is fed.
    pub part_class: Option<String>,
    /// Resting pose, as the factsheet names it; nothing: any.
    pub pose_class: Option<String>,
    /// Largest horizontal distance allowed between the part and the station's tool axis, m.
    pub tolerance_m: f64,
    /// Least free gap to the nearest other part, m; nothing: what the gripper needs.
    pub part_gap_m_min: Option<f64>,
    /// When to give up; nothing: never.
    pub timeout: Option<Duration>,
}

/// A goal.
#[must_use]
pub fn to_goal(wanted: &PartWanted) -> DeliverPartGoal {
    DeliverPartGoal {
        station: wanted.station.clone(),
        part_class: wanted.part_class.clone().unwrap_or_default(),
        pose_class: wanted.pose_class.clone().unwrap_or_default(),
        tolerance_m: wanted.tolerance_m,
        part_gap_m_min: wanted.part_gap_m_min.unwrap_or(0.0),
        timeout_s: wanted.timeout.map_or(0.0, |timeout| timeout.as_secs_f64()),
    }
}

/// What a goal asks for.
///
/// # Errors
/// A gap or a time that is negative or no number: what, and what is allowed.
pub fn from_goal(goal: &DeliverPartGoal) -> Result<PartWanted, String> {
    let stated = |text: &String| (!text.is_empty()).then(|| text.clone());
    let DeliverPartGoal { part_gap_m_min, timeout_s, .. } = *goal;
    if !(part_gap_m_min >= 0.0 && part_gap_m_min.is_finite()) {
        return Err(format!(
            "part_gap_m_min = {part_gap_m_min}, allowed is 0 (what the gripper needs) or a positive number"
        ));
    }
    let timeout = Duration::try_from_secs_f64(timeout_s)
        .map_err(|_| format!("timeout_s = {timeout_s}, allowed is 0 (never) or a positive number"))?;
    Ok(PartWanted {
        station: goal.station.clone(),
        part_class: stated(&goal.part_class),
        pose_class: stated(&goal.pose_class),
        tolerance_m: goal.tolerance_m,
        part_gap_m_min: Some(part_gap_m_min).filter(|gap_m| *gap_m > 0.0),
        timeout: Some(timeout).filter(|_| timeout_s > 0.0),
    })
}

/// A part under a station's tool.
#[derive(Clone, Debug, PartialEq)]
pub struct PresentedPart {
    /// Names the part as the selector follows it.
    pub id: String,
    /// Where it is in the station's tool frame.
    pub pose_in_station: UprightPose,
}

fn to_part(part: Option<&PresentedPart>) -> (String, Pose) {
    part.map(|part| (part.id.clone(), pose::to_message(&part.pose_in_station))).unwrap_or_default()
}

fn from_part(id: String, pose_in_station: &Pose) -> Option<PresentedPart> {
    (!id.is_empty()).then(|| PresentedPart { id, pose_in_station: pose::from_message(pose_in_station) })
}

/// How far a delivery is.
#[derive(Clone, Debug, PartialEq)]
pub struct DeliveryProgress {
    /// Where the planner stands.
    pub phase: Phase,
    /// Time until the part is presented, if that can be told.
    pub eta: Option<Duration>,
    /// Names the delivery.
    pub delivery_id: String,
    /// The part, once it is presented.
    pub part: Option<PresentedPart>,
}

/// Progress as feedback.
#[must_use]
pub fn to_feedback(progress: &DeliveryProgress) -> DeliverPartFeedback {
    let (part_id, part_in_station) = to_part(progress.part.as_ref());
    DeliverPartFeedback {
        phase: phase_number(progress.phase),
        eta_s: progress.eta.map_or(-1.0, |eta| eta.as_secs_f64()),
        delivery_id: progress.delivery_id.clone(),
        part_id,
        part_in_station,
    }
}

/// The progress of feedback.
///
/// # Errors
/// A phase that is not known.
pub fn from_feedback(message: DeliverPartFeedback) -> Result<DeliveryProgress, UnknownNumber> {
    Ok(DeliveryProgress {
        phase: phase_of(message.phase)?,
        eta: Duration::try_from_secs_f64(message.eta_s).ok(),
        delivery_id: message.delivery_id,
        part: from_part(message.part_id, &message.part_in_station),
    })
}

/// How a delivery ended.
#[derive(Clone, Debug, PartialEq)]
pub struct DeliveryEnd {
    /// In a word.
    pub outcome: Outcome,
    /// Why it failed, for people; empty: it did not.
    pub reason: String,
    /// Names the delivery.
    pub delivery_id: String,
    /// The part, if one was presented.
    pub part: Option<PresentedPart>,
}

/// An end as a result.
#[must_use]
pub fn to_result(end: DeliveryEnd) -> DeliverPartResult {
    let (part_id, part_in_station) = to_part(end.part.as_ref());
    DeliverPartResult {
        outcome: outcome_number(end.outcome),
        reason: end.reason,
        delivery_id: end.delivery_id,
        part_id,
        part_in_station,
    }
}

/// The end of a result.
///
/// # Errors
/// An outcome that is not known.
pub fn from_result(message: DeliverPartResult) -> Result<DeliveryEnd, UnknownNumber> {
    Ok(DeliveryEnd {
        outcome: outcome_of(message.outcome)?,
        reason: message.reason,
        delivery_id: message.delivery_id,
        part: from_part(message.part_id, &message.part_in_station),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted() -> PartWanted {
        PartWanted {
            station: "station_2".to_owned(),
            part_class: Some("block".to_owned()),
            pose_class: Some("flat".to_owned()),
            tolerance_m: 5e-4,
            part_gap_m_min: Some(0.004),
            timeout: Some(Duration::from_millis(1_500)),
        }
    }

    fn part() -> PresentedPart {
        let pose_in_station = UprightPose { x_m: 1e-4, y_m: -2e-4, z_m: 0.0, yaw_rad: 0.5 };
        PresentedPart { id: "31".to_owned(), pose_in_station }
    }

    fn assert_same_part(came: Option<&PresentedPart>, sent: Option<&PresentedPart>) {
        let (Some(came), Some(sent)) = (came, sent) else { return assert_eq!(came, sent) };
        assert_eq!(came.id, sent.id);
        assert!(crate::pose::tests::same(&came.pose_in_station, &sent.pose_in_station), "{came:?}");
    }

    #[test]
    fn names_survive_the_round_trip_and_other_texts_name_nothing() {
        assert_eq!(name_of(7), "delivery_7");
        for number in [0, 7, u64::MAX] {
            assert_eq!(number_of(&name_of(number)), Some(number));
        }
        for text in ["", "7", "delivery_", "delivery_x", "delivery_-1"] {
            assert_eq!(number_of(text), None, "{text}");
        }
    }

    #[test]
    fn goals_survive_the_round_trip_with_everything_stated_and_with_nothing() {
        let bare = PartWanted { part_class: None, pose_class: None, part_gap_m_min: None, timeout: None, ..wanted() };
        for sent in [wanted(), bare] {
            assert_eq!(from_goal(&to_goal(&sent)), Ok(sent));
        }
    }

    #[test]
    fn goals_that_make_no_sense_are_refused_by_name() {
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            let gap = from_goal(&DeliverPartGoal { part_gap_m_min: bad, ..to_goal(&wanted()) }).unwrap_err();
            assert!(gap.starts_with(&format!("part_gap_m_min = {bad}, allowed is 0")), "{gap}");
            let timeout = from_goal(&DeliverPartGoal { timeout_s: bad, ..to_goal(&wanted()) }).unwrap_err();
            assert!(timeout.starts_with(&format!("timeout_s = {bad}, allowed is 0")), "{timeout}");
        }
    }

    #[test]
    fn feedback_survives_the_round_trip() {
        let delivery_id = "delivery_3".to_owned();
        let moving = DeliveryProgress {
            phase: Phase::Moving,
            eta: Some(Duration::from_millis(250)),
            delivery_id: delivery_id.clone(),
            part: None,
        };
        let presented = DeliveryProgress { phase: Phase::Presented, eta: None, delivery_id, part: Some(part()) };
        for sent in [moving, presented] {
            let came = from_feedback(to_feedback(&sent)).unwrap();
            assert_same_part(came.part.as_ref(), sent.part.as_ref());
            assert_eq!(DeliveryProgress { part: sent.part.clone(), ..came }, sent);
        }
        let unknown = DeliverPartFeedback { phase: 11, ..DeliverPartFeedback::default() };
        assert_eq!(from_feedback(unknown).unwrap_err().to_string(), "phase = 11, allowed are 0 to 10");
    }

    #[test]
    fn results_survive_the_round_trip_with_every_outcome() {
        let outcomes: Vec<Outcome> = (0..=u8::MAX).filter_map(|number| outcome_of(number).ok()).collect();
        assert_eq!(outcomes.len(), 11);
        for (outcome, part) in outcomes.into_iter().zip([None, Some(part())].into_iter().cycle()) {
            let (reason, delivery_id) = ("nobody came".to_owned(), "delivery_3".to_owned());
            let sent = DeliveryEnd { outcome, reason, delivery_id, part };
            let came = from_result(to_result(sent.clone())).unwrap();
            assert_same_part(came.part.as_ref(), sent.part.as_ref());
            assert_eq!(DeliveryEnd { part: sent.part.clone(), ..came }, sent);
        }
    }
}
