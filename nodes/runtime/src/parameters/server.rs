//! The parameter services of a node, and the events that tell of changes.

use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use minifactory_msgs::{
    Service,
    interface::standard::PARAMETER_EVENTS,
    rcl_interfaces::{
        msg::{Parameter, ParameterDescriptor, ParameterEvent, ParameterValue, SetParametersResult},
        srv::{
            DescribeParameters, DescribeParametersResponse, GetParameterTypes, GetParameterTypesResponse,
            GetParameters, GetParametersResponse, ListParameters, ListParametersResponse, SetParameters,
            SetParametersAtomically, SetParametersAtomicallyResponse, SetParametersResponse,
        },
    },
};

use super::{Store, Value};
use crate::{
    clock::TimeSource,
    dds::{DdsError, Outlet, Participant, Server, Writer},
};

/// Requests that may wait for an answer; more are refused.
const WAITING_MAX: usize = 256;

/// Asked about changes before they are made.
type Accept = Box<dyn FnMut(&[(String, Value)]) -> Result<(), String> + Send>;

/// A node's parameters on offer, until dropped.
pub struct ParameterServer {
    // Dropped in this order: nothing is set of which nobody could be told.
    services: Vec<Server>,
    _events: Writer,
    shared: Arc<Shared>,
    worker: Option<JoinHandle<()>>,
}

impl Drop for ParameterServer {
    fn drop(&mut self) {
        // The thread ends with the last sender of jobs, which the services own.
        self.services.clear();
        if self.worker.take().is_some_and(|worker| worker.join().is_err()) {
            tracing::error!("the thread of the parameters had panicked");
        }
    }
}

/// A request on its way to the thread that answers it.
type Job = Box<dyn FnOnce() + Send>;

/// Where requests are taken, to be answered on a thread of their own: a check may take long, and the participant's
/// thread must not wait for it.
struct Desk<'a> {
    participant: &'a Participant,
    jobs: SyncSender<Job>,
    shared: &'a Arc<Shared>,
}

impl Desk<'_> {
    fn offer<S: Service>(
        &self,
        service: &str,
        answer: fn(&Shared, S::Request) -> S::Response,
    ) -> Result<Server, DdsError> {
        let (jobs, shared) = (self.jobs.clone(), Arc::clone(self.shared));
        let name = format!("{}/{service}", shared.node);
        self.participant.serve_later::<S>(&name.clone(), move |request, responder| {
            let shared = Arc::clone(&shared);
            if jobs.try_send(Box::new(move || responder.send(&answer(&shared, request)))).is_err() {
                tracing::warn!("{name}: a request is dropped, {WAITING_MAX} wait already");
            }
        })
    }
}

impl ParameterServer {
    /// Offers the parameters of a participant's node. `accept` is asked about changes that the declarations
    /// allow, before they are made, and may refuse them with a reason; it runs on a thread of this server,
    /// or on that which calls [`set`](Self::set), and must not use this server.
    ///
    /// # Errors
    /// [`DdsError::Endpoint`] when the middleware refuses.
    pub fn new(
        participant: &Participant,
        store: Store,
        clock: TimeSource,
        accept: impl FnMut(&[(String, Value)]) -> Result<(), String> + Send + 'static,
    ) -> Result<Self, DdsError> {
        let events = participant.topic_writer(&PARAMETER_EVENTS, "")?;
        let node = participant.node().to_string();
        let shared = Arc::new(Shared {
            state: Mutex::new(State { store, accept: Box::new(accept) }),
            events: events.outlet(),
            node: node.clone(),
            clock,
        });
        let (jobs, queue) = sync_channel::<Job>(WAITING_MAX);
        let worker = thread::Builder::new()
            .name(format!("parameters {}", participant.node().name()))
            .spawn(move || queue.iter().for_each(|job| job()))
            .map_err(|error| DdsError::Endpoint { what: "thread", name: node.clone(), reason: error.to_string() })?;
        let desk = Desk { participant, jobs, shared: &shared };
        let services = vec![
            desk.offer::<ListParameters>("list_parameters", |shared, request| ListParametersResponse {
                result: shared.state().store.list(&request),
            })?,
            desk.offer::<GetParameters>("get_parameters", |shared, request| {
                let state = shared.state();
                let value = |name: &String| state.store.get(name).map(Value::to_message).unwrap_or_default();
                GetParametersResponse { values: request.names.iter().map(value).collect() }
            })?,
            desk.offer::<GetParameterTypes>("get_parameter_types", |shared, request| {
                let state = shared.state();
                let kind = |name: &String| state.store.get(name).map_or(0, |value| value.kind() as u8);
                GetParameterTypesResponse { types: request.names.iter().map(kind).collect() }
            })?,
            desk.offer::<DescribeParameters>("describe_parameters", |shared, request| {
                let state = shared.state();
                let describe = |name: String| {
                    let unknown = || ParameterDescriptor { name: name.clone(), ..Default::default() };
                    state.store.descriptor(&name).unwrap_or_else(unknown)
                };
                DescribeParametersResponse { descriptors: request.names.into_iter().map(describe).collect() }
            })?,
            desk.offer::<SetParameters>("set_parameters", |shared, request| {
                let set_one = |parameter| result(shared.set_messages(vec![parameter]));
                SetParametersResponse { results: request.parameters.into_iter().map(set_one).collect() }
            })?,
            desk.offer::<SetParametersAtomically>("set_parameters_atomically", |shared, request| {
                SetParametersAtomicallyResponse { result: result(shared.set_messages(request.parameters)) }
            })?,
        ];
        let new_parameters = shared.state().store.messages();
        shared.tell(new_parameters, Vec::new());
        Ok(Self { services, _events: events, shared, worker: Some(worker) })
    }

    /// The value of a parameter now.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Value> {
        self.shared.state().store.get(name).cloned()
    }

    /// Sets a parameter as `ros2 param set` would.
    ///
    /// # Errors
    /// The reason for which it may not be set.
    pub fn set(&self, name: &str, value: Value) -> Result<(), String> {
        self.shared.set(vec![(name.to_owned(), value)])
    }
}

fn result(outcome: Result<(), String>) -> SetParametersResult {
    SetParametersResult { successful: outcome.is_ok(), reason: outcome.err().unwrap_or_default() }
}

struct State {
    store: Store,
    accept: Accept,
}

struct Shared {
    state: Mutex<State>,
    events: Arc<Outlet>,
    node: String,
    clock: TimeSource,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set_messages(&self, parameters: Vec<Parameter>) -> Result<(), String> {
        let read = |Parameter { name, value }: Parameter| match unset_or(value) {
            Ok(value) => Ok((name, value)),
            Err(reason) => Err(format!("parameter {name} {reason}")),
        };
        self.set(parameters.into_iter().map(read).collect::<Result<_, _>>()?)
    }

    fn set(&self, mut changes: Vec<(String, Value)>) -> Result<(), String> {
        let mut state = self.state();
        let State { store, accept } = &mut *state;
        changes.iter().try_for_each(|(name, value)| store.check(name, value))?;
        // A read-only one was "set" to the value it has.
        changes.retain(|(name, _)| !store.is_read_only(name));
        if changes.is_empty() {
            return Ok(());
        }
        accept(&changes)?;
        store.set(&changes)?;
        // Told under the lock, so that news come in the order of the changes.
        let message = |(name, value): (String, Value)| Parameter { name, value: value.to_message() };
        self.tell(Vec::new(), changes.into_iter().map(message).collect());
        Ok(())
    }

    fn tell(&self, new_parameters: Vec<Parameter>, changed_parameters: Vec<Parameter>) {
        self.events.publish_message(&ParameterEvent {
            stamp: (self.clock)(),
            node: self.node.clone(),
            new_parameters,
            changed_parameters,
            deleted_parameters: Vec::new(),
        });
    }
}

fn unset_or(value: ParameterValue) -> Result<Value, String> {
    match value.r#type {
        0 => Err("cannot be deleted: it is declared".to_owned()),
        other => Value::from_message(value).ok_or_else(|| format!("cannot be set: {other} is no type of a parameter")),
    }
}
