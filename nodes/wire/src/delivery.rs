//! Phases, outcomes, reports and names of deliveries as messages hold them.

use feeder_model::delivery::{HandOver, Outcome, Phase};
use minifactory_msgs::action::DeliverPartResult;
use minifactory_msgs::msg::DeliveryState;
use minifactory_msgs::srv::ReportHandoverRequest;

use crate::numbered::numbered;

const DELIVERY_PREFIX: &str = "delivery_";

/// The name of a delivery, by its number.
#[must_use]
pub fn name_of(number: u64) -> String {
    format!("{DELIVERY_PREFIX}{number}")
}

/// The number of a delivery; nothing for a text that names none.
#[must_use]
pub fn number_of(name: &str) -> Option<u64> {
    name.strip_prefix(DELIVERY_PREFIX)?.parse().ok()
}

numbered! {
    /// The number of a phase.
    phase_number,
    /// The phase of a number; nothing for one that is not known.
    phase_of,
    Phase {
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

numbered! {
    /// The number of an outcome.
    outcome_number,
    /// The outcome of a number; nothing for one that is not known.
    outcome_of,
    Outcome {
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

numbered! {
    /// The number of a report on a hand-over.
    report_number,
    /// The report of a number; nothing for one that is not known.
    report_of,
    HandOver {
        Taken = ReportHandoverRequest::TAKEN,
        NotTaken = ReportHandoverRequest::NOT_TAKEN,
        Released = ReportHandoverRequest::RELEASED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn phases_outcomes_and_reports_survive_the_round_trip() {
        for number in 0..=u8::MAX {
            assert_eq!(phase_of(number).map(phase_number), (number < 11).then_some(number));
            assert_eq!(outcome_of(number).map(outcome_number), (number < 11).then_some(number));
            assert_eq!(report_of(number).map(report_number), (number < 3).then_some(number));
        }
    }
}
