//! Nodes against the wall clock, over real DDS.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

use crate::common::{participant, wait_until};
use feeder_runtime::dds::{Domain, Participant, Qos, Reader};
use feeder_runtime::launch::run_real;
use feeder_runtime::node::{
    ActionClient, ActionClientPorts, ActionServer, ActionServerPorts, CallId, Client, ClientEvent, Declare, FeederNode,
    GoalEnd, GoalId, NodeError, Publisher, Server, ServerEvent, StepIo, Subscriber, ns_of_stamp,
};
use feeder_runtime::testing::TestDomain;
use minifactory_msgs::Message;
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::interface::{ActionSpec, Namespace, ServiceSpec, TopicSpec, User};
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse};

const TICK: Duration = Duration::from_millis(10);
const TICK_NS: u64 = 10_000_000;
const PATIENCE: Duration = Duration::from_secs(20);

/// What a node of these tests reports to its test.
#[derive(Clone, Default, schemars::JsonSchema)]
struct Notes(#[schemars(with = "()")] Arc<Mutex<Vec<String>>>);

impl serde::Serialize for Notes {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_unit()
    }
}

/// Nodes are configured with the notes themselves.
impl<'de> serde::Deserialize<'de> for Notes {
    fn deserialize<D: serde::Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
        Ok(Self::default())
    }
}

impl Notes {
    fn add(&self, note: impl Into<String>) {
        self.0.lock().unwrap().push(note.into());
    }

    fn has(&self, note: &str) -> bool {
        self.0.lock().unwrap().iter().any(|noted| noted == note)
    }
}

/// Says the time in every step and its birth once, serves a switch and an action.
struct Serving {
    time: Publisher<Header>,
    born: Publisher<Header>,
    switch: Server<SetBool>,
    deliver: ActionServer<DeliverPart>,
    running: Option<(GoalId, u64)>,
}

struct ServingPorts {
    time: Publisher<Header>,
    born: Publisher<Header>,
    switch: Server<SetBool>,
    deliver: ActionServerPorts<DeliverPart>,
}

const SERVING: &[&str] = &["serving"];
const OWN: Namespace = Namespace::Own("");
const TIME: TopicSpec<Header> =
    TopicSpec::new(OWN, "time", Qos::command()).between(SERVING, &[User::Forward("asking")], "");
const BORN: TopicSpec<Header> =
    TopicSpec::new(OWN, "born", Qos::latched()).between(SERVING, &[User::Forward("asking")], "");
const SWITCH: ServiceSpec<SetBool> = ServiceSpec::new(OWN, "switch").between(SERVING, &[User::Feedback("asking")], "");
const MISSING: ServiceSpec<SetBool> =
    ServiceSpec::new(OWN, "missing").between(SERVING, &[User::Feedback("asking")], "");
const DELIVER: ActionSpec<DeliverPart> =
    ActionSpec::new(OWN, "deliver").between(SERVING, &[User::Feedback("asking")], "");

impl FeederNode for Serving {
    const NAME: &'static str = "serving";
    type Config = Notes;
    type Ports = ServingPorts;

    fn tick(_: &Notes) -> Duration {
        TICK
    }

    fn declare(io: &mut Declare, _: &Notes) -> ServingPorts {
        ServingPorts {
            time: io.publisher(&TIME),
            born: io.publisher(&BORN),
            switch: io.server(&SWITCH),
            deliver: io.action_server(&DELIVER),
        }
    }

    fn open(ports: ServingPorts, _: &Notes) -> Result<Self, NodeError> {
        let ServingPorts { time, born, switch, deliver } = ports;
        Ok(Self { time, born, switch, deliver: ActionServer::new(deliver), running: None })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        if io.tick() == 0 {
            io.publish(&self.born, &io.header("born"));
        }
        io.publish(&self.time, &io.header(&io.tick().to_string()));
        for (asker, request) in io.requests(&self.switch) {
            let message = if request.data { "on" } else { "off" }.into();
            io.reply(&self.switch, asker, &SetBoolResponse { success: true, message });
        }
        for event in self.deliver.poll(io) {
            if let ServerEvent::Requested(request) = event {
                self.running = Some((request.id, io.tick() + 20));
                self.deliver.accept(io, request);
            }
        }
        if let Some((id, ends)) = self.running {
            if io.tick() < ends {
                self.deliver.feedback(io, id, DeliverPartFeedback { eta_s: 0.5, ..Default::default() });
            } else {
                self.running = None;
                self.deliver.finish(
                    io,
                    id,
                    GoalEnd::Succeeded,
                    DeliverPartResult { reason: "there".into(), ..Default::default() },
                );
            }
        }
        Ok(())
    }
}

/// Hears the time and the birth, throws the switch, also one that nobody has, and has a part delivered.
struct Asking {
    ports: AskingPorts,
    deliver: ActionClient<DeliverPart>,
    missing: Option<CallId>,
    notes: Notes,
}

struct AskingPorts {
    time: Subscriber<Header>,
    born: Subscriber<Header>,
    switch: Client<SetBool>,
    missing: Client<SetBool>,
    deliver: Option<ActionClientPorts<DeliverPart>>,
}

impl FeederNode for Asking {
    const NAME: &'static str = "asking";
    type Config = Notes;
    type Ports = AskingPorts;

    fn tick(_: &Notes) -> Duration {
        TICK
    }

    fn declare(io: &mut Declare, _: &Notes) -> AskingPorts {
        AskingPorts {
            time: io.subscriber(&TIME),
            born: io.subscriber(&BORN),
            switch: io.client(&SWITCH),
            missing: io.client(&MISSING),
            deliver: Some(io.action_client(&DELIVER)),
        }
    }

    fn open(mut ports: AskingPorts, notes: &Notes) -> Result<Self, NodeError> {
        let deliver = ports.deliver.take().ok_or_else(|| NodeError::new("declared above"))?;
        Ok(Self { ports, deliver: ActionClient::new(deliver), missing: None, notes: notes.clone() })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        if io.tick() == 0 {
            io.call(&self.ports.switch, &SetBoolRequest { data: true });
            self.missing = Some(io.call(&self.ports.missing, &SetBoolRequest { data: true }));
            self.deliver.send(io, GoalId([7; 16]), DeliverPartGoal::default());
        }
        for message in io.take(&self.ports.born) {
            self.notes.add(message.frame_id);
        }
        if !io.take(&self.ports.time).is_empty() {
            self.notes.add("time");
        }
        for (_, response) in io.replies(&self.ports.switch) {
            self.notes.add(response.message);
        }
        for (call, _) in io.replies(&self.ports.missing) {
            self.notes.add(format!("{call:?} came from nobody"));
        }
        for event in self.deliver.poll(io) {
            self.notes.add(match event {
                ClientEvent::Accepted(_) => "accepted".into(),
                ClientEvent::Rejected(_) => "rejected".into(),
                ClientEvent::Feedback(_, feedback) => format!("feedback {}", feedback.eta_s),
                ClientEvent::Finished(_, end, result) => format!("{end:?} {}", result.reason),
                ClientEvent::Lost(_) => "lost".into(),
            });
        }
        Ok(())
    }
}

/// Runs a node in a thread until dropped.
struct Running {
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<Result<(), String>>>,
}

impl Running {
    fn start<N: FeederNode<Config = Notes>>(domain: &Domain, notes: &Notes) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (domain, notes, stopped) = (*domain, notes.clone(), stop.clone());
        let run = move || run_real::<N>(&domain, "/test", &notes, &stopped).map_err(|error| error.to_string());
        Self { stop, thread: Some(std::thread::spawn(run)) }
    }

    fn stop(mut self) -> Result<(), String> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().map_or(Ok(()), |thread| thread.join().unwrap())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn hear<M: Message>(participant: &Participant, topic: &str, qos: Qos) -> (Reader, Receiver<M>) {
    let (sender, heard) = channel();
    let reader = participant.reader(topic, &M::INFO.dds_type(), &qos, move |sample| {
        let _ = sender.send(sample.decode().unwrap());
    });
    (reader.unwrap(), heard)
}

#[test]
fn stamps_are_wall_time_a_tick_apart() {
    let domain = TestDomain::claim();
    let before = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    let node = Running::start::<Serving>(&domain, &Notes::default());
    let listening = participant(&domain, "listening");
    let (_reader, heard) = hear::<Header>(&listening, "/test/time", Qos::command());
    let headers: Vec<Header> = (0..50).map(|_| heard.recv_timeout(PATIENCE).unwrap()).collect();
    let after = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    for pair in headers.windows(2) {
        let ticks = [0, 1].map(|index: usize| pair[index].frame_id.parse::<u64>().unwrap());
        assert_eq!(ticks[1], ticks[0] + 1, "none is lost");
        let step_ns = ns_of_stamp(&pair[1].stamp) - ns_of_stamp(&pair[0].stamp);
        // A machine that stands still for a while makes the node skip, never hurry.
        assert!(step_ns >= TICK_NS, "{step_ns} ns");
    }
    for header in headers {
        let stamp = Duration::from_nanos(ns_of_stamp(&header.stamp));
        assert!(before <= stamp && stamp <= after, "{stamp:?} is not between {before:?} and {after:?}");
    }
    node.stop().unwrap();
}

#[test]
fn nodes_hear_serve_and_call_each_other_and_one_that_is_late_gets_what_is_latched() {
    let domain = TestDomain::claim();
    let serving = Running::start::<Serving>(&domain, &Notes::default());
    let listening = participant(&domain, "listening");
    let (_reader, heard) = hear::<Header>(&listening, "/test/time", Qos::command());
    heard.recv_timeout(PATIENCE).unwrap();
    let notes = Notes::default();
    let asking = Running::start::<Asking>(&domain, &notes);
    for note in ["born", "time", "on", "accepted", "feedback 0.5", "Some(Succeeded) there"] {
        wait_until(note, || notes.has(note));
    }
    assert!(!notes.0.lock().unwrap().iter().any(|note| note.contains("nobody")));
    asking.stop().unwrap();
    serving.stop().unwrap();
}

#[test]
fn clients_anywhere_on_the_graph_are_answered() {
    let domain = TestDomain::claim();
    let serving = Running::start::<Serving>(&domain, &Notes::default());
    let asking = participant(&domain, "anybody");
    let client = asking.service_client::<SetBool>("/test/switch").unwrap();
    for (data, message) in [(true, "on"), (false, "off")] {
        let answer = client.call(&SetBoolRequest { data }, PATIENCE).wait().unwrap();
        assert_eq!((answer.success, answer.message.as_str()), (true, message));
    }
    serving.stop().unwrap();
}
