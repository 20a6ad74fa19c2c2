//! Reports on hand-overs, as agents make them by `report_handover`.

use feeder_model::delivery::HandOver;
use minifactory_msgs::srv::ReportHandoverRequest;

use crate::numbered::{UnknownNumber, numbered};

numbered! {
    /// The number of a report on a hand-over.
    report_number,
    /// The report of a number.
    report_of,
    "report", "0 to 2",
    HandOver as u8 {
        Taken = ReportHandoverRequest::TAKEN,
        NotTaken = ReportHandoverRequest::NOT_TAKEN,
        Released = ReportHandoverRequest::RELEASED,
    }
}

/// What an agent says of a hand-over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HandOverReport {
    /// The delivery that presented the part.
    pub delivery_id: String,
    /// Tells the reports on a delivery apart; an agent counts them from 1.
    pub sequence: u32,
    /// How it goes.
    pub hand_over: HandOver,
    /// What happened, for people.
    pub message: String,
}

/// A report as a request.
#[must_use]
pub fn to_request(report: HandOverReport) -> ReportHandoverRequest {
    let HandOverReport { delivery_id, sequence, hand_over, message } = report;
    ReportHandoverRequest { delivery_id, sequence, report: report_number(hand_over), message }
}

/// The report of a request.
///
/// # Errors
/// A report that is not known.
pub fn from_request(message: ReportHandoverRequest) -> Result<HandOverReport, UnknownNumber> {
    let ReportHandoverRequest { delivery_id, sequence, report, message } = message;
    Ok(HandOverReport { delivery_id, sequence, hand_over: report_of(report)?, message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_survive_the_round_trip() {
        for hand_over in [HandOver::Taken, HandOver::NotTaken, HandOver::Released] {
            let (delivery_id, message) = ("delivery_3".to_owned(), "slipped".to_owned());
            let sent = HandOverReport { delivery_id, sequence: 2, hand_over, message };
            assert_eq!(from_request(to_request(sent.clone())), Ok(sent));
        }
        let unknown = ReportHandoverRequest { report: 3, ..ReportHandoverRequest::default() };
        assert_eq!(from_request(unknown).unwrap_err().to_string(), "report = 3, allowed are 0 to 2");
    }
}
