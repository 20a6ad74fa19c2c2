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
    LegLimits {
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
            Lease::LegLimits { name, expires } => {
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
            (None, Lease::None | Lease::LegLimits { .. }) => Trip::Granted,
        }
    }

    /// Whether the trip's lease lasts until `until`; asks for longer when not.
    pub(super) fn lasts(&mut self, now: Stamp, until: Stamp, outputs: &mut Vec<Output>) -> bool {
        match &self.trip {
            Lease::LegLimits { name, expires } if *expires < until => {
                let (name, expires) = (name.clone(), *expires);
                let id = self.next();
                let duration = until.saturating_sub(now);
                outputs.push(Output::Renew { id, lease: name.clone(), duration });
                self.trip = Lease::Renewing { name, expires, id };
                false
            }
            Lease::LegLimits { .. } => true,
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
        if let Lease::LegLimits { name, .. } | Lease::Renewing { name, .. } = std::mem::take(&mut self.trip) {
            outputs.push(Output::Release(name));
        }
    }

    /// Takes the arbiter's answer. Returns why the place to park was refused, if it was.
    pub(super) fn answered(&mut self, id: ReserveId, answer: LeaseAnswer, outputs: &mut Vec<Output>) -> Option<String> {
        let asked = |lease: &Lease| match lease {
            Lease::Asked(asked) | Lease::Renewing { id: asked, .. } => *asked == id,
            Lease::None | Lease::LegLimits { .. } => false,
        };
        if asked(&self.parking) {
            return match answer {
                Ok((name, expires)) => {
                    self.parking = Lease::LegLimits { name, expires };
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
                Ok((name, expires)) => self.trip = Lease::LegLimits { name, expires },
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
