//! Carries out what viewers ask for, by the services that any client would call.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use feeder_model::waveform::{Segment, Waveform};
use feeder_runtime::dds::{DdsError, Participant, Reader};
use feeder_runtime::parameters::Value as ParameterValue;
use feeder_runtime::service::{ServiceClient, ServiceError};
use feeder_wire::deliver_part::{PartWanted, from_result, to_goal};
use feeder_wire::services;
use minifactory_msgs::Action;
use minifactory_msgs::action::DeliverPart;
use minifactory_msgs::action_msgs::srv::{CancelGoal, CancelGoalRequest};
use minifactory_msgs::interface::{Qos, ServiceSpec, simulation};
use minifactory_msgs::msg;
use minifactory_msgs::rcl_interfaces::msg::Parameter;
use minifactory_msgs::rcl_interfaces::srv::{GetParameters, GetParametersRequest, SetParameters, SetParametersRequest};
use minifactory_msgs::rosbag2_interfaces::srv::{GetRate, IsPaused, Pause, PlayNext, Resume, SetRate, SetRateRequest};
use minifactory_msgs::simulation_interfaces::srv::{
    GetSimulationState, ResetSimulation, ResetSimulationRequest, SetSimulationState, SetSimulationStateRequest,
    StepSimulation, StepSimulationRequest,
};
use minifactory_msgs::simulation_interfaces::{self, msg::SimulationState};
use minifactory_msgs::srv::{
    LoadParts, LoadPartsRequest, ReportHandover, ReportHandoverRequest, SetWaveform, SetWaveformRequest,
};
use minifactory_msgs::std_srvs::srv::{SetBool, SetBoolRequest, Trigger, TriggerResponse};
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::{Message, Service};
use serde_json::{Map, Value, json};

use crate::Shared;
use crate::description::{Description, Source};
use crate::events::{Event, Level};

/// How long a service may take, wall time. Many answer within simulated time only, which may pass slowly.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long a delivery may take, wall time.
const DELIVERY_PATIENCE: Duration = Duration::from_secs(24 * 3600);
/// How long to wait before a reset that comes at the wrong moment is asked for again.
const RETRY: Duration = Duration::from_millis(50);
/// The clock of a run, and the player of a bag.
const CLOCK: &str = "/feeder_up";
const PLAYER: &str = "/rosbag2_player";

type SendGoal = <DeliverPart as Action>::SendGoal;
type GetResult = <DeliverPart as Action>::GetResult;
type GoalFeedback = <DeliverPart as Action>::FeedbackMessage;

/// Clients of what every feeder serves.
struct FeederClients {
    load_parts: ServiceClient<LoadParts>,
    set_feeding: ServiceClient<SetBool>,
    set_waveform: ServiceClient<SetWaveform>,
    emergency_stop: ServiceClient<Trigger>,
    reset_fault: ServiceClient<Trigger>,
    reset_planner: ServiceClient<Trigger>,
    report_hand_over: ServiceClient<ReportHandover>,
    send_goal: ServiceClient<SendGoal>,
    get_result: ServiceClient<GetResult>,
    cancel_goal: ServiceClient<CancelGoal>,
    /// The delivery that was asked for here last.
    asked: Arc<Mutex<Asked>>,
    _feedback: Reader,
}

/// A delivery that was asked for here.
#[derive(Default)]
struct Asked {
    goal: Option<UUID>,
    /// What the planner calls it, once it says so.
    delivery_id: Option<String>,
    /// Reports on it so far.
    reports: u32,
}

fn lock(asked: &Mutex<Asked>) -> MutexGuard<'_, Asked> {
    asked.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Clients of everything that can be asked for.
pub(crate) struct Clients {
    set_parameters: ServiceClient<SetParameters>,
    get_parameters: ServiceClient<GetParameters>,
    step: ServiceClient<StepSimulation>,
    reset: ServiceClient<ResetSimulation>,
    get_state: ServiceClient<GetSimulationState>,
    set_state: ServiceClient<SetSimulationState>,
    pause: ServiceClient<Pause>,
    resume: ServiceClient<Resume>,
    is_paused: ServiceClient<IsPaused>,
    set_rate: ServiceClient<SetRate>,
    get_rate: ServiceClient<GetRate>,
    play_next: ServiceClient<PlayNext>,
    feeders: Vec<FeederClients>,
}

impl Clients {
    /// Makes them all; what they call may come and go.
    ///
    /// # Errors
    /// When DDS refuses a client.
    pub(crate) fn open(participant: &Participant, cell: &Description) -> Result<Self, DdsError> {
        fn of<S: Service>(participant: &Participant, node: &str, name: &str) -> Result<ServiceClient<S>, DdsError> {
            participant.service_client::<S>(&format!("{node}/{name}"))
        }
        let feeders = cell.feeders.iter().map(|feeder| FeederClients::open(participant, &feeder.namespace));
        Ok(Self {
            set_parameters: of(participant, CLOCK, "set_parameters")?,
            get_parameters: of(participant, CLOCK, "get_parameters")?,
            step: participant.service_client(&simulation::STEP_SIMULATION.name_in(""))?,
            reset: participant.service_client(&simulation::RESET_SIMULATION.name_in(""))?,
            get_state: participant.service_client(&simulation::GET_SIMULATION_STATE.name_in(""))?,
            set_state: participant.service_client(&simulation::SET_SIMULATION_STATE.name_in(""))?,
            pause: of(participant, PLAYER, "pause")?,
            resume: of(participant, PLAYER, "resume")?,
            is_paused: of(participant, PLAYER, "is_paused")?,
            set_rate: of(participant, PLAYER, "set_rate")?,
            get_rate: of(participant, PLAYER, "get_rate")?,
            play_next: of(participant, PLAYER, "play_next")?,
            feeders: feeders.collect::<Result<_, _>>()?,
        })
    }

    /// How fast time passes at most, nothing for no limit, and whether it is paused; nothing where nobody says.
    pub(crate) async fn pace(&self, source: Source) -> Option<(Option<f64>, bool)> {
        if source == Source::Bag {
            let paused = answer(&self.is_paused, &Default::default()).await.ok()?.paused;
            let rate = answer(&self.get_rate, &Default::default()).await.ok()?.rate;
            return Some((Some(rate), paused));
        }
        let names = vec!["speed".to_owned(), "paused".to_owned()];
        let values = answer(&self.get_parameters, &GetParametersRequest { names }).await.ok()?.values;
        let mut values = values.into_iter().map(ParameterValue::from_message);
        let (Some(Some(ParameterValue::Double(speed))), Some(Some(ParameterValue::Bool(paused)))) =
            (values.next(), values.next())
        else {
            return None;
        };
        Some((Some(speed).filter(|speed| *speed > 0.0), paused))
    }

    /// Whether somebody can be asked for the pace.
    pub(crate) fn has_clock(&self, source: Source) -> bool {
        if source == Source::Bag { self.is_paused.is_available() } else { self.get_parameters.is_available() }
    }

    /// Whether a bag is being played on this graph.
    pub(crate) fn has_player(&self) -> bool {
        self.is_paused.is_available()
    }

    async fn set(&self, name: &str, value: ParameterValue) -> Result<(), String> {
        let parameters = vec![Parameter { name: name.to_owned(), value: value.to_message() }];
        let results = answer(&self.set_parameters, &SetParametersRequest { parameters }).await?.results;
        match results.into_iter().next() {
            Some(result) if result.successful => Ok(()),
            Some(result) => Err(result.reason),
            None => Err(format!("{CLOCK} has not said whether {name} is set")),
        }
    }
}

impl FeederClients {
    fn open(participant: &Participant, namespace: &str) -> Result<Self, DdsError> {
        fn of<S: Service>(
            participant: &Participant,
            namespace: &str,
            service: &ServiceSpec<S>,
        ) -> Result<ServiceClient<S>, DdsError> {
            participant.service_client::<S>(&service.name_in(namespace))
        }
        let action = format!("{}/_action", services::DELIVER_PART.name_in(namespace));
        let asked = Arc::new(Mutex::new(Asked::default()));
        let feedback = {
            let asked = Arc::clone(&asked);
            let dds_type = <GoalFeedback as Message>::INFO.dds_type();
            participant.reader(&format!("{action}/feedback"), &dds_type, &Qos::command(), move |sample| {
                let Ok(message) = sample.decode::<GoalFeedback>() else { return };
                let (goal, feedback) = message.into();
                let mut asked = lock(&asked);
                if asked.goal.as_ref() == Some(&goal) {
                    asked.delivery_id = Some(feedback.delivery_id);
                }
            })?
        };
        Ok(Self {
            load_parts: of(participant, namespace, &services::LOAD_PARTS)?,
            set_feeding: of(participant, namespace, &services::SET_FEEDING)?,
            set_waveform: of(participant, namespace, &services::SET_WAVEFORM)?,
            emergency_stop: of(participant, namespace, &services::EMERGENCY_STOP)?,
            reset_fault: of(participant, namespace, &services::RESET_FAULT)?,
            reset_planner: of(participant, namespace, &services::RESET)?,
            report_hand_over: of(participant, namespace, &services::REPORT_HANDOVER)?,
            send_goal: participant.service_client(&format!("{action}/send_goal"))?,
            get_result: participant.service_client(&format!("{action}/get_result"))?,
            cancel_goal: participant.service_client(&format!("{action}/cancel_goal"))?,
            asked,
            _feedback: feedback,
        })
    }

    async fn report(&self, report: u8) -> Result<(), String> {
        let (delivery_id, sequence) = {
            let mut asked = lock(&self.asked);
            let delivery_id = asked.delivery_id.clone().ok_or("no delivery that was asked for here is under way")?;
            asked.reports += 1;
            (delivery_id, asked.reports)
        };
        let request =
            ReportHandoverRequest { delivery_id, sequence, report, message: "reported on the view".to_owned() };
        let reply = answer(&self.report_hand_over, &request).await?;
        if reply.accepted { Ok(()) } else { Err(reply.message) }
    }
}

async fn answer<S: Service>(client: &ServiceClient<S>, request: &S::Request) -> Result<S::Response, String> {
    client.call(request, PATIENCE).await.map_err(|error: ServiceError| error.to_string())
}

async fn trigger(client: &ServiceClient<Trigger>) -> Result<(), String> {
    let TriggerResponse { success, message } = answer(client, &Default::default()).await?;
    if success { Ok(()) } else { Err(message) }
}

/// What a service of the simulation says of how it went.
fn done(result: simulation_interfaces::msg::Result) -> Result<(), String> {
    if result.result == simulation_interfaces::msg::Result::RESULT_OK { Ok(()) } else { Err(result.error_message) }
}

/// Starts the run again: one that stands still comes back so, another as soon as no part is on its way to a station.
async fn reset(clients: &Clients) -> Result<(), String> {
    let state = answer(&clients.get_state, &Default::default()).await?.state.state;
    if state == SimulationState::STATE_PAUSED {
        let state = SimulationState { state: SimulationState::STATE_STOPPED };
        return done(answer(&clients.set_state, &SetSimulationStateRequest { state }).await?.result);
    }
    let since = Instant::now();
    loop {
        let result = answer(&clients.reset, &ResetSimulationRequest::default()).await?.result;
        let is_to_wait = result.result == simulation_interfaces::msg::Result::RESULT_INCORRECT_STATE;
        if !is_to_wait || since.elapsed() > PATIENCE {
            return done(result);
        }
        tokio::time::sleep(RETRY).await;
        if answer(&clients.get_state, &Default::default()).await?.state.state != SimulationState::STATE_PLAYING {
            // Somebody else has started it again.
            return Ok(());
        }
    }
}

fn number(arguments: &Map<String, Value>, name: &str) -> f64 {
    arguments.get(name).and_then(Value::as_f64).unwrap_or_default()
}

fn whole(arguments: &Map<String, Value>, name: &str) -> u32 {
    arguments.get(name).and_then(Value::as_u64).and_then(|value| value.try_into().ok()).unwrap_or_default()
}

fn flag(arguments: &Map<String, Value>, name: &str) -> bool {
    arguments.get(name).and_then(Value::as_bool).unwrap_or_default()
}

fn text(arguments: &Map<String, Value>, name: &str) -> String {
    arguments.get(name).and_then(Value::as_str).unwrap_or_default().to_owned()
}

/// Does what a control says; `arguments` have been checked. What comes back beside success is for the viewer.
pub(crate) async fn perform(
    shared: &Arc<Shared>,
    source: Source,
    control: &'static str,
    feeder: usize,
    arguments: &Map<String, Value>,
) -> Result<Value, String> {
    let clients = &shared.clients;
    let here = &clients.feeders[feeder];
    if source == Source::Bag {
        return play(clients, control, arguments).await.map(|()| Value::Null);
    }
    match control {
        "pause" => clients.set("paused", ParameterValue::Bool(true)).await?,
        "resume" => clients.set("paused", ParameterValue::Bool(false)).await?,
        "step" => {
            let steps = whole(arguments, "ticks").into();
            done(answer(&clients.step, &StepSimulationRequest { steps }).await?.result)?;
        }
        "reset" => reset(clients).await?,
        "speed" => clients.set("speed", ParameterValue::Double(number(arguments, "speed"))).await?,
        "full_speed" => clients.set("speed", ParameterValue::Double(0.0)).await?,
        "load_parts" => {
            let count = whole(arguments, "count");
            let reply = answer(&here.load_parts, &LoadPartsRequest { count }).await?;
            if reply.loaded < count {
                return Err(format!("{} of {count} loaded: {}", reply.loaded, reply.message));
            }
        }
        "set_feeding" => {
            let reply = answer(&here.set_feeding, &SetBoolRequest { data: flag(arguments, "enabled") }).await?;
            if !reply.success {
                return Err(reply.message);
            }
        }
        "set_waveform" => set_waveform(shared, feeder, arguments).await?,
        "emergency_stop" => trigger(&here.emergency_stop).await?,
        "reset_fault" => trigger(&here.reset_fault).await?,
        "reset_planner" => trigger(&here.reset_planner).await?,
        "deliver" => deliver(shared, feeder, arguments).await?,
        "hand_over" => {
            let report =
                if flag(arguments, "taken") { ReportHandoverRequest::TAKEN } else { ReportHandoverRequest::NOT_TAKEN };
            here.report(report).await?;
            here.report(ReportHandoverRequest::RELEASED).await?;
        }
        "cancel" => {
            let goal = lock(&here.asked).goal.ok_or("no delivery was asked for here")?;
            let mut request = CancelGoalRequest::default();
            request.goal_info.goal_id = goal;
            let reply = answer(&here.cancel_goal, &request).await?;
            if reply.goals_canceling.is_empty() {
                return Err("the delivery has ended already".to_owned());
            }
        }
        unknown => return Err(format!("{unknown:?} is no control")),
    }
    Ok(Value::Null)
}

/// What the player of a bag does.
async fn play(clients: &Clients, control: &str, arguments: &Map<String, Value>) -> Result<(), String> {
    let done = |success: bool| if success { Ok(()) } else { Err("the player refuses".to_owned()) };
    match control {
        "pause" => answer(&clients.pause, &Default::default()).await.map(|_| ()),
        "resume" => answer(&clients.resume, &Default::default()).await.map(|_| ()),
        "step" => {
            for _ in 0..whole(arguments, "ticks") {
                done(answer(&clients.play_next, &Default::default()).await?.success)?;
            }
            Ok(())
        }
        "speed" => {
            let rate = number(arguments, "speed");
            done(answer(&clients.set_rate, &SetRateRequest { rate }).await?.success)
        }
        _ => Err("a bag is played: what was done cannot be changed".to_owned()),
    }
}

/// The waveform of the run's beginning, scaled and stretched in time.
fn changed(waveform: &Waveform, scale: f64, period_s: Option<f64>) -> Result<Waveform, String> {
    let stretch = period_s.map_or(1.0, |period_s| period_s / waveform.period_s());
    let segments = waveform.segments().iter();
    let segments = segments.map(|segment| Segment { duration_s: segment.duration_s * stretch, ..*segment }).collect();
    let stretched = Waveform::new(waveform.axis(), segments).map_err(|error| error.to_string())?;
    stretched.scaled(scale).map_err(|error| error.to_string())
}

async fn set_waveform(shared: &Shared, feeder: usize, arguments: &Map<String, Value>) -> Result<(), String> {
    let (described, heard) = (&shared.cell.feeders[feeder], &shared.heard.feeders[feeder]);
    let period_s = arguments.get("period_s").and_then(Value::as_f64);
    let waveform = changed(&described.waveform, number(arguments, "scale"), period_s)?;
    described.envelope.check(&waveform).map_err(|error| error.to_string())?;
    let now = heard.waveform.latest();
    let waveform = msg::Waveform {
        name: now.as_ref().map(|now| now.name.clone()).unwrap_or_default(),
        // As it is: whether feeding is on is another control.
        enabled: now.is_some_and(|now| now.enabled),
        ..feeder_wire::waveform::to_message(&waveform)
    };
    let reply = answer(&shared.clients.feeders[feeder].set_waveform, &SetWaveformRequest { waveform }).await?;
    if reply.accepted { Ok(()) } else { Err(reply.message) }
}

/// Asks for a delivery. How it ends becomes an event.
async fn deliver(shared: &Arc<Shared>, feeder: usize, arguments: &Map<String, Value>) -> Result<(), String> {
    let stated = |text: String| Some(text).filter(|text| !text.is_empty());
    let timeout_s = number(arguments, "timeout_s");
    let wanted = PartWanted {
        station: text(arguments, "station"),
        part_class: None,
        pose_class: stated(text(arguments, "pose_class")),
        tolerance_m: number(arguments, "tolerance_m"),
        part_gap_m_min: None,
        timeout: Some(Duration::from_secs_f64(timeout_s)).filter(|timeout| !timeout.is_zero()),
    };
    let goal = UUID { uuid: rand::random() };
    let here = &shared.clients.feeders[feeder];
    *lock(&here.asked) = Asked { goal: Some(goal), ..Asked::default() };
    let (accepted, _) = answer(&here.send_goal, &(goal, to_goal(&wanted)).into()).await?.into();
    if !accepted {
        return Err("the planner does not take the delivery: its log says why".to_owned());
    }
    let shared = Arc::clone(shared);
    tokio::spawn(async move {
        let here = &shared.clients.feeders[feeder];
        let reply = here.get_result.call(&goal.into(), DELIVERY_PATIENCE).await;
        let (level, message, delivery_id) = match reply.map(|reply| from_result(Into::<(i8, _)>::into(reply).1)) {
            Ok(Ok(end)) if end.reason.is_empty() => (Level::Info, format!("{:?}", end.outcome), Some(end.delivery_id)),
            Ok(Ok(end)) => (Level::Warn, format!("{:?}: {}", end.outcome, end.reason), Some(end.delivery_id)),
            Ok(Err(error)) => (Level::Warn, error.to_string(), None),
            Err(error) => (Level::Warn, error.to_string(), None),
        };
        let name = &shared.cell.feeders[feeder].name;
        let station = Some(wanted.station);
        shared.events.add(Event { delivery_id, station, ..Event::new("asked", level, None, message).of(name) });
    });
    Ok(())
}

/// A control and its arguments, for people.
pub(crate) fn in_words(control: &str, arguments: &Map<String, Value>) -> String {
    let arguments = arguments.iter().map(|(name, value)| format!(" {name} {value}"));
    format!("{control}{}", arguments.collect::<String>())
}

/// The reply to a control.
pub(crate) fn reply(id: u64, outcome: &Result<Value, String>) -> Value {
    json!({ "type": "reply", "id": id, "ok": outcome.is_ok(), "message": outcome.as_ref().err() })
}
