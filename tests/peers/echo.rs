//! A node that answers every request with something that only this request can have asked for.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use feeder_runtime::args::RosArgs;
use feeder_runtime::dds::{DiscoveryRange, Domain};
use feeder_runtime::launch::run_remapped;
use feeder_runtime::node::{
    ActionServer, ActionServerPorts, Declare, FeederNode, GoalEnd, GoalId, NodeError, Server, ServerEvent, StepIo,
};
use feeder_runtime::testing::TestDomain;
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartResult};
use minifactory_msgs::interface::{ActionSpec, Namespace, ServiceSpec};
use minifactory_msgs::srv::{ReportHandover, ReportHandoverRequest, ReportHandoverResponse};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the node is configured by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct EchoConfig {
    /// How often, in hertz
    #[schemars(range(min = 0.5, max = 100.0))]
    pub(super) rate_hz: f64,
    /// From the scenario
    pub(super) name: String,
    /// Places, in metres
    pub(super) places_m: Vec<f64>,
}

impl Default for EchoConfig {
    fn default() -> Self {
        Self { rate_hz: 10.0, name: "demo".to_owned(), places_m: vec![0.1, 0.25] }
    }
}

/// A goal with this tolerance replaces the goals of its client that are running.
pub(super) const REPLACES_M: f64 = 1.0;

/// Reports are answered with their delivery; goals run as many steps as they allow seconds, or until they are
/// cancelled or replaced, and end with the name of their station.
pub(super) struct Echo {
    report: Server<ReportHandover>,
    deliver: ActionServer<DeliverPart>,
    running: Vec<Running>,
}

struct Running {
    id: GoalId,
    client: u64,
    station: String,
    /// Steps that are left; none: until cancelled.
    steps: Option<u32>,
}

const REPORT: ServiceSpec<ReportHandover> =
    ServiceSpec::new(Namespace::Own(""), "report").between(&[Echo::NAME], &[], "");
const DELIVER: ActionSpec<DeliverPart> = ActionSpec::new(Namespace::Own(""), "deliver").between(&[Echo::NAME], &[], "");

impl FeederNode for Echo {
    const NAME: &'static str = "echo";
    type Config = EchoConfig;
    type Ports = (Server<ReportHandover>, ActionServerPorts<DeliverPart>);

    fn tick(_: &EchoConfig) -> Duration {
        Duration::from_millis(10)
    }

    fn check(config: &EchoConfig) -> Result<(), NodeError> {
        if config.places_m.is_empty() { Err(NodeError::new("places_m is empty")) } else { Ok(()) }
    }

    fn declare(io: &mut Declare, _: &EchoConfig) -> Self::Ports {
        (io.server(&REPORT), io.action_server(&DELIVER))
    }

    fn open((report, deliver): Self::Ports, _: &EchoConfig) -> Result<Self, NodeError> {
        Ok(Self { report, deliver: ActionServer::new(deliver), running: Vec::new() })
    }

    fn settable() -> &'static [&'static str] {
        &["rate_hz"]
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for (asker, request) in io.requests(&self.report) {
            let response = ReportHandoverResponse {
                accepted: request.report == ReportHandoverRequest::TAKEN,
                message: request.delivery_id,
            };
            io.reply(&self.report, asker, &response);
        }
        for event in self.deliver.poll(io) {
            match event {
                ServerEvent::Requested(request) if request.goal.tolerance_m < 0.0 => {
                    self.deliver.reject(io, request, "a tolerance is not negative");
                }
                ServerEvent::Requested(request) => {
                    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small number")]
                    let steps = Some(request.goal.timeout_s as u32).filter(|steps| *steps > 0);
                    let client = request.client();
                    if request.goal.tolerance_m.total_cmp(&REPLACES_M).is_eq() {
                        self.end(io, GoalEnd::Canceled, |running| running.client == client);
                    }
                    self.running.push(Running { id: request.id, client, station: request.goal.station.clone(), steps });
                    self.deliver.accept(io, request);
                }
                ServerEvent::CancelRequested(id) => {
                    self.end(io, GoalEnd::Canceled, |running| running.id == id);
                }
            }
        }
        for running in &mut self.running {
            if let Some(steps) = &mut running.steps {
                *steps -= 1;
                let feedback = DeliverPartFeedback {
                    eta_s: f64::from(*steps),
                    delivery_id: running.station.clone(),
                    ..DeliverPartFeedback::default()
                };
                self.deliver.feedback(io, running.id, feedback);
            }
        }
        self.end(io, GoalEnd::Succeeded, |running| running.steps == Some(0));
        Ok(())
    }
}

impl Echo {
    fn end(&mut self, io: &mut StepIo, end: GoalEnd, ends: impl Fn(&Running) -> bool) {
        let (ended, going_on) = std::mem::take(&mut self.running).into_iter().partition(|running| ends(running));
        self.running = going_on;
        for Running { id, station, .. } in ended {
            let succeeded = end == GoalEnd::Succeeded;
            let outcome = if succeeded { DeliverPartResult::DELIVERED } else { DeliverPartResult::CANCELLED };
            let result = DeliverPartResult { outcome, reason: station, ..DeliverPartResult::default() };
            self.deliver.finish(io, id, end, result);
        }
    }
}

/// The node, running in a thread until dropped, in a domain that peers with default settings find.
pub(super) struct EchoNode {
    pub(super) domain: Domain,
    _claimed: TestDomain,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<Result<(), String>>>,
}

impl EchoNode {
    pub(super) fn start() -> Self {
        let claimed = TestDomain::claim();
        let domain = Domain { range: DiscoveryRange::Subnet, ..*claimed };
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let run = move || {
            let ros = RosArgs::default();
            run_remapped::<Echo>(&domain, "/test", &ros, &EchoConfig::default(), &stopped)
                .map_err(|error| error.to_string())
        };
        Self { domain, _claimed: claimed, stop, thread: Some(std::thread::spawn(run)) }
    }

    /// Ends it, which must go well.
    #[track_caller]
    pub(super) fn stop(mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap().unwrap();
    }
}

impl Drop for EchoNode {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}
