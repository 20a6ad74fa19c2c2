//! The platen arbiter: leases areas of the platen, so that agents which share it do not collide.
//!
//! It serves `reserve_area` and `release_area` and publishes all leases. An answer to a reservation comes when the area
//! is granted or refused; see [`Arbiter`] for the rules and for why there is no deadlock.

use std::collections::BTreeMap;
use std::time::Duration;

use feeder_control::platen::{Answer, Arbiter, Granted, LeaseId, Refusal, Reservation, Ticket};
use feeder_runtime::node::{Asker, Declare, FeederNode, NodeError, Publisher, Server, StepIo};
use feeder_scenario::plan::{NodeConfig, PlatenArbiterConfig};
use feeder_wire::area::{self, AreaRequest, LeasedArea, NoLease, PlatenLeases};
use feeder_wire::{frames, nodes, response, services, topics};
use minifactory_msgs::msg::AreaLeases;
use minifactory_msgs::srv::{ReleaseArea, ReserveArea, ReserveAreaRequest, ReserveAreaResponse};

/// Handles of the arbiter's ports.
pub struct Ports {
    reserve: Server<ReserveArea>,
    release: Server<ReleaseArea>,
    leases: Publisher<AreaLeases>,
}

/// The platen arbiter.
pub struct PlatenArbiter {
    ports: Ports,
    arbiter: Arbiter,
    tickets: Ticket,
    askers: BTreeMap<Ticket, Asker>,
    /// What was last published, without its stamp.
    said: Option<PlatenLeases>,
}

impl FeederNode for PlatenArbiter {
    const NAME: &'static str = nodes::PLATEN_ARBITER;
    type Config = PlatenArbiterConfig;
    type Ports = Ports;

    fn tick(config: &PlatenArbiterConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &PlatenArbiterConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, _: &PlatenArbiterConfig) -> Ports {
        Ports {
            reserve: io.server(&services::RESERVE_AREA),
            release: io.server(&services::RELEASE_AREA),
            leases: io.publisher(&topics::LEASES),
        }
    }

    fn open(ports: Ports, _: &PlatenArbiterConfig) -> Result<Self, NodeError> {
        Ok(Self { ports, arbiter: Arbiter::default(), tickets: 0, askers: BTreeMap::new(), said: None })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        let now = Duration::from_nanos(io.now_ns());
        for (asker, request) in io.requests(&self.ports.release) {
            let lease = request.lease_id.parse();
            let released = lease.and_then(|lease| self.arbiter.release(&request.agent, lease)).map(|()| "");
            io.reply(&self.ports.release, asker, &response::to_message(released));
        }
        for (asker, request) in io.requests(&self.ports.reserve) {
            self.reserve(io, now, asker, &request);
        }
        for (ticket, answer) in self.arbiter.step(now) {
            if let Some(asker) = self.askers.remove(&ticket) {
                io.reply(&self.ports.reserve, asker, &response(answer));
            }
        }
        self.publish(io);
        Ok(())
    }
}

impl PlatenArbiter {
    fn reserve(&mut self, io: &mut StepIo, now: Duration, asker: Asker, request: &ReserveAreaRequest) {
        let (asked, duration) = match area::from_request(request) {
            Ok(understood) => understood,
            Err(message) => {
                let response = area::to_response(Err((NoLease::Invalid, message)));
                io.reply(&self.ports.reserve, asker, &response);
                return;
            }
        };
        match asked {
            AreaRequest::Renew { lease } => {
                let renewed = lease.parse().and_then(|lease: LeaseId| {
                    let expires = self.arbiter.renew(now, &request.agent, lease, duration)?;
                    Ok((lease.to_string(), expires))
                });
                let answer = renewed.map_err(|error| (NoLease::UnknownLease, error.to_string()));
                io.reply(&self.ports.reserve, asker, &area::to_response(answer));
            }
            AreaRequest::New { area, parked, occupied, wait } => {
                self.tickets += 1;
                self.askers.insert(self.tickets, asker);
                let agent = request.agent.clone();
                let reservation = Reservation { agent, area, parked, occupied, duration, wait };
                self.arbiter.reserve(now, self.tickets, reservation);
            }
        }
    }

    fn publish(&mut self, io: &mut StepIo) {
        let leases = self.arbiter.leases().iter().map(|(id, lease)| LeasedArea {
            lease: id.to_string(),
            agent: lease.agent.clone(),
            area: lease.area.clone(),
            parked: lease.parked,
            occupied: lease.occupied,
            expires: lease.expires,
            overdue: lease.overdue,
        });
        let leases =
            PlatenLeases { leases: leases.collect(), waiting: self.arbiter.waiting().map(str::to_owned).collect() };
        if self.said.as_ref() != Some(&leases) {
            for lease in leases.leases.iter().filter(|lease| lease.overdue) {
                tracing::warn!("{} of {} has ended without a release", lease.lease, lease.agent);
            }
            let message = AreaLeases { header: io.header(frames::PLATEN), ..area::to_leases(&leases) };
            io.publish(&self.ports.leases, &message);
            self.said = Some(leases);
        }
    }
}

fn response(answer: Answer) -> ReserveAreaResponse {
    area::to_response(answer.map(|Granted { lease, expires }| (lease.to_string(), expires)).map_err(|refusal| {
        let kind = match refusal {
            Refusal::NoAgent | Refusal::Area(_) | Refusal::Duration { .. } => NoLease::Invalid,
            Refusal::Taken { .. } | Refusal::Full { .. } => NoLease::Taken,
            Refusal::Parked { .. } => NoLease::Parked,
            Refusal::Overdue { .. } => NoLease::Overdue,
            Refusal::OnATrip { .. } => NoLease::OnATrip,
        };
        (kind, refusal.to_string())
    }))
}
