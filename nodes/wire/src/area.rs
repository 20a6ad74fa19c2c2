//! Areas of the platen and their leases as messages.

use std::time::Duration;

use feeder_model::area::Area;
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::msg::{self, AreaLease, AreaLeases};
use minifactory_msgs::ns_of_stamp;
use minifactory_msgs::srv::{ReserveAreaRequest, ReserveAreaResponse};
use nalgebra::Vector2;

use crate::numbered::numbered;
use crate::stamp_of;

/// An area as a message.
#[must_use]
pub fn to_message(area: &Area) -> msg::Area {
    let points = area.points_m.iter().map(|point| Point { x: point.x, y: point.y, z: 0.0 }).collect();
    msg::Area { points, radius_m: area.radius_m }
}

/// The area of a message, unchecked; see [`Area::validate`].
#[must_use]
pub fn from_message(message: &msg::Area) -> Area {
    let points_m = message.points.iter().map(|point| Vector2::new(point.x, point.y)).collect();
    Area { points_m, radius_m: message.radius_m }
}

/// What an agent asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum AreaRequest {
    /// A lease of an area.
    New {
        /// What for.
        area: Area,
        /// The agent rests there.
        parked: bool,
        /// The agent's body is there or enters it.
        occupied: bool,
        /// How long the request may wait.
        wait: Duration,
    },
    /// That a lease goes on.
    Renew {
        /// The lease.
        lease: String,
    },
}

/// A request of `agent` for a lease that lasts for `duration` from now on.
#[must_use]
pub fn to_request(agent: &str, request: &AreaRequest, duration: Duration) -> ReserveAreaRequest {
    let common =
        ReserveAreaRequest { agent: agent.to_owned(), duration_s: duration.as_secs_f64(), ..Default::default() };
    match request {
        AreaRequest::New { area, parked, occupied, wait } => ReserveAreaRequest {
            area: to_message(area),
            parked: *parked,
            occupied: *occupied,
            wait_s: wait.as_secs_f64(),
            ..common
        },
        AreaRequest::Renew { lease } => ReserveAreaRequest { lease_id: lease.clone(), ..common },
    }
}

/// What a request asks for, and for how long.
///
/// # Errors
/// A time that is no positive number: what, and what is allowed.
pub fn from_request(message: &ReserveAreaRequest) -> Result<(AreaRequest, Duration), String> {
    let seconds = |key: &str, value_s: f64| {
        Duration::try_from_secs_f64(value_s).map_err(|_| format!("{key} = {value_s}, allowed is a positive number"))
    };
    let duration = seconds("duration_s", message.duration_s)?;
    let wait = seconds("wait_s", message.wait_s)?;
    if !message.lease_id.is_empty() {
        return Ok((AreaRequest::Renew { lease: message.lease_id.clone() }, duration));
    }
    let area = from_message(&message.area);
    Ok((AreaRequest::New { area, parked: message.parked, occupied: message.occupied, wait }, duration))
}

/// Why there is no lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoLease {
    /// A value is out of its range.
    Invalid,
    /// Others were in the way for as long as the request could wait.
    Taken,
    /// Another agent is parked in the area.
    Parked,
    /// Another agent's lease has ended in the area, but it has not left.
    Overdue,
    /// Others are in the way, and an agent on a trip may not wait.
    OnATrip,
    /// The agent holds no such lease to renew.
    UnknownLease,
}

numbered! {
    /// The number of a refusal.
    refusal_number,
    /// The refusal of a number.
    refusal_of,
    "result", "0 to 6",
    NoLease as u8 {
        Invalid = ReserveAreaResponse::INVALID,
        Taken = ReserveAreaResponse::TAKEN,
        Parked = ReserveAreaResponse::PARKED,
        Overdue = ReserveAreaResponse::OVERDUE,
        OnATrip = ReserveAreaResponse::ON_A_TRIP,
        UnknownLease = ReserveAreaResponse::UNKNOWN_LEASE,
    }
}

/// What a request came to: the name of the lease and when it ends on the run's clock, or why there is none, in a word and
/// for people.
pub type AreaAnswer = Result<(String, Duration), (NoLease, String)>;

/// An answer as a message.
#[must_use]
pub fn to_response(answer: AreaAnswer) -> ReserveAreaResponse {
    match answer {
        Ok((lease_id, expires)) => ReserveAreaResponse {
            result: ReserveAreaResponse::GRANTED,
            lease_id,
            expires: stamp_of(expires),
            message: String::new(),
        },
        Err((refusal, message)) => {
            ReserveAreaResponse { result: refusal_number(refusal), message, ..ReserveAreaResponse::default() }
        }
    }
}

/// The answer of a message; a result that is not known counts as [`NoLease::Invalid`].
#[expect(clippy::missing_errors_doc, reason = "an answer may be a refusal")]
pub fn from_response(message: ReserveAreaResponse) -> AreaAnswer {
    if message.result == ReserveAreaResponse::GRANTED {
        return Ok((message.lease_id, Duration::from_nanos(ns_of_stamp(&message.expires))));
    }
    Err((refusal_of(message.result).unwrap_or(NoLease::Invalid), message.message))
}

/// A lease as it is told to everybody.
#[derive(Clone, Debug, PartialEq)]
pub struct LeasedArea {
    /// Names it.
    pub lease: String,
    /// Who holds it.
    pub agent: String,
    /// What is leased.
    pub area: Area,
    /// The holder rests there.
    pub parked: bool,
    /// The holder's body is there.
    pub occupied: bool,
    /// When it ends, on the run's clock.
    pub expires: Duration,
    /// It has ended, but the holder's body may still be there.
    pub overdue: bool,
}

/// All leases of the platen, oldest first, and the agents whose requests wait, first come first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlatenLeases {
    /// The leases.
    pub leases: Vec<LeasedArea>,
    /// The agents that wait.
    pub waiting: Vec<String>,
}

/// The leases as a message; its header is left to the publisher.
#[must_use]
pub fn to_leases(leases: &PlatenLeases) -> AreaLeases {
    let PlatenLeases { leases, waiting } = leases;
    AreaLeases { leases: leases.iter().map(to_lease).collect(), waiting: waiting.clone(), ..AreaLeases::default() }
}

/// The leases of a message.
#[must_use]
pub fn from_leases(message: &AreaLeases) -> PlatenLeases {
    PlatenLeases { leases: message.leases.iter().map(from_lease).collect(), waiting: message.waiting.clone() }
}

fn to_lease(lease: &LeasedArea) -> AreaLease {
    AreaLease {
        lease_id: lease.lease.clone(),
        agent: lease.agent.clone(),
        area: to_message(&lease.area),
        parked: lease.parked,
        occupied: lease.occupied,
        expires: stamp_of(lease.expires),
        overdue: lease.overdue,
    }
}

fn from_lease(message: &AreaLease) -> LeasedArea {
    LeasedArea {
        lease: message.lease_id.clone(),
        agent: message.agent.clone(),
        area: from_message(&message.area),
        parked: message.parked,
        occupied: message.occupied,
        expires: Duration::from_nanos(ns_of_stamp(&message.expires)),
        overdue: message.overdue,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corridor() -> Area {
        Area { points_m: vec![Vector2::new(0.1, -0.2), Vector2::new(0.5, 0.7)], radius_m: 0.1 }
    }

    #[test]
    fn requests_survive_the_round_trip() {
        let new =
            AreaRequest::New { area: corridor(), parked: false, occupied: true, wait: Duration::from_millis(2_500) };
        for request in [new, AreaRequest::Renew { lease: "lease_7".to_owned() }] {
            let duration = Duration::from_secs(30);
            let message = to_request("feeder", &request, duration);
            assert_eq!(message.agent, "feeder");
            assert_eq!(from_request(&message), Ok((request, duration)));
        }
    }

    #[test]
    fn a_time_that_makes_no_sense_is_named() {
        let message = ReserveAreaRequest { duration_s: 1.0, wait_s: f64::NAN, ..Default::default() };
        assert_eq!(from_request(&message).unwrap_err(), "wait_s = NaN, allowed is a positive number");
    }

    #[test]
    fn answers_survive_the_round_trip() {
        let granted = Ok(("lease_7".to_owned(), Duration::from_nanos(12_000_000_003)));
        let refusals: Vec<NoLease> = (0..=u8::MAX).filter_map(|number| refusal_of(number).ok()).collect();
        assert_eq!(refusals.len(), 6);
        let refused = refusals.into_iter().map(|refusal| Err((refusal, "why not".to_owned())));
        for answer in refused.chain([granted]) {
            assert_eq!(from_response(to_response(answer.clone())), answer);
        }
        let unknown = ReserveAreaResponse { result: 200, ..Default::default() };
        assert_eq!(from_response(unknown), Err((NoLease::Invalid, String::new())));
    }

    #[test]
    fn leases_survive_the_round_trip() {
        let lease = |number: u64| LeasedArea {
            lease: format!("lease_{number}"),
            agent: format!("feeder_{number}"),
            area: corridor(),
            parked: number == 1,
            occupied: number == 2,
            expires: Duration::from_millis(90_500 + number),
            overdue: number == 3,
        };
        let waiting = vec!["crane".to_owned(), "feeder_2".to_owned()];
        let sent = PlatenLeases { leases: (1..4).map(lease).collect(), waiting };
        assert_eq!(from_leases(&to_leases(&sent)), sent);
    }
}
