//! The platen arbiter: leases areas of the platen, so that agents which share it do not collide.
//!
//! It serves `reserve_area` and `release_area` and publishes all leases. An answer to a reservation comes when the area
//! is granted or refused; see [`Arbiter`] for the rules and for why there is no deadlock.

use std::collections::BTreeMap;
use std::time::Duration;

use feeder_control::platen::{Answer, Arbiter, Area, Granted, LeaseId, Refusal, Reservation, Ticket};
use feeder_runtime::node::{Asker, Declare, FeederNode, NodeError, Publisher, Server, StepIo, stamp_of_ns};
use feeder_scenario::plan::{NodeConfig, PlatenArbiterConfig};
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::msg::{self, AreaLease, AreaLeases};
use minifactory_msgs::srv::{
    ReleaseArea, ReleaseAreaRequest, ReleaseAreaResponse, ReserveArea, ReserveAreaRequest, ReserveAreaResponse,
};
use nalgebra::Vector2;

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
    said: Option<(Vec<AreaLease>, Vec<String>)>,
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
            let response = self.release(&request);
            io.reply(&self.ports.release, asker, &response);
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
        let seconds = |key: &str, value_s: f64| {
            Duration::try_from_secs_f64(value_s).map_err(|_| format!("{key} = {value_s}, allowed is a positive number"))
        };
        let times = seconds("duration_s", request.duration_s)
            .and_then(|duration| Ok((duration, seconds("wait_s", request.wait_s)?)));
        let (duration, wait) = match times {
            Ok(times) => times,
            Err(message) => {
                let response = ReserveAreaResponse { result: ReserveAreaResponse::INVALID, message, ..refused() };
                io.reply(&self.ports.reserve, asker, &response);
                return;
            }
        };
        if !request.lease_id.is_empty() {
            let renewed = request.lease_id.parse().and_then(|lease: LeaseId| {
                let expires = self.arbiter.renew(now, &request.agent, lease, duration)?;
                Ok(Granted { lease, expires })
            });
            let response = match renewed {
                Ok(granted) => response(Ok(granted)),
                Err(error) => ReserveAreaResponse {
                    result: ReserveAreaResponse::UNKNOWN_LEASE,
                    message: error.to_string(),
                    ..refused()
                },
            };
            io.reply(&self.ports.reserve, asker, &response);
            return;
        }
        self.tickets += 1;
        self.askers.insert(self.tickets, asker);
        let points_m = request.area.points.iter().map(|point| Vector2::new(point.x, point.y)).collect();
        let reservation = Reservation {
            agent: request.agent.clone(),
            area: Area { points_m, radius_m: request.area.radius_m },
            parked: request.parked,
            occupied: request.occupied,
            duration,
            wait,
        };
        self.arbiter.reserve(now, self.tickets, reservation);
    }

    fn release(&mut self, request: &ReleaseAreaRequest) -> ReleaseAreaResponse {
        let released = request.lease_id.parse().and_then(|lease| self.arbiter.release(&request.agent, lease));
        match released {
            Ok(()) => ReleaseAreaResponse { released: true, message: String::new() },
            Err(error) => ReleaseAreaResponse { released: false, message: error.to_string() },
        }
    }

    fn publish(&mut self, io: &mut StepIo) {
        let leases: Vec<AreaLease> = self
            .arbiter
            .leases()
            .iter()
            .map(|(id, lease)| AreaLease {
                lease_id: id.to_string(),
                agent: lease.agent.clone(),
                area: area_message(&lease.area),
                parked: lease.parked,
                occupied: lease.occupied,
                expires: time(lease.expires),
                overdue: lease.overdue,
            })
            .collect();
        let waiting: Vec<String> = self.arbiter.waiting().map(str::to_owned).collect();
        if self.said.as_ref().is_none_or(|(said, waited)| (said, waited) != (&leases, &waiting)) {
            for lease in leases.iter().filter(|lease| lease.overdue) {
                tracing::warn!("{} of {} has ended without a release", lease.lease_id, lease.agent);
            }
            self.said = Some((leases.clone(), waiting.clone()));
            io.publish(&self.ports.leases, &AreaLeases { header: io.header("platen"), leases, waiting });
        }
    }
}

fn response(answer: Answer) -> ReserveAreaResponse {
    let refusal = match answer {
        Ok(Granted { lease, expires }) => {
            return ReserveAreaResponse {
                result: ReserveAreaResponse::GRANTED,
                lease_id: lease.to_string(),
                expires: time(expires),
                message: String::new(),
            };
        }
        Err(refusal) => refusal,
    };
    let result = match refusal {
        Refusal::NoAgent | Refusal::Area(_) | Refusal::Duration { .. } => ReserveAreaResponse::INVALID,
        Refusal::Taken { .. } | Refusal::Full { .. } => ReserveAreaResponse::TAKEN,
        Refusal::Parked { .. } => ReserveAreaResponse::PARKED,
        Refusal::Overdue { .. } => ReserveAreaResponse::OVERDUE,
        Refusal::OnATrip { .. } => ReserveAreaResponse::ON_A_TRIP,
    };
    ReserveAreaResponse { result, message: refusal.to_string(), ..refused() }
}

/// What all refusals have in common.
fn refused() -> ReserveAreaResponse {
    ReserveAreaResponse::default()
}

fn area_message(area: &Area) -> msg::Area {
    let points = area.points_m.iter().map(|point| Point { x: point.x, y: point.y, z: 0.0 }).collect();
    msg::Area { points, radius_m: area.radius_m }
}

fn time(since_start: Duration) -> Time {
    stamp_of_ns(u64::try_from(since_start.as_nanos()).unwrap_or(u64::MAX))
}
