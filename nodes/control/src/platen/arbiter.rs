//! Who may be where: areas of the platen leased to one agent at a time.
//!
//! An agent that comes to rest somewhere *parks* there; one that wants to move leases the whole area of its *trip* in
//! one piece, goes, and releases it when it is parked again. Leases of different agents never overlap.
//!
//! Requests wait in the order in which they came: one is granted when it overlaps neither a lease of another agent nor
//! a request that came before it, so nobody is overtaken by those it stands in the way of, and others need not wait.
//!
//! No deadlock is possible. Whoever waits, waits for a trip's lease or for a request that came earlier: a request that
//! overlaps the place where another agent parks is refused, not kept, and so is one of an agent that is on a trip. The
//! holder of a trip's lease therefore waits for nobody, and requests wait for older ones only: no circle can close. As
//! leases end and waiting is limited, nobody waits for ever either.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use thiserror::Error;

use feeder_model::area::Area;
use feeder_model::range::OutOfRange;

/// Names a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LeaseId(pub u64);

impl fmt::Display for LeaseId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "lease_{}", self.0)
    }
}

impl std::str::FromStr for LeaseId {
    type Err = UnknownLease;

    fn from_str(text: &str) -> Result<Self, UnknownLease> {
        let number = text.strip_prefix("lease_").and_then(|number| number.parse().ok());
        number.map(Self).ok_or_else(|| UnknownLease { lease: text.to_owned(), agent: String::new() })
    }
}

/// Names a request until it is answered; the caller chooses it.
pub type Ticket = u64;

/// What an agent asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Reservation {
    /// Who asks.
    pub agent: String,
    /// What for.
    pub area: Area,
    /// The agent rests in the area, rather than moving through it.
    pub parked: bool,
    /// The agent's body is in the area or enters it: when the lease ends in time, the area stays closed to others until
    /// it is released.
    pub occupied: bool,
    /// How long the lease lasts from its grant on.
    pub duration: Duration,
    /// How long the request may wait.
    pub wait: Duration,
}

/// A lease that was granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Granted {
    /// Its name.
    pub lease: LeaseId,
    /// When it ends, on the clock of the caller.
    pub expires: Duration,
}

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Refusal {
    /// The agent has no name.
    #[error("agent is empty; allowed is the name of the agent, unique on the platen")]
    NoAgent,
    /// An area that cannot be.
    #[error("area: {0}")]
    Area(#[from] OutOfRange),
    /// A lease that would last no time, or too long.
    #[error("duration_s = {duration_s} is outside its range: above 0 to {max_s}")]
    Duration {
        /// The duration asked for, s.
        duration_s: f64,
        /// The longest allowed, s.
        max_s: f64,
    },
    /// Another agent rests there.
    #[error("{agent} is parked in the area")]
    Parked {
        /// The other agent.
        agent: String,
    },
    /// Another agent's lease has ended, but it has not left.
    #[error("the lease {lease} of {agent} has ended in the area without a release")]
    Overdue {
        /// The other agent.
        agent: String,
        /// Its lease.
        lease: LeaseId,
    },
    /// The agent is on a trip already, and an agent on a trip may not wait for another area.
    #[error("the area is taken by {taken_by}, and an agent that holds {held} may not wait for another area")]
    OnATrip {
        /// The lease the agent holds.
        held: LeaseId,
        /// Who is in the way.
        taken_by: String,
    },
    /// Nothing became free in time.
    #[error("the area is taken by {taken_by}")]
    Taken {
        /// Who is in the way.
        taken_by: String,
    },
    /// Too many requests wait.
    #[error("{waiting} requests wait already, as many as may")]
    Full {
        /// How many.
        waiting: usize,
    },
}

/// A lease that is not there, or is not that agent's.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{agent:?} holds no lease {lease:?}")]
pub struct UnknownLease {
    /// The lease named.
    pub lease: String,
    /// The agent named.
    pub agent: String,
}

/// A lease.
#[derive(Clone, Debug, PartialEq)]
pub struct Lease {
    /// Who holds it.
    pub agent: String,
    /// What is leased.
    pub area: Area,
    /// The holder rests there.
    pub parked: bool,
    /// The holder's body is there.
    pub occupied: bool,
    /// When it ends.
    pub expires: Duration,
    /// It has ended, but the holder's body may still be there.
    pub overdue: bool,
}

/// What a request came to.
pub type Answer = Result<Granted, Refusal>;

#[derive(Clone, Debug)]
struct Waiting {
    ticket: Ticket,
    reservation: Reservation,
    until: Duration,
}

/// The arbiter. Time is an argument, on any clock.
#[derive(Clone, Debug, Default)]
pub struct Arbiter {
    leases: BTreeMap<LeaseId, Lease>,
    /// In the order in which they came.
    waiting: Vec<Waiting>,
    leased: u64,
    answers: Vec<(Ticket, Answer)>,
}

impl Arbiter {
    /// The longest lease.
    pub const DURATION_MAX: Duration = Duration::from_secs(86_400);
    /// The longest wait.
    pub const WAIT_MAX: Duration = Duration::from_secs(3_600);
    /// Most requests that may wait at a time.
    pub const WAITING_MAX: usize = 256;

    /// All leases.
    #[must_use]
    pub fn leases(&self) -> &BTreeMap<LeaseId, Lease> {
        &self.leases
    }

    /// The agents that wait, in the order in which they came.
    pub fn waiting(&self) -> impl Iterator<Item = &str> {
        self.waiting.iter().map(|waiting| waiting.reservation.agent.as_str())
    }

    /// Takes a request; the answer comes out of [`step`](Self::step).
    pub fn reserve(&mut self, now: Duration, ticket: Ticket, reservation: Reservation) {
        match self.check(&reservation) {
            Ok(()) => {
                let until = now + reservation.wait.min(Self::WAIT_MAX);
                self.waiting.push(Waiting { ticket, reservation, until });
            }
            Err(refusal) => self.answers.push((ticket, Err(refusal))),
        }
    }

    /// Makes a lease last for `duration` from now on, also one that is overdue. Returns its new end.
    ///
    /// # Errors
    /// The agent holds no such lease.
    pub fn renew(
        &mut self,
        now: Duration,
        agent: &str,
        lease: LeaseId,
        duration: Duration,
    ) -> Result<Duration, UnknownLease> {
        match self.leases.get_mut(&lease) {
            Some(held) if held.agent == agent => {
                held.expires = now + duration.min(Self::DURATION_MAX);
                held.overdue = false;
                Ok(held.expires)
            }
            _ => Err(UnknownLease { lease: lease.to_string(), agent: agent.to_owned() }),
        }
    }

    /// Ends a lease.
    ///
    /// # Errors
    /// The agent holds no such lease.
    pub fn release(&mut self, agent: &str, lease: LeaseId) -> Result<(), UnknownLease> {
        match self.leases.get(&lease) {
            Some(held) if held.agent == agent => {
                self.leases.remove(&lease);
                Ok(())
            }
            _ => Err(UnknownLease { lease: lease.to_string(), agent: agent.to_owned() }),
        }
    }

    /// Ends what ends in time, grants what can be granted, and returns the answers to requests.
    pub fn step(&mut self, now: Duration) -> Vec<(Ticket, Answer)> {
        self.leases.retain(|_, lease| lease.occupied || now < lease.expires);
        for lease in self.leases.values_mut() {
            lease.overdue |= now >= lease.expires;
        }
        let mut still: Vec<Waiting> = Vec::new();
        for waiting in std::mem::take(&mut self.waiting) {
            match self.judge(now, &waiting, &still) {
                Some(answer) => self.answers.push((waiting.ticket, answer)),
                None => still.push(waiting),
            }
        }
        self.waiting = still;
        std::mem::take(&mut self.answers)
    }

    fn check(&self, reservation: &Reservation) -> Result<(), Refusal> {
        if reservation.agent.is_empty() {
            return Err(Refusal::NoAgent);
        }
        reservation.area.validate()?;
        if reservation.duration.is_zero() || reservation.duration > Self::DURATION_MAX {
            let (duration_s, max_s) = (reservation.duration.as_secs_f64(), Self::DURATION_MAX.as_secs_f64());
            return Err(Refusal::Duration { duration_s, max_s });
        }
        if self.waiting.len() >= Self::WAITING_MAX {
            return Err(Refusal::Full { waiting: self.waiting.len() });
        }
        Ok(())
    }

    /// The answer to a request that comes after those that are `still` waiting; nothing while it waits.
    fn judge(&mut self, now: Duration, waiting: &Waiting, still: &[Waiting]) -> Option<Answer> {
        let Reservation { agent, area, .. } = &waiting.reservation;
        let in_the_way: Vec<(LeaseId, &Lease)> = self
            .leases
            .iter()
            .filter(|(_, lease)| lease.agent != *agent && lease.area.overlaps(area))
            .map(|(id, lease)| (*id, lease))
            .collect();
        if let Some((lease, overdue)) = in_the_way.iter().find(|(_, lease)| lease.overdue) {
            return Some(Err(Refusal::Overdue { agent: overdue.agent.clone(), lease: *lease }));
        }
        if let Some((_, lease)) = in_the_way.iter().find(|(_, lease)| lease.parked) {
            return Some(Err(Refusal::Parked { agent: lease.agent.clone() }));
        }
        let before = still.iter().map(|earlier| &earlier.reservation);
        let before = before.filter(|earlier| earlier.agent != *agent && earlier.area.overlaps(area));
        let taken_by = in_the_way.iter().map(|(_, lease)| &lease.agent).chain(before.map(|earlier| &earlier.agent));
        let Some(taken_by) = taken_by.map(String::clone).next() else {
            return Some(Ok(self.grant(now, &waiting.reservation)));
        };
        let on_a_trip = self.leases.iter().find(|(_, lease)| lease.agent == *agent && !lease.parked);
        if let Some((held, _)) = on_a_trip {
            return Some(Err(Refusal::OnATrip { held: *held, taken_by }));
        }
        (now >= waiting.until).then_some(Err(Refusal::Taken { taken_by }))
    }

    fn grant(&mut self, now: Duration, reservation: &Reservation) -> Granted {
        self.leased += 1;
        let (lease, expires) = (LeaseId(self.leased), now + reservation.duration);
        let Reservation { agent, area, parked, occupied, .. } = reservation.clone();
        self.leases.insert(lease, Lease { agent, area, parked, occupied, expires, overdue: false });
        Granted { lease, expires }
    }
}
