//! An agent of one's own: asks a feeder for parts and takes them, over the ROS graph and outside the run's loop.
//!
//! `cargo run --package overhead_manipulator --example own_agent`, in the domain that the environment names, beside a
//! run whose `station_1` is `external`.

use std::error::Error;
use std::sync::mpsc::channel;
use std::time::{Duration, SystemTime};

use feeder_runtime::dds::{Domain, NodeName, Participant};
use feeder_wire::topics::FACTSHEET;
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::geometry_msgs::msg::{Pose, Quaternion};
use minifactory_msgs::interface::Qos;
use minifactory_msgs::msg::{DeliveryState, Factsheet};
use minifactory_msgs::srv::{Pick, PickRequest, ReportHandover, ReportHandoverRequest};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::{Action, Message, Service};

const STATION: &str = "station_1";
const PARTS: usize = 3;
/// How long anything may take, wall time.
const PATIENCE: Duration = Duration::from_secs(60);

type FeedbackMessage = <DeliverPart as Action>::FeedbackMessage;

fn main() -> Result<(), Box<dyn Error>> {
    let here = Participant::open(&Domain::from_env()?, &NodeName::new("/", "own_agent")?)?;
    let (tell, facts) = channel();
    let _facts = here.topic_reader(&FACTSHEET, "/feeder", move |sample| {
        // What cannot be read is no factsheet of the version that this agent was built with.
        if let Ok(facts) = sample.decode::<Factsheet>() {
            let _ = tell.send(facts);
        }
    })?;
    let facts = facts.recv_timeout(PATIENCE)?;
    if !facts.protocol_version.starts_with("3.") {
        return Err(format!("the feeder speaks version {}, this agent 3", facts.protocol_version).into());
    }
    let station = facts.stations.iter().find(|station| station.name == STATION);
    let tool = station.ok_or("the feeder does not serve this station")?.tool_in_platen;
    for _ in 0..PARTS {
        println!("{}", take_part(&here, &facts, &Pose { position: tool, orientation: UPRIGHT })?);
    }
    Ok(())
}

const UPRIGHT: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

/// One delivery: asks, waits until the part is presented, grips, reports, and gives how it ended.
fn take_part(here: &Participant, facts: &Factsheet, tool: &Pose) -> Result<String, Box<dyn Error>> {
    let (tell, heard) = channel();
    let topic = "/feeder/deliver_part/_action/feedback";
    let _feedback = here.reader(topic, &FeedbackMessage::INFO.dds_type(), &Qos::command(), move |sample| {
        if let Ok(message) = sample.decode::<FeedbackMessage>() {
            let _ = tell.send(message);
        }
    })?;
    // The wall clock in ns tells this client's goals apart.
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
    let id = UUID { uuid: now.as_nanos().to_le_bytes() };
    let goal = DeliverPartGoal {
        station: STATION.to_owned(),
        tolerance_m: facts.tolerance_m_min.max(0.0005),
        timeout_s: 60.0,
        ..DeliverPartGoal::default()
    };
    let request = (id, goal).into();
    let answer = call::<<DeliverPart as Action>::SendGoal>(here, "/feeder/deliver_part/_action/send_goal", &request)?;
    let (accepted, _) = answer.into();
    if !accepted {
        return Err("the goal was rejected".into());
    }
    let delivery_id = loop {
        let (of, feedback): (UUID, DeliverPartFeedback) = heard.recv_timeout(PATIENCE)?.into();
        if of == id && feedback.phase == DeliveryState::PRESENTED {
            break feedback.delivery_id;
        }
    };
    // In simulation this service is the gripper. With one feeder it lies in the station's namespace.
    let grip = PickRequest { station: STATION.to_owned(), tool_in_platen: *tool, gripper_opening_m: 0.01 };
    let grip = call::<Pick>(here, &format!("/{STATION}/pick"), &grip)?;
    let taken = if grip.picked { ReportHandoverRequest::TAKEN } else { ReportHandoverRequest::NOT_TAKEN };
    for (sequence, report) in [(1, taken), (2, ReportHandoverRequest::RELEASED)] {
        let (delivery_id, message) = (delivery_id.clone(), grip.message.clone());
        let report = ReportHandoverRequest { delivery_id, sequence, report, message };
        let answer = call::<ReportHandover>(here, "/feeder/report_handover", &report)?;
        if !answer.accepted {
            return Err(answer.message.into());
        }
    }
    let result = "/feeder/deliver_part/_action/get_result";
    let (status, result): (i8, DeliverPartResult) =
        call::<<DeliverPart as Action>::GetResult>(here, result, &id.into())?.into();
    Ok(format!("{delivery_id}: status {status}, outcome {}, {}", result.outcome, result.part_id))
}

/// Calls a service and waits for its answer.
fn call<S: Service>(here: &Participant, name: &str, request: &S::Request) -> Result<S::Response, Box<dyn Error>> {
    Ok(here.service_client::<S>(name)?.call(request, PATIENCE).wait()?)
}
