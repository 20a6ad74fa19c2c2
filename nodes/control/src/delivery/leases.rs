//! What the planner holds of a platen that it shares: the place where it parks, and the area of the trip under way.

use std::time::Duration;

use super::protocol::Output;
use super::request::{LeaseAnswer, ReserveId, Stamp};
use crate::platen::{Arbiter, Area};

/// A lease, as far as the planner knows.
#[derive(Clone, Debug, Default, PartialEq)]
enum Lease {
    #[default]
    None,
    Asked(ReserveId),
    Granted {
        name: String,
        expires: Stamp,
    },
    /// It holds, but has been asked for longer.
    Renewing {
        name: String,
        expires: Stamp,
        id: ReserveId,
    },
}

/// How the request for a trip stands.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Trip {
    /// Not decided yet.
    Open,
    /// The area is the planner's for as long as asked.
    Granted,
    /// It is not, and why.
    Refused(String),
}

/// The leases of a planner. On a platen of its own everything is granted at once.
#[derive(Clone, Debug)]
pub(super) struct Leases {
    arbitrated: bool,
    asked: u64,
    parking: Lease,
    trip: Lease,
    refused: Option<String>,
}

impl Leases {
    /// How long a place to park is leased for; renewed at half of it.
    const PARKING: Duration = Arbiter::DURATION_MAX;

    pub(super) fn new(arbitrated: bool) -> Self {
        Self { arbitrated, asked: 0, parking: Lease::None, trip: Lease::None, refused: None }
    }

    /// Asks for the place to park, and for longer when half of its time is over. Says whether the planner has it.
    pub(super) fn park(&mut self, now: Stamp, area: &Area, outputs: &mut Vec<Output>) -> bool {
        if !self.arbitrated {
            return true;
        }
        match &self.parking {
            Lease::None => {
                let id = self.next();
                let (duration, wait) = (Self::PARKING, Duration::ZERO);
                outputs.push(Output::Reserve { id, area: area.clone(), parked: true, duration, wait });
                self.parking = Lease::Asked(id);
                false
            }
            Lease::Asked(_) => false,
            Lease::Granted { name, expires } => {
                if *expires < now + Self::PARKING / 2 {
                    let (lease, expires) = (name.clone(), *expires);
                    let id = self.next();
                    outputs.push(Output::Renew { id, lease: lease.clone(), duration: Self::PARKING });
                    self.parking = Lease::Renewing { name: lease, expires, id };
                }
                true
            }
            Lease::Renewing { .. } => true,
        }
    }

    /// Asks for the area of a trip. There is one trip at a time: what is left of another is given back.
    pub(super) fn ask(&mut self, area: Area, duration: Duration, wait: Duration, outputs: &mut Vec<Output>) {
        self.end_trip(outputs);
        if self.arbitrated {
            let id = self.next();
            outputs.push(Output::Reserve { id, area, parked: false, duration, wait });
            self.trip = Lease::Asked(id);
        }
    }

    /// How the request for the trip stands.
    pub(super) fn trip(&self) -> Trip {
        match (&self.refused, &self.trip) {
            (Some(reason), _) => Trip::Refused(reason.clone()),
            (None, Lease::Asked(_)) => Trip::Open,
            (None, Lease::Renewing { .. }) => Trip::Open,
            (None, Lease::None) if self.arbitrated => Trip::Refused("it was never reserved".into()),
            (None, Lease::None | Lease::Granted { .. }) => Trip::Granted,
        }
    }

    /// Whether the trip's lease lasts until `until`; asks for longer when not.
    pub(super) fn lasts(&mut self, now: Stamp, until: Stamp, outputs: &mut Vec<Output>) -> bool {
        match &self.trip {
            Lease::Granted { name, expires } if *expires < until => {
                let (name, expires) = (name.clone(), *expires);
                let id = self.next();
                let duration = until.saturating_sub(now);
                outputs.push(Output::Renew { id, lease: name.clone(), duration });
                self.trip = Lease::Renewing { name, expires, id };
                false
            }
            Lease::Granted { .. } => true,
            Lease::None => !self.arbitrated,
            Lease::Asked(_) | Lease::Renewing { .. } => false,
        }
    }

    /// Whether a trip's area must be asked for before the courier may move.
    pub(super) fn must_ask(&self) -> bool {
        self.arbitrated && self.trip == Lease::None
    }

    /// Why the last request for a trip was refused, told once.
    pub(super) fn take_refusal(&mut self) -> Option<String> {
        self.refused.take()
    }

    /// Gives the trip's area back, or takes it that it is not wanted any more.
    pub(super) fn end_trip(&mut self, outputs: &mut Vec<Output>) {
        self.refused = None;
        if let Lease::Granted { name, .. } | Lease::Renewing { name, .. } = std::mem::take(&mut self.trip) {
            outputs.push(Output::Release(name));
        }
    }

    /// Takes the arbiter's answer. Returns why the place to park was refused, if it was.
    pub(super) fn answered(&mut self, id: ReserveId, answer: LeaseAnswer, outputs: &mut Vec<Output>) -> Option<String> {
        let asked = |lease: &Lease| match lease {
            Lease::Asked(asked) | Lease::Renewing { id: asked, .. } => *asked == id,
            Lease::None | Lease::Granted { .. } => false,
        };
        if asked(&self.parking) {
            return match answer {
                Ok((name, expires)) => {
                    self.parking = Lease::Granted { name, expires };
                    None
                }
                Err(reason) => {
                    self.parking = Lease::None;
                    Some(reason)
                }
            };
        }
        if asked(&self.trip) {
            match answer {
                Ok((name, expires)) => self.trip = Lease::Granted { name, expires },
                Err(reason) => {
                    self.trip = Lease::None;
                    self.refused = Some(reason);
                }
            }
        } else if let Ok((name, _)) = answer {
            // The trip was given up before its area was granted.
            outputs.push(Output::Release(name));
        }
        None
    }

    fn next(&mut self) -> ReserveId {
        self.asked += 1;
        ReserveId(self.asked)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    fn seconds(s: u64) -> Duration {
        Duration::from_secs(s)
    }

    fn area() -> Area {
        Area::disc(Vector2::zeros(), 0.1)
    }

    /// What a step asks of the arbiter: the number of a request with a word for its kind.
    fn asked(outputs: &mut Vec<Output>) -> Vec<(&'static str, Option<ReserveId>)> {
        let kind = |output: Output| match output {
            Output::Reserve { id, .. } => ("reserve", Some(id)),
            Output::Renew { id, .. } => ("renew", Some(id)),
            Output::Release(_) => ("release", None),
            other => panic!("{other:?}"),
        };
        outputs.drain(..).map(kind).collect()
    }

    fn ok(expires_s: u64) -> LeaseAnswer {
        Ok(("lease_1".to_owned(), seconds(expires_s)))
    }

    /// A trip asked for 10 s and granted.
    fn on_trip() -> (Leases, Vec<Output>) {
        let (mut leases, mut outputs) = (Leases::new(true), Vec::new());
        leases.ask(area(), seconds(10), seconds(60), &mut outputs);
        assert_eq!((asked(&mut outputs), leases.trip()), (vec![("reserve", Some(ReserveId(1)))], Trip::Open));
        assert_eq!(leases.answered(ReserveId(1), ok(10), &mut outputs), None);
        assert_eq!(leases.trip(), Trip::Granted);
        (leases, outputs)
    }

    #[test]
    fn a_trip_that_would_outlast_its_lease_waits_until_the_lease_is_renewed() {
        let (mut leases, mut outputs) = on_trip();
        assert!(leases.lasts(seconds(5), seconds(10), &mut outputs) && outputs.is_empty());
        assert!(!leases.lasts(seconds(5), seconds(11), &mut outputs));
        let [Output::Renew { id, duration, .. }] = &outputs[..] else { panic!("{outputs:?}") };
        assert_eq!((*id, *duration), (ReserveId(2), seconds(6)));
        outputs.clear();
        assert_eq!(leases.trip(), Trip::Open);
        assert!(!leases.lasts(seconds(5), seconds(11), &mut outputs) && outputs.is_empty());
        leases.answered(ReserveId(2), ok(11), &mut outputs);
        assert!(leases.lasts(seconds(5), seconds(11), &mut outputs));
    }

    #[test]
    fn what_is_granted_after_the_trip_was_given_up_is_given_back() {
        let (mut leases, mut outputs) = (Leases::new(true), Vec::new());
        leases.ask(area(), seconds(10), seconds(60), &mut outputs);
        leases.end_trip(&mut outputs);
        outputs.clear();
        leases.answered(ReserveId(1), ok(10), &mut outputs);
        assert_eq!(outputs, [Output::Release("lease_1".to_owned())]);
        assert!(leases.must_ask());
    }

    #[test]
    fn a_lease_is_given_back_also_while_it_is_being_renewed() {
        let (mut leases, mut outputs) = on_trip();
        leases.lasts(seconds(5), seconds(11), &mut outputs);
        outputs.clear();
        leases.end_trip(&mut outputs);
        assert_eq!(outputs, [Output::Release("lease_1".to_owned())]);
        assert!(leases.must_ask());
    }

    #[test]
    fn a_refused_trip_says_why_once() {
        let (mut leases, mut outputs) = (Leases::new(true), Vec::new());
        leases.ask(area(), seconds(10), seconds(60), &mut outputs);
        leases.answered(ReserveId(1), Err("taken".to_owned()), &mut outputs);
        assert_eq!(leases.trip(), Trip::Refused("taken".to_owned()));
        assert_eq!((leases.take_refusal().as_deref(), leases.take_refusal()), (Some("taken"), None));
        assert!(leases.must_ask() && matches!(leases.trip(), Trip::Refused(_)));
    }

    #[test]
    fn the_place_to_park_is_renewed_when_half_of_its_time_is_over() {
        let (mut leases, mut outputs) = (Leases::new(true), Vec::new());
        assert!(!leases.park(seconds(0), &area(), &mut outputs));
        assert_eq!(asked(&mut outputs), [("reserve", Some(ReserveId(1)))]);
        assert!(!leases.park(seconds(1), &area(), &mut outputs) && outputs.is_empty());
        leases.answered(ReserveId(1), Ok(("lease_1".to_owned(), Leases::PARKING)), &mut outputs);
        let half = Leases::PARKING / 2;
        assert!(leases.park(half, &area(), &mut outputs) && outputs.is_empty());
        let past = half + seconds(1);
        assert!(leases.park(past, &area(), &mut outputs));
        assert_eq!(asked(&mut outputs), [("renew", Some(ReserveId(2)))]);
        assert!(leases.park(past, &area(), &mut outputs) && outputs.is_empty());
        // A renewal that is refused leaves no place, and is told.
        let refused = leases.answered(ReserveId(2), Err("gone".to_owned()), &mut outputs);
        assert_eq!(refused.as_deref(), Some("gone"));
        assert!(!leases.park(past, &area(), &mut outputs));
    }

    #[test]
    fn a_platen_of_ones_own_needs_no_leases() {
        let (mut leases, mut outputs) = (Leases::new(false), Vec::new());
        leases.ask(area(), seconds(10), seconds(60), &mut outputs);
        assert!(leases.park(seconds(0), &area(), &mut outputs) && leases.trip() == Trip::Granted);
        assert!(leases.lasts(seconds(0), seconds(99), &mut outputs) && !leases.must_ask() && outputs.is_empty());
    }
}
