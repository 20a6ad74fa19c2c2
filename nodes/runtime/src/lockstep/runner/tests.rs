//! Nodes in a loop: they report while they are slow or fail, and refuse a contract made for other ports.

use std::sync::mpsc::channel;

use minifactory_msgs::geometry_msgs::msg::Point;
use minifactory_msgs::interface::{EVERY_NODE, Namespace, ServiceSpec, TopicSpec, User};
use minifactory_msgs::std_srvs::srv::Trigger;

use super::*;
use crate::dds::Qos;
use crate::lockstep::LoopTiming;
use crate::node::Declare;

const TICK_NS: u64 = 10_000_000;

/// A node that dawdles in each step, or fails.
enum Toy {
    Quick,
    Slow,
    Failing,
}

#[derive(Clone, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
struct NoConfig {}

impl FeederNode for Toy {
    const NAME: &'static str = "toy";
    type Config = NoConfig;
    type Ports = ();

    fn tick(_: &NoConfig) -> Duration {
        Duration::from_nanos(TICK_NS)
    }

    fn declare(_: &mut Declare, _: &NoConfig) {}

    fn open((): (), _: &NoConfig) -> Result<Self, NodeError> {
        Ok(Self::Quick)
    }

    fn step(&mut self, _: &mut StepIo) -> Result<(), NodeError> {
        match self {
            Self::Quick => {}
            Self::Slow => std::thread::sleep(HEARTBEAT_PERIOD),
            Self::Failing => return Err(NodeError::new("out of order")),
        }
        Ok(())
    }
}

/// Keeps what is sent.
#[derive(Clone, Default)]
struct Kept(Arc<std::sync::Mutex<Vec<LoopStatus>>>);

impl Links for Kept {
    fn send_bundle(&mut self, _: usize, _: LoopBundle) -> Result<(), RunError> {
        Ok(())
    }

    fn send_status(&mut self, status: LoopStatus) -> Result<(), RunError> {
        self.0.lock().unwrap().push(status);
        Ok(())
    }
}

fn interface(declare: impl FnOnce(&mut Declare)) -> Interface {
    let mut io = Declare::new("toy", "/");
    declare(&mut io);
    io.finish().unwrap()
}

const ANY: &[User] = &[User::Forward(EVERY_NODE)];
const X: TopicSpec<Point> = TopicSpec::new(Namespace::Own(""), "x", Qos::command()).between(&[EVERY_NODE], ANY, "");
const GO: ServiceSpec<Trigger> = ServiceSpec::new(Namespace::Own(""), "go").between(&[EVERY_NODE], ANY, "");

fn publishes(io: &mut Declare) {
    io.publisher(&X);
}

fn subscribes(io: &mut Declare) {
    io.subscriber(&X);
}

fn contract(nodes: &[(String, Interface)]) -> LoopContract {
    let timing = LoopTiming { tick_ns: TICK_NS, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 40 };
    LoopContract::connect(7, timing, nodes).unwrap()
}

fn runner(contract: &LoopContract, interface: Interface, links: Kept) -> Result<Runner<Toy, Kept>, LoopError> {
    let digest = Digest::new(None, "/b", &[]);
    Runner::new(Toy::Quick, "/b".into(), interface, contract, links, None, digest)
}

/// A clock that hears nothing for a while takes a node for dead.
#[test]
fn regress_a_node_reports_also_while_its_steps_are_slow() {
    let alone = interface(publishes);
    let contract = contract(&[("/b".into(), alone.clone())]);
    let kept = Kept::default();
    let mut runner = runner(&contract, alone, kept.clone()).unwrap();
    runner.node = Toy::Slow;
    let (sender, inbox) = channel();
    // The window ends far behind the third step, and a quarter of it too.
    let grant = LoopGrant { run_id: 7, until_tick: 40, end_tick: 3, ended: false };
    sender.send(Incoming::Grant(grant)).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let clock = std::thread::spawn({
        let kept = kept.clone();
        move || {
            while kept.0.lock().unwrap().iter().all(|status| status.tick < 3) {
                std::thread::sleep(Duration::from_millis(1));
            }
            sender.send(Incoming::Grant(LoopGrant { ended: true, ..grant })).unwrap();
        }
    });
    runner.run(&inbox, &stop).unwrap();
    clock.join().unwrap();
    let statuses = kept.0.lock().unwrap();
    for tick in 1..=3 {
        assert!(statuses.iter().any(|status| status.tick == tick), "nothing was said after step {tick}");
    }
    let last = statuses.last().unwrap();
    assert!(last.finished && last.error.is_empty(), "{last:?}");
}

/// The first of them may be lost on the way, when the node has left before it was acknowledged.
#[test]
fn regress_a_failing_node_says_so_until_the_clock_has_heard() {
    let alone = interface(publishes);
    let contract = contract(&[("/b".into(), alone.clone())]);
    let kept = Kept::default();
    let mut runner = runner(&contract, alone, kept.clone()).unwrap();
    runner.node = Toy::Failing;
    let (sender, inbox) = channel();
    let grant = LoopGrant { run_id: 7, until_tick: 40, end_tick: 40, ended: false };
    sender.send(Incoming::Grant(grant)).unwrap();
    let clock = std::thread::spawn({
        let kept = kept.clone();
        move || {
            while kept.0.lock().unwrap().iter().filter(|status| status.finished).count() < 3 {
                std::thread::sleep(Duration::from_millis(1));
            }
            sender.send(Incoming::Grant(LoopGrant { ended: true, ..grant })).unwrap();
        }
    });
    let error = runner.run(&inbox, &Arc::new(AtomicBool::new(false))).unwrap_err();
    clock.join().unwrap();
    assert_eq!(error.to_string(), "out of order");
    let statuses = kept.0.lock().unwrap();
    let last_words: Vec<_> = statuses.iter().filter(|status| status.finished).collect();
    assert!(last_words.iter().all(|status| *status == last_words[0] && status.error == "out of order"), "{statuses:?}");
}

#[test]
fn a_contract_made_for_other_ports_is_refused() {
    let publisher = ("/a".to_owned(), interface(publishes));
    let contract = contract(&[publisher, ("/b".into(), interface(subscribes))]);
    let misfit = |name: &str| Some(LoopError::Misfit { node: "/b".into(), name: name.into() });
    let refused = |interface| runner(&contract, interface, Kept::default()).err();
    assert_eq!(refused(interface(subscribes)), None);
    assert_eq!(refused(Interface::default()), misfit("/x"));
    assert_eq!(refused(interface(publishes)), misfit("/x"));
    let both = interface(|io| {
        subscribes(io);
        io.client(&GO);
    });
    assert_eq!(refused(both), misfit("/go"));
    let serves_too = interface(|io| {
        subscribes(io);
        io.server(&GO);
    });
    assert_eq!(refused(serves_too), None, "a service without clients in the loop is no misfit");
}
